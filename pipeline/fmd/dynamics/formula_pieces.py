"""Pieces of a formula on each of which it is smooth, and its integral however narrow its features are."""

import math
from functools import cached_property, lru_cache

import numpy as np

from fmd.core.arrays import Array, BoolArray
from fmd.core.data_classes import dataclass
from fmd.core.formula import Formula
from fmd.core.limits import loads as limits
from fmd.dynamics.compiler.formulas import trace_formula
from fmd.dynamics.compiler.graph import Graph, Scalar, total
from fmd.dynamics.compiler.interpret import evaluation_of
from fmd.dynamics.signals.bounds import PieceBounds


@dataclass(frozen=True)
class LawPieces:
    """Places between which a force law is smooth."""

    edges: Array  # (n_edges,): ends of the pieces [m or rad], ascending; the first and the last piece go on beyond
    # Length of the pieces beyond the first and the last edge [m or rad]; infinite where the law is smooth there.
    beyond: float = math.inf

    @property
    def are_short(self) -> bool:
        """True if a step may pass a whole piece."""
        return len(self.edges) > 1 or math.isfinite(self.beyond)


@lru_cache(maxsize=64)
def divide_formula(formula: Formula) -> LawPieces:
    """Divide the elongations until a formula is smooth on each piece, or does next to nothing there."""
    farthest = limits.FARTHEST
    while True:
        pieces = _FormulaPieces(formula, farthest)
        if pieces.resolved:
            break
        farthest /= limits.NARROWER
    edges = pieces.edges
    if farthest == limits.FARTHEST:
        return LawPieces(edges[1:-1])
    return LawPieces(edges, float(np.diff(edges).min()))


class _FormulaPieces:
    """Pieces of a formula between two places at the same distance from 0: ``resolved`` unless they are too many.

    Their ``edges`` are in m or rad.
    """

    def __init__(self, formula: Formula, farthest: float) -> None:
        self._formula = formula
        self._known = {side: np.zeros((2, 1)) for side in (-1.0, 1.0)}  # distances in order, largest force up to there
        known = {0.0, *(at for at in formula.breakpoints if abs(at) < farthest)}
        ends = np.array([-farthest, *sorted(known), farthest])
        with np.errstate(all="ignore"):
            self.edges, self.resolved = self._divide(ends[:-1], ends[1:], farthest)
            if self.resolved:
                self._merge()
                self._drop_little_ones()

    def _divide(self, begin: Array, end: Array, farthest: float) -> tuple[Array, bool]:
        kept, count = [end[-1:]], 0
        for level in range(limits.MOST_LEVELS + 1):
            smooth, little = self._weigh(begin, end)
            done = smooth | little | (level == limits.MOST_LEVELS)
            kept.append(begin[done])
            count += len(done)
            if done.all():
                break
            if count > limits.MOST_PIECES and farthest > limits.NEAREST:
                return np.zeros(0), False
            first, last = begin[~done], end[~done]
            middle = 0.5 * (first + last)
            begin, end = np.r_[first, middle], np.r_[middle, last]
        return np.sort(np.concatenate(kept)), True

    def _weigh(self, begin: Array, end: Array) -> tuple[BoolArray, BoolArray]:
        """Return on which pieces the formula is close to a polynomial, and on which that makes no difference."""
        middle, half = 0.5 * (begin + end), 0.5 * (end - begin)
        n = len(begin)
        both, rough = self._series(np.concatenate([begin, middle]), np.concatenate([end, middle]))
        bounds, at_middle, rough = [x[:, :n] for x in both], [x[:, n:] for x in both], rough[:n]
        sizes = [np.abs(x[0]) * half**k for k, x in enumerate(at_middle[:-1])]
        rest = np.where(rough, math.inf, np.abs(bounds[-1]).max(axis=0) * half ** (limits.TAYLOR_TERMS - 1))
        spread = np.minimum(np.nan_to_num(rest, nan=math.inf), bounds[0][1] - bounds[0][0])
        nothing = ~self._has_value(begin, middle, end)  # the march will tell
        little = np.nan_to_num(spread, nan=math.inf) * (end - begin) <= limits.LITTLE_WORK * self._weight(
            begin, end, sizes[0]
        )
        return (np.isfinite(rest) & (rest <= limits.SMOOTH_REST * np.sum(sizes, axis=0))) | nothing, little

    def _has_value(self, begin: Array, middle: Array, end: Array) -> BoolArray:
        """Return on which pieces the formula has a finite value in the middle or near an end."""
        inset = limits.INSET * (end - begin)
        points = np.concatenate([begin + inset, middle, end - inset])
        (values, *_), _ = self._series(points, points, 1)
        return np.asarray(np.isfinite(values[0]).reshape(3, -1).any(axis=0))

    def _series(self, begin: Array, end: Array, n_terms: int = limits.TAYLOR_TERMS) -> tuple[list[Array], BoolArray]:
        pieces = PieceBounds(begin, end, n_terms)
        return pieces.run_program(self._formula.codes, self._formula.constants), pieces.rough

    def _weight(self, begin: Array, end: Array, force: Array) -> Array:
        """Return the largest force known from 0 to somewhat beyond the near end of each piece, times that way."""
        middle, weight = 0.5 * (begin + end), np.full(len(begin), math.inf)
        near = np.where(begin * end < 0.0, 0.0, np.minimum(np.abs(begin), np.abs(end)))
        far = np.maximum(limits.SOMEWHAT_BEYOND * near, limits.NEAREST)
        for side, known in self._known.items():
            inside = np.copysign(1.0, middle) == side
            new = np.stack([np.abs(middle[inside]), np.nan_to_num(force[inside], posinf=0.0)])
            distances, forces = (both := np.concatenate([known, new], axis=1))[:, np.argsort(both[0], kind="stable")]
            self._known[side] = np.stack([distances, np.maximum.accumulate(forces)])
            reaches = end > 0.0 if side > 0.0 else begin < 0.0
            at = np.searchsorted(distances, far[reaches], side="right") - 1
            weight[reaches] = np.minimum(weight[reaches], far[reaches] * self._known[side][1, at])
        return weight

    def _merge(self) -> None:
        """Join neighbours on which the formula is smooth together, until there are none."""
        idle, offset = 0, 0
        while idle < 2 and len(self.edges) > 3 - offset:
            first = self.edges[offset:-2:2]
            last = self.edges[offset + 2 :: 2]
            smooth, little = self._weigh(first, last[: len(first)])
            joined = offset + 1 + 2 * np.flatnonzero(smooth | little)
            idle = idle + 1 if not len(joined) else 0
            self.edges, offset = np.delete(self.edges, joined), 1 - offset

    def _drop_little_ones(self) -> None:
        """Leave a piece about a kink, short and of no account, to the longer one beside it."""
        lengths = np.diff(self.edges)
        if len(lengths) < 3:
            return
        begin, end = self.edges[:-1], self.edges[1:]
        about, _ = self._series(begin - lengths, end + lengths, 1)
        weight = limits.WIDER * limits.LITTLE_WORK * self._weight(begin, end, np.zeros(len(begin)))
        little = (about[0][1] - about[0][0]) * lengths <= weight
        shorter = np.r_[False, (lengths[1:-1] < lengths[2:]) & (lengths[1:-1] < lengths[:-2]), False]
        self.edges = np.delete(self.edges, np.flatnonzero(little & shorter))


