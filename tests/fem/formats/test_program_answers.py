"""Stress and geometric stiffness that another program has computed for a body without elements."""

import shutil
import subprocess
from dataclasses import replace
from itertools import product
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import scipy.sparse as sp

from fmd import load_scene
from fmd.core.cache import Cache
from fmd.core.errors import AccuracyError, InputError
from fmd.fem.assembly import assemble
from fmd.fem.formats.import_mesh import read_mesh
from fmd.fem.formats.matrices import read_matrices
from fmd.fem.formats.matrix_files import write_matrices
from fmd.fem.formats.matrix_model import MatrixModel
from fmd.fem.formats.program_answers import read_geometric_stiffness, read_stress
from fmd.fem.formats.program_fields import CSV_HEADER, read_frd, read_point_stress
from fmd.fem.geometric_stiffness import geometric_stiffness, reduced_geometric_stiffness
from fmd.fem.material import Material
from fmd.fem.model import FEModel
from fmd.fem.strain import stresses
from fmd.fem.surface import surface_topology
from fmd.output.formats import write_format
from fmd.output.mechanism_view import body_surface
from fmd.output.pictures import draw_stress
from fmd.output.report import contents
from fmd.output.report.contents import _draw_still
from fmd.output.report.view3d import collect_view
from fmd.output.summary import _stiffness_warnings
from fmd.recovery.stress import modal_stress
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.loads import centrifugal_fields, inertia_of
from fmd.render.camera import Camera
from fmd.scene.outputs import StressPicture
from fmd.stages.basis import reduce_body, stiffen_reduced
from fmd.stages.pipeline import Pipeline

SECTION = "*MATERIAL,NAME=M\n*ELASTIC\n70000.,.3\n*DENSITY\n2.7e-9\n*SOLID SECTION,ELSET=E,MATERIAL=M\n"
SCENE = """
title = "arm"
[body.arm]
matrices = {{ stiffness = "arm.sti", mass = "arm.mas", nodes = "arm.inp", unit = "mm", stiffness_unit = "N/mm", \
mass_unit = "t"{} }}
modes = {{ count = 4, boundary = "joint", enrich = "inertia" }}
marker = {{ root = {{ plane = "x = 0 mm" }}, tip = {{ plane = "x = 200 mm" }} }}
[joint.hub]
type = "revolute"
axis = [0, 0, 1]
child = "arm.root"
parent = "ground"
[drive.spin]
type = "motion"
joint = "hub"
angle = {{ formula = "3000*t**2", unit = "rad" }}
[simulation]
duration = "10 ms"
output_step = "1 ms"
tip = "arm.tip"
[[simulation.run]]
integrator = "auto"
"""


def arm_deck() -> str:
    """Four C3D20 of 50 × 20 × 4 mm in line."""
    number: dict[tuple[int, int, int], int] = {}
    corners = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
    middles = [(1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2)]
    middles += [(0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)]
    elements = []
    for element in range(4):
        places = [(i + 2 * element, j, k) for i, j, k in corners + middles]
        own = [str(number.setdefault(place, len(number) + 1)) for place in places]
        elements.append(f"{element + 1}," + ",".join(own[:10]) + ",\n" + ",".join(own[10:]))
    nodes = [f"{n},{25.0 * i},{10.0 * j},{2.0 * k}" for (i, j, k), n in number.items()]
    return "\n".join(["*NODE", *nodes, "*ELEMENT,TYPE=C3D20,ELSET=E", *elements, SECTION])


