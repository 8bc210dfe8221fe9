"""Stress by patches of elements: exact where the fitted polynomials hold the stress."""

import numpy as np
import pytest

from fmd.fem.model import FEModel
from fmd.recovery.patch_stress import patch_stress
from fmd.recovery.stress import point_stress


def bent(x: np.ndarray) -> np.ndarray:
    """Pure bending about z with curvature 1, nu = 0.3: σ_xx = E y, nothing else."""
    nu, (X, Y, Z) = 0.3, x.T
    return np.stack([X * Y, -(X**2 + nu * (Y**2 - Z**2)) / 2, -nu * Y * Z], axis=1)


@pytest.mark.parametrize(
    "element", [("hex20", "hexahedron", 2), ("tet10", "tetra", 2)], indirect=True, ids=lambda e: e[0]
)
def test_linear_stress_comes_back_at_corners_and_inside(box_mesh, steel, element) -> None:
    from fmd.fem.assembly import assemble

    fe = assemble(box_mesh(element.cell_type, (3, 2, 1)), 2, steel)
    u = bent(fe.x)[:, :, None]
    for node in (0, len(fe.x) // 2, int(np.argmax(fe.x.sum(axis=1)))):
        stress = patch_stress(fe.discretisation, steel, u, node)[:, 0]
        exact = np.array([steel.E * fe.x[node, 1], 0, 0, 0, 0, 0])
        assert np.abs(stress - exact).max() < 1e-9 * steel.E


def test_uniform_stress_comes_back_from_any_element(distorted: FEModel) -> None:
    strain = np.array([[1.0, 0.2, 0.0], [0.2, -0.5, 0.1], [0.0, 0.1, 0.3]])
    u = (distorted.x @ strain)[:, :, None]
    voigt = [strain[0, 0], strain[1, 1], strain[2, 2], 2 * strain[1, 2], 2 * strain[0, 2], 2 * strain[0, 1]]
    exact, space = distorted.material.stiffness @ voigt, distorted.discretisation
    by_patch = patch_stress(space, distorted.material, u, 5)[:, 0]
    at_point = point_stress(space, distorted.material, u, np.array([[0.3, 0.4, 0.2]]))[0, :, 0]
    assert np.abs(by_patch - exact).max() < 1e-9 * np.abs(exact).max()
    assert np.abs(at_point - exact).max() < 1e-9 * np.abs(exact).max()
