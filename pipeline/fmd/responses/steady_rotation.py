"""Steady rotation of a mechanism: where a rotor that turns as a whole is at rest in the axes that turn with it.

Its parts are stretched by their inertia and by what acts on them. Linearised anywhere else, the accelerations that are
left would count as stiffness, through all that depends on the deflection.

An unbalanced rotor in bearings whirls, without bound at its critical rates. Its vibrations are those about its straight
axis, so the motions in which the axis bends or tilts are left out of the search.
"""

from collections.abc import Callable

import numpy as np
from scipy.linalg import eigh

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError
from fmd.core.limits import newton as limits
from fmd.core.limits.responses import BENDS
from fmd.core.limits.round_off import SUMMED
from fmd.core.newton import Tolerance, largest, solve
from fmd.responses.linearisation import Linearisation, Motions
from fmd.responses.moving_axes import position_map, turning_axes, with_unit_quaternions
from fmd.responses.state_space import StateSpace
from fmd.stability.tangent import OperatingPoint

_TOLERANCE = Tolerance(limits.STEADY_CORRECTIONS, relative=limits.TURNING, absolute=SUMMED)


@dataclass(frozen=True)
class Rotation:
    """A rotation of a mechanism as a whole."""

    rates: Array  # (n,): rates of all coordinates
    motions: Motions  # position, rate and acceleration of each prescribed joint


class SteadyRotation:
    """The search for steady rotations of a mechanism.

    ``turning`` returns the `Rotation` at a rate [rad/s] and positions; in the coordinates of names ``still`` the
    mechanism turns as a whole: they stay. ``close`` returns positions in which loops are closed, near to given ones.
    """

    def __init__(
        self,
        linearisation: Linearisation,
        turning: Callable[[float, Array], Rotation],
        still: tuple[str, ...],
        close: Callable[[Array], Array],
    ) -> None:
        self.linearisation, self.turning, self.close = linearisation, turning, close
        self._names = linearisation.rate_names()
        self._still = still
        links = linearisation.mechanism.links
        self._modes = np.concatenate([linearisation.mechanism.modes_of(k) for k in range(len(links))])
        self._basis: tuple[Array, Array] | None = None
        self._last: tuple[tuple[float, bytes], Array] | None = None  # state that was asked last: it is asked again

    def leave_out_bending(self, q: Array, across: IntArray) -> None:
        """Leave motions out of the search that move the axis at rest, at positions q.

        The linearisation's outputs ``across`` are displacements of points on the axis, across it.
        """
        rotation = self.turning(0.0, q)
        model, free = self._model(0.0, q)
        k = len(free)
        M = self.linearisation.mass_matrix(OperatingPoint(0.0, q, rotation.rates), rotation.motions)
        K = -M @ model.A[k:, :k]
        stiffness, ways = eigh(0.5 * (K + K.T), M)
        moved = ((model.C[across][:, :k] @ ways) ** 2).sum(axis=0) * self.linearisation.mechanism.mass
        kept = (np.abs(stiffness) > SUMMED * np.abs(stiffness).max(initial=0.0)) & (moved < BENDS)
        self._basis = ways[:, kept], ways[:, kept].T @ M

    def find(self, rate: float, q: Array) -> Array:
        """Return positions (n_positions,) at which a mechanism turns steadily, from others near by.

        Raises
        ------
        AccuracyError
            There are none: something gives way, or turns ever faster.
        """
        sizes = [0.0]

        def correction(q: Array, left: Array) -> Array:
            model, free = self._model(rate, q)
            change = np.zeros(len(self._names))
            change[free] = self._correction(model, free, left[free])
            sizes.append(largest(change))
            return change

        def shorten(change: Array) -> Array:
            joints = largest(np.delete(change, self._modes))
            return change * min(1.0, limits.FARTHEST / max(joints, limits.SHORTEST_NORM))

        found = solve(
            q,
            lambda q: self.accelerations(rate, q),
            correction,
            lambda q, change: self._move(rate, q, change),
            _TOLERANCE,
            scale=lambda q: max(sizes),
            shorten=shorten,
        )
        if found.converged:
            return found.state
        if found.failure != "too many corrections":
            raise AccuracyError(f"no steady rotation at {rate:.4g} rad/s: the search for it has run away")
        raise AccuracyError(
            f"no steady rotation at {rate:.4g} rad/s: modes and joints still change by {found.size:.1e} after "
            f"{found.corrections} corrections; something gives way to its inertia or to a load of the start"
        )

    def accelerations(self, rate: float, q: Array) -> Array:
        """Return the accelerations of all coordinates, as the turning axes see them, (n,)."""
        state = rate, q.tobytes()
        if self._last is None or self._last[0] != state:
            self._last = state, self._accelerations(rate, q)
        return self._last[1]

    def _accelerations(self, rate: float, q: Array) -> Array:
        rotation = self.turning(rate, q)
        W, _, sliding = turning_axes(self.linearisation.mechanism, q, rotation.rates)
        a = self.linearisation.accelerations(OperatingPoint(0.0, q, rotation.rates), rotation.motions)
        return np.asarray(W.T @ a - sliding @ W.T @ rotation.rates)

    def model(self, rate: float, q: Array) -> StateSpace:
        """Linearise at positions in which the mechanism turns at a rate [rad/s]."""
        rotation = self.turning(rate, q)
        return self.linearisation.at(OperatingPoint(0.0, q, rotation.rates), rotation.motions)

    def _model(self, rate: float, q: Array) -> tuple[StateSpace, IntArray]:
        """Return the linear model, and the numbers of its independent coordinates."""
        model = self.model(rate, q)
        return model, self.independent(model)

    def independent(self, model: StateSpace) -> IntArray:
        """Return the numbers of a model's independent coordinates, in the order of its positions."""
        numbers = {name: k for k, name in enumerate(self._names)}
        names = model.states[: len(model.states) // 2]
        return np.array([numbers[name] for name, _ in names], dtype=np.int64)

    def _correction(self, model: StateSpace, free: IntArray, left: Array) -> Array:
        """Return Newton's correction of the independent coordinates, in axes that turn with free bodies."""
        k = len(free)
        slopes = model.A[k:, :k] - model.A[k:, k:] @ model.A[:k, :k]
        basis, dual = self._basis if self._basis else self._turning_with(free)
        own = dual @ slopes @ basis
        scale = 1.0 / np.sqrt(np.maximum(np.abs(own.diagonal()), limits.SOFT))
        found = np.linalg.lstsq(scale[:, None] * own * scale, -scale * (dual @ left), rcond=limits.LOOSE)[0]
        return np.asarray(basis @ (scale * found))

    def _turning_with(self, free: IntArray) -> tuple[Array, Array]:
        """Return a basis of all coordinates that don't turn the mechanism as a whole, and its dual one."""
        loose = [j for j, number in enumerate(free) if self._names[number] not in self._still]
        basis = np.eye(len(free))[:, loose]
        return basis, basis.T

    def _move(self, rate: float, q: Array, change: Array) -> Array:
        """Return positions moved by a change (n,) in axes that turn with free bodies, with loops closed."""
        mechanism = self.linearisation.mechanism
        W, _, _ = turning_axes(mechanism, q, self.turning(rate, q).rates)
        return self.close(with_unit_quaternions(mechanism, q + position_map(mechanism, q) @ (W @ change)))
