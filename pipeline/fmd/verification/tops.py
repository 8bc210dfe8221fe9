"""Cases of a free rigid body: Euler's symmetric top, Jacobi's functions, the racket that turns over."""

from scipy.interpolate import CubicSpline

from fmd.core.arrays import Array
from fmd.core.cache import Cache
from fmd.verification.case import Figure, VerificationCase, make_figures, open_scene
from fmd.verification.closed_forms import asymmetric_top, symmetric_top

_MOMENTS = (1.0, 2.0, 3.0)  # of models/verification/top.toml
_CLOSE = 1e-7


def _spins(cache: Cache | None, *overrides: str) -> tuple[Array, Array]:
    """Return the times, and the angular velocity along the body's axes, (n_times, 3) [rad/s]."""
    march = open_scene("verification/top", cache, overrides).motion.trajectory
    return march.times, march.v[:, 3:]


def _symmetric(cache: Cache | None) -> list[Figure]:
    inertia = 'body.top.inertia=["1 kg m^2", "1 kg m^2", "1.6 kg m^2"]'
    times, spins = _spins(cache, inertia)
    exact = symmetric_top((1.0, 1.6), (1.0, 2.0), times)
    names = [f"ω_{axis} after 20 s [rad/s]" for axis in "xyz"]
    return make_figures(names, spins[-1], exact[-1], _CLOSE)


def _asymmetric(cache: Cache | None) -> list[Figure]:
    times, spins = _spins(cache)
    exact, _ = asymmetric_top(_MOMENTS, (1.0, 2.0), times)
    names = [f"ω_{axis} after 20 s [rad/s]" for axis in "xyz"]
    return make_figures(names, spins[-1], exact[-1], _CLOSE)


def _racket(cache: Cache | None) -> list[Figure]:
    """Measure when a body that spins near the separatrix, L² = 2 E B, turns over.

    Its axis of rotation stays near the middle one, and leaves it again and again.
    """
    x, z = 1.75, 1.011  # L² − 2 E B = C (C − B) z² − A (B − A) x²: a thousandth of the first is left
    times, spins = _spins(cache, f'joint.free.spin=["{x} rad/s", "0 rad/s", "{z} rad/s"]')
    _, period = asymmetric_top(_MOMENTS, (x, z), times)
    crossings = CubicSpline(times, spins[:, 1]).roots(extrapolate=False)
    crossings = crossings[crossings > 0.1 * period]
    return [
        Figure("time until it turns over [s]", float(crossings[0]), period / 2, _CLOSE),
        Figure("period [s]", float(crossings[1]), period, _CLOSE),
    ]


_MECHANICS = "Landau & Lifshitz, Mechanics"
CASES = (
    VerificationCase("symmetric-top", "free symmetric body", f"Euler: {_MECHANICS}, §36", _symmetric),
    VerificationCase("asymmetric-top", "free asymmetric body", f"Jacobi: {_MECHANICS}, §37", _asymmetric),
    VerificationCase("tennis-racket", "racket that turns over", f"period 4K(k): {_MECHANICS}, §37", _racket),
)
