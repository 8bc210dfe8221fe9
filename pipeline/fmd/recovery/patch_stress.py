"""Recovery of stress from patches of elements, and errors of shapes by recovered stress, without a second mesh.

Polynomials are fitted to the stress at the elements' most accurate points around a node (superconvergent patch
recovery; Zienkiewicz & Zhu, Int J Num Meth Eng 33, 1992); the difference from averaged stress estimates the error of
both.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.memory import STRAINED_AT_ONCE
from fmd.core.limits.recovery import EFFECTIVITY, INDEPENDENT_TERM, SAMPLES_PER_TERM
from fmd.fem.elements import determinants, shape_functions
from fmd.fem.material import AnyElastic, AnyMaterial, batches
from fmd.fem.space import Discretisation, member_of
from fmd.fem.strain import DOUBLED, HALVED, TENSOR, VOIGT, strains, stresses
from fmd.recovery.stress import average_at_nodes

if TYPE_CHECKING:
    from fmd.fem.joined import AnySpace


def patch_stress(space: AnySpace, material: AnyMaterial, shapes: Array, node: int) -> Array:
    """Stress of each shape (n_nodes, 3, n) at a node by a fit to the elements around it, shape (6, n).

    Components are xx, yy, zz, yz, xz, xy [Pa per unit of the shape].
    """
    space, material, shapes, node = _around(space, material, shapes, node)
    X = space.kind.stress_points
    patch = np.flatnonzero((space.element_nodes == node).any(axis=1))
    # Where shells and beams bend, stress is a product of places along and across, which straight terms don't have.
    order = space.order if space.mesh.midsurface is None else 2
    n_terms = 4 if order == 1 else 10
    while len(patch) * X.shape[1] < SAMPLES_PER_TERM * n_terms:
        wider = np.flatnonzero(np.isin(space.element_nodes, space.element_nodes[patch]).any(axis=1))
        if len(wider) == len(patch):
            break
        patch = wider
    N, _ = shape_functions(space.kind.geometry, X)
    places = (N.T @ space.corner_coordinates[patch] - space.x[node]).reshape(-1, 3)
    size = np.ptp(places, axis=0)
    stress = stresses(space, material, shapes, X, patch).reshape(len(places), 6, -1)
    fitted = np.linalg.lstsq(_terms(order, places / size), stress.reshape(len(places), -1), rcond=None)[0]
    return np.asarray(fitted[0].reshape(6, -1))  # the other terms vanish at the node


def element_stresses(space: AnySpace, material: AnyMaterial, shapes: Array, node: int) -> Array:
    """Stress of each shape (n_nodes, 3, n) at a node in each element around it, whose mean is the averaged stress.

    Components of (n_elements, 6, n) are xx, yy, zz, yz, xz, xy [Pa per unit of the shape].
    """
    space, material, shapes, node = _around(space, material, shapes, node)
    elements, places = np.nonzero(space.element_nodes == node)
    at_points = stresses(space, material, shapes, space.kind.stress_points, elements)
    each = at_points.reshape(*at_points.shape[:2], 6, -1)
    return np.asarray(np.einsum("eq,eqrn->ern", space.kind.stress_to_nodes[places], each))


def _terms(order: int, x: Array) -> Array:
    """Monomials up to an order at places (n, 3), the constant first, shape (n, n_terms).

    Monomials that depend on the others at these places are left out, as squares across a single layer of elements are.
    """
    terms = [np.ones(len(x)), *x.T]
    if order == 2:
        for a in range(3):
            for b in range(a, 3):
                term, others = x[:, a] * x[:, b], np.stack(terms, axis=1)
                rest = term - others @ np.linalg.lstsq(others, term, rcond=None)[0]
                if np.linalg.norm(rest) > INDEPENDENT_TERM * np.linalg.norm(term):
                    terms.append(term)
    return np.stack(terms, axis=1)


def _around(
    space: AnySpace, material: AnyMaterial, shapes: Array, node: int
) -> tuple[Discretisation, AnyMaterial, Array, int]:
    """Return what `element_stresses` takes, of the elements of the one kind that has the node."""
    member = member_of(space.members, node)
    return member.space.stressed, member.material(material), member.of_shapes(shapes), node - member.first


def energy_errors(space: AnySpace, material: AnyMaterial, shapes: Array) -> Array:
    """Energy products (n, n) of the errors of shapes (n_nodes, 3, n) [J per unit of two shapes].

    The strain of the elements jumps between them; averaged at the nodes and interpolated, it is more accurate, and the
    energy of the difference estimates that of the error (Zienkiewicz & Zhu, Int J Num Meth Eng 24, 1987). Strain and
    stress jump between materials in truth: each is averaged over the elements of one. With unit modal mass, an
    eigenvalue is too high by its mode's own product [rad²/s²].
    """
    return sum(
        (_member_errors(own.space, own.material(material), own.of_shapes(shapes)) for own in space.members),
        np.zeros((shapes.shape[2],) * 2),
    )


def _member_errors(space: Discretisation, material: AnyMaterial, shapes: Array) -> Array:
    if (line := space.mesh.midsurface) is not None:
        space = space.strained_by(line.evenly_strained())
    nodes, everything = np.arange(len(space.x)), np.arange(len(space.element_nodes))
    total = np.zeros((shapes.shape[2],) * 2)
    for own_material, mine in material.over(slice(None)):
        own = own_material.summed
        evaluate = partial(_strains_with_middle_shear, space, own)
        recovered = average_at_nodes(space, shapes, nodes, evaluate, everything[mine])
        X, w = space.kind.quadrature(space.kind.stiffness_order)
        N, _ = shape_functions(space.kind.element, X)
        for _, chosen in batches(own, len(everything[mine]), STRAINED_AT_ONCE):
            part = everything[mine][chosen]
            averaged = np.einsum("aq,earn->eqrn", N, recovered[space.element_nodes[part]], optimize=True)
            J = space.jacobians(X, part)
            apart = averaged - evaluate(shapes, X, part)
            if space.kind.from_middle is not None:
                zeta = np.repeat(X[2], shapes.shape[2])
                apart = _by_tensors(apart, partial(space.kind.from_middle, zeta=zeta), J, own, part)
            apart = np.sqrt(determinants(J) * w)[:, :, None, None] * apart
            energy = own.energy_root(space, X, part, apart.swapaxes(1, 2)).reshape(-1, shapes.shape[2])
            total += energy.T @ energy
    return total / EFFECTIVITY


def _strains_with_middle_shear(
    space: Discretisation, material: AnyElastic, shapes: Array, X: Array, elements: IntArray
) -> Array:
    """Return strains whose transverse shear in shells, none at their faces, is that in the middle of the thickness."""
    strain = strains(space, material, shapes, X, elements)
    if space.kind.from_middle is None:
        return strain
    middle = np.stack([X[0], X[1], np.full_like(X[2], 0.5)])
    other = strains(space, material, shapes, middle, elements)
    shear = other - _by_tensors(other, space.kind.stressed, space.jacobians(middle, elements), material, elements)
    return _by_tensors(strain, space.kind.stressed, space.jacobians(X, elements), material, elements) + shear


def _by_tensors(strain: Array, change: Any, J: Array, material: AnyElastic, elements: IntArray) -> Array:
    """Return strains (n_elements, n_q, 6, n) as `ElementKind.stressed` or its like changes their tensors."""
    n = strain.shape[3]
    A = strain.swapaxes(2, 3)[..., TENSOR].reshape(len(strain), -1, 3, 3) * HALVED
    changed = change(A, np.repeat(J, n, axis=1), material, elements)
    return np.asarray((changed.reshape(*strain.shape[:2], n, 9)[..., VOIGT] * DOUBLED).swapaxes(2, 3))
