"""Warping of sections of laminates: stress of plies by three-dimensional elasticity, and what is stated of it."""

import math

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.fem.laminate import Lamina
from fmd.fem.layered import Layered
from fmd.recovery.plies import modal_ply_stress
from fmd.recovery.ply_warping import warped_ply_stress
from tests.fem.test_laminate import CARBON, QuarterPlate, elastic_stress, stack

N = 12
OF_MESH = 0.008  # share of a stress, of 12 elements along a quarter of a wave


def ply_stresses(lamina: Lamina, h: float, degrees: tuple[int, ...]) -> Array:
    """Return sizes of 11, 22 and 12 at the upper faces of plies of a plate under a half sine of pressure each way.

    Shape (3, n_plies, 3): of the shell, with the warping of sections, and by three-dimensional elasticity.
    """
    plate = QuarterPlate(N, stack(lamina, h, *degrees))
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
        own = elastic_stress(lamina, h, degrees, ply)
        exact.append([own["yy"], own["xx"], own["xy"]] if turned else [own["xx"], own["yy"], own["xy"]])
    return np.abs(np.array([*found, exact]))


@pytest.mark.parametrize(("ratio", "without", "within"), [(4, 0.49, 0.07), (10, 0.14, 0.005), (20, 0.045, 0.005)])
def test_warping_brings_stress_along_fibres_to_that_of_elasticity(ratio: int, without: float, within: float) -> None:
    """Pagano's plate 0/90/90/0, at its upper face."""
    shell, warped, exact = ply_stresses(CARBON, 1 / ratio, (0, 90, 90, 0))[:, 3, 0]
    assert 1 - shell / exact == pytest.approx(without, abs=0.01)
    assert warped / exact == pytest.approx(1, abs=within)


@pytest.mark.parametrize("seed", range(8))
def test_what_is_stated_of_plane_sections_holds_elasticity(seed: int) -> None:
    """Twice the error of `ModelErrors`: of random moduli, plies and lengths from 4 to 20 thicknesses."""
    rng = np.random.default_rng(seed)
    lamina = Lamina(10 ** rng.uniform(9.3, 10.5), 1e9, 0.25, *(1e9 * rng.uniform(0.2, 0.6, 3)), 1500.0)
    degrees = tuple(int(90 * turned) for turned in rng.integers(0, 2, rng.integers(2, 6)))
    shell, warped, exact = ply_stresses(lamina, 1 / rng.uniform(4, 20), degrees)
    change = np.abs(warped - shell).max(axis=0) / np.maximum(warped.max(axis=0), shell.max(axis=0))
    stated = 2 * np.hypot(change, change.max())
    true = np.abs(shell - exact).max(axis=0) / exact.max(axis=0)
    assert (true < stated + OF_MESH).all(), (true, stated)
    assert stated[0] < 6 * true[0] + OF_MESH, (true, stated)