def calculix(folder: Path, job: str) -> None:
    subprocess.run(["ccx", job], cwd=folder, check=True, capture_output=True, timeout=120)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The arm after the whole road: matrices, load cases, their answers, and the geometric stiffness under each."""
    if shutil.which("ccx") is None:
        pytest.skip("CalculiX isn't installed")
    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm-body.inp").write_text(arm_deck())
    (folder / "arm.inp").write_text(arm_deck() + "*STEP\n*FREQUENCY,SOLVER=MATRIXSTORAGE\n1\n*END STEP\n")
    answers = ', stress = "cases.frd", geometric_stiffness = "cases-kg-*.sti"'
    for name, text in (("plain", ""), ("stressed", answers.rpartition(", geo")[0]), ("whole", answers)):
        (folder / f"{name}.toml").write_text(SCENE.format(text))
    calculix(folder, "arm")
    assert write_format(pipeline(folder, "plain"), "load-cases", "arm", folder / "cases.inp") == [folder / "cases.inp"]
    with pytest.raises(InputError, match=r"arm\.inp: is a file that the scene is read from; give another name"):
        write_format(pipeline(folder, "plain"), "load-cases", "arm", folder / "arm.inp")
    calculix(folder, "cases")
    for deck in write_format(pipeline(folder, "stressed"), "load-cases", "arm", folder / "cases.inp")[1:]:
        calculix(folder, deck.stem)
    return folder


def pipeline(folder: Path, name: str) -> Pipeline:
    return Pipeline(load_scene(str(folder / f"{name}.toml")), Cache(None))


def test_a_body_of_calculix_has_the_stress_and_the_stiffening_of_the_same_part_meshed_here(folder: Path) -> None:
    part = pipeline(folder, "whole").parts["arm"]
    mesh = read_mesh(folder / "arm-body.inp", 1e-3)
    fe = assemble(mesh, 2, Material(70e9, 0.3, 2700.0))
    apart = np.linalg.norm(part.fe.x[:, None] - fe.x, axis=2)
    place = apart.argmin(axis=1)  # of each of the matrices' nodes on the mesh
    markers = {name: replace(own, nodes=place[own.nodes]) for name, own in part.markers.items()}
    model = replace(part.model, fe=fe, markers=markers)
    modes = replace(part.modes, shapes=part.modes.shapes[np.argsort(place)])
    own = reduce_body(model, modes, part.shape.modes, part.frame)
    stiffened = stiffen_reduced(model, own)
    sign = np.sign(np.einsum("naj,naj->j", own.shapes[place], part.body.shapes))
    assert own.omega == pytest.approx(part.body.omega, rel=1e-6)

    integrals, markers_of = part.second_order
    for name in ("stiffening", "rotation2"):
        mine, theirs = getattr(stiffened.integrals, name), getattr(integrals, name)
        assert np.abs(mine * np.outer(sign, sign) - theirs).max() <= 1e-5 * np.abs(mine).max()
    mine, theirs = (bodies["tip"].displacement2 for bodies in (stiffened.markers, markers_of))
    assert np.abs(mine * np.outer(sign, sign) - theirs).max() < 1e-5 * np.abs(mine).max()

    mine = modal_stress(fe.discretisation, fe.material, own.shapes, place[part.surface.nodes]) * sign
    alike = (mine * part.surface_stress).sum(axis=(0, 1)) / np.linalg.norm(mine, axis=(0, 1))
    # CalculiX extrapolates to nodes from other points: alike it is there, and equal where the elements have it.
    assert (alike / np.linalg.norm(part.surface_stress, axis=(0, 1)) > 0.93).all()
    fields, u = part.given_model.fields, np.zeros((len(fe.x), 3, 26))
    assert fields is not None
    u[place[fields.nodes]] = fields.displacement
    gauss = 0.5 + 0.5 * np.sqrt(0.6) * np.array(list(product((-1, 0, 1), repeat=3)))[:, ::-1].T
    inside = stresses(fe.discretisation, fe.material, u, gauss, np.arange(4)).reshape(-1, 6, 26) / 1e6
    steps = read_point_stress((folder / "cases.dat").read_text())
    printed = np.array([[line.split(",")[2:] for line in step] for step in steps], dtype=float)[
        :, :, [0, 1, 2, 5, 4, 3]
    ]
    errors = np.abs(inside.transpose(2, 0, 1) - printed).max(axis=(1, 2)) / np.abs(printed).max(axis=(1, 2))
    assert errors.max() < 1e-2  # of six digits of a displacement that has a rigid motion in it
    assert np.median(errors) < 1e-3
    assert np.array_equal(np.sort(place[part.surface.nodes]), surface_topology(fe.discretisation).nodes)
    assert len(part.surface.triangles) == len(surface_topology(fe.discretisation).triangles)


def test_the_run_has_stress_in_motion_and_without_the_files_says_what_gives_it(folder: Path) -> None:
    whole, plain = pipeline(folder, "whole"), pipeline(folder, "plain")
    assert whole.stress_of("arm").worst()[2] > 1e6
    assert not [warning for warning in _stiffness_warnings(whole) if warning["code"] == "stiffening-left-out"]
    (warning,) = _stiffness_warnings(plain)
    assert warning["text"].endswith("left out: matrices.geometric_stiffness gives it")
    assert not plain.wholes["arm"].has_stress


def test_loads_that_the_files_have_not_and_matrices_by_displacement_are_refused(folder: Path) -> None:
    paths = sorted(folder.glob("cases-kg-*.sti"))
    model = read_matrices(folder / "arm.sti", folder / "arm.mas", folder / "arm.inp", (1e-3, 1e3, 1e3))
    few = read_geometric_stiffness(model, paths[:5], (1e-3, 1e3))
    u = FreeBodySolver(model).static_response(inertia_of(model, centrifugal_fields(model.x, np.array([0.0, 0.0, 1.0]))))
    with pytest.raises(AccuracyError, match=r"load 1 isn't a combination of those of its 5 matrices: \S+ % of it are"):
        reduced_geometric_stiffness(few, u, u)
    deck = (folder / "cases.inp").read_text().split("*EL PRINT")[0]  # one step, whose displacement stays
    end = "*END STEP\n*STEP,PERTURBATION\n*BOUNDARY,OP=NEW\n*FREQUENCY,SOLVER=MATRIXSTORAGE\n1\n*END STEP\n"
    (folder / "deformed.inp").write_text(deck + end)
    calculix(folder, "deformed")
    with pytest.raises(AccuracyError, match=r"no geometric stiffness: .* takes the stress as initial stress"):
        read_geometric_stiffness(model, [folder / "deformed.sti"], (1e-3, 1e3))


@pytest.fixture
def model(small_bar: FEModel) -> MatrixModel:
    """The small bar by its matrices."""
    x = small_bar.x
    return MatrixModel(None, None, small_bar.K, small_bar.m, x, 1 + np.arange(len(x)))  # type: ignore[arg-type]


@pytest.mark.parametrize("alone", [True, False])
def test_geometric_stiffness_comes_alone_or_with_the_stiffness(
    model: MatrixModel, small_bar: FEModel, alone: bool, tmp_path: Path
) -> None:
    solver = FreeBodySolver(small_bar)
    rng = np.random.default_rng(3)
    u = solver.static_response(rng.normal(size=(len(model.x), 3, 4)))
    known = geometric_stiffness(small_bar, u)
    for k, own in enumerate(known):
        A = sp.kron(own, sp.eye_array(3)) * 1e-3 + (0 if alone else 1) * small_bar.K
        sp.save_npz(tmp_path / f"kg-{k}.npz", sp.csr_array(A))
    stressed = read_geometric_stiffness(model, sorted(tmp_path.glob("kg-*.npz")), (1.0, 1.0))
    share, shapes = rng.normal(size=4), rng.normal(size=(len(model.x), 3, 2))
    found = reduced_geometric_stiffness(stressed, (u @ share)[:, :, None], shapes)
    wanted = reduced_geometric_stiffness(small_bar, (u @ share)[:, :, None], shapes)
    assert np.abs(found - wanted).max() < 1e-5 * np.abs(wanted).max()  # K is far larger, and is taken off


def csv_of(model: MatrixModel, u: np.ndarray, stress: np.ndarray) -> str:
    rows = [
        ",".join(map(repr, [case + 1, int(label), *u[k, :, case].tolist(), *stress[k, :, case].tolist()]))
        for case in range(u.shape[2])
        for k, label in enumerate(model.labels)
    ]
    return "\n".join(["case,node,ux,uy,uz,sxx,syy,szz,syz,sxz,sxy", *rows])


def test_stress_of_shapes_is_combined_from_cases_beside_rigid_motions(
    model: MatrixModel, small_bar: FEModel, tmp_path: Path
) -> None:
    rng = np.random.default_rng(4)
    u = FreeBodySolver(small_bar).static_response(rng.normal(size=(len(model.x), 3, 3)))
    nodes = np.arange(len(model.x))
    moved = u + (small_bar.rigid_modes @ rng.normal(size=(6, 3)) * np.abs(u).max()).reshape(u.shape)
    stress = modal_stress(small_bar.discretisation, small_bar.material, moved, nodes)
    (tmp_path / "cases.csv").write_text(csv_of(model, 1e3 * moved, 1e-6 * stress))
    given = read_stress(model, tmp_path / "cases.csv", tmp_path / "nodes.csv", (1e-3, 1e6))
    share = rng.normal(size=(3, 2))
    found = given.stress_of(u @ share)
    assert np.abs(found - stress @ share).max() < 1e-9 * np.abs(stress).max()
    assert not len(given.surface.triangles)  # no elements are known
    with pytest.raises(AccuracyError, match=r"cases\.csv: mode 1 isn't a combination of its 3 displacements: \S+ % of"):
        given.stress_of(FreeBodySolver(small_bar).static_response(rng.normal(size=(len(model.x), 3, 1))))


@pytest.mark.parametrize(("n", "told"), [(3, False), (10, False), (40, True), (146, True)])
def test_stress_at_too_few_nodes_is_refused(
    model: MatrixModel, small_bar: FEModel, n: int, told: bool, tmp_path: Path
) -> None:
    rng = np.random.default_rng(6)
    u = FreeBodySolver(small_bar).static_response(rng.normal(size=(len(model.x), 3, 24)))
    stress = modal_stress(small_bar.discretisation, small_bar.material, u, np.arange(len(u)))
    some = np.sort(rng.choice(len(u), n, replace=False))
    few = replace(model, positions=model.x[some], labels=model.labels[some])
    (tmp_path / "few.csv").write_text(csv_of(few, u[some], stress[some]))
    given = read_stress(model, tmp_path / "few.csv", tmp_path / "nodes.csv", (1.0, 1.0))
    share = rng.normal(size=(24, 1))
    if told:
        assert np.abs(given.stress_of(u @ share) - stress[some] @ share).max() < 1e-6 * np.abs(stress @ share).max()
        return
    message = rf"few\.csv, matrices\.stress: displacements of 24 cases at {n} of .* stress at more nodes is needed"
    with pytest.raises(AccuracyError, match=message):
        given.stress_of(u @ share)


def test_cases_of_one_displacement_with_two_stresses_are_refused(
    model: MatrixModel, small_bar: FEModel, tmp_path: Path
) -> None:
    u = np.repeat(FreeBodySolver(small_bar).modes(1).shapes, 2, axis=2)
    stress = modal_stress(small_bar.discretisation, small_bar.material, u, np.arange(len(u)))
    for factor in (1.0, 1.01):
        (tmp_path / "two.csv").write_text(csv_of(model, u, stress * [1.0, factor]))
        given = read_stress(model, tmp_path / "two.csv", tmp_path / "nodes.csv", (1.0, 1.0))
        if factor == 1.0:
            assert given.stress_of(u) == pytest.approx(stress, rel=1e-9, abs=1e-9 * np.abs(stress).max())
        else:
            with pytest.raises(AccuracyError, match="don't tell the stress of a shape"):
                given.stress_of(u)


def test_stress_of_nodes_alone_has_no_picture_and_says_what_gives_one(
    small_bar: FEModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    x, n = small_bar.x, len(small_bar.x)
    write_matrices(tmp_path / "bar.npz", small_bar, 1 + np.arange(n))
    (tmp_path / "cases.csv").write_text("\n".join([",".join(CSV_HEADER), *(f"1,{k + 1}{',0' * 9}" for k in range(n))]))
    files = 'stiffness = "bar.npz", mass = "bar-mass.npz", nodes = "bar-nodes.csv", stress = "cases.csv"'
    end = f'marker = {{ end = {{ plane = "x = {x[:, 0].min()}" }} }}'
    body = f'matrices = {{ {files}, unit = "m" }}\nmodes = {{ count = 1 }}\n{end}'
    motion = SCENE[SCENE.index("[joint") :].replace("{{", "{").replace("}}", "}").replace("arm.root", "bar.end")
    motion = motion.replace("arm.tip", "bar.end").replace("3000*t**2", "0*t")
    (tmp_path / "bar.toml").write_text(f'title = "bar"\n[body.bar]\n{body}\n{motion}')
    run = pipeline(tmp_path, "bar")
    with pytest.raises(InputError, match=r"has nodes without solid elements: the deck .* so it has no picture"):
        body_surface(run, "bar")
    with pytest.raises(InputError, match=r"body\.bar\.matrices: has nodes without solid elements"):
        draw_stress(run, StressPicture(type="stress", file="stress.png"), tmp_path)
    view = collect_view(run, 1.0, Camera())
    assert not [body for body in view["bodies"] if "levels" in body]
    assert view["worst"] is None
    assert view["lines"]  # the body
    drawn = list[str]()
    monkeypatch.setattr(contents, "draw_inline", lambda _, kind, **__: drawn.append(kind) or [Mock(png=b"")])
    _draw_still(run)
    assert drawn == ["mechanism"]


def test_stress_that_lacks_a_node_of_the_surface_says_which(tmp_path: Path) -> None:
    (tmp_path / "arm.inp").write_text(arm_deck())
    x = read_mesh(tmp_path / "arm.inp", 1e-3).points
    n = len(x)
    model = MatrixModel(None, None, sp.csr_array((3 * n, 3 * n)), sp.csr_array((n, n)), x, 1 + np.arange(n))  # type: ignore[arg-type]
    for left_out in (0, 2):
        rows = [f"1,{label}{',0' * 9}" for label in model.labels[left_out:]]
        (tmp_path / "cases.csv").write_text("\n".join([",".join(CSV_HEADER), *rows]))
        fields = read_stress(model, tmp_path / "cases.csv", tmp_path / "arm.inp", (1.0, 1.0)).fields
        assert fields is not None
        said = "has no stress at node 1 (and 1 more) of its surface" if left_out else ""
        assert (bool(len(fields.surface.triangles)), fields.not_drawn) == (not left_out, said)


FRD = """    1C
 -1         7 0.00000E+00 0.00000E+00 0.00000E+00
 -3
    1PSTEP                         1           1           1
  100CL  101 1.000000000           2                     0    1           1
 -4  DISP        4    1
 -5  D1          1    2    1    0
 -5  D2          1    2    2    0
 -5  D3          1    2    3    0
 -5  ALL         1    2    0    0    1ALL
 -1         7 1.19048E-02-1.68160E-16-1.15440E-16
 -1         9 2.00000E+00-3.00000E+00 4.00000E+00
 -3
  100CL  101 1.000000000           2                     0    1           1
 -4  STRESS      6    1
 -5  SXX         1    4    1    1
 -5  SYY         1    4    2    2
 -5  SZZ         1    4    3    3
 -5  SXY         1    4    1    2
 -5  SYZ         1    4    2    3
 -5  SZX         1    4    3    1
 -1         7 1.00000E+00 2.00000E+00 3.00000E+00 4.00000E+00 5.00000E+00 6.00000E+00
 -1         9-1.00000E+00 0.00000E+00 0.00000E+00 0.00000E+00 0.00000E+00 0.00000E+00
 -3
 9999
