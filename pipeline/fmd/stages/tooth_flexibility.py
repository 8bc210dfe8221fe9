"""Flexibility of a spur gear's teeth from its finite element model, by the structured mesh of `meshes.spur_gear`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import cKDTree

from fmd.contact.gear_pair import ToothFlexibility
from fmd.core.arrays import Array, IntArray
from fmd.fem.strain import TENSOR
from fmd.meshes.spur_gear import tooth_block
from fmd.recovery.stress import modal_stress

if TYPE_CHECKING:
    from fmd.scene.gears import SpurGear
    from fmd.stages.part import FlexiblePart


def find_tooth_flexibility(part: FlexiblePart) -> ToothFlexibility:
    """Load the flank of a gear's middle tooth, with its bore held, and return what that moves and stresses.

    Points of links, which are behind the mesh's nodes and have no stiffness of their own, are left out.
    """
    gear: Any = part.shape
    x, block = part.space.x, tooth_block(gear)
    tree, beside = cKDTree(x), gear.meshed_teeth // 2
    turns = [_turn(2.0 * np.pi * k / gear.teeth) for k in range(-beside, beside + 1)]
    flank = _functionals(gear, tree, block[2 * gear.mesh.fillet :, -1])
    loads = np.zeros((len(x), 3, flank.shape[0], 2))
    for a in range(2):
        loads[:, a, :, a] = flank.T
    free = np.flatnonzero(np.repeat(np.hypot(*x[:, :2].T) > 0.5 * gear.bore * (1.0 + 1e-9), 3))
    u = np.zeros((3 * len(x), 2 * flank.shape[0]))
    u[free] = part.model.factorise(part.fe.K[free][:, free]).solve(loads.reshape(u.shape)[free])
    shapes = u.reshape(len(x), 3, -1)
    middle = block[:, gear.mesh.across]
    moved = [
        np.einsum("ij,rn,njl->ril", turn[:2, :2].T, _functionals(gear, tree, middle @ turn[:2, :2].T), shapes[:, :2])
        for turn in turns
    ]
    stress = [
        _turned(modal_stress(part.space, part.material, shapes, own), turn) for own, turn in _roots(part, gear, turns)
    ]
    n = flank.shape[0], 2
    return ToothFlexibility(
        gear.tooth,
        middle[:, 0].copy(),
        np.stack(moved).reshape(len(turns), len(middle), 2, *n),
        np.stack(stress).reshape(len(turns), -1, 6, *n),
        gear.E,
        gear.nu,
    )


def _functionals(gear: SpurGear, tree: cKDTree, line: Array) -> Array:
    """Return the means over the width at points of a fine line of quadratic faces, shape (n_points, n_nodes).

    Every second point is a corner of elements; between them faces have a node at each end of an element alone, and
    their shape functions there, integrated along the axis, are ½, and ⅓ and −⅙ of the nodes beside.
    """
    levels = 2 * gear.mesh.along + 1
    z = np.linspace(-0.5, 0.5, levels) * gear.width
    places = np.concatenate([np.repeat(line, levels, axis=0), np.tile(z, len(line))[:, None]], axis=1)
    node = tree.query(places)[1].reshape(len(line), levels)
    ends, middles = np.zeros(levels), np.zeros(levels)
    middles[1::2] = 1.0 / gear.mesh.along
    for k in range(gear.mesh.along):
        ends[[2 * k, 2 * k + 2]] += 1.0 / gear.mesh.along
    simpson = ends / 6.0 + 2.0 / 3.0 * middles
    found = np.zeros((len(line), tree.n))
    for i in range(len(line)):
        if i % 2 == 0:
            np.add.at(found[i], node[i], simpson)
            continue
        np.add.at(found[i], node[i, ::2], 0.5 * ends[::2])
        for beside in (i - 1, i + 1):
            np.add.at(found[i], node[beside], middles / 3.0 - ends / 6.0)
    return found


def _roots(part: FlexiblePart, gear: SpurGear, turns: list[Array]) -> list[tuple[IntArray, Array]]:
    """Return the nodes in the fillet on the loaded side of each tooth, all in one order, with the tooth's turn.

    Its highest sixth is left out: a line of force on the involute beside it has no finite stress.
    """
    x = part.space.x
    roots = part.mesh.faces["roots"]
    angle, radius = np.arctan2(x[roots, 1], x[roots, 0]), np.hypot(x[roots, 0], x[roots, 1])
    highest = np.linalg.norm(gear.tooth.fillet((5.0 * gear.tooth.alpha + 0.5 * np.pi) / 6.0))
    own = x[roots[(angle > 0.0) & (angle < np.pi / gear.teeth * (1.0 + 1e-9)) & (radius < highest)]]
    tree = cKDTree(x)
    return [(tree.query(own @ turn.T)[1], turn) for turn in turns]


def _turned(stress: Array, turn: Array) -> Array:
    """Return stresses (n_points, 6, n) in the axes of a turned tooth."""
    full = np.einsum("ia,nijl,jb->nabl", turn, stress[:, TENSOR], turn)
    return np.stack([full[:, a, b] for a, b in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))], axis=1)


def _turn(angle: float) -> Array:
    """Return the matrix (3, 3) of a rotation about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
