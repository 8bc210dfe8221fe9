"""Strain of displacement fields in chosen elements, enhanced in linear hexahedra, and its stress by Hooke's law.

By enhanced assumed strain linear hexahedra bend without locking: each adds strains of its own, ``ε = B u + G α``, to
those of its nodes' displacements. The nine columns of G are the strains of three internal displacements ``1 − ξ_k²``
along each axis, with the gradients
``(det J₀ / det J) J₀⁻ᵀ ∇_ξ (1 − ξ_k²)``, where J₀ is the Jacobian in the element's middle: Taylor, Beresford & Wilson
(Int J Num Meth Eng 10, 1976), and the same space as the nine modes of Simo & Rifai (Int J Num Meth Eng 29, 1990). With
this correction they do no work under constant stress, as the patch test demands. Where a material is nearly
incompressible, three volume strains ξη, ηζ, ζξ are added (Andelfinger & Ramm, Int J Num Meth Eng 36, 1993).

The parameters α minimise the element's own energy, ``H α = −Γ u`` with ``H = ∫ Gᵀ C G dV`` and ``Γ = ∫ Gᵀ C B dV``, and
leave the stiffness ``∫ Bᵀ C B dV − Γᵀ H⁻¹ Γ`` on the same nodes.
"""

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.memory import CACHED_NUMBERS
from fmd.core.limits.mesh import NEARLY_INCOMPRESSIBLE
from fmd.fem.elements import inverse_and_determinant
from fmd.fem.material import AnyElastic, AnyMaterial, Material, batches
from fmd.fem.space import Discretisation

_COMPONENTS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
TENSOR = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])  # places of a tensor's components in a vector of six
VOIGT = np.array([0, 4, 8, 5, 2, 1])  # places of these in a flat tensor
DOUBLED = np.array([1.0, 1, 1, 2, 2, 2])  # a vector of strain over the tensor's components
HALVED = 1 / DOUBLED[TENSOR]


def condensed_stiffness(space: Discretisation, material: AnyMaterial, elements: IntArray) -> Array:
    """Return the stiffness of elements without their internal parameters, shape (n_elements, 3 n, 3 n) [N/m].

    The matrices are symmetric to the last bit.
    """
    n = 3 * space.element_nodes.shape[1]
    condensed = np.empty((len(elements), n, n))
    for own, mine in material.over(elements):
        root = _energy_root(space, own, elements[mine])
        # NumPy multiplies a matrix by its own transpose with BLAS's syrk: symmetric to the last bit
        K = root.swapaxes(1, 2) @ root
        Y = np.linalg.inv(np.linalg.cholesky(K[:, n:, n:])) @ K[:, n:, :n]
        condensed[mine] = K[:, :n, :n] - Y.swapaxes(1, 2) @ Y
    return condensed


def enhanced_strains(
    space: Discretisation, material: AnyMaterial, shapes: Array, X: Array, elements: IntArray
) -> Array:
    """Return the strains ``B u + G α`` of displacement fields; parameters and shape are those of `strain.strains`."""
    u = shapes[space.element_nodes[elements]].reshape(len(elements), 3 * space.element_nodes.shape[1], shapes.shape[2])
    strain = np.empty((len(elements), X.shape[1], 6, u.shape[2]))
    for own, mine in material.over(elements):
        root = _energy_root(space, own, elements[mine])
        compatible, internal = root[..., : u.shape[1]], root[..., u.shape[1] :].swapaxes(1, 2)
        alpha = np.linalg.solve(internal @ internal.swapaxes(1, 2), -internal @ (compatible @ u[mine]))
        B, _ = _strain_matrix(space, own, X, elements[mine])
        both = B.reshape(len(B), -1, B.shape[3]) @ np.concatenate([u[mine], alpha], axis=1)
        strain[mine] = both.reshape(*B.shape[:3], -1).swapaxes(1, 2)
    return strain


def _energy_root(space: Discretisation, material: AnyElastic, elements: IntArray) -> Array:
    """Return R with ``|R (u, α)|²`` twice the strain energy, shape (n_elements, n_rows, n_local + n_internal)."""
    summed = material.summed
    X, w = space.kind.quadrature(space.kind.stiffness_order)
    B, det = _strain_matrix(space, summed, X, elements)
    B *= np.sqrt(det * w)[:, None, :, None]
    return summed.energy_root(space, X, elements, B).reshape(len(B), -1, B.shape[3])


def _strain_matrix(space: Discretisation, material: AnyElastic, X: Array, elements: IntArray) -> tuple[Array, Array]:
    """Return [B, G] and Jacobian determinants at points X as the kind of element has them, B alone of plain strain."""
    if space.kind.strain_matrix is not None:
        return space.kind.strain_matrix(space, material, X, elements)
    if not space.is_enhanced:
        g, det = space.gradients(X, elements)
        return _by_gradients(g), det
    assert isinstance(material, Material)  # layers are of shells
    return enhanced_matrix(space, material, X, elements)


