"""Strain of displacement fields in chosen elements, and its stress by Hooke's law."""

from __future__ import annotations

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.fem.enhanced_strain import enhanced_strains
from fmd.fem.gradients import gradients
from fmd.fem.material import AnyMaterial
from fmd.fem.space import Discretisation


def strains(space: Discretisation, material: AnyMaterial, shapes: Array, X: Array, elements: IntArray) -> Array:
    """Return the strains of displacement fields at reference points of elements.

    Parameters
    ----------
    space : Discretisation
        The body's finite element space.
    material : AnyMaterial
        Material of each element, on which enhanced strains depend.
    shapes : ndarray, shape (n_nodes, 3, n)
        Displacement fields.
    X : ndarray, shape (3, n_q)
        Reference points.
    elements : ndarray, shape (n_elements,)
        Numbers of the elements.

    Returns
    -------
    ndarray, shape (n_elements, n_q, 6, n)
        xx, yy, zz, 2yz, 2xz, 2xy [1/m per unit of the shape].
    """
    if space.is_enhanced:
        return enhanced_strains(space, material, shapes, X, elements)
    local = space.element_nodes[elements]
    g, _ = gradients(space, X, elements)
    u = shapes[local].reshape(len(elements), 1, local.shape[1], -1)
    du = (g.swapaxes(2, 3) @ u).reshape(len(elements), X.shape[1], 3, 3, -1)  # du[e, q, j, i] = ∂u_i/∂x_j
    return np.stack(
        [du[:, :, 0, 0], du[:, :, 1, 1], du[:, :, 2, 2]]
        + [du[:, :, a, b] + du[:, :, b, a] for a, b in ((1, 2), (0, 2), (0, 1))],
        axis=2,
    )


def stresses(space: Discretisation, material: AnyMaterial, shapes: Array, X: Array, elements: IntArray) -> Array:
    """Return the stresses xx, yy, zz, yz, xz, xy of fields [Pa]; parameters and shape are those of `strains`."""
    return hooke_stress(material, elements, strains(space, material, shapes, X, elements))


def hooke_stress(material: AnyMaterial, elements: IntArray, strain: Array) -> Array:
    """Return the stress of strains in chosen elements by Hooke's law, both of shape (n_elements, n_points, 6, n)."""
    stress = np.empty_like(strain)
    for own, mine in material.over(elements):
        stress[mine] = own.stiffness @ strain[mine]
    return stress
