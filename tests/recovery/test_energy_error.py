"""The energy of a mode's error against what its eigenvalue really is too high by, by a much finer mesh."""

import numpy as np
import pytest

from fmd.fem.assembly import assemble
from fmd.fem.model import FEModel
from fmd.recovery.patch_stress import energy_errors
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.modes import EigenPairs

SIZES = (0.3, 0.04, 0.02)


def solved(box_mesh, steel, cell_type, divisions, order) -> tuple[FEModel, EigenPairs]:
    fe = assemble(box_mesh(cell_type, divisions, SIZES), order, steel)
    return fe, FreeBodySolver(fe).modes(4)


@pytest.mark.parametrize(
    ("cell_type", "divisions", "order"),
    [("hexahedron", (20, 4, 2), 1), ("hexahedron", (10, 2, 1), 2), ("tetra", (12, 2, 1), 2)],
)
def test_it_is_within_a_factor_of_three_of_the_eigenvalues_error(box_mesh, steel, cell_type, divisions, order) -> None:
    fe, pairs = solved(box_mesh, steel, cell_type, divisions, order)
    _, exact = solved(box_mesh, steel, "hexahedron", (30, 4, 3), 2)
    true = pairs.omega**2 - exact.omega**2
    stated = np.diag(energy_errors(fe.discretisation, steel, pairs.shapes))
    assert (stated > true / 3).all()
    assert (stated < 3 * true).all()


def test_uniform_stress_has_no_error(distorted: FEModel) -> None:
    u = (distorted.x @ np.diag([1.0, -0.3, 0.2]))[:, :, None]
    energy = u.ravel() @ (distorted.K @ u.ravel())
    assert energy_errors(distorted.discretisation, distorted.material, u)[0, 0] < 1e-20 * energy