def _by_gradients(g: Array, volumes: int = 0) -> Array:
    """Return B (n_elements, 6, n_q, 3 n + volumes) of gradients (n_elements, n_q, n, 3), zero in its last columns."""
    n_elements, n_q, n, _ = g.shape
    B = np.zeros((n_elements, 6, n_q, 3 * n + volumes))
    for row, (a, b) in enumerate(_COMPONENTS):
        B[:, row, :, a : 3 * n : 3] = g[..., b]
        B[:, row, :, b : 3 * n : 3] = g[..., a]
    return B


def enhanced_matrix(space: Discretisation, material: Material, X: Array, elements: IntArray) -> tuple[Array, Array]:
    """Return [B, G] and Jacobian determinants at points X of hexahedra.

    Shapes (n_elements, 6, n_q, 33 or 36), (n_elements, n_q).
    """
    g, det = space.gradients(X, elements)
    xi = 2 * X - 1
    inverse, det_middle = inverse_and_determinant(space.jacobians(np.full((3, 1), 0.5), elements))
    scale = (det_middle / det)[:, :, None]
    g = np.concatenate([g, (scale * xi.T)[..., None] * inverse], axis=2)
    volumes = 3 if material.nu > NEARLY_INCOMPRESSIBLE else 0
    B = _by_gradients(g, volumes)
    if volumes:
        B[:, :3, :, -volumes:] = (scale * (xi * np.roll(xi, -1, axis=0)).T)[:, None]
    return B, det


def strains(space: Discretisation, material: AnyMaterial, shapes: Array, X: Array, elements: IntArray) -> Array:
    """Return the strains (n_elements, n_q, 6, n) of displacement fields (n_nodes, 3, n) at reference points X (3, n_q).

    Components are xx, yy, zz, 2yz, 2xz, 2xy [1/m per unit of the shape]. Enhanced strains depend on the material.
    """
    if space.is_enhanced:
        return enhanced_strains(space, material, shapes, X, elements)
    local = space.element_nodes[elements]
    g, _ = space.gradients(X, elements)
    u = shapes[local].reshape(len(elements), 1, local.shape[1], -1)
    du = (g.swapaxes(2, 3) @ u).reshape(len(elements), X.shape[1], 3, 3, -1)  # du[e, q, j, i] = ∂u_i/∂x_j
    return np.stack(
        [du[:, :, 0, 0], du[:, :, 1, 1], du[:, :, 2, 2]]
        + [du[:, :, a, b] + du[:, :, b, a] for a, b in ((1, 2), (0, 2), (0, 1))],
        axis=2,
    )


def stresses(space: Discretisation, material: AnyMaterial, shapes: Array, X: Array, elements: IntArray) -> Array:
    """Return the stresses xx, yy, zz, yz, xz, xy of fields [Pa]; parameters and shape are those of `strains`."""
    strain = strains(space, material, shapes, X, elements)
    stress = np.empty_like(strain)
    for own, mine in material.over(elements):
        stress[mine] = own.stress(space, X, elements[mine], strain[mine])
    return stress


def elastic_forces(space: Discretisation, material: AnyMaterial, shapes: Array) -> Array:
    """Return the forces ``K u`` of displacement fields, both (n_nodes, 3, n), by their strain.

    A product with the matrix K has the round-off of elements' stiffest motions, 1e-9 to 1e-7 of what a slender body's
    lowest modes have; strain, in which rigid motions cancel element by element, has less than 1e-12.
    """
    n = shapes.shape[2]
    u = shapes.reshape(len(shapes), -1)
    found = np.zeros_like(u)
    n_elements, n_local = space.element_nodes.shape
    strains_each = 6 * space.kind.quadrature(space.kind.stiffness_order)[1].size
    for own, elements in batches(material, n_elements, 1 + CACHED_NUMBERS // (strains_each * (n + 3 * n_local))):
        nodes = space.element_nodes[elements]
        apart = u[nodes]
        apart -= apart[:, :1]  # translations cancel to the last bit
        apart = apart.reshape(len(nodes), -1, n)
        if space.is_enhanced:
            root = _energy_root(space, own, elements)
            compatible, internal = np.split(root, [3 * n_local], axis=2)
            across = internal.swapaxes(1, 2)
            compatible = compatible - internal @ np.linalg.solve(across @ internal, across @ compatible)
            f = compatible.swapaxes(1, 2) @ (compatible @ apart)
        else:
            X, w = space.kind.quadrature(space.kind.stiffness_order)
            B, det = _strain_matrix(space, own, X, elements)
            B = B.reshape(len(nodes), -1, 3 * n_local)
            stress = own.stress(space, X, elements, (B @ apart).reshape(len(nodes), 6, -1, n).swapaxes(1, 2))
            stress *= (det * w)[:, :, None, None]
            f = B.swapaxes(1, 2) @ stress.swapaxes(1, 2).reshape(len(nodes), -1, n)
        order = nodes.argsort(axis=None)
        own_nodes, first = np.unique(nodes.ravel()[order], return_index=True)
        entries = np.ones(order.size), order, np.append(first, order.size)
        found[own_nodes] += sp.csr_array(entries, shape=(len(first), order.size)) @ f.reshape(order.size, -1)
    return found.reshape(shapes.shape)
