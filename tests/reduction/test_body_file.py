"""A reduced body as a file: every field and its motion come back to the last bit, other files are refused."""

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

from fmd.core.errors import InputError
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.links import Link
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import half_sine
from fmd.fem.markers import Marker, face_marker
from fmd.fem.model import FEModel
from fmd.fem.surface import SurfaceTopology, surface_topology
from fmd.integrators.central_difference import CentralDifference
from fmd.recovery.stress import modal_stress
from fmd.reduction.body import FlexibleBody, MarkerShapes, reduced_body
from fmd.reduction.body_file import FORMAT, VERSION, SavedBody, load_body, save_body
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.inertia import InertiaIntegrals
from fmd.reduction.mode_families import lowest_modes
from fmd.reduction.stiffening import stiffen_body
from fmd.scene.joints.revolute import REVOLUTE
from fmd.scene.joints.spherical import SPHERICAL
from tests.dynamics.hinged_body import hinged as on_hinge

Z = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def markers(small_bar: FEModel) -> dict[str, Marker]:
    space = small_bar.discretisation
    return {name: face_marker(space, space.mesh.faces[face]) for name, face in (("tip", "x+"), ("Fuß", "x-"))}


@pytest.fixture(scope="module")
def solver(small_bar: FEModel) -> FreeBodySolver:
    return FreeBodySolver(small_bar)


@pytest.fixture(scope="module")
def hinged(small_bar: FEModel, solver: FreeBodySolver, markers: dict[str, Marker]) -> FlexibleBody:
    modes = lowest_modes(solver, 4)
    return reduced_body(small_bar, modes.omega, modes.shapes, markers, "Fuß", Z[None])


@pytest.fixture(scope="module")
def saved(small_bar: FEModel, solver: FreeBodySolver, markers: dict[str, Marker], hinged: FlexibleBody) -> SavedBody:
    """Everything that a file can hold."""
    space = small_bar.discretisation
    held = markers["Fuß"].columns(len(small_bar.x), np.eye(3)[:2])
    body = stiffen_body(hinged, small_bar, solver, held, moving={name: markers[name] for name in list(markers)[1:]})
    surface = surface_topology(space)
    stress = modal_stress(space, small_bar.material, body.shapes, surface.nodes)
    return SavedBody(body, surface, stress, lowest_modes(solver, 4).frequencies_hz)


@pytest.fixture
def path(saved: SavedBody, tmp_path: Path) -> Path:
    save_body(tmp_path / "body.nc", saved.body, saved.surface, saved.stress, saved.elastic_hz)
    return tmp_path / "body.nc"


def bits(value: Any) -> Any:
    """Every number of it as bytes, with type and shape."""
    match value:
        case np.ndarray():
            return value.dtype, value.shape, value.tobytes()
        case float():
            return np.float64(value).tobytes()
        case dict():
            return [(name, bits(item)) for name, item in value.items()]
        case FlexibleBody() | InertiaIntegrals() | MarkerShapes() | SurfaceTopology() | SavedBody():
            return [(part.name, bits(getattr(value, part.name))) for part in fields(value)]
    return value


def test_everything_comes_back_to_the_last_bit(saved: SavedBody, path: Path) -> None:
    assert saved.body.integrals.stiffening.any()
    assert saved.body.integrals.displacement2.any()
    assert saved.body.integrals.rotation2.any()
    assert any(marker.displacement2.any() for marker in saved.body.markers.values())
    assert bits(load_body(path)) == bits(load_body(str(path))) == bits(saved)


def test_inertia_in_a_deformed_state_is_the_same_to_the_last_bit(hinged: FlexibleBody, tmp_path: Path) -> None:
    # sums over G run along its memory, which need not be in the order of its axes
    hinged = replace(hinged, integrals=replace(hinged.integrals, G=np.asfortranarray(hinged.integrals.G)))
    save_body(tmp_path / "body.nc", hinged)
    loaded = load_body(tmp_path / "body.nc").body.integrals
    p = np.r_[1.0, np.random.default_rng(0).normal(size=4)]
    assert loaded.mass_matrix(p).tobytes() == hinged.integrals.mass_matrix(p).tobytes()


