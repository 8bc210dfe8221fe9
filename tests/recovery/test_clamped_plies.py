"""Plies beside a clamp: first-order theory beside plane elasticity of a strip that is held there and sheared."""

import numpy as np
import pytest
import skfem
from skfem.helpers import ddot, sym_grad

from fmd.core.arrays import Array
from fmd.fem.laminate import Laminate
from tests.fem.test_laminate import CARBON, stack
from tests.recovery.test_angle_plies import elastic

FROM_CLAMP = np.array([0.5, 1.0, 2.0])  # over the thickness
N_PLY = 3  # elements through a ply


def elasticity(laminate: Laminate) -> tuple[float, Array]:
    """Return deflection and outer stress along x of a strip of unit length, which doesn't stretch across."""
    h = laminate.thickness
    z = np.append(0.0, np.cumsum(np.repeat([ply.thickness / N_PLY for ply in laminate.plies], N_PLY)))
    near = h * np.array([0, 0.02, 0.05, 0.1, 0.18, 0.28, 0.4, 0.5, 0.7, 0.85, 1.0, 1.25, 1.5, 1.75, 2.0, 2.5])
    mesh = skfem.MeshQuad.init_tensor(np.append(near, np.linspace(3 * h, 1.0, 15)), z)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementQuad2()), intorder=4)
    layers = np.searchsorted(z, mesh.p[1, mesh.t].mean(axis=0)) - 1
    C = np.stack([elastic(ply)[np.ix_([0, 2, 4], [0, 2, 4])] for ply in laminate.plies])[layers // N_PLY]

    def stress(gradient: Array, of: Array) -> Array:
        strain = np.stack([gradient[0, 0], gradient[1, 1], gradient[0, 1] + gradient[1, 0]])
        xx, zz, xz = np.einsum("eij,jeq->ieq", of, strain)
        return np.array([[xx, xz], [xz, zz]])

    K = skfem.BilinearForm(lambda u, v, _: ddot(stress(u.grad, C), sym_grad(v))).assemble(basis)
    end = skfem.FacetBasis(mesh, basis.elem, facets=mesh.facets_satisfying(lambda x: np.abs(x[0] - 1) < 1e-9))
    f = skfem.LinearForm(lambda v, _: v[1] / h).assemble(end)
    u = skfem.solve(*skfem.condense(K, f, D=basis.get_dofs(lambda x: np.abs(x[0]) < 1e-9)))
    places = np.stack([h * FROM_CLAMP, np.full(len(FROM_CLAMP), h * (1 - 1e-6))])
    cells = mesh.element_finder()(*places)
    X = mesh.mapping().invF(places[:, :, None], tind=cells)
    shapes = [basis.elem.gbasis(mesh.mapping(), X, k, tind=cells)[0].grad for k in range(basis.Nbfun)]
    gradient = sum(np.asarray(own) * u[basis.element_dofs[k, cells]][:, None] for k, own in enumerate(shapes))
    return float(f @ u), stress(gradient, C[cells])[0, 0, :, 0]


@pytest.mark.parametrize(
    ("ratio", "deflection", "lost"),  # how much too large and too small first-order theory is
    [(4, 0.0393, (0.218, 0.128, 0.049)), (10, 0.0053, (0.093, 0.046, 0.012)), (20, 0.0009, (0.047, 0.022, 0.005))],
)
def test_stress_beside_a_clamp_is_short_of_elasticitys_as_the_page_says(
    ratio: int, deflection: float, lost: tuple[float, ...]
) -> None:
    laminate = stack(CARBON, 1 / ratio, 0, 90, 90, 0)
    h, bending = laminate.thickness, laminate.plane[2][0, 0]
    w, sigma = elasticity(laminate)
    assert (1 / (3 * bending) + 1 / laminate.shear[0, 0]) / w - 1 == pytest.approx(deflection, abs=3e-4)
    plain = -(1 - h * FROM_CLAMP) / bending * h / 2 * laminate.stiffnesses[-1][0, 0]
    assert 1 - plain / sigma == pytest.approx(lost, abs=5e-3)
