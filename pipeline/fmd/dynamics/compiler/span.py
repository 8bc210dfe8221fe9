"""Rows that span how a body's modes move its markers, along which the modes of a carrier are eliminated.

Markers move by ``R_c η`` for modal accelerations η, and what displacements of second order add to the modal mass has
such rows too (see `bodies`). Shapes of the first order are constant: their span has orthonormal rows that are known
beforehand. A row with a part of second order changes with the deflection, and is made orthogonal to the others at each
state. It may vanish, or lie among the others, as that of a second body at the same marker does, or the slope of a bar's
end, which without deflection is a multiple of its displacement in some mode. So

- it isn't brought to unit length: its square comes with it;
- rows that differ without deflection come first, and those that only deflections tell apart after them: what is left of
  these is small, and nothing else has a large part of it;
- what is left is made orthogonal to the others three times. Twice is enough for a row of which a part is its own
  (Parlett, The Symmetric Eigenvalue Problem, 1980, section 6.9). Of one that is wholly among the others round-off is
  left, and the third pass makes that, too, a direction that counts as any other. A row that counted by a part, as what
  is left of it passed a threshold, gave its direction that part of the modal mass: accelerations had a pole there.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.rank import NO_SQUARE
from fmd.dynamics.compiler.algebra import Matrix, add, constants
from fmd.dynamics.compiler.cleaning import orthonormal_rows
from fmd.dynamics.compiler.graph import Graph, Scalar, Vector, combine
from fmd.dynamics.compiler.marker import MarkerMotion


@dataclass(frozen=True)
class Span:
    """Orthogonal rows Q that span groups of rows, ``R_c = L_c Q``."""

    Q: list[Vector]
    inverse_squares: list[Scalar]  # ``1 / (Q_i · Q_i)``
    L: list[Matrix]  # L_c of each group of rows, as many columns as Q has rows


@dataclass(frozen=True)
class ModalRows:
    """Rows that change linearly with the modal coordinates."""

    shapes: Array  # (m, n): their constant part
    forms: Array  # (m, n, n): their derivatives by the modal coordinates
    values: list[Vector]


def rows_of_marker(at: MarkerMotion) -> ModalRows:
    """Return the rows by which modes move a marker."""
    return ModalRows(
        np.concatenate([at.shapes.translation, at.shapes.rotation]), at.shapes.displacement2, at.slopes + at.turns
    )


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
    for k in _in_order(rows, basis, varies, sizes):
        row = values[k].multiplied_by(np.diag(free))
        weights[k] = [graph.number(0.0)] * len(Q)
        for _ in range(3):
            shares = [row.dot(other) * inverse for other, inverse in zip(Q, inverses, strict=True)]
            row = combine([(1.0, row), *((-1.0 * share, other) for share, other in zip(shares, Q, strict=True))])
            weights[k] = add(weights[k], shares)
        Q, weights[k] = [*Q, row], [*weights[k], graph.number(1.0)]
        inverses = [*inverses, (row.dot(row) + NO_SQUARE).inverse()]
    zero = graph.number(0.0)
    return _split(Q, inverses, [row + [zero] * (len(Q) - len(row)) for row in weights], sizes)


def _in_order(rows: Array, basis: Array, varies: NDArray[np.bool_], sizes: Sequence[int]) -> list[int]:
    """Return the numbers of rows that vary, first those of which most is left beside the others without deflection."""
    scales = np.concatenate([np.zeros(0), *(_scales(group) for group in np.split(rows, np.cumsum(sizes)[:-1]))])
    rest = (rows - (rows @ basis.T) @ basis) / scales[:, None]
    order, left = list[int](), [int(k) for k in np.flatnonzero(varies)]
    while left:
        squares = [float(rest[k] @ rest[k]) for k in left]
        order.append(left.pop(int(np.argmax(squares))))
        unit = rest[order[-1]] / max(np.sqrt(max(squares)), NO_SQUARE)
        rest = rest - np.outer(rest @ unit, unit)
    return order


def _scales(rows: Array) -> Array:
    """Return the size of the largest row of each half of a group, of displacements and of rotations."""
    halves = np.array_split(np.linalg.norm(rows, axis=1), 2)
    return np.concatenate([np.full(len(half), max(half.max(initial=0.0), NO_SQUARE)) for half in halves])


def _split(Q: list[Vector], inverse_squares: list[Scalar], rows: Matrix, sizes: Sequence[int]) -> Span:
    ends = np.cumsum(sizes, dtype=np.int64)
    return Span(Q, inverse_squares, [rows[end - size : end] for end, size in zip(ends, sizes, strict=True)])
