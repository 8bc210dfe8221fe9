"""Warping of sections of laminates: stress of plies by three-dimensional elasticity, and what is stated of it."""

import math
from collections.abc import Sequence

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.fem.laminate import Lamina, Laminate, Ply
from fmd.fem.layered import Layered
from fmd.fem.space import Discretisation
from fmd.recovery.half_waves import half_waves
from fmd.recovery.plies import modal_ply_stress
from fmd.recovery.ply_warping import warped_ply_stress
from tests.fem.sheets import shell_mesh, unit_grid
from tests.fem.test_laminate import CARBON, CORE, Elastic, QuarterPlate, crossed, elastic_stress, sandwich, stack

N = 12
OF_MESH = 0.008  # share of a stress, of 12 elements along a quarter of a wave


def ply_stresses(laminate: Laminate, elastic: Sequence[Elastic], degrees: tuple[int, ...]) -> Array:
    """Return sizes of 11, 22 and 12 at the upper faces of plies of a plate under a half sine of pressure each way.

    Shape (3, n_plies, 3): of the shell, with the warping of sections, and by three-dimensional elasticity.
    """
    plate = QuarterPlate(N, laminate)
    u, space, material = plate.bend()[:, :, None], plate.fe.discretisation, plate.fe.material
    assert isinstance(material, Layered)
    middle, corner = 0, N * N - 1
    size = {middle: math.cos(math.pi / 4 / N) ** 2, corner: math.cos(math.pi / 4 / N) ** 2}
    found = []
    for of in (modal_ply_stress, warped_ply_stress):
        stress = of(space, material, u, np.array([middle, corner]))[..., 1, :, 0]
        found.append(np.column_stack([stress[0][:, :2] / size[middle], stress[1][:, 4] / size[corner]]))
    exact = []
    for ply, turned in enumerate(degrees):
        own = elastic_stress(elastic, ply)
        exact.append([own["yy"], own["xx"], own["xy"]] if turned else [own["xx"], own["yy"], own["xy"]])
    return np.abs(np.array([*found, exact]))


def laid(lamina: Lamina, h: float, degrees: tuple[int, ...]) -> Array:
    """Return `ply_stresses` of plies of one material and thickness."""
    return ply_stresses(stack(lamina, h, *degrees), crossed(lamina, h, degrees), degrees)


@pytest.mark.parametrize(
    ("degrees", "ratio", "without", "within"),
    [
        ((0, 90, 90, 0), 4, 0.49, 0.07),
        ((0, 90, 90, 0), 10, 0.14, 0.005),
        ((0, 90, 90, 0), 20, 0.045, 0.005),
        ((0, 90, 0), 4, 0.50, 0.11),
        ((0, 90, 0), 10, 0.15, 0.01),
    ],
)
def test_warping_brings_stress_along_fibres_to_that_of_elasticity(
    degrees: tuple[int, ...], ratio: int, without: float, within: float
) -> None:
    """Pagano's plates, at their upper faces."""
    shell, warped, exact = laid(CARBON, 1 / ratio, degrees)[:, -1, 0]
    assert 1 - shell / exact == pytest.approx(without, abs=0.01)
    assert warped / exact == pytest.approx(1, abs=within)


@pytest.mark.parametrize(("ratio", "without"), [(4, 0.53), (10, 0.143)])
def test_warping_brings_stress_in_the_faces_of_a_sandwich_to_that_of_elasticity(ratio: int, without: float) -> None:
    """Pagano's sandwich: along its fibres, across them and in shear."""
    h = 1 / ratio
    plies = tuple(Ply(each, t * h, 0.0) for each, t in ((CARBON, 0.1), (CORE, 0.4), (CORE, 0.4), (CARBON, 0.1)))
    shell, warped, exact = ply_stresses(Laminate(plies), sandwich(h), (0, 0, 0, 0))[:, 3]
    assert 1 - shell[0] / exact[0] == pytest.approx(without, abs=0.01)
    assert warped[:2] / exact[:2] == pytest.approx(1, abs=0.012)
    assert warped[2] / exact[2] == pytest.approx(1, abs=0.055)


@pytest.mark.parametrize(("ratio", "element"), [(4, "quadrilateral"), (10, "triangle")])
def test_half_waves_of_a_plate_are_its_width(ratio: int, element: str) -> None:
    """A half sine each way has a/√2 in all; a motion in the plane has none."""
    plate = QuarterPlate(8, stack(CARBON, 1 / ratio, 0, 90), element)
    shapes = np.stack([plate.bend(), np.random.default_rng(1).normal(size=(len(plate.fe.x), 3)) * [1, 1, 0]], axis=2)
    assert half_waves(plate.fe.discretisation, shapes) == pytest.approx([ratio / math.sqrt(2), math.inf], rel=5e-3)


@pytest.mark.parametrize("across", [1, 4, 40])
def test_half_waves_along_a_strip_of_triangles_are_its_length_however_thin_these_are(across: int) -> None:
    x, cells = unit_grid(20, across, "triangle")
    space = Discretisation(shell_mesh(np.pad(x * [1, 0.2], ((0, 0), (0, 1))), cells, 0.01), 1)
    shape = np.zeros((len(space.x), 3, 1))
    shape[:, 2, 0] = np.sin(np.pi * space.x[:, 0])
    assert half_waves(space, shape) == pytest.approx([100.0], rel=5e-3)


@pytest.mark.parametrize("seed", range(8))
def test_what_is_stated_of_plane_sections_holds_elasticity(seed: int) -> None:
    """Twice the error of `ModelErrors`: of random moduli, plies and lengths from 4 to 20 thicknesses."""
    rng = np.random.default_rng(seed)
    lamina = Lamina(10 ** rng.uniform(9.3, 10.5), 1e9, 0.25, *(1e9 * rng.uniform(0.2, 0.6, 3)), 1500.0)
    degrees = tuple(int(90 * turned) for turned in rng.integers(0, 2, rng.integers(2, 6)))
    shell, warped, exact = laid(lamina, 1 / rng.uniform(4, 20), degrees)
    change = np.abs(warped - shell).max(axis=0) / np.maximum(warped.max(axis=0), shell.max(axis=0))
    stated = 2 * np.hypot(change, change.max())
    true = np.abs(shell - exact).max(axis=0) / exact.max(axis=0)
    assert (true < stated + OF_MESH).all(), (true, stated)
    assert stated[0] < 6 * true[0] + OF_MESH, (true, stated)
