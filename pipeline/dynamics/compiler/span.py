"""Rows that span how a body's modes move its markers, along which the modes of a carrier are eliminated.

Markers move by ``R_c η`` for modal accelerations η. Shapes of the first order are constant: their span has orthonormal
rows that are known beforehand. A row with a part of second order changes with the deflection, and is made orthogonal to
the others at each state. It may vanish, or lie among the others; so it isn't brought to unit length: its square comes
with it, and a number that is nothing beside any modal mass keeps that from being zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.core.arrays import Array
from pipeline.dynamics.compiler.algebra import Matrix, constants
from pipeline.dynamics.compiler.cleaning import orthonormal_rows
from pipeline.dynamics.compiler.graph import Graph, Scalar, Vector, combine
from pipeline.dynamics.compiler.marker import MarkerMotion

_NOTHING = 1e-30  # [1/kg]


@dataclass(frozen=True)
class Span:
    """Orthogonal rows Q that span the motion of markers by modes, ``R_c = L_c Q``.

    Attributes
    ----------
    Q : list of Vector
        The rows.
    inverse_squares : list of Scalar
        ``1 / (Q_i · Q_i)``.
    L : list of Matrix
        L_c of each marker, 6 × as many as there are rows.
    """

    Q: list[Vector]
    inverse_squares: list[Scalar]
    L: list[Matrix]


def span_markers(graph: Graph, markers: Sequence[MarkerMotion], free: Array) -> Span:
    """Span the motion of a body's markers by those modes for which ``free`` (n,) is 1; it is 0 for the others."""
    shapes = [np.concatenate([at.shapes.translation, at.shapes.rotation]) * free for at in markers]
    rows = np.concatenate([np.zeros((0, len(free))), *shapes])
    forms = np.concatenate([np.zeros((0, len(free), len(free))), *(at.shapes.bow for at in markers)])
    varies = np.asarray(forms.any(axis=(1, 2)))
    basis, L = orthonormal_rows(np.where(varies[:, None], 0.0, rows))
    moving = (free > 0.0) & (rows.any(axis=0) | forms.any(axis=(0, 1)))
    slopes = [row for at in markers for row in at.slopes + at.turns]
    if len(basis) + np.count_nonzero(varies) >= np.count_nonzero(moving):  # the modes keep the markers' zeros
        modes = np.flatnonzero(moving)
        Q = [graph.array(row) for row in np.eye(len(free))[modes]]
        return _split(Q, [graph.number(1.0)] * len(Q), [[row.entry(int(k)) for k in modes] for row in slopes])
    Q, inverses = [graph.array(row) for row in basis], [graph.number(1.0)] * len(basis)
    weights = [constants(graph, row) for row in L]
    for k in np.flatnonzero(varies):
        row = slopes[k].multiplied_by(np.diag(free))
        weights[k] = [row.dot(other) * inverse for other, inverse in zip(Q, inverses, strict=True)]
        row = combine([(1.0, row), *((-1.0 * weight, other) for weight, other in zip(weights[k], Q, strict=True))])
        weights[k] = [*weights[k], graph.number(1.0)]
        Q, inverses = [*Q, row], [*inverses, (row.dot(row) + _NOTHING).inverse()]
    zero = graph.number(0.0)
    return _split(Q, inverses, [row + [zero] * (len(Q) - len(row)) for row in weights])


def _split(Q: list[Vector], inverse_squares: list[Scalar], rows: Matrix) -> Span:
    return Span(Q, inverse_squares, [rows[first : first + 6] for first in range(0, len(rows), 6)])
