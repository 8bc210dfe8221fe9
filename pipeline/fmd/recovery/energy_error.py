"""Errors of shapes in the energy norm, estimated from recovered stress without a second mesh.

The stress of the elements jumps between them; averaged at the nodes and interpolated, it is more accurate, and the
energy of the difference estimates that of the error (Zienkiewicz & Zhu, Int J Num Meth Eng 24, 1987). A mode's
eigenvalue is too high by just this energy.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.memory import STRAINED_AT_ONCE
from fmd.core.limits.recovery import EFFECTIVITY
from fmd.fem.elements import determinants, shape_functions
from fmd.fem.strain import stresses
from fmd.recovery.stress import modal_stress

if TYPE_CHECKING:
    from fmd.fem.material import AnyMaterial
    from fmd.fem.space import Discretisation


def energy_errors(space: Discretisation, material: AnyMaterial, shapes: Array) -> Array:
    """Energy products of the errors of shapes, shape (n, n) [J per unit of two shapes].

    With unit modal mass, an eigenvalue is too high by its mode's own product [rad²/s²].

    Parameters
    ----------
    space : Discretisation
        The body's finite element space.
    material : AnyMaterial
        Material of each element.
    shapes : ndarray, shape (n_nodes, 3, n)
        Displacement fields.
    """
    recovered = modal_stress(space, material, shapes, np.arange(len(space.x)))
    X, w = space.kind.quadrature(space.kind.stiffness_order)
    N, _ = shape_functions(space.kind.element, X)
    total = np.zeros((shapes.shape[2],) * 2)
    for start in range(0, len(space.element_nodes), STRAINED_AT_ONCE):
        part = np.arange(start, min(start + STRAINED_AT_ONCE, len(space.element_nodes)))
        raw = stresses(space, material, shapes, X, part)
        averaged = np.einsum("aq,earn->eqrn", N, recovered[space.element_nodes[part]], optimize=True)
        weights = np.sqrt(determinants(space.jacobians(X, part)) * w)
        apart = weights[:, :, None, None] * (averaged - raw)
        for own, mine in material.over(part):
            root = np.linalg.cholesky(np.linalg.inv(own.stiffness)).T  # |root σ|² is twice the energy density
            energy = (root @ apart[mine]).reshape(-1, shapes.shape[2])
            total += energy.T @ energy
    return total / EFFECTIVITY
