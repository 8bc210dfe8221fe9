"""Assembly of stiffness and mass: element matrices by batched dense products, summed into sparse ones.

For an isotropic material the stiffness follows from one array of gradient products
``T[ai, bj] = ∫ g_ai g_bj dV`` (g_ai: derivative of shape function a along axis i) as
``K[ai, bj] = λ T[ai, bj] + μ T[aj, bi] + μ δ_ij Σ_k T[ak, bk]``. One dense product of size (3 n_local × n_q) gives an
element's T; the material enters after the sum over elements, where there are far fewer blocks.
"""

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.memory import BLOCKS_AT_ONCE, ELEMENTS_AT_ONCE, ENHANCED_AT_ONCE
from fmd.fem.beam_mass import carry_beam_mass
from fmd.fem.beams import BeamLine
from fmd.fem.elements import Formulation, determinants, shape_functions
from fmd.fem.joined import AnyMesh, JoinedMesh, JoinedSpace
from fmd.fem.joined_model import join_models
from fmd.fem.material import AnyElastic, AnyMaterial, Material, batches
from fmd.fem.model import FEModel
from fmd.fem.shell_model import hang_on_nodes
from fmd.fem.space import Discretisation
from fmd.fem.strain import condensed_stiffness


def assemble(mesh: AnyMesh, order: int, material: AnyMaterial, formulation: Formulation = "enhanced") -> FEModel:
    """Assemble stiffness and consistent mass of a solid, of a shell, of beams, or of some of them as one body.

    The displacement is of order 1 or 2, and linear hexahedra of ``enhanced`` or ``plain`` strain.

    Raises
    ------
    AccuracyError
        The Jacobian is not positive at every quadrature point.
    """
    if isinstance(mesh, JoinedMesh):
        joined = JoinedSpace(mesh, order, formulation)
        return replace(
            join_models(joined, [_assemble(own.space, own.material(material)) for own in joined.members]),
            material=material,
        )
    return _assemble(Discretisation(mesh, order, formulation), material)


def _assemble(space: Discretisation, material: AnyMaterial) -> FEModel:
    """Assemble stiffness and mass of elements of one kind."""
    mesh = space.mesh
    layer = FEModel(space, material, _stiffness(space, material), _mass(space, material))
    if mesh.midsurface is None:
        return layer
    hung = hang_on_nodes(layer, mesh.midsurface)
    return carry_beam_mass(hung, mesh.midsurface) if isinstance(mesh.midsurface, BeamLine) else hung


def _stiffness(space: Discretisation, material: AnyMaterial) -> sp.csr_array:
    """Assemble the stiffness matrix, shape (3 n_nodes, 3 n_nodes) [N/m]."""
    structure = space.structure
    if space.is_enhanced:
        return structure.block_matrix(structure.sums(_condensed_blocks(space, material)))
    products = _gradient_products(space)
    each = [_isotropic(structure.sums(_select(products, mine)), own) for own, mine in material.over(slice(None))]
    del products  # a third of the assembly's peak memory
    return structure.block_matrix(sum(each[1:], each[0]))


def _mass(space: Discretisation, material: AnyMaterial) -> sp.csr_array:
    """Assemble the scalar mass matrix, shape (n_nodes, n_nodes) [kg]."""
    structure = space.structure
    return structure.scalar_matrix(structure.sums(_mass_products(space, material)))


def _select(entries: Array, elements: IntArray | slice) -> Array:
    """Return the entries of some elements and zero for the others."""
    if isinstance(elements, slice):
        return entries
    chosen = np.zeros_like(entries)
    chosen[elements] = entries[elements]
    return chosen


def _isotropic(T: Array, material: AnyElastic) -> Array:
    """Turn sums of gradient products T (n_pairs, 3, 3) into blocks of the stiffness, in place."""
    assert isinstance(material, Material)  # layers are of shells, whose strain is their own
    lam, mu = material.lame
    transposed, diagonal = np.arange(9).reshape(3, 3).T.ravel(), np.eye(3).ravel()
    for start in range(0, len(T), BLOCKS_AT_ONCE):
        block = T[start : start + BLOCKS_AT_ONCE].reshape(-1, 9)
        shear = np.take(block, transposed, axis=1)
        trace = block @ diagonal
        for k in np.flatnonzero(diagonal):
            shear[:, k] += trace
        shear *= mu
        block *= lam
        block += shear
    return T


def _condensed_blocks(space: Discretisation, material: AnyMaterial) -> Array:
    """Return the stiffness of enhanced elements by pairs of nodes, shape (n_elements, n_local, n_local, 3, 3) [N/m]."""
    n_elements, n_local = space.element_nodes.shape
    blocks = np.empty((n_elements, n_local, n_local, 3, 3))
    flat, by_pairs = blocks.reshape(n_elements, -1), _by_pairs(n_local)
    for own, part in batches(material, n_elements, ENHANCED_AT_ONCE):
        flat[part] = condensed_stiffness(space, own, part).reshape(len(part), -1)[:, by_pairs]
    return blocks


def _by_pairs(n_local: int) -> IntArray:
    """Return the places of a flat matrix (3 n_local, 3 n_local) in the order of the blocks of pairs of nodes."""
    return np.arange(9 * n_local**2).reshape(n_local, 3, n_local, 3).swapaxes(1, 2).ravel()


def _gradient_products(space: Discretisation) -> Array:
    """Return ``∫ g_ai g_bj dV`` of each element, shape (n_elements, n_local, n_local, 3, 3)."""
    X, w = space.kind.quadrature(space.kind.stiffness_order)
    n_elements, n_local = space.element_nodes.shape
    T = np.empty((n_elements, n_local, n_local, 3, 3))
    flat_T = T.reshape(n_elements, -1)
    by_pairs = _by_pairs(n_local)
    step = max(ELEMENTS_AT_ONCE // 16, 16 * ELEMENTS_AT_ONCE // n_local**2)
    for start in range(0, n_elements, step):
        chunk = slice(start, start + step)
        g, det = space.gradients(X, chunk)
        g *= np.sqrt(det * w)[:, :, None, None]
        flat = g.reshape(len(g), w.size, 3 * n_local)
        # NumPy multiplies a matrix by its own transpose with BLAS's syrk: symmetric to the last bit
        products = (flat.transpose(0, 2, 1) @ flat).reshape(len(g), -1)
        np.take(products, by_pairs, axis=1, out=flat_T[chunk], mode="clip")  # thrice as fast as by strides
    return T


def _mass_products(space: Discretisation, material: AnyMaterial) -> Array:
    """Return ``∫ ρ N_a N_b dV`` of each element, shape (n_elements, n_local, n_local) [kg]."""
    n_elements, n_local = space.element_nodes.shape
    products = np.empty((n_elements, n_local**2))
    for own, part in batches(material, n_elements, ELEMENTS_AT_ONCE):
        X, w = space.kind.quadrature(space.kind.mass_order)
        N, _ = shape_functions(space.kind.element, X)
        weights = (N[:, None] * N[None]).reshape(-1, w.size) * (w * own.density(X))
        if space.kind.is_affine:
            X, weights = X[:, :1], weights.sum(axis=1, keepdims=True)
        products[part] = determinants(space.jacobians(X, part)) @ weights.T
    return products.reshape(n_elements, n_local, n_local)
