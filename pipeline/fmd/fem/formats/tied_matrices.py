"""Rigid and average connections of a deck on the matrices that come before them, as Nastran's KGG.

Unknowns of dependent points follow from those of others, ``y = C z``, and points move by ``T C z``. What hangs on a
rigid connection moves in second order as its reference turns.
"""

from dataclasses import replace
from typing import TypeVar

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.mesh import IDLE_TURN
from fmd.core.rotations import rigid_motions
from fmd.fem.arms import Arms, second_of_mean, second_of_rigid
from fmd.fem.connections import Connections, MeanConnection, RigidConnection
from fmd.fem.constraints import Constraints
from fmd.fem.formats.six_unknowns import SixUnknownsModel
from fmd.fem.links import mean_motion
from fmd.fem.markers import weighted_marker

_Connection = TypeVar("_Connection", RigidConnection, MeanConnection)


def tie_matrices(model: SixUnknownsModel, deck: Connections) -> SixUnknownsModel:
    """Return the model of matrices whose points rigid and average connections join, by their numbers in the model.

    Masses and springs are in the matrices.

    Raises
    ------
    ValueError
        A connection hangs on another, or is of a kind that isn't read.
    """
    if deck.equations:
        raise ValueError(f"{deck.equations[0].label} isn't in KGG, which comes before it, and isn't read with matrices")
    if model.arms is None:
        return model
    assert model.T is not None
    moved = np.concatenate([np.zeros(0, int), *(e.points[1:] for e in deck.rigid), *(e.points[:1] for e in deck.mean)])
    ties = Constraints(model.T.shape[1], 0)
    arms = model.arms
    for rigid in deck.rigid:
        _require_own(rigid, int(rigid.points[0]), moved)
        first, others = int(rigid.points[0]), rigid.points[1:]
        for other in map(int, others):
            six = rigid_motions((model.x[other] - model.x[first])[None])[0]
            ties.give(_moves(other), np.concatenate([_moves(first), _turns(model, first)]), six)
            if rigid.turning and model.turning[other] >= 0:
                ties.give(_turns(model, other), _turns(model, first), np.eye(3))
            own = _around(model, other)
            r = (model.x[own] if rigid.turning else model.x[[other] * len(own)]) - model.x[first]
            arms = _carried(arms, own, _link(model, first), second_of_rigid(r), rigid.turning)
    for mean in deck.mean:
        first, others = int(mean.points[0]), mean.points[1:]
        for other in map(int, others):
            _require_own(mean, other, moved)
        if not mean.turning:
            raise ValueError(f"{mean.label} doesn't turn its point, which isn't read with matrices")
        marker = weighted_marker(others, model.x[others], mean.weights)
        six, own = mean_motion(marker, model.x[first]), _around(model, first)
        places = model.x[others] - marker.position
        second = second_of_mean(model.x[own] - marker.position, places, marker.rotation_weights)
        arms = _carried(arms, own, _link(model, first), second, True)
        ties.give(np.concatenate([_moves(first), _turns(model, first)]), np.concatenate(list(map(_moves, others))), six)
    _follow_idle_turns(model, ties)
    C, _ = ties.transformation()
    return model if C.shape[0] == C.shape[1] else replace(model, T=sp.csr_array(model.T @ C), arms=arms)


def _follow_idle_turns(model: SixUnknownsModel, ties: Constraints) -> None:
    """Let nodes turn as those around them do in the mean about an axis that nothing resists, as a shell's normal is."""
    assert model.T is not None
    n, turns = len(model.labels), np.flatnonzero(model.turning >= 0)
    resistance = np.zeros((len(turns), 3, 3))
    for A in (model.given_stiffness, sp.csr_array(model.T.T @ model.M @ model.T)):
        own = sp.csr_array(A[3 * n :, 3 * n :])
        largest = abs(own).max() if own.nnz else 0.0
        for a in range(3):
            for b in range(3):
                resistance[:, a, b] += own[a::3, b::3].diagonal() / (largest or 1.0)
    sizes, axes = np.linalg.eigh(resistance)
    idle = sizes <= IDLE_TURN * sizes[:, 2:]
    for node, axis in zip(turns[idle.sum(axis=1) == 1], axes[idle.sum(axis=1) == 1, :, 0], strict=True):
        columns, stored = _turns(model, node), model.given_stiffness[3 * node + np.arange(3)].indices
        around = np.setdiff1d(stored[stored < 3 * n] // 3, node)
        mean = weighted_marker(around, model.x[around], np.ones(len(around)))
        by_others = axis @ mean.rotation_weights.reshape(3, -1)
        if ties.are_given(columns).any() or not by_others.any():
            continue
        first, *others = np.argsort(-np.abs(axis))
        unknowns = np.concatenate([*map(_moves, around), columns[others]])
        row = np.concatenate([by_others, -axis[others]]) / axis[first]
        ties.give(columns[[first]], unknowns, row[None])


def references(deck: Connections) -> IntArray:
    """Return the points that connections turn, which need rotations."""
    return np.unique([int(each.points[0]) for each in (*deck.rigid, *deck.mean)]).astype(np.int64)


def _require_own(each: _Connection, point: int, moved: IntArray) -> None:
    if point in moved:
        raise ValueError(f"{each.label} hangs on a point that another link moves, which isn't read with matrices")


def _moves(node: int) -> IntArray:
    return 3 * node + np.arange(3)


def _turns(model: SixUnknownsModel, node: int) -> IntArray:
    return 3 * len(model.labels) + 3 * _link(model, node) + np.arange(3)


def _link(model: SixUnknownsModel, node: int) -> int:
    """Return the number of a node that turns among those that do."""
    return (int(model.turning[node]) - len(model.labels)) // 7


def _around(model: SixUnknownsModel, node: int) -> IntArray:
    """Return the points of a node: itself, and those on arms around it."""
    start = int(model.turning[node])
    return np.array([node, *(start + np.arange(7) if start >= 0 else ())], dtype=np.int64)


def _carried(arms: Arms, own: IntArray, link: int, second: Array, instead: bool) -> Arms:
    """Return arms with those of points that a link carries, in place of their own or beside them."""
    free = ~np.isin(arms.points, own) if instead else np.ones(len(arms.points), dtype=bool)
    return Arms(
        np.concatenate([arms.points[free], own]),
        np.concatenate([arms.link[free], np.full(len(own), link)]),
        arms.turn,
        np.concatenate([arms.second[free], second]),
    )
