"""Bodies that go out in a file and come back: they move as the body that was written, on every kind of joint."""

from pathlib import Path

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.cache import Cache
from fmd.core.errors import AccuracyError, InputError
from fmd.output.formats import write_format

BEAM = """
[body.beam]
shape = "bar"
length = "340 mm"
depth = "25 mm"
width = "10 mm"
E = "722 MPa"
nu = 0.34
rho = "2000 kg/m^3"
mesh = { element = "hexahedron", order = 2, divisions = [8, 1, 1] }
modes = { count = 4, enrich = "none", damping = 0.02 }
marker = { root = { face = "x-" }, tip = { face = "x+" } }
"""
SIMULATION = """
[simulation]
duration = "50 ms"
output_step = "2 ms"
tip = "beam.tip"
gravity = ["0 m/s^2", "-9.81 m/s^2", "1 m/s^2"]
stiffening = "STIFFENING"
[[simulation.run]]
integrator = "runge-kutta"
tolerance = 1e-9
"""
JOINTS = {
    "hinge": 'type = "revolute"\naxis = [0, 0, 1]\nrate = "20 rad/s"',
    "ball": 'type = "spherical"\nspin = ["3 rad/s", "10 rad/s", "20 rad/s"]',
    "clamp": 'type = "fixed"',
    "free": 'type = "free"\nspin = ["3 rad/s", "10 rad/s", "20 rad/s"]',
}
NODES = {"sid": ("1", "2")} | dict.fromkeys(("mbdyn", "exudyn", "python"), ("root", "tip"))
SUFFIXES = {"sid": ".SID_FEM", "mbdyn": ".fem", "exudyn": ".npz", "python": ".nc"}


def scene_of(body: str, joint: str, stiffening: str, folder: Path, child: str = "root") -> Pipeline:
    hangs = f'[joint.hub]\nparent = "ground"\nchild = "beam.{child}"\n{JOINTS[joint]}\n' if joint else ""
    moves = SIMULATION.replace("STIFFENING", stiffening) if joint else ""
    path = folder / f"scene-{abs(hash((body, joint, stiffening, child)))}.toml"
    path.write_text(f'title = "t"\n{body}\n{hangs}\n{moves}')
    return Pipeline(load_scene(path), Cache(None))


def read_body(file: str, root: str, tip: str, more: str = "") -> str:
    marker = f'marker = {{ root = {{ node = "{root}" }}, tip = {{ node = "{tip}" }} }}'
    return f'[body.beam]\nbody = {{ file = "{file}" }}\n{marker}\n{more}\n'


@pytest.mark.slow
@pytest.mark.parametrize(
    ("to", "stiffening", "joint"),
    [
        *(("sid", "on", joint) for joint in JOINTS),
        *(("mbdyn", "off", joint) for joint in ("hinge", "ball")),
        ("sid", "off", "clamp"),
        ("exudyn", "off", "hinge"),
        ("python", "off", "free"),
    ],
)
def test_a_body_that_comes_back_has_the_same_equations(joint: str, to: str, stiffening: str, tmp_path: Path):
    """Frequencies, inertia, stiffening, damping and markers, of the body on its joint."""
    run = scene_of(BEAM, joint, stiffening, tmp_path)
    write_format(run, to, "beam", tmp_path / f"beam{SUFFIXES[to]}")
    back = scene_of(read_body(f"beam{SUFFIXES[to]}", *NODES[to]), joint, stiffening, tmp_path)
    ours, theirs = run.parts["beam"].for_any_motion(run.bodies["beam"]), back.bodies["beam"]
    turn = np.sign(np.einsum("ij,ij->j", *(body.markers["tip"].translation for body in (ours, theirs))))
    p = np.r_[1.0, turn]
    scale = np.abs(ours.integrals.G).max()
    assert theirs.omega == pytest.approx(ours.omega, rel=1e-9)
    assert np.abs(theirs.integrals.G * np.outer(p, p) - ours.integrals.G).max() < 1e-9 * scale
    assert theirs.damping == pytest.approx(np.full(4, 0.0 if to == "python" else 0.02), rel=1e-9)
    tip, want = theirs.markers["tip"], ours.markers["tip"]
    assert np.abs(tip.translation * turn - want.translation).max() < 1e-9 * np.abs(want.translation).max()
    assert np.abs(tip.rotation * turn - want.rotation).max() < 1e-8 * np.abs(want.rotation).max()
    for form in ("displacement2", "rotation2"):  # a scene has those of the motions that it makes, a file has all
        given, found = getattr(ours.integrals, form), getattr(theirs.integrals, form)
        for axis in np.flatnonzero(np.abs(given).max(axis=(1, 2), initial=0.0)):
            allowed = max(1e-8 * np.abs(given).max(), 1e-20)  # on a ball there is none but by round-off
            assert np.abs(found[axis] * np.outer(turn, turn) - given[axis]).max() < allowed


