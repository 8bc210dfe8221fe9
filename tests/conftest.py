"""What the tests share: a cache folder of the session's own, small meshes and models, formulas of beam theory."""

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from itertools import permutations
from pathlib import Path
from typing import NamedTuple

# Kernels are compiled into this folder as soon as pipeline.dynamics is imported, so it has to be set before that.
os.environ["FMD_CACHE"] = tempfile.mkdtemp(prefix="fmd-tests-")

import numpy as np
import pytest
from hypothesis import settings
from scipy.linalg import expm
from scipy.optimize import brentq

from meshes.bar import hexahedral_bar, tetrahedral_bar
from pipeline.checks import Array
from pipeline.fem.assembly import assemble
from pipeline.fem.material import Material
from pipeline.fem.mesh import SolidMesh
from pipeline.fem.model import FEModel

settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")

STEEL = Material(E=210e9, nu=0.3, rho=7800.0)
Sizes = tuple[float, float, float]
Divisions = tuple[int, int, int]


class Element(NamedTuple):
    """An element by name, the cells it lives on and its order."""

    name: str
    cell_type: str
    order: int


ELEMENTS = (
    Element("hex8", "hexahedron", 1),
    Element("hex20", "hexahedron", 2),
    Element("tet4", "tetra", 1),
    Element("tet10", "tetra", 2),
)


def pytest_unconfigure() -> None:
    shutil.rmtree(os.environ["FMD_CACHE"], ignore_errors=True)


def make_box(
    cell_type: str, divisions: Divisions, sizes: Sizes = (1.0, 1.0, 1.0), distortion: float = 0.0, seed: int = 0
) -> SolidMesh:
    """Grid a box with a corner at the origin; its inner points are moved by up to ``distortion`` of a cell."""
    axes = [np.arange(n + 1) for n in divisions]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    inner = ((grid > 0) & (grid < divisions)).all(axis=1)
    moved = grid + inner[:, None] * np.random.default_rng(seed).uniform(-distortion, distortion, grid.shape)
    stride = np.array([(divisions[1] + 1) * (divisions[2] + 1), divisions[2] + 1, 1])
    first = grid[(grid < divisions).all(axis=1)] @ stride
    if cell_type == "hexahedron":
        around = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
        corners = [np.concatenate([around, around + [0, 0, 1]])]
    else:  # Kuhn's six tetrahedra, each along one way from a cube's corner to the opposite one
        corners = []
        for order in permutations(range(3)):
            way = np.cumsum(np.eye(3, dtype=int)[[*order]], axis=0)
            corners.append(np.array([[0, 0, 0], *(way if np.linalg.det(way) > 0 else way[[1, 0, 2]])]))
    cells = np.concatenate([first[:, None] + corner @ stride for corner in corners])
    faces = {
        name + sign: np.flatnonzero(grid[:, a] == end)
        for a, name in enumerate("xyz")
        for sign, end in (("-", 0), ("+", divisions[a]))
    }
    points = moved * (np.array(sizes) / divisions)
    return SolidMesh(points, cells, cell_type, {"box": np.arange(len(cells))}, faces)


def make_bar(
    element: Element, sizes: Sizes, divisions: Divisions | None = None, size: float | None = None
) -> SolidMesh:
    """Mesh a bar by Gmsh: hexahedra by divisions, tetrahedra by size."""
    if element.cell_type == "hexahedron":
        assert divisions is not None
        return SolidMesh(*hexahedral_bar(*sizes, divisions))
    assert size is not None
    return SolidMesh(*tetrahedral_bar(*sizes, size))


def timoshenko_hz(
    length: float, depth: float, width: float, material: Material, count: int, pinned: bool = False
) -> Array:
    """Bending frequencies [Hz] of Timoshenko's beam, free at x = L and free or pinned at x = 0.

    With s = x/L and the state (w/L, ψ, M L/EI, Q L²/EI) the beam is a linear system y' = S(ω) y; the frequencies are
    the zeros of the determinant that the end conditions pick out of exp(S). The shear factor is Cowper's for the
    rectangle (J Appl Mech 33, 1966).
    """
    E, nu, rho = material.E, material.nu, material.rho
    area, second = width * depth, width * depth**3 / 12
    shear = 10 * (1 + nu) / (12 + 11 * nu) * E / (2 * (1 + nu)) * area
    bending = E * second
    start = [1, 3] if pinned else [0, 1]  # what may be non-zero at x = 0

    def determinant(omega: float) -> float:
        S = np.zeros((4, 4))
        S[0, 1], S[0, 3] = 1.0, bending / (shear * length**2)
        S[1, 2] = 1.0
        S[2, 1], S[2, 3] = -rho * second * omega**2 * length**2 / bending, -1.0
        S[3, 0] = -rho * area * omega**2 * length**4 / bending
        return float(np.linalg.det(expm(S)[2:, start]))

    scale = np.sqrt(bending / (rho * area)) / length**2
    trial = scale * np.linspace(1.0, (np.pi * (count + 1)) ** 2, 100 * (count + 1))
    value = [determinant(omega) for omega in trial]
    roots = [brentq(determinant, trial[k], trial[k + 1]) for k in np.flatnonzero(np.diff(np.sign(value)))]
    return np.array(roots[:count]) / (2 * np.pi)


@pytest.fixture(scope="session", params=ELEMENTS, ids=lambda element: element.name)
def element(request: pytest.FixtureRequest) -> Element:
    """Each element in turn."""
    return request.param


@pytest.fixture(scope="session")
def steel() -> Material:
    return STEEL


@pytest.fixture(scope="session")
def box_mesh() -> Callable[..., SolidMesh]:
    return make_box


@pytest.fixture(scope="session")
def bar_mesh() -> Callable[..., SolidMesh]:
    return make_bar


@pytest.fixture(scope="session")
def timoshenko() -> Callable[..., Array]:
    return timoshenko_hz


@pytest.fixture(scope="session")
def distorted(element: Element) -> FEModel:
    """A box of 1.2 × 1 × 0.8 m of each element, its inner points moved at random."""
    return assemble(make_box(element.cell_type, (3, 3, 3), (1.2, 1.0, 0.8), 0.2), element.order, STEEL)


@pytest.fixture(scope="session")
def small_bar() -> FEModel:
    """A bar of 300 × 40 × 20 mm, of 7 × 2 × 1 quadratic hexahedra: small enough for dense solutions."""
    return assemble(SolidMesh(*hexahedral_bar(0.3, 0.04, 0.02, (7, 2, 1))), 2, STEEL)


@pytest.fixture
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A cache folder of the test's own."""
    monkeypatch.setenv("FMD_CACHE", str(tmp_path / "cache"))
    yield tmp_path / "cache"
