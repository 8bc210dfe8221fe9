"""Hooke's law, and materials of single elements."""

import numpy as np
import pytest

from fmd.fem.material import Material, MaterialOfElements


@pytest.mark.parametrize(
    ("E", "nu", "rho"),
    [
        (0, 0.3, 1),
        (-1, 0.3, 1),
        (1, 0.5, 1),
        (1, -1, 1),
        (1, 0.3, 0),
        (np.nan, 0.3, 1),
        (1, np.nan, 1),
        (1, 0.3, np.nan),
    ],
)
def test_what_is_not_a_material_is_refused(E: float, nu: float, rho: float) -> None:
    with pytest.raises(ValueError, match=rf"not a material: E = {E} Pa, nu = {nu}, rho = {rho} kg/m³"):
        Material(E, nu, rho)


@pytest.mark.parametrize("nu", [-0.5, 0.0, 0.34, 0.49])
def test_a_stretched_bar_obeys_youngs_modulus_and_poissons_ratio(nu: float) -> None:
    E = 72.2e9
    strain = np.array([1, -nu, -nu, 0, 0, 0]) * 1e-3
    assert Material(E, nu, 1.0).stiffness @ strain == pytest.approx([E * 1e-3, 0, 0, 0, 0, 0], rel=1e-12, abs=1e-4)


@pytest.mark.parametrize("nu", [-0.5, 0.0, 0.34, 0.49])
def test_shear_and_bulk_moduli_follow_from_young_and_poisson(nu: float) -> None:
    # Landau & Lifshitz, Theory of Elasticity, §5: μ = E/2(1+ν), K = E/3(1−2ν)
    material = Material(200e9, nu, 1.0)
    shear, bulk = 200e9 / (2 * (1 + nu)), 200e9 / (3 * (1 - 2 * nu))
    sheared, swollen = (material.stiffness @ strain for strain in ([0, 0, 0, 1, 0, 0], [1, 1, 1, 0, 0, 0]))
    assert sheared == pytest.approx([0, 0, 0, shear, 0, 0], rel=1e-14)
    assert swollen == pytest.approx([3 * bulk] * 3 + [0] * 3, rel=1e-13)


def test_materials_of_elements_come_one_by_one_with_their_elements() -> None:
    steel, aluminium, unused = Material(210e9, 0.3, 7800.0), Material(70e9, 0.33, 2700.0), Material(1e9, 0.4, 1000.0)
    several = MaterialOfElements((steel, unused, aluminium), np.array([0, 2, 2, 0, 2]))
    assert [(own, list(mine)) for own, mine in several.over(slice(1, 4))] == [(steel, [2]), (aluminium, [0, 1])]
    assert [(own, list(mine)) for own, mine in several.over(np.array([1, 4]))] == [(aluminium, [0, 1])]
    ((own, every),) = steel.over(slice(2, 5))
    assert (own, every) == (steel, slice(None))
