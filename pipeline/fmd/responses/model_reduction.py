"""Linear models with fewer states, by balanced truncation, and how far their responses are off.

The states that decay are balanced: in coordinates in which inputs reach and outputs see each state alike, by its Hankel
singular value σ. Those with the smallest are left out (Moore, IEEE Trans Automatic Control 26, 1981, 17–32), which
moves no response by more than ``2 Σ σ`` of them (Enns 1984). Rigid, undamped and growing motions have no such measure:
all are kept.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits import responses as limits
from fmd.core.limits.round_off import SUMMED
from fmd.responses.state_space import Channel, StateSpace, choose_frequencies


@dataclass(frozen=True)
class ReducedModel:
    """A model with fewer states."""

    model: StateSpace  # its states have no unit, and numbers for names
    # Largest error of a response at any frequency up to the fastest pole, over the output's largest response; those of
    # what doesn't decay, which are exact, are left out of both.
    error: float
    bound: float  # bound on it at all frequencies, from the singular values of what is left out


class ModelReduction:
    """A model's balanced states, of which as many are taken as are requested."""

    def __init__(self, model: StateSpace) -> None:
        self.model = model
        kept, A, B, C = _split(model)
        self._kept, self._decaying = kept, (A, B, C)
        empty = tuple(Channel(f"state {k + 1}", "") for k in range(len(A)))
        part = StateSpace(A, B, C, np.zeros_like(model.D), empty, model.inputs, model.outputs)
        highest = limits.BEYOND_POLES * float(np.abs(part.poles).max(initial=1.0)) / (2 * np.pi)
        self._frequencies = choose_frequencies(part, 0.0, highest, limits.RESPONSE_POINTS, limits.FINE_RATIO)
        self._response = part.frequency_response(self._frequencies)
        self._to_size, self._from_size = _sizes(self._response, model)
        self._balance()

    @property
    def n_kept(self) -> int:
        """Number of states of rigid, undamped and growing motions."""
        return len(self._kept[0])

    @property
    def orders(self) -> range:
        """Numbers of states that a reduced model can have."""
        return range(self.n_kept, self.n_kept + len(self.singular_values) + 1)

    def _balance(self) -> None:
        from scipy.linalg import solve_continuous_lyapunov

        A, B, C = self._decaying
        B, C = B / self._from_size, C / self._to_size[:, None]
        reach = _root(solve_continuous_lyapunov(A, -B @ B.T))
        seen = _root(solve_continuous_lyapunov(A.T, -C.T @ C))
        left, values, right = np.linalg.svd(seen.T @ reach)
        count = int((values > limits.ROUNDED_GRAMIAN * values.max(initial=0.0)).sum())
        self.singular_values = values[:count]
        scale = 1.0 / np.sqrt(values[:count])
        self._into = reach @ right[:count].T * scale
        self._onto = (seen @ left[:, :count] * scale).T

    def to_order(self, order: int) -> ReducedModel:
        """Return the model with so many states.

        Raises
        ------
        ValueError
            There are no such many, or fewer than have to be kept.
        """
        if order not in self.orders:
            raise ValueError(
                f"must be {self.orders[0]} to {self.orders[-1]} states: {self.n_kept} are of rigid, undamped or "
                "growing motions, which are all kept"
            )
        n = order - self.n_kept
        A, B, C = self._decaying
        into, onto = self._into[:, :n], self._onto[:n]
        part = (onto @ A @ into, onto @ B, C @ into)
        kept_A, kept_B, kept_C = self._kept
        zero = np.zeros((self.n_kept, n))
        whole = StateSpace(
            np.block([[kept_A, zero], [zero.T, part[0]]]),
            np.concatenate([kept_B, part[1]]),
            np.concatenate([kept_C, part[2]], axis=1),
            self.model.D,
            tuple(Channel(f"state {k + 1}", "") for k in range(order)),
            self.model.inputs,
            self.model.outputs,
        )
        return ReducedModel(whole, self._error(part), 2.0 * float(self.singular_values[n:].sum()))

    def to_error(self, error: float) -> ReducedModel:
        """Return the model with the fewest states whose error is no larger.

        Raises
        ------
        ValueError
            No number of states has so small an error.
        """
        for order in self.orders:
            found = self.to_order(order)
            if found.error <= error:
                return found
        raise ValueError(f"can't be reached: all {self.orders[-1]} states leave {found.error:.2g}")

    def _error(self, part: tuple[Array, Array, Array]) -> float:
        names = tuple(Channel(f"state {k + 1}", "") for k in range(len(part[0])))
        model = StateSpace(*part, np.zeros_like(self.model.D), names, self.model.inputs, self.model.outputs)
        off = model.frequency_response(self._frequencies) - self._response
        return float(np.abs(off / self._to_size[:, None] / self._from_size).max(initial=0.0))


