"""Rows that span how a body's modes move its markers, along which the modes of a carrier are eliminated.

Markers move by ``R_c η`` for modal accelerations η, and what displacements of second order add to the modal mass has
such rows too (see `added_mass`). Shapes of the first order are constant: their span has orthonormal rows that are known
beforehand. A row with a part of second order changes with the deflection, and is made orthogonal to the others at each
state. It may vanish, or lie among the others, as that of a second body at the same marker does; so it isn't brought to
unit length: its square comes with it, and a part of the given row's square that is more than round-off and nothing
beside any modal mass is added to that, lest the inverse magnify round-off until accelerations have two digits. It is
made orthogonal twice, which is enough (Parlett, The Symmetric Eigenvalue Problem, 1980, section 6.9): small deflections
leave so little of it that one pass leaves round-off along the others, and accelerations would have five digits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.core.arrays import Array
from pipeline.dynamics.compiler.algebra import Matrix, add, constants
from pipeline.dynamics.compiler.cleaning import orthonormal_rows
from pipeline.dynamics.compiler.graph import Graph, Scalar, Vector, combine
from pipeline.dynamics.compiler.marker import MarkerMotion

_NOTHING = 1e-30  # [1/kg]
_ROUND_OFF = 1e-18  # of a row's square: what is left of a row that lies among the others


@dataclass(frozen=True)
class Span:
    """Orthogonal rows Q that span groups of rows, ``R_c = L_c Q``.

    Attributes
    ----------
    Q : list of Vector
        The rows.
    inverse_squares : list of Scalar
        ``1 / (Q_i · Q_i)``.
    L : list of Matrix
        L_c of each group of rows, as many columns as Q has rows.
    """

    Q: list[Vector]
    inverse_squares: list[Scalar]
    L: list[Matrix]


@dataclass(frozen=True)
class ModalRows:
    """Rows that change linearly with the modal coordinates.

    Attributes
    ----------
    shapes, forms : ndarray, shapes (m, n) and (m, n, n)
        Their constant part, and their derivatives.
    values : list of Vector
        The rows at the state.
    """

    shapes: Array
    forms: Array
    values: list[Vector]


def rows_of_marker(at: MarkerMotion) -> ModalRows:
    """Return the rows by which modes move a marker."""
    return ModalRows(np.concatenate([at.shapes.translation, at.shapes.rotation]), at.shapes.bow, at.slopes + at.turns)


def span_rows(graph: Graph, groups: Sequence[ModalRows], free: Array) -> Span:
    """Span groups of rows by those modes for which ``free`` (n,) is 1; it is 0 for the others."""
    rows = np.concatenate([np.zeros((0, len(free))), *(group.shapes * free for group in groups)])
    forms = np.concatenate([np.zeros((0, len(free), len(free))), *(group.forms for group in groups)])
    varies = np.asarray(forms.any(axis=(1, 2)))
    basis, L = orthonormal_rows(np.where(varies[:, None], 0.0, rows))
    moving = (free > 0.0) & (rows.any(axis=0) | forms.any(axis=(0, 1)))
    values, sizes = [row for group in groups for row in group.values], [len(group.values) for group in groups]
    if len(basis) + np.count_nonzero(varies) >= np.count_nonzero(moving):  # the modes keep the rows' zeros
        modes = np.flatnonzero(moving)
        Q = [graph.array(row) for row in np.eye(len(free))[modes]]
        return _split(Q, [graph.number(1.0)] * len(Q), [[row.entry(int(k)) for k in modes] for row in values], sizes)
    Q, inverses = [graph.array(row) for row in basis], [graph.number(1.0)] * len(basis)
    weights = [constants(graph, row) for row in L]
    for k in np.flatnonzero(varies):
        given = row = values[k].multiplied_by(np.diag(free))
        weights[k] = [graph.number(0.0)] * len(Q)
        for _ in range(2):  # what is left may be a millionth of the row, and orthogonal to the others but for round-off
            shares = [row.dot(other) * inverse for other, inverse in zip(Q, inverses, strict=True)]
            row = combine([(1.0, row), *((-1.0 * share, other) for share, other in zip(shares, Q, strict=True))])
            weights[k] = add(weights[k], shares)
        weights[k] = [*weights[k], graph.number(1.0)]
        square = row.dot(row) + _ROUND_OFF * given.dot(given) + _NOTHING
        Q, inverses = [*Q, row], [*inverses, square.inverse()]
    zero = graph.number(0.0)
    return _split(Q, inverses, [row + [zero] * (len(Q) - len(row)) for row in weights], sizes)


def _split(Q: list[Vector], inverse_squares: list[Scalar], rows: Matrix, sizes: Sequence[int]) -> Span:
    ends = np.cumsum(sizes, dtype=np.int64)
    return Span(Q, inverse_squares, [rows[end - size : end] for end, size in zip(ends, sizes, strict=True)])
