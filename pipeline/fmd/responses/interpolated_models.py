"""Linear models over a parameter, interpolated between few at which they were computed."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.responses import INTERPOLATED, NARROWEST_PANEL, RIGID_DRIFT
from fmd.core.limits.round_off import SUMMED
from fmd.responses.state_space import StateSpace
from fmd.responses.whirl import scaled_eigen

_NODES = np.cos(np.pi * (np.arange(8) + 0.5) / 8)  # Chebyshev's, of degree 7
_WEIGHTS = (-1.0) ** np.arange(8) * np.sin(np.pi * (np.arange(8) + 0.5) / 8)
_CHECKS = (-0.87, 0.02, 0.93)  # where no node is near

Matrices = tuple[Array, Array]
"""State matrix (n, n) and output matrix (n_outputs, n)."""


def interpolate_models(
    model: Callable[[float], StateSpace], start: float, end: float, bends: Sequence[float] = ()
) -> Callable[[float], Matrices]:
    """Return state and output matrices as a function of a parameter, from few models that are computed.

    Between ``start`` and ``end`` they follow a polynomial of degree 7 through Chebyshev's nodes (Berrut & Trefethen,
    SIAM Review 46, 2004), held against models between them; where that is off, each half has one of its own, and so has
    each side of a place at which models bend.
    """
    if inside := [at for at in bends if start < at < end]:
        return _join(model, start, inside[len(inside) // 2], end, inside)
    middle, half = 0.5 * (start + end), 0.5 * (end - start)
    if half <= NARROWEST_PANEL * abs(end):
        return partial(matrices_of, model)
    nodes = [model(middle + half * x) for x in _NODES]
    A, C = np.array([at.A for at in nodes]), np.array([at.C for at in nodes])

    def whole(parameter: float) -> Matrices:
        apart = (parameter - middle) / half - _NODES
        if not apart.all():
            k = int(np.flatnonzero(apart == 0.0)[0])
            return A[k], C[k]
        weights = _WEIGHTS / apart
        weights /= weights.sum()
        return np.tensordot(weights, A, 1), np.tensordot(weights, C, 1)

    checked = [middle + half * x for x in _CHECKS]
    alike = all(at.states == nodes[0].states for at in nodes)  # loops may choose other independent coordinates
    if alike and all(_agree(model(x).A, whole(x)[0]) for x in checked):
        return whole
    return _join(model, start, middle, end)


def _join(
    model: Callable[[float], StateSpace], start: float, middle: float, end: float, bends: Sequence[float] = ()
) -> Callable[[float], Matrices]:
    """Return matrices by one polynomial or more on each side of a place."""
    low, high = (interpolate_models(model, *ends, bends) for ends in ((start, middle), (middle, end)))
    return lambda parameter: (low if parameter <= middle else high)(parameter)


def matrices_of(model: Callable[[float], StateSpace], parameter: float) -> Matrices:
    """Return state and output matrices of the model at a parameter."""
    at = model(parameter)
    return at.A, at.C


def _agree(A: Array, B: Array) -> bool:
    """Return True if two state matrices have the same poles, but for those of rigid motions."""
    one, other = scaled_eigen(A)[0], scaled_eigen(B)[0]
    fastest = float(np.abs(one).max(initial=0.0))
    one = one[np.abs(one) > RIGID_DRIFT * fastest]
    apart = np.abs(one[:, None] - other).min(axis=1, initial=np.inf)
    return bool((apart <= INTERPOLATED * np.abs(one) + SUMMED * fastest).all())


def with_inputs_seen(model: StateSpace) -> StateSpace:
    """Return a model without inputs, whose last outputs are the columns of its input matrix."""
    C, outputs = np.concatenate([model.C, model.B.T]), (*model.outputs, *model.inputs)
    return StateSpace(model.A, np.zeros((len(model.A), 0)), C, np.zeros((len(C), 0)), model.states, (), outputs)
