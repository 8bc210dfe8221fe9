"""Geometric stiffness by a static stress, and the strain that is quadratic in a displacement.

Under a stress σ a displacement u takes the additional energy ``½ ∫ σ_ab ∂_a u·∂_b u dV``, alike for its three
components. So the matrix is ``k ⊗ 1₃`` with a number ``k_ij = ∫ σ_ab ∂_a N_i ∂_b N_j dV`` for each pair of nodes. The
stress is that of enhanced strain where elements have it, the gradients are those of the nodes' displacements alone; so
the matrix turns the nodes' forces as the body turns, ``k (θ × x) = θ × f``.

Green's strain of a displacement u is ``ε(u) + ½ ∂_a u·∂_b u``. A body that is free to shorten answers to the second
part by a small displacement v, which takes nearly all of its energy away; what is left stretches the body (von Kármán;
Bathe, Finite Element Procedures, section 6.2).
"""

from collections.abc import Sequence
from functools import singledispatch

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array
from fmd.core.limits.memory import STRESSED_AT_ONCE
from fmd.fem.joined import AnySpace
from fmd.fem.material import AnyMaterial, batches
from fmd.fem.model import FEModel
from fmd.fem.space import Discretisation
from fmd.fem.strain import DOUBLED, TENSOR, VOIGT, stresses


def geometric_stiffness(fe: FEModel, u: Array) -> list[sp.csr_array]:
    """Return geometric stiffness of the linear stress of each of k displacements (n_nodes, 3, k) [m].

    It is assembled from that of elements, as scalar matrices [N/m] in the pattern of ``fe.m``, each for all three
    components of a displacement.
    """
    each = [_element_sums(own.space, own.material(fe.material), own.of_shapes(u)) for own in fe.discretisation.members]
    n = len(fe.discretisation.x)
    return [_on_all(fe.discretisation, [found[k] for found in each], n) for k in range(u.shape[2])]


def _element_sums(space: Discretisation, material: AnyMaterial, u: Array) -> list[sp.csr_array]:
    """Return `geometric_stiffness` of the elements of one kind, at their own points."""
    n_elements, n_local = space.element_nodes.shape
    entries = np.empty((n_elements, n_local, n_local, u.shape[2]))
    line = space.mesh.midsurface
    forced = space if line is None else space.strained_by(line.forced())
    for own, part in batches(material, n_elements, STRESSED_AT_ONCE):
        X, w = space.kind.quadrature(space.kind.stiffness_order)
        g, det = space.gradients(X, part)
        stress = stresses(forced, own.summed, u, X, part)[:, :, TENSOR] * (det * w)[..., None, None, None]
        flat = g.swapaxes(1, 2).reshape(len(g), n_local, -1)
        for k in range(u.shape[2]):
            pulled = (g @ stress[..., k]).swapaxes(1, 2).reshape(flat.shape)
            entries[part, ..., k] = pulled @ flat.swapaxes(1, 2)
    pairs = space.structure.sums(entries)
    return [space.structure.scalar_matrix(pairs[:, k].copy()) for k in range(u.shape[2])]


def _on_all(space: AnySpace, matrices: Sequence[sp.csr_array], n: int) -> sp.csr_array:
    """Return the matrix (n, n) of all points by those of the members' own."""
    if len(matrices) == 1 and matrices[0].shape[0] == n:
        return matrices[0]
    whole = sp.csr_array((n, n))
    for own, matrix in zip(space.members, matrices, strict=True):
        entries = sp.coo_array(matrix)
        row, column = entries.coords
        whole = whole + sp.csr_array((entries.data, (own.first + row, own.first + column)), shape=(n, n))
    return sp.csr_array(whole)


@singledispatch
def reduced_geometric_stiffness(fe: FEModel, u: Array, shapes: Array) -> Array:
    """Geometric stiffness of shapes, ``K_G[j, l] = ∫ σ_ab ∂_a φ_j·∂_b φ_l dV``, for the stress of each field u.

    Fields (n_nodes, 3, k) [m] stiffen shapes (n_nodes, 3, n); (k, n, n) is symmetric [N/m per unit of the shapes
    squared].
    """
    matrices = geometric_stiffness(fe, u)
    return energies(matrices, shapes[: matrices[0].shape[0]])  # nodes of elements come first


def energies(matrices: Sequence[sp.csr_array], shapes: Array) -> Array:
    """Return energies (k, n, n) of shapes (…, n) by matrices, whose rows are unknowns, or nodes for all directions."""
    n, rows = shapes.shape[-1], matrices[0].shape[0]
    flat = shapes.reshape(rows, -1)
    K = np.array([flat.reshape(-1, n).T @ (k_G @ flat).reshape(-1, n) for k_G in matrices])
    return np.asarray(0.5 * (K + K.swapaxes(1, 2)))


def quadratic_strain_load(fe: FEModel, u: Array) -> tuple[Array, float]:
    """Return the load on a small displacement by the quadratic strain of another, u (n_nodes, 3) [m], and its energy.

    The load f (n_nodes, 3) has ``f·v = ∫ C E : ε(v) + σ(u) : ∂u·∂v``, with ``E = ½ ∂u·∂u`` [N], and the energy of that
    strain is ``½ ∫ E : C E`` [J].
    """
    n, f, energy = len(fe.discretisation.x), np.zeros_like(u), 0.0
    f[:n] = geometric_stiffness(fe, u[:, :, None])[0] @ u[:n]
    for member in fe.discretisation.members:
        space, own_u, own_f = member.space, member.of_shapes(u), member.of_shapes(f)
        for material, part in batches(member.material(fe.material), len(space.element_nodes), STRESSED_AT_ONCE):
            own = material.summed
            X, w = space.kind.quadrature(space.kind.mass_order)
            g, det = space.gradients(X, part)
            nodes = space.element_nodes[part]
            slopes = np.einsum("eqia,eib->eqab", g, own_u[nodes], optimize=True)  # ∂_a u_b
            E = 0.5 * slopes @ slopes.swapaxes(2, 3)
            if space.kind.stressed is not None:  # directors don't stretch: their second-order motion takes it up
                E = space.kind.stressed(E, space.jacobians(X, part), own, part)
            strain = E.reshape(*E.shape[:2], 9)[..., VOIGT] * DOUBLED
            stress = own.stress(space, X, part, strain[..., None])[:, :, TENSOR, 0]
            volume = np.abs(det) * w
            energy += 0.5 * float(np.einsum("eqab,eqab,eq->", stress, E, volume, optimize=True))
            np.add.at(own_f, nodes, np.einsum("eqia,eqab,eq->eib", g, stress, volume, optimize=True))
    return f, energy


def membrane_ratio(fe: FEModel, u: Array, v: Array, f: Array, energy: float) -> float:
    """Return how much stiffer stretching makes a body at a displacement, relative to its linear stiffness.

    Of the displacement u `quadratic_strain_load` gives f and energy; v is the static response to ``−f``, (n_nodes, 3)
    [m].
    """
    flat = u.ravel()
    linear = 0.5 * float(flat @ (fe.K @ flat))
    left = energy + 0.5 * float((f * v).sum())
    return max(2 * left / linear, 0.0) if linear else 0.0