class FormulaIntegral:
    """Integral of a formula from 0 on, exact however narrow its features are.

    It is summed from the edge of a piece next to 0, number ``middle`` of ``edges`` (n_edges,), outwards, lest a pole
    far away, or a range without values, take all digits.
    """

    def __init__(self, formula: Formula) -> None:
        self._formula = formula
        edges = divide_formula(formula).edges
        self.edges = edges if len(edges) else np.zeros(1)
        self.middle = int(np.argmin(np.abs(self.edges)))

    @cached_property
    def sums(self) -> Array:
        """Integral up to each edge, shape (n_edges,)."""
        works = np.nan_to_num(self._between(self.edges[:-1], self.edges[1:]), nan=0.0, posinf=0.0, neginf=0.0)
        below = -np.cumsum(works[: self.middle][::-1])[::-1]
        sums = np.concatenate([below, [0.0], np.cumsum(works[self.middle :])])
        return np.asarray(sums - self._between(self.edges[[self.middle]], np.zeros(1)))

    def trace(self, x: Scalar) -> Scalar:
        """Trace the integral from 0: up to the last edge of a piece before x, and by quadrature from there."""
        begin, value = (x.graph.number(float(known[self.middle])) for known in (self.edges, self.sums))
        for k in range(len(self.edges)):
            if k != self.middle:
                before = k - 1 if k > self.middle else k + 1
                passed = ((x - float(self.edges[k])) * (k - before)).apply("step")
                begin = begin + passed * float(self.edges[k] - self.edges[before])
                value = value + passed * float(self.sums[k] - self.sums[before])
        return value + self._trace_between(begin, x)

    def _trace_between(self, begin: Scalar, end: Scalar) -> Scalar:
        points, weights = np.polynomial.legendre.leggauss(limits.GAUSS_POINTS)
        length = end - begin
        places = (begin + length * float(0.5 * (point + 1.0)) for point in points)
        inside = (trace_formula(self._formula.codes, self._formula.constants, place) for place in places)
        return total(f * float(w) for f, w in zip(inside, weights, strict=True)) * length * 0.5

    def _between(self, begin: Array, end: Array) -> Array:
        graph = Graph()
        integral = self._trace_between(graph.scalar_input("ends", 0), graph.scalar_input("ends", 1))
        return evaluation_of([integral]).over({"ends": np.stack([begin, end])}, len(begin))[:, 0]


@lru_cache(maxsize=64)
def integrate_formula(formula: Formula) -> FormulaIntegral:
    """Return a formula's integral, once for all who want it."""
    return FormulaIntegral(formula)