@pytest.mark.slow
@pytest.mark.parametrize(("to", "stiffening"), [("sid", "on"), ("exudyn", "off")])
def test_it_moves_as_the_body_that_was_written(to: str, stiffening: str, tmp_path: Path):
    run = scene_of(BEAM, "hinge", stiffening, tmp_path)
    write_format(run, to, "beam", tmp_path / f"beam{SUFFIXES[to]}")
    back = scene_of(read_body(f"beam{SUFFIXES[to]}", *NODES[to]), "hinge", stiffening, tmp_path)
    ours, theirs = run.motion.tip_position, back.motion.tip_position
    path = np.linalg.norm(np.diff(ours, axis=0), axis=1).sum()
    assert path > 0.1
    assert np.abs(ours - theirs).max() < 1e-9 * path


def test_a_body_may_hang_elsewhere_than_where_it_was_written(tmp_path: Path):
    """Written free, it hangs on its other end as the mesh does whose free modes it has."""
    write_format(scene_of(BEAM, "", "", tmp_path), "mbdyn", "beam", tmp_path / "free.fem")
    for joint in ("clamp", "hinge"):
        ours = scene_of(BEAM, joint, "off", tmp_path, "tip").bodies["beam"]
        theirs = scene_of(read_body("free.fem", "root", "tip"), joint, "off", tmp_path, "tip").bodies["beam"]
        assert theirs.omega == pytest.approx(ours.omega, rel=1e-9)
        assert np.abs(theirs.integrals.S[:, 0] - ours.integrals.S[:, 0]).max() < 1e-12
        assert (
            np.abs(np.abs(theirs.integrals.S) - np.abs(ours.integrals.S)).max() < 1e-9 * np.abs(ours.integrals.S).max()
        )


@pytest.mark.parametrize("to", ["exudyn", "python"])
def test_stress_comes_back_where_the_file_has_it(to: str, tmp_path: Path):
    run = scene_of(BEAM, "clamp", "off", tmp_path)
    write_format(run, to, "beam", tmp_path / f"beam{SUFFIXES[to]}")
    back = scene_of(read_body(f"beam{SUFFIXES[to]}", "root", "tip"), "hinge", "off", tmp_path, "tip")
    ours, theirs = run.parts["beam"], back.parts["beam"]
    assert theirs.has_stress
    assert np.array_equal(theirs.surface.triangles, ours.surface.triangles)
    # Held elsewhere, the shapes are other combinations and move as a whole, too: the same deformation, the same stress.
    load = np.random.default_rng(0).standard_normal(4)
    shapes, others = ours.body.shapes[ours.surface.nodes], theirs.body.shapes[theirs.surface.nodes]
    turns = np.cross(np.eye(3), ours.body.x[ours.surface.nodes][:, None]).swapaxes(1, 2)
    both = np.concatenate([others, np.tile(np.eye(3), (len(shapes), 1, 1)), turns], axis=2).reshape(-1, 10)
    q = np.linalg.lstsq(both, (shapes @ load).ravel(), rcond=None)[0][:4]
    want = ours.surface_stress @ load
    assert np.abs(theirs.surface_stress @ q - want).max() < 1e-8 * np.abs(want).max()


def test_a_file_without_stress_has_no_pictures_of_it(tmp_path: Path):
    write_format(scene_of(BEAM, "clamp", "off", tmp_path), "mbdyn", "beam", tmp_path / "beam.fem")
    part = scene_of(read_body("beam.fem", "root", "tip"), "clamp", "off", tmp_path).parts["beam"]
    assert not part.has_stress
    with pytest.raises(InputError, match="is of no file with a surface's stress"):
        part.surface  # noqa: B018


def test_stiffening_of_a_file_stays_in_its_frame(tmp_path: Path):
    write_format(scene_of(BEAM, "clamp", "on", tmp_path), "sid", "beam", tmp_path / "beam.SID_FEM")
    with pytest.raises(InputError, match="holds geometric stiffening in its own frame, which the joint doesn't keep"):
        scene_of(read_body("beam.SID_FEM", "1", "2"), "clamp", "on", tmp_path, "tip").bodies  # noqa: B018


