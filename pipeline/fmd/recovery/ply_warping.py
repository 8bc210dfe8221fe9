"""Stress of plies with the warping of sections, which a shell's plane sections leave out.

Transverse shear that differs from ply to ply moves the points of a section along it. Where shear changes along the
shell, that stretches plies, as a sandwich's faces, by strain that adds up to no force and no moment (first step of a
predictor and corrector; Noor & Burton, Composite Structures 14, 1990).
"""

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.recovery import INDEPENDENT_WAY
from fmd.fem.layered import Layered
from fmd.fem.material import PLANE, bond
from fmd.fem.space import Discretisation
from fmd.fem.strain import strains
from fmd.recovery.plies import modal_ply_stress, places_of_plies

_STRETCHES = np.array([0, 1, 4])  # in the plane, of a ply's five components


def warped_ply_stress(space: Discretisation, material: Layered, shapes: Array, elements: IntArray) -> Array:
    """Return the stress of shapes at both faces of each ply as `modal_ply_stress` does, with the warping of sections.

    Of each element, shear changes along the shell as a linear field through it that is nearest to those of the elements
    around it.
    """
    stress = modal_ply_stress(space, material, shapes, elements)
    laminate = material.laminate
    strain = laminate.warping_strain(places_of_plies(laminate)).reshape(len(laminate.plies), 2, 3, 4)
    in_plane = np.ix_(_STRETCHES, _STRETCHES)
    for k, ply in enumerate(laminate.plies):
        turn = bond(ply.turn)[np.ix_(PLANE, PLANE)][in_plane]
        own = ply.lamina.stiffness[in_plane] @ turn @ strain[k]
        stress[:, k][:, :, _STRETCHES] += np.einsum("fas,esn->efan", own, _slopes(space, material, shapes, elements))
    return stress


def _slopes(space: Discretisation, material: Layered, shapes: Array, elements: IntArray) -> Array:
    """Return slopes of mean shear xz and yz along the laminate's direction, then across it, (n_elements, 4, n)."""
    around = _neighbours(space.element_nodes)[elements]
    patch = np.unique(np.concatenate([elements, around.indices]))
    X = np.append(space.kind.corners.mean(axis=0)[:2], 0.5)[:, None]
    strain = strains(space, material.summed, shapes[: len(space.x)], X, patch)
    frames = material.frames(space.jacobians(X, patch), patch)[:, 0]
    local = (bond(frames)[:, PLANE, :] @ strain[:, 0])[:, [3, 2]]
    shear = np.einsum("ebi,ebn->ein", frames[:, :2], local)
    x, numbers = space.corner_coordinates[patch].mean(axis=1), np.searchsorted(patch, elements)
    row = np.repeat(np.arange(len(elements)), np.diff(around.indptr))
    way = x[(other := np.searchsorted(patch, around.indices))] - x[numbers[row]]
    normal = frames[numbers[row], 2]
    way -= (way * normal).sum(axis=1, keepdims=True) * normal
    P = np.zeros((len(elements), 3, 3))
    np.add.at(P, row, way[:, :, None] * way[:, None, :])
    share = np.einsum("kij,kj->ki", np.linalg.pinv(P, rcond=INDEPENDENT_WAY, hermitian=True)[row], way)
    size = (len(elements), len(patch))
    own, at = sp.csr_array((np.ones(len(elements)), (np.arange(len(elements)), numbers)), shape=size), (row, other)
    each = [sp.csr_array((share[:, axis], at), shape=size) for axis in range(3)]
    slopes = [(D - sp.diags_array(D.sum(axis=1)) @ own) @ shear.reshape(len(patch), -1) for D in each]
    G = np.stack(slopes, axis=1).reshape(len(elements), 3, 3, -1)
    R = frames[numbers, :2]
    return np.asarray(np.einsum("eai,ebj,eijn->eabn", R, R, G, optimize=True).reshape(len(elements), 4, -1))


def _neighbours(element_nodes: IntArray) -> sp.csr_array:
    """Return the matrix of which elements have a node in common."""
    n, corners = element_nodes.shape
    at = (np.repeat(np.arange(n), corners), element_nodes.ravel())
    touches = sp.csr_array((np.ones(n * corners), at), shape=(n, int(element_nodes.max()) + 1))
    return sp.csr_array(touches @ touches.T)