def test_a_body_alone_comes_back_as_it_was(hinged: FlexibleBody, tmp_path: Path) -> None:
    save_body(tmp_path / "body.nc", hinged)
    assert bits(load_body(tmp_path / "body.nc")) == bits(SavedBody(hinged))


def test_numbers_of_every_size_come_back(hinged: FlexibleBody, tmp_path: Path) -> None:
    omega = np.array([5e-324, np.nextafter(1.0, 2.0), 1e150, -0.0])
    body = replace(hinged, omega=omega, coupling=float("nan"), x=hinged.x.astype(">f8").astype(float))
    save_body(tmp_path / "body.nc", body)
    assert bits(load_body(tmp_path / "body.nc").body) == bits(body)


def test_the_motion_of_a_loaded_rotor_is_the_same_to_the_last_bit(hinged: FlexibleBody, tmp_path: Path) -> None:
    save_body(tmp_path / "body.nc", hinged)
    loaded = load_body(tmp_path / "body.nc").body
    marches = []
    for body in (hinged, loaded):
        rotor = on_hinge(body, half_sine(0.0, 0.005, 40.0))
        rest = np.zeros(rotor.n)
        marches.append(CentralDifference(1e-6).march(rotor, rest, rest, np.linspace(0.0, 0.01, 11)))
    first, second = marches
    assert np.abs(first.q[-1]).min() > 0
    assert (first.q.tobytes(), first.v.tobytes()) == (second.q.tobytes(), second.v.tobytes())


def test_the_motion_of_a_chain_of_loaded_bodies_is_the_same_to_the_last_bit(saved: SavedBody, path: Path) -> None:
    first, second = (_swing(body) for body in (saved.body, load_body(path).body))
    assert np.abs(first.q[-1]).min() > 0
    assert (first.q.tobytes(), first.v.tobytes()) == (second.q.tobytes(), second.v.tobytes())


def _swing(body: FlexibleBody) -> Any:
    """Swing two of the body, one on the other's tip, on a hinge and a ball joint under gravity."""
    tip = body.markers["tip"]
    upper = Link("upper", body.integrals, REVOLUTE, omega=body.omega, joint_rotation=body.joint_rotation)
    lower = Link(
        "lower",
        body.integrals,
        SPHERICAL,
        parent=0,
        place=MarkerShapes(tip.position, tip.translation, tip.rotation),
        omega=body.omega,
    )
    tree = Mechanism([upper, lower], gravity=np.array([0.3, -9.81, 0.1]))
    q0, v0 = np.zeros(tree.n_positions), np.zeros(tree.n)
    q0[tree.layout.position[1]] = 1.0  # the unit quaternion
    v0[:] = np.linspace(0.1, 0.2, tree.n)
    return CentralDifference(1e-6).march(CompiledSystem(tree), q0, v0, np.linspace(0.0, 1e-3, 3))


# What other programs find -----------------------------------------------------------------------------------------


def test_each_variable_has_a_unit_and_a_meaning(path: Path) -> None:
    with xarray.open_dataset(path, engine="scipy") as file:
        assert all(variable.attrs["units"] and variable.attrs["long_name"] for variable in file.data_vars.values())
        assert file.attrs.pop("error").startswith("not stated: ")
        assert file.attrs == {"format": FORMAT, "format_version": VERSION, "joint": "Fuß"}
        assert file["marker"].values.tolist() == ["tip", "Fuß"]
        assert file["surface_stress"].dims == ("surface_node", "component", "mode")


def test_mass_and_stiffness_are_those_of_the_finite_elements(
    small_bar: FEModel, hinged: FlexibleBody, markers: dict[str, Marker], tmp_path: Path
) -> None:
    # independent path: the 6 + n motions of all nodes through the full matrices
    save_body(tmp_path / "body.nc", hinged)
    n = len(hinged.omega)
    rigid = small_bar.rigid_modes.reshape(-1, 3, 6).copy()
    rigid[:, :, 3:] = np.cross(np.eye(3)[None], hinged.x[:, None]).swapaxes(1, 2)
    motions = np.concatenate([rigid, hinged.shapes], axis=2).reshape(-1, 6 + n)
    M, K = motions.T @ small_bar.M @ motions, motions.T @ small_bar.K @ motions
    with xarray.open_dataset(tmp_path / "body.nc", engine="scipy") as file:
        assert file["M_hat"].to_numpy() == pytest.approx(M, abs=1e-9 * np.abs(M).max())
        assert file["K_hat"].to_numpy() == pytest.approx(K, abs=1e-7 * np.abs(K).max())