def test_stiffening_of_a_file_may_be_left_out(tmp_path: Path):
    """The body is as the unstiffened one, and so hangs anywhere; a file that tells the sum alone is refused."""
    write_format(scene_of(BEAM, "clamp", "on", tmp_path), "sid", "beam", tmp_path / "beam.SID_FEM")
    plain = scene_of(BEAM, "clamp", "off", tmp_path).bodies["beam"]
    back = scene_of(read_body("beam.SID_FEM", "1", "2"), "clamp", "off", tmp_path).bodies["beam"]
    assert np.abs(np.abs(back.integrals.G) - np.abs(plain.integrals.G)).max() < 1e-10 * np.abs(plain.integrals.G).max()
    assert not back.markers["tip"].displacement2.size
    elsewhere = scene_of(read_body("beam.SID_FEM", "1", "2"), "clamp", "off", tmp_path, "tip").bodies["beam"]
    want = scene_of(BEAM, "clamp", "off", tmp_path, "tip").bodies["beam"]
    assert elsewhere.omega == pytest.approx(want.omega, rel=1e-9)
    text = (tmp_path / "beam.SID_FEM").read_text()
    lines, inside = [], False
    for line in text.splitlines():
        inside = (inside or line.strip() == "Gr") and line.strip() != "end Gr"
        if not (inside and "m1(" in line):
            lines.append(line.replace("order = 1", "order = 0") if inside else line)
    (tmp_path / "sum.SID_FEM").write_text("\n".join(lines))
    with pytest.raises(InputError, match="can't be told apart from inertia in sum"):
        scene_of(read_body("sum.SID_FEM", "1", "2"), "clamp", "off", tmp_path).bodies  # noqa: B018


def test_damping_of_the_scene_goes_before_the_files(tmp_path: Path):
    write_format(scene_of(BEAM, "clamp", "off", tmp_path), "sid", "beam", tmp_path / "beam.SID_FEM")
    back = scene_of(read_body("beam.SID_FEM", "1", "2", "modes = { damping = 0.07 }"), "clamp", "off", tmp_path)
    assert back.mechanism.links[0].damping == pytest.approx(np.full(4, 0.07))
    back = scene_of(read_body("beam.SID_FEM", "1", "2"), "clamp", "off", tmp_path)
    assert back.mechanism.links[0].damping == pytest.approx(np.full(4, 0.02), rel=1e-9)


@pytest.mark.parametrize(
    ("file", "root", "message"),
    [
        ("none.SID_FEM", "1", "body.beam.body.file = 'none.SID_FEM': can't be read"),
        ("beam.sid", "1", "is no file of a reduced body that is read; these are: .nc .sid_fem .npz .fem"),
        ("beam.SID_FEM", "root", "body.beam.marker.root.node = 'root': no such node"),
    ],
)
def test_what_is_not_there_is_named(tmp_path: Path, file: str, root: str, message: str):
    write_format(scene_of(BEAM, "", "", tmp_path), "sid", "beam", tmp_path / "beam.SID_FEM")
    (tmp_path / "beam.sid").write_text("")
    with pytest.raises(InputError, match=message.replace(".", r"\.")):
        scene_of(read_body(file, root, "2"), "clamp", "off", tmp_path).bodies  # noqa: B018


def test_one_node_without_rotation_is_no_marker(tmp_path: Path):
    write_format(scene_of(BEAM, "", "", tmp_path), "exudyn", "beam", tmp_path / "beam.npz")
    with pytest.raises(InputError, match="doesn't tell the node's rotation: take three nodes"):
        scene_of(read_body("beam.npz", "0", "tip"), "clamp", "off", tmp_path).bodies  # noqa: B018


def test_shapes_that_depend_on_one_another_are_refused(tmp_path: Path):
    write_format(scene_of(BEAM, "", "", tmp_path), "exudyn", "beam", tmp_path / "beam.npz")
    arrays = dict(np.load(tmp_path / "beam.npz", allow_pickle=True))
    K = arrays["stiffnessMatrixReduced"].copy()
    K[0] = K[:, 0] = 0.0
    np.savez(tmp_path / "soft.npz", **(arrays | {"stiffnessMatrixReduced": K}))
    with pytest.raises(AccuracyError, match="has no stiffness"):
        scene_of(read_body("soft.npz", "root", "tip"), "clamp", "off", tmp_path).bodies  # noqa: B018


def test_inertia_that_no_body_has_is_refused(tmp_path: Path):
    """A mode can't have more momentum than mass and modal mass allow (Cauchy and Schwarz)."""
    write_format(scene_of(BEAM, "clamp", "off", tmp_path), "exudyn", "beam", tmp_path / "beam.npz")
    arrays = dict(np.load(tmp_path / "beam.npz", allow_pickle=True))
    np.savez(tmp_path / "heavy.npz", **(arrays | {"mPhitTPsi": 9 * arrays["mPhitTPsi"]}))
    with pytest.raises(AccuracyError, match="the file's inertia can't be a body's: mode 1"):
        scene_of(read_body("heavy.npz", "root", "tip"), "clamp", "off", tmp_path).bodies  # noqa: B018