def _sizes(response: Array, model: StateSpace) -> tuple[Array, Array]:
    """Return sizes of outputs and of inputs: over both, no response is above 1, and each output has one that is 1.

    What is nothing but round-off beside another output or input of the same unit has that one's size.
    """
    size = np.abs(response).max(axis=0, initial=0.0)
    outputs = _above_round_off(size.max(axis=1, initial=0.0), model.outputs)
    inputs = _above_round_off((size / outputs[:, None]).max(axis=0, initial=0.0), model.inputs)
    return outputs, inputs


def _above_round_off(sizes: Array, channels: Sequence[Channel]) -> Array:
    units = np.array([channel.unit for channel in channels])
    largest = np.array([sizes[units == unit].max() for unit in units])
    sizes = np.where(sizes > SUMMED * largest, sizes, largest)
    return np.where(sizes > 0.0, sizes, 1.0)


def _root(gramian: Array) -> Array:
    """Return L with ``gramian = L Lᵀ``; round-off may have made small eigenvalues negative."""
    values, vectors = np.linalg.eigh((gramian + gramian.T) / 2)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _split(model: StateSpace) -> tuple[tuple[Array, Array, Array], Array, Array, Array]:
    """Return A, B, C of the motions that don't decay, and those of the others, which nothing couples any more."""
    from scipy.linalg import matrix_balance, schur, solve_sylvester

    balanced, (scale, _) = matrix_balance(model.A, permute=False, separate=True)
    still = model.slowest_pole

    def stays(real: float, imaginary: float) -> bool:
        return real > -max(still, limits.UNDAMPED * float(np.hypot(real, imaginary)))

    T, Q, k = schur(balanced, output="real", sort=stays)
    B, C = Q.T @ (model.B / scale[:, None]), (model.C * scale) @ Q
    X = solve_sylvester(T[:k, :k], -T[k:, k:], -T[:k, k:]) if 0 < k < len(T) else np.zeros((k, len(T) - k))
    kept = (T[:k, :k], B[:k] - X @ B[k:], C[:, :k])
    return kept, *_to_vibrations(T[k:, k:], B[k:], C[:, :k] @ X + C[:, k:])


def _to_vibrations(A: Array, B: Array, C: Array) -> tuple[Array, Array, Array]:
    """Return the matrices with a 2 × 2 block for each vibration, which inputs reach and outputs see about alike.

    Gramians of other coordinates span so many orders of magnitude that round-off hides the small ones.
    """
    values, vectors = np.linalg.eig(A) if len(A) else (np.zeros(0), np.zeros((0, 0)))
    upper = values.imag >= 0.0
    columns = [part for v, one in zip(vectors.T[upper], values[upper], strict=True) for part in _parts(v, one)]
    T = np.array(columns).T.reshape(len(A), len(A))
    if not len(A) or np.linalg.cond(T) * np.finfo(float).eps > limits.WORST_VIBRATIONS:
        return A, B, C
    A, B, C = np.asarray(np.linalg.solve(T, A @ T)), np.asarray(np.linalg.solve(T, B)), C @ T
    reached, seen = np.linalg.norm(B, axis=1), np.linalg.norm(C, axis=0)
    starts = np.cumsum([0, *(1 + (one.imag > 0.0) for one in values[upper])])
    for start, end in pairwise(starts):
        block = slice(start, end)
        size = np.sqrt((np.linalg.norm(reached[block]) or 1.0) / (np.linalg.norm(seen[block]) or 1.0))
        A[block], B[block] = A[block] / size, B[block] / size
        A[:, block], C[:, block] = A[:, block] * size, C[:, block] * size
    return A, B, C


def _parts(vector: Array, value: complex) -> list[Array]:
    return [vector.real, vector.imag] if value.imag > 0.0 else [vector.real]