# What is refused --------------------------------------------------------------------------------------------------


def test_stress_needs_its_surface(saved: SavedBody, tmp_path: Path) -> None:
    assert saved.stress is not None
    with pytest.raises(ValueError, match="there is none"):
        save_body(tmp_path / "body.nc", saved.body, stress=saved.stress)
    with pytest.raises(ValueError, match="stress has shape"):
        save_body(tmp_path / "body.nc", saved.body, saved.surface, saved.stress[1:])
    assert list(tmp_path.iterdir()) == []


def test_a_bad_place_leaves_nothing_behind(hinged: FlexibleBody, tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(OSError, match="file"):
        save_body(file / "body.nc", hinged)
    assert list(tmp_path.iterdir()) == [file]


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    for place in (tmp_path / "nothing.nc", tmp_path):
        with pytest.raises(InputError, match="can't be read") as caught:
            load_body(place)
        assert caught.value.file == str(place)


@pytest.mark.parametrize("content", [b"", b"CDF", b"not a NetCDF file at all", b"\x89HDF\r\n\x1a\n" + bytes(600)])
def test_other_files_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "body.nc").write_bytes(content)
    with pytest.raises(InputError, match="no file of a reduced body"):
        load_body(tmp_path / "body.nc")


def test_another_netcdf_file_is_refused(tmp_path: Path) -> None:
    xarray.Dataset({"omega": ("mode", np.ones(3))}).to_netcdf(tmp_path / "other.nc", engine="scipy")
    with pytest.raises(InputError, match="but not of a reduced body"):
        load_body(tmp_path / "other.nc")


def test_a_file_cut_off_anywhere_is_refused(path: Path, tmp_path: Path) -> None:
    content = path.read_bytes()
    cuts = [*range(0, 200, 7), *range(200, 8000, 231), *np.linspace(8000, len(content) - 4, 60).astype(int)]
    for cut in cuts:
        (tmp_path / "cut.nc").write_bytes(content[:cut])
        with pytest.raises(InputError):
            load_body(tmp_path / "cut.nc")


def changed(path: Path, change: Callable[[xarray.Dataset], xarray.Dataset]) -> Path:
    with xarray.open_dataset(path, engine="scipy", mask_and_scale=False) as file:
        dataset = file.load()
    change(dataset).to_netcdf(path.with_name("changed.nc"), engine="scipy")
    return path.with_name("changed.nc")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.assign_attrs(format_version=VERSION + 1), f"version {VERSION + 1}; this program reads {VERSION}"),
        (lambda d: d.assign_attrs(joint="elbow"), "'elbow' is none of tip, Fuß"),
        (lambda d: d.drop_vars("G"), "lacks 'G'"),
        (lambda d: d.drop_vars("marker"), "lacks 'marker'"),
        (lambda d: d.drop_vars("triangles"), "lacks 'triangles'"),
        (lambda d: d.assign(omega=("node", d["x"].to_numpy()[:, 0])), "omega has dimensions"),
    ],
)
def test_a_file_that_was_tampered_with_is_refused(
    path: Path, change: Callable[[xarray.Dataset], xarray.Dataset], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        load_body(changed(path, change))


@pytest.mark.slow
def test_loading_needs_neither_mesh_nor_finite_elements(path: Path) -> None:
    import subprocess
    import sys

    listing = (
        "import sys; from pathlib import Path; from fmd.reduction.body_file import load_body;"
        "load_body(Path(sys.argv[1])); print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", listing, str(path)], capture_output=True, text=True, check=True)
    assert not set(done.stdout.split()) & {"skfem", "meshio", "gmsh", "llvmlite", "fmd.fem.mesh", "fmd.recovery"}
