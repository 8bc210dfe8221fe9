"""Largest stable steps of plain central difference and of sub-cycling for a mechanism, ratio by ratio.

A step is called stable if the scheme by itself makes small vibrations grow less than tenfold over the duration: about
the reference state by the amplification matrix, and at operating points of the motion by the scheme's tangent map.
"""

from collections.abc import Callable, Iterable

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.round_off import SOLVED
from fmd.core.limits.stability import ALLOWED_GROWTH, BELOW_CRITICAL, BEYOND_LIMIT, BISECTIONS, SMALLEST_SHARE, SUMMIT
from fmd.dynamics.compiled_system.reference_state import FreeMotion
from fmd.dynamics.system import System
from fmd.dynamics.vibration import highest_frequency, inertial_coupling
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.protocol import ResumableIntegrator
from fmd.integrators.subcycling import Subcycling
from fmd.stability.operating_points import OperatingPoints
from fmd.stability.splitting import cycle_growth, recommend_step


@dataclass(frozen=True)
class StepLimit:
    """Largest fast steps that one ratio allows."""

    substeps: int  # fast steps to a slow one; 1 is plain central difference
    # Fast step up to which the scheme by itself makes small vibrations grow less than tenfold over the duration [s].
    critical_step: float
    worst_time: float  # time at which they grow fastest just beyond it [s]: 0 for the reference state
    sudden_step: float  # fast step up to which they grow weakly if at all, undamped in the reference state [s]
    # Fastest growth at half of that step [1/s]: 0 unless slow and fast coordinates couple through the mass matrix.
    growth_rate: float


@dataclass(frozen=True)
class MechanismLimits:
    """Largest stable steps of a mechanism, and the step and ratio that fit a wanted error."""

    # Largest canonical correlation of slow and fast coordinates in the mass matrix, β of the two-dof system.
    coupling: float
    limits: tuple[StepLimit, ...]  # one for each ratio
    along: bool  # true if operating points of the motion count, and not the reference state alone
    duration: float  # of the motion [s]
    n_slow: int  # number of slow coordinates
    # Fast step [s] and ratio for the wanted error; the ratio is 1 if any other would let a vibration grow.
    recommended: tuple[float, int]


def find_limits(
    system: System,
    reference: FreeMotion,
    ratios: Iterable[int],
    duration: float,
    error: float,
    points: OperatingPoints | None = None,
) -> MechanismLimits:
    """Find the largest stable steps of a mechanism about its reference state and, if given, at operating points.

    Ratios are numbers of fast steps to a slow one, plain central difference first; the step to recommend has an error
    relative to the largest deformation over a duration [s].
    """
    limits = tuple(find_limit(system, reference, m, duration, points) for m in ratios)
    step, m = recommend_step(reference.M, reference.K, reference.n_slow, error, duration)
    step = min(step, BELOW_CRITICAL * limits[0].critical_step)
    if points:
        step, m = _recommend_along(points, step, m, error)
    coupling = inertial_coupling(reference.M, reference.n_slow)
    return MechanismLimits(coupling, limits, points is not None, duration, reference.n_slow, (step, m))


def find_limit(
    system: System, reference: FreeMotion, m: int, duration: float, points: OperatingPoints | None = None
) -> StepLimit:
    """Find the largest stable fast step of a mechanism with m fast steps to a slow one."""
    M, K, C, n_slow = reference
    sudden, rate = find_sudden_step(M, K, n_slow, m)

    def e_folds(step: float) -> float:
        return float(duration / (m * step) * np.log(max(cycle_growth(M, K, n_slow, step, m, C), 1.0)))

    critical, worst = longest_safe_step(e_folds, sudden, BISECTIONS), 0.0
    if points:
        along = longest_safe_step(lambda step: points.e_folds(explicit_method(step, m)), critical)
        if along < critical:
            rates = points.excess_growth(explicit_method(min(BEYOND_LIMIT * along, critical), m)).max(axis=1)
            critical, worst = along, points.points[int(np.argmax(rates))].time
    return StepLimit(m, critical, worst, sudden, rate)


def explicit_method(step: float, m: int) -> ResumableIntegrator:
    """Return central difference with a fast step [s], sub-cycled if there are m > 1 fast steps to a slow one."""
    return CentralDifference(step) if m == 1 else Subcycling(step, m)


def _recommend_along(points: OperatingPoints, step: float, most: int, error: float) -> tuple[float, int]:
    """Reduce a ratio until growth along the motion stays below the wanted error."""
    low, high = 1, most + 1
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if points.e_folds(explicit_method(step, middle)) < error else (low, middle)
    return step, low


def find_sudden_step(M: Array, K: Array, n_slow: int, substeps: int) -> tuple[float, float]:
    """Bisect for the fast step beyond which undamped vibrations grow suddenly, within a few major cycles.

    A weakly unstable cycle multiplies a vibration by ``1 + c β² Ω²/(1 − β²)``, a suddenly unstable one by Ω² − 2 or so:
    between them lies a jump, whose place is the limit. Step and growth rate are as in `StepLimit`.
    """
    L, S = slice(0, n_slow), slice(n_slow, None)
    upper = min(2.02 / highest_frequency(M[S, S], K[S, S]), 2.02 / (substeps * highest_frequency(M[L, L], K[L, L])))
    if substeps == 1:
        upper = 2.02 / highest_frequency(M, K)
    small = 0.05 * upper
    weak = max(cycle_growth(M, K, n_slow, small, substeps) - 1, 0.0) * (upper / small) ** 2  # by its square
    low, high = 0.0, upper
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        allowed = 1 + SOLVED + 4 * weak * (middle / upper) ** 2
        if cycle_growth(M, K, n_slow, middle, substeps) <= allowed:
            low = middle
        else:
            high = middle
    radius = cycle_growth(M, K, n_slow, 0.5 * low, substeps) if low else 1.0
    rate = np.log(radius) / (substeps * 0.5 * low) if radius > 1 + SOLVED else 0.0
    return low, float(rate)


_SCAN = 0.5 ** np.arange(6.0, -0.5, -0.5)  # shares of the upper step


def longest_safe_step(e_folds: Callable[[float], float], upper: float, bisections: int = 8) -> float:
    """Return the longest step [s], up to ``upper``, by which small vibrations grow by `ALLOWED_GROWTH` at most.

    That is ``upper`` if nothing below it grows; 0 if everything down to a millionth of it does. Where growth falls
    again before it is too much, but after half of the e-folds allowed, it is the step at which it is largest.
    ``e_folds`` gives those of growth over the duration with a step [s]; the interval of the limit, which begins as a
    factor of √2, is halved ``bisections`` times.
    """
    allowed = np.log(ALLOWED_GROWTH)
    low = high = before = 0.0
    for share in _SCAN:
        folds = e_folds(share * upper)
        if folds > allowed:
            high = share * upper
            break
        if before > max(folds, SUMMIT * allowed):
            steps = np.geomspace(low * _SCAN[0] / _SCAN[1], share * upper, 9)[:-1]
            near = np.array([0.0, *(e_folds(step) for step in steps[1:])])
            beyond = np.flatnonzero(near > allowed)
            if not beyond.size:
                return float(steps[np.argmax(near)])
            low, high = float(steps[beyond[0] - 1]), float(steps[beyond[0]])
            break
        low, before = share * upper, folds
    if not high:
        return upper
    while not low:
        lower = 0.25 * high
        if lower < SMALLEST_SHARE * upper:
            return 0.0
        if e_folds(lower) > allowed:
            high = lower
        else:
            low = lower
    for _ in range(bisections):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if e_folds(middle) <= allowed else (low, middle)
    return low
