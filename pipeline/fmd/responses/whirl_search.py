"""Vibrations whose equations have coefficients of their own frequency: a nonlinear eigenvalue problem in one number."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.responses import PEAK_DIGITS, RIGID_POLE, WHIRL_CORRECTIONS, WHIRL_DIGITS, WHIRL_OFF_LINE
from fmd.core.limits.round_off import SOLVED
from fmd.reduction.rotating import WhirlingModes
from fmd.responses.whirl import SolvedVibrations, SpaceView, state_scale, whirling_modes


class Bracket(NamedTuple):
    """Two places of the grid between which a vibration has the frequency of its coefficients."""

    mode: int  # its number at both, from 0
    low: float  # the places [rad/s]
    high: float  # the places [rad/s]
    apart: tuple[float, float]  # how far its frequency is above each [rad/s]


class OwnVibration(NamedTuple):
    """A vibration that has the frequency of its coefficients: in Hz, its growth [1/s], its whirl, and its pole."""

    frequency_hz: float
    growth: float
    whirl: float
    pole: complex

    def is_like(self, other: OwnVibration) -> bool:
        """Return True if two are one, found twice, also by its conjugate."""
        apart = min(abs(self.pole - other.pole), abs(self.pole - other.pole.conjugate()))
        return apart <= PEAK_DIGITS * abs(self.pole)


@dataclass(frozen=True)
class WhirlSearch:
    """Search for the vibrations of a rotor at one rate whose coefficients are those at their own frequency."""

    matrix: Callable[[float], Array]  # returns the state matrix (n, n) with the coefficients of a frequency [rad/s]
    view: SpaceView  # how vibrations are seen from space
    # (n_places,): Frequencies between which they are looked for [rad/s], ascending from 0. Beyond the last the
    # coefficients are constant.
    grid: Array

    @cached_property
    def _solved(self) -> dict[float, SolvedVibrations]:
        return {}

    def _at(self, omega: float) -> SolvedVibrations:
        """Return all vibrations with the coefficients of a frequency."""
        if omega not in self._solved:
            self._solved[omega] = whirling_modes(self.matrix(omega), self.view)
        return self._solved[omega]

    def find(self) -> WhirlingModes:
        """Return all vibrations that have the frequency of their coefficients.

        The k-th frequency of the first n is continuous in that of the coefficients: of two motions without oscillation
        that were one vibration, only the first is among them.
        """
        n = min(len(self._at(omega).seen.frequencies_hz) for omega in self.grid.tolist())
        rows = [_row(self._at(omega), k) for k, omega in self._at_ends(n)]
        crossings = [*self._crossings(n)]
        quick = [self._correct(at) for at in crossings]
        for at, own in zip(crossings, quick, strict=True):
            alone = own is not None and sum(each is not None and own.is_like(each) for each in quick) == 1
            rows.append(own[:3] if own is not None and alone else self._bisect(at))
        rows = [*sorted(rows), *self._second_poles(n)]
        return WhirlingModes(*np.array(rows).T) if rows else self._at(0.0).seen

    def _apart(self, omega: float, k: int) -> float:
        found = self._at(omega).seen
        return float(2 * np.pi * found.frequencies_hz[k] - max(omega, _still(found)))  # at rest: below 0

    def _at_ends(self, n: int) -> Iterator[tuple[int, float]]:
        """Yield vibrations that stand still, and those beyond the last place, each with the place where it is known."""
        for k in range(n):
            if self._apart(float(self.grid[0]), k) <= 0.0:
                yield k, float(self.grid[0])
            if self._apart(float(self.grid[-1]), k) > 0.0:
                yield k, float(self.grid[-1])

    def _crossings(self, n: int) -> Iterator[Bracket]:
        places = self.grid.tolist()
        for k in range(n):
            apart = [self._apart(omega, k) for omega in places]
            for i in range(len(places) - 1):
                if (apart[i] > 0.0) != (apart[i + 1] > 0.0):
                    yield Bracket(k, places[i], places[i + 1], (apart[i], apart[i + 1]))

    def _bisect(self, at: Bracket) -> tuple[float, float, float]:
        omega = brentq(self._apart, at.low, at.high, args=(at.mode,), rtol=WHIRL_DIGITS)
        return _row(self._at(float(omega)), at.mode)

    def _correct(self, at: Bracket) -> OwnVibration | None:
        """Return the vibration of a crossing by Newton's method for pole, state and frequency together.

        The equations ``A(ω) v = s v``, ``vᴴ v = 1`` and ``ω = |Ω ± Im s|`` are linearised with the mean slope of A
        between both places (Ruhe, SIAM J. Numer. Anal. 10, 1973). Without an answer between these there is none.
        """
        low, high = self.matrix(at.low), self.matrix(at.high)
        scale = state_scale(low)
        slope = scale[:, None] * (high - low) / scale / (at.high - at.low)
        share = at.apart[0] / (at.apart[0] - at.apart[1])
        omega, near = at.low + share * (at.high - at.low), self._at(at.low if share < 0.5 else at.high)
        s, v = complex(near.poles[at.mode]), scale * near.vectors[:, at.mode]
        v /= np.linalg.norm(v)
        n = len(v)
        bordered, right = np.zeros((n + 1, n + 1), complex), np.zeros((n + 1, 2), complex)
        for _ in range(WHIRL_CORRECTIONS):
            A = scale[:, None] * self.matrix(omega) / scale
            bordered[:n, :n], bordered[:n, n], bordered[n, :n] = A - s * np.eye(n), -v, v.conj()
            right[:n, 0], right[:n, 1] = s * v - A @ v, -slope @ v
            try:
                change = np.linalg.solve(bordered, right)
            except np.linalg.LinAlgError:
                return None
            (frequency,), (sense,), _ = self.view.look(np.array([s]), (v / scale)[:, None])
            sense *= np.sign(frequency)
            ahead = abs(frequency) - omega + sense * change[n, 0].imag
            step = ahead / (1.0 - sense * change[n, 1].imag)
            moved = change[:, 0] + step * change[:, 1]
            v, s, omega = v + moved[:n], s + moved[n], omega + float(step)
            v /= np.linalg.norm(v)
            if not at.low <= omega <= at.high:
                return None
            if abs(step) <= WHIRL_DIGITS * omega and abs(moved[n]) <= WHIRL_DIGITS * abs(s):
                (frequency,), _, (whirl,) = self.view.look(np.array([s]), (v / scale)[:, None])
                own = OwnVibration(float(abs(frequency)) / (2 * np.pi), float(s.real), float(whirl), s)
                is_own = abs(abs(frequency) - omega) <= PEAK_DIGITS * omega and self._is_between(at, omega, s)
                return own if is_own else None
        return None

    def _is_between(self, at: Bracket, omega: float, pole: complex) -> bool:
        """Return True if a pole is near the straight line between those at both places, not another vibration's."""
        low, high = (complex(self._at(place).poles[at.mode]) for place in (at.low, at.high))
        line = low + (omega - at.low) / (at.high - at.low) * (high - low)
        return bool(abs(pole - line) <= WHIRL_OFF_LINE * abs(high - low) + SOLVED * abs(pole))

    def _second_poles(self, n: int) -> Iterator[tuple[float, float, float]]:
        """Yield the second of two motions that don't oscillate: in space it stands still, or is carried round at Ω.

        `whirling_modes` lists them after the first n.
        """
        for omega in sorted({0.0, self.view.rate}):
            solved = self._at(omega)
            for k in range(n, len(solved.seen.frequencies_hz)):
                if abs(2 * np.pi * solved.seen.frequencies_hz[k] - omega) <= _still(solved.seen):
                    yield _row(solved, k)


def _still(found: WhirlingModes) -> float:
    """Return the frequency [rad/s] below which a motion stands still."""
    return RIGID_POLE * 2 * np.pi * float(found.frequencies_hz.max(initial=0.0))


def _row(solved: SolvedVibrations, k: int) -> tuple[float, float, float]:
    frequency, growth, whirl = (float(values[k]) for values in solved.seen)
    return frequency, growth, whirl
