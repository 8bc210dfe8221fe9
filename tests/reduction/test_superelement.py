"""Superelements: their rigid motions, frequencies and damping, and the files that hold them."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat
from scipy.linalg import eigh

from fmd.core.errors import InputError
from fmd.fem.markers import face_marker
from fmd.fem.model import FEModel
from fmd.reduction.craig_bampton import Superelement, craig_bampton_modes, make_superelement
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.formats.openfast_file import read_extptfm, write_extptfm
from fmd.reduction.formats.simscape_file import write_simscape

RATIO = 0.03


@pytest.fixture(scope="module")
def solver(small_bar: FEModel) -> FreeBodySolver:
    return FreeBodySolver(small_bar)


@pytest.fixture(scope="module")
def markers(small_bar: FEModel):
    mesh = small_bar.discretisation.mesh
    return {name: face_marker(small_bar.discretisation, mesh.faces[face]) for name, face in (("a", "x-"), ("b", "x+"))}


@pytest.fixture(scope="module")
def element(small_bar: FEModel, solver: FreeBodySolver, markers) -> Superelement:
    return make_superelement(small_bar, solver, markers, 4, lambda omega: np.full(len(omega), RATIO))


def test_rigid_motions_cost_nothing_and_have_the_bodys_inertia(small_bar: FEModel, element: Superelement):
    R = np.zeros((len(element.K), 6))
    for k, place in enumerate(element.origins.values()):
        for a in range(3):
            R[6 * k + a, a] = R[6 * k + 3 + a, 3 + a] = 1.0
            R[6 * k : 6 * k + 3, 3 + a] = np.cross(np.eye(3)[a], place)
    whole = small_bar.rigid_modes
    inertia = whole.T @ (small_bar.M @ whole)
    assert np.abs(element.K @ R).max() < 1e-7 * np.abs(element.K).max()
    assert np.abs(R.T @ element.M @ R - inertia).max() < 1e-8 * inertia.max()
    assert np.abs(R.T @ element.weight - inertia[:, :3]).max() < 1e-8 * inertia.max()
    assert np.abs(element.D @ R).max() < 1e-6 * np.abs(element.D).max()


def test_elastic_frequencies_are_those_of_the_craig_bampton_basis(small_bar, solver, markers, element: Superelement):
    basis = craig_bampton_modes(small_bar, solver, list(markers.values()), 4)
    assert element.frequencies_hz[6:] == pytest.approx(basis.frequencies_hz, rel=1e-6)
    assert np.abs(element.frequencies_hz[:6]).max() < 1e-2 * basis.frequencies_hz[0]


def test_every_elastic_mode_has_the_damping_ratio(element: Superelement):
    omega2, V = eigh(element.K, element.M)
    ratios = np.diag(V.T @ element.D @ V)[6:] / (2 * np.sqrt(omega2[6:]))
    assert ratios == pytest.approx(np.full(len(ratios), RATIO), rel=1e-9)
    off = V.T @ element.D @ V
    assert np.abs(off - np.diag(off.diagonal())).max() < 1e-8 * np.abs(off).max()


def test_openfast_gets_it_to_the_last_digit(small_bar: FEModel, solver: FreeBodySolver, markers, tmp_path: Path):
    one = make_superelement(small_bar, solver, {"top": markers["b"]}, 5, lambda omega: np.full(len(omega), RATIO))
    gravity = np.array([0.0, 0.0, -9.81])
    path, main = write_extptfm(tmp_path / "tower.dat", one, gravity)
    found = read_extptfm(path)
    for key in ("K", "M", "D"):
        assert np.array_equal(found[key], getattr(one, key))
    assert found["loads"].shape == (2, 7 + 5)
    assert found["loads"][:, 1:] == pytest.approx(np.tile(one.weight @ gravity, (2, 1)), abs=0)
    assert found["loads"][0, 3] == pytest.approx(-9.81 * small_bar.mass, rel=1e-9)
    assert '"tower.dat"' in main.read_text()
    assert str(tmp_path) not in main.read_text() + path.read_text()
    assert np.array_equal(found["M"][6:, 6:], np.eye(5))


def test_openfast_has_one_interface(element: Superelement, tmp_path: Path):
    with pytest.raises(ValueError, match="one interface, and the body 2 markers"):
        write_extptfm(tmp_path / "x.dat", element, np.zeros(3))


@pytest.mark.filterwarnings("ignore")
def test_the_wind_turbine_library_reads_openfasts_file(small_bar, solver, markers, tmp_path: Path):
    reader = pytest.importorskip("welib.weio.fast_input_file")
    one = make_superelement(small_bar, solver, {"top": markers["b"]}, 5)
    path, _ = write_extptfm(tmp_path / "tower.dat", one, np.zeros(3))
    theirs = reader.FASTInputFile(str(path))
    assert np.array_equal(theirs["MassMatrix"], one.M)
    assert np.array_equal(theirs["StiffnessMatrix"], one.K)


def test_simscape_gets_frames_matrices_and_names(element: Superelement, tmp_path: Path):
    write_simscape(tmp_path / "body.mat", element)
    found = loadmat(tmp_path / "body.mat")
    for key, want in (("K", element.K), ("M", element.M), ("C", element.D)):
        assert np.array_equal(found[key], want)
    assert np.array_equal(found["origins"], np.array(list(element.origins.values())))
    assert np.array_equal(found["quaternions"], [[1.0, 0, 0, 0]] * 2)
    assert [str(row[0][0]) for row in found["names"]] == ["a", "b"]
    assert found["frequencies_hz"][:, 0] == pytest.approx(element.omega / (2 * np.pi), rel=1e-15)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda lines: [], "no superelement in FLEX's format"),
        (lambda lines: lines[:12], "line 13: 11 finite numbers expected, not ''"),
        (lambda lines: [line.replace("!Stiffness", "!Softness") for line in lines], "has no '!stiffness matrix'"),
        (lambda lines: [*lines[:8], "1 2 x", *lines[9:]], "line 9: 11 finite numbers expected, not '1 2 x'"),
        (lambda lines: [line.replace("!Dimension: 11", "!Dimension: 3") for line in lines], "six or more"),
    ],
)
def test_a_bad_file_is_refused_in_one_line(small_bar, solver, markers, tmp_path: Path, change, message: str):
    one = make_superelement(small_bar, solver, {"top": markers["b"]}, 5)
    path, _ = write_extptfm(tmp_path / "tower.dat", one, np.zeros(3))
    path.write_text("\n".join(change(path.read_text().splitlines())))
    with pytest.raises(InputError) as error:
        read_extptfm(path)
    assert message in str(error.value)
    assert "\n" not in str(error.value)