"""


def test_results_of_calculix_are_read_by_name_and_column() -> None:
    others = FRD.partition("  100C")[2].partition("  100C")[0].replace("DISP    ", "FORC    ")
    others = others.replace(" 4.00000E+00\n", " 4.00000E+00\n -2           not a number\n")
    found = read_frd(FRD.replace(" 9999", f"  100C{others} 9999"))
    assert found.labels.tolist() == [7, 9]
    assert found.displacement[1, :, 0].tolist() == [2.0, -3.0, 4.0]
    assert found.stress[0, :, 0].tolist() == [1.0, 2.0, 3.0, 5.0, 6.0, 4.0]  # yz, xz, xy


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (FRD.replace("STRESS", "TOSTRAIN"), "holds no displacements with stress"),
        (FRD.replace("DISP", "FORC"), "stress number 1 has no displacement before it"),
        (
            FRD.replace("    1           1\n -4", "    1           2\n -4"),
            "line 5: its format isn't the long one of text",
        ),
        (FRD.replace("4.00000E+00\n", "4.0x000E+00\n"), "the results before line 13 aren't read as numbers"),
        (
            FRD.replace("SZX", "SXZ"),
            r"line 24: STRESS at 2 nodes has SXX, .*SXZ; SXX, SYY, SZZ, SYZ, SZX, SXY are read",
        ),
        (FRD.replace(" -5  SZZ         1    4    3    3\n", ""), "line 23: STRESS at 2 nodes has SXX, SYY, SXY"),
        (FRD[: FRD.index(" -1         7 1.19")] + " -3\n", "line 11: DISP at 0 nodes has D1, D2, D3"),
        (FRD.replace(" -1         9", " -1         7"), "case 1 has node 7 more than once"),
    ],
)
def test_results_that_are_not_read_are_named(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        read_frd(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("node,x\n1,2\n", "its header must be case,node,ux"),
        (f"{','.join(CSV_HEADER)}\n1,2,3\n", "rows are of 11 numbers"),
        (f"{','.join(CSV_HEADER)}\n1,1{',0' * 9}\n2,2{',0' * 9}\n", "case 2 isn't for the nodes of the first one"),
        (f"{','.join(CSV_HEADER)}\n1,1{',nan' * 9}\n", "aren't finite numbers"),
        (f"{','.join(CSV_HEADER)}\n1,1.9{',0' * 9}\n", "numbers of cases and nodes must be whole"),
        (f"{','.join(CSV_HEADER)}\n1,nan{',0' * 9}\n", "numbers of cases and nodes must be whole"),
        (f"{','.join(CSV_HEADER)}\nnan,1{',0' * 9}\n", "numbers of cases and nodes must be whole"),
        (f"{','.join(CSV_HEADER)}\n1,1{',0' * 9}\n1,1{',1' * 9}\n", "case 1 has node 1 more than once"),
        (f"{','.join(CSV_HEADER)}\n1,900{',0' * 9}\n", r"has node 900 \(and 0 more\), which isn't among the nodes"),
    ],
)
def test_rows_that_do_not_fit_are_named(model: MatrixModel, text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "cases.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        read_stress(model, tmp_path / "cases.csv", tmp_path / "nodes.csv", (1.0, 1.0))


def test_other_files_of_stress_are_refused_with_those_that_are_read(model: MatrixModel, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"stress is read from \.frd and \.csv"):
        read_stress(model, tmp_path / "cases.op2", tmp_path / "nodes.csv", (1.0, 1.0))
