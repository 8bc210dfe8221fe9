"""Element matrices by batched dense products, and their sum into sparse matrices.

For an isotropic material the element stiffness follows from one array of gradient products
``T[ai, bj] = Σ_q w_q g_ai g_bj`` (g_ai: derivative of shape function a along axis i) as
``K[ai, bj] = λ T[ai, bj] + μ T[aj, bi] + μ δ_ij Σ_k T[ak, bk]``, and one dense product of size
(3 n_local × n_q) makes T for each element.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from pipeline.checks import AccuracyError, Array, IntArray
from pipeline.fem.elements import shape_functions
from pipeline.fem.material import Material
from pipeline.fem.mesh import SolidMesh
from pipeline.fem.model import Discretisation, FEModel

_CHUNK = 1024  # elements at a time: their gradients stay in the processor's cache


def assemble(mesh: SolidMesh, order: int, material: Material) -> FEModel:
    """Assemble stiffness and consistent mass of a solid.

    Parameters
    ----------
    mesh : SolidMesh
        The part.
    order : int
        Order of the displacement, 1 or 2.
    material : Material
        The same everywhere.

    Raises
    ------
    AccuracyError
        The Jacobian is not positive at every quadrature point.
    """
    space = Discretisation(mesh, order)
    nodes = space.element_nodes
    n_elements, n_local = nodes.shape
    K = np.empty((n_elements, n_local, n_local, 3, 3))
    m = np.empty((n_elements, n_local, n_local))
    for start in range(0, n_elements, _CHUNK):
        chunk = slice(start, start + _CHUNK)
        K[chunk] = _element_stiffness(space, material, chunk)
        m[chunk] = _element_mass(space, material.rho, chunk)
    structure = BlockStructure(nodes, len(space.x))
    return FEModel(space, material, structure.sum_blocks(K), structure.sum_scalars(m))


def gradients(space: Discretisation, X: Array, elements: slice | IntArray) -> tuple[Array, Array]:
    """Spatial gradients of the shape functions and Jacobian determinants at reference points X (3, n_q).

    Returns
    -------
    g : ndarray, shape (n_elements, n_q, n_local, 3) [1/m]
    det : ndarray, shape (n_elements, n_q) [m³]
    """
    _, dN = shape_functions(space.kind.element, X)
    J = space.jacobians(X, elements)
    return dN.transpose(2, 0, 1) @ np.linalg.inv(J), volume_ratio(J)


def volume_ratio(J: Array) -> Array:
    """Determinants of the Jacobians J (n_elements, n_q, 3, 3), positive: scikit-fem's hexahedra are left-handed."""
    det = np.linalg.det(J)
    det *= np.sign(np.median(det)) or 1.0
    if det.min() <= 0:
        bad = np.count_nonzero((det <= 0).any(axis=1))
        raise AccuracyError(f"{bad} elements are inverted (Jacobian ≤ 0 at a quadrature point)")
    return np.asarray(det)


def _element_stiffness(space: Discretisation, material: Material, elements: slice) -> Array:
    X, w = space.kind.quadrature(space.kind.stiffness_order)
    g, det = gradients(space, X, elements)
    n_elements, n_q, n_local, _ = g.shape
    g *= np.sqrt(det * w)[:, :, None, None]
    flat = g.reshape(n_elements, n_q, 3 * n_local)
    T = (flat.transpose(0, 2, 1) @ flat).reshape(n_elements, n_local, 3, n_local, 3).transpose(0, 1, 3, 2, 4)
    T = 0.5 * (T + T.transpose(0, 2, 1, 4, 3))  # symmetric to the last bit
    lam, mu = material.lame
    K = lam * T + mu * T.swapaxes(3, 4)
    K[..., range(3), range(3)] += mu * np.einsum("eabkk->eab", T)[..., None]
    return K


def _element_mass(space: Discretisation, rho: float, elements: slice) -> Array:
    X, w = space.kind.quadrature(space.kind.mass_order)
    N, _ = shape_functions(space.kind.element, X)
    det = volume_ratio(space.jacobians(X, elements))
    products = (N[:, None] * N[None]).reshape(-1, w.size)
    return (rho * (det * w) @ products.T).reshape(-1, len(N), len(N))


class BlockStructure:
    """The sparsity pattern of node pairs that share an element, and the sums of element entries into it."""

    def __init__(self, element_nodes: IntArray, n_nodes: int) -> None:
        n_local = element_nodes.shape[1]
        key = np.repeat(element_nodes, n_local, axis=1) * n_nodes + np.tile(element_nodes, (1, n_local))
        self._order = np.argsort(key.ravel(), kind="stable")
        key = key.ravel()[self._order]
        self._start = np.flatnonzero(np.r_[True, key[1:] != key[:-1]])
        row, self._column = np.divmod(key[self._start], n_nodes)
        self._pointer = np.r_[0, np.cumsum(np.bincount(row, minlength=n_nodes))]
        self._n = n_nodes

    def sum_scalars(self, entries: Array) -> sp.csr_array:
        """Sum (n_elements, n_local, n_local) entries into an (n_nodes, n_nodes) matrix."""
        data = np.add.reduceat(entries.ravel()[self._order], self._start)
        return sp.csr_array((data, self._column, self._pointer), shape=(self._n, self._n))

    def sum_blocks(self, entries: Array) -> sp.csr_array:
        """Sum (n_elements, n_local, n_local, 3, 3) entries into a (3 n_nodes, 3 n_nodes) matrix."""
        data = np.add.reduceat(entries.reshape(-1, 3, 3)[self._order], self._start, axis=0)
        n = 3 * self._n
        return sp.csr_array(sp.bsr_array((data, self._column, self._pointer), shape=(n, n)).tocsr())
