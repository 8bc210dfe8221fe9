"""Which step is safe: maps of the two-degree-of-freedom system, and the limits of a scene's own mechanism."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.core.arrays import Array
from pipeline.core.errors import InputError
from pipeline.dynamics.vibration import highest_frequency
from pipeline.stability.amplification import STABLE, growth
from pipeline.stability.growth import longest_safe_step
from pipeline.stability.splitting import recommended_step
from pipeline.stability.two_dof import SCHEMES, growth_law, stability_map
from pipeline.stages.operating_points import course_of

__all__ = ["laws", "require_map", "scene_stability", "summary_of_maps", "summary_of_scene", "two_dof"]

if TYPE_CHECKING:
    from pipeline.dynamics.mechanism import Mechanism
    from pipeline.dynamics.system import System
    from pipeline.integrators.protocol import Integrator
    from pipeline.stability.growth import Course
    from pipeline.stability.two_dof import Map
    from pipeline.stages.pipeline import Pipeline

_BISECTIONS = 30


def require_map(substeps: int, couplings: list[float], scheme: str, resolution: int) -> None:
    """Raise `InputError` unless maps can be made with these options."""
    if not all(0 <= beta < 1 for beta in couplings):
        raise InputError("--coupling", "", couplings, "must be 0 ≤ β < 1")
    if not 1 <= substeps <= 1000 or not 2 <= resolution <= 2000:
        raise InputError("--substeps", "", substeps, "must be 1 … 1000, and --resolution 2 … 2000")
    if scheme not in SCHEMES:
        raise InputError("--scheme", "", scheme, f"must be one of {', '.join(SCHEMES)}")


def two_dof(substeps: int, couplings: list[float], resolution: int, scheme: str, folder: Path) -> tuple[list[Map], str]:
    """Compute the maps of the two-dof system for one ratio, and draw them; return them and the picture's name."""
    from pipeline.render.stability_chart import Panel, draw_stability

    maps = [stability_map(substeps, coupling, resolution, scheme) for coupling in couplings]
    kind = "" if scheme == "sub-cycling" else f"{scheme}-"
    name = f"two-dof-{kind}{substeps}-substeps.png"
    panels = [Panel(m.omega_s, m.omega_l, m.rho, f"β = {m.coupling:g}") for m in maps]
    title = f"{'Reversible sub' if kind else 'Sub'}-cycling with {substeps} fast steps to a slow one"
    folder.mkdir(parents=True, exist_ok=True)
    draw_stability(panels, folder / name, title=title)
    return maps, name


def laws() -> list[dict[str, float]]:
    """Fit ``ρ − 1 = c(m) β^b Ω_S^s/(1 − β²)`` for each ratio from 2 to 20."""
    couplings, courant = np.array([0.01, 0.03, 0.1, 0.3, 0.77]), np.array([1e-3, 2e-3, 5e-3])
    return [asdict(growth_law(m, couplings, courant)) for m in range(2, 21)]


@dataclass(frozen=True)
class Limit:
    """What one ratio allows.

    Attributes
    ----------
    substeps : int
        m; 1 is plain central difference.
    critical_step : float
        Fast step up to which the method itself makes small vibrations grow less than tenfold over the scene [s].
    worst_time : float
        When they grow fastest just beyond it [s]: 0 for the reference state.
    sudden_step : float
        Fast step up to which they grow weakly if at all, undamped in the reference state [s].
    growth_rate : float
        Fastest growth at half of that step [1/s]: 0 unless slow and fast coordinates couple through the mass matrix.
    """

    substeps: int
    critical_step: float
    worst_time: float
    sudden_step: float
    growth_rate: float


@dataclass(frozen=True)
class SceneStability:
    """A scene's limits.

    Attributes
    ----------
    coupling : float
        Largest canonical correlation of slow and fast coordinates in the mass matrix, β of the two-dof system.
    limits : tuple of Limit
        For each ratio.
    along : bool
        Whether the states of the scene's motion count, and not the reference state alone.
    duration : float
        Of the scene [s].
    n_slow : int
        Number of slow coordinates.
    recommended : tuple of float and int
        Fast step [s] and ratio for the scene's wanted error, the ratio 1 if any other would let a mode grow.
    """

    coupling: float
    limits: tuple[Limit, ...]
    along: bool
    duration: float
    n_slow: int
    recommended: tuple[float, int]


def scene_stability(run: Pipeline, ratios: list[int], along: bool) -> SceneStability:
    """Find the limits of a scene's mechanism at its reference state or, ``along`` its motion, at the worst state too.

    The split is that of the scene's first sub-cycled run; without one, the joints are slow. The motion is taken by
    states with all bodies rigid and all modes and fast joints at rest where the loads leave them.
    """
    simulation = run.scene.simulation
    mechanism, system = _split(run)
    M, K, C = system.linear_matrices
    course = course_of(run, mechanism, system) if along else None
    limits = []
    with run.store.monitor("stability") as advance:
        for k, m in enumerate(ratios):
            limits.append(_limit(system, (M, K, C), m, simulation.duration, course))
            advance((k + 1) / len(ratios))
    best = recommended_step(M, K, system.n_slow, simulation.error, simulation.duration)
    beta = mass_coupling(M, system.n_slow)
    if course:
        best = _recommended_along(course, *best, simulation.error, limits[0].critical_step)
        if system is mechanism:
            masses = [mechanism.mass_matrix(at.q, at.time) for at in course.states]
            beta = max(beta, *(mass_coupling(mass, system.n_slow) for mass in masses))
    return SceneStability(beta, tuple(limits), along, simulation.duration, system.n_slow, best)


def _limit(
    system: System, matrices: tuple[Array, Array, Array], m: int, duration: float, course: Course | None
) -> Limit:
    M, K, C = matrices
    sudden, rate = find_limit(M, K, system.n_slow, m)

    def folds(step: float) -> float:
        return float(duration / (m * step) * np.log(max(growth(M, K, system.n_slow, step, m, C), 1.0)))

    critical, worst = longest_safe_step(folds, sudden, _BISECTIONS), 0.0
    if course:
        along = longest_safe_step(lambda step: course.e_folds(explicit(step, m)), critical)
        if along < critical:
            rates = course.excess(explicit(min(1.02 * along, critical), m)).max(axis=1)
            critical, worst = along, course.states[int(np.argmax(rates))].time
    return Limit(m, critical, worst, sudden, rate)


def explicit(step: float, m: int) -> Integrator:
    """Central difference, or sub-cycling with m fast steps to a slow one."""
    from pipeline.integrators.central_difference import CentralDifference
    from pipeline.integrators.subcycling import Subcycling

    return CentralDifference(step) if m == 1 else Subcycling(step, m)


def _recommended_along(course: Course, step: float, m: int, error: float, critical: float) -> tuple[float, int]:
    """The largest ratio, and the step, that keep growth along the motion below the wanted error too."""
    step, low, high = min(step, 0.8 * critical), 1, m + 1
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if course.e_folds(explicit(step, middle)) < error else (low, middle)
    return step, low


def find_limit(M: Array, K: Array, n_slow: int, substeps: int) -> tuple[float, float]:
    """Bisect the fast step up to which a major cycle's growth stays weak: below that of one that is really unstable.

    A weakly unstable cycle multiplies a mode by ``1 + c β² Ω²/(1 − β²)``, an unstable one by Ω² − 2 or so: between them
    lies a jump, whose place is the limit.

    Returns
    -------
    sudden_step, growth_rate : float
        As in `Limit`.
    """
    L, S = slice(0, n_slow), slice(n_slow, None)
    upper = min(2.02 / highest_frequency(M[S, S], K[S, S]), 2.02 / (substeps * highest_frequency(M[L, L], K[L, L])))
    if substeps == 1:
        upper = 2.02 / highest_frequency(M, K)
    small = 0.05 * upper
    weak = max(growth(M, K, n_slow, small, substeps) - 1, 0.0) * (upper / small) ** 2  # by its square
    low, high = 0.0, upper
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        allowed = 1 + STABLE + 4 * weak * (middle / upper) ** 2
        if growth(M, K, n_slow, middle, substeps) <= allowed:
            low = middle
        else:
            high = middle
    radius = growth(M, K, n_slow, 0.5 * low, substeps) if low else 1.0
    rate = np.log(radius) / (substeps * 0.5 * low) if radius > 1 + STABLE else 0.0
    return low, float(rate)


def mass_coupling(M: Array, n_slow: int) -> float:
    """Largest ``x_Lᵀ M_LS x_S`` for ``x_Lᵀ M_LL x_L = x_Sᵀ M_SS x_S = 1``: 0 without coupling, always below 1."""
    if not 0 < n_slow < len(M):
        return 0.0
    L, S = (np.linalg.cholesky(M[part, part]) for part in (slice(0, n_slow), slice(n_slow, None)))
    return float(np.linalg.norm(np.linalg.solve(L, np.linalg.solve(S, M[n_slow:, :n_slow]).T), 2))


def _split(run: Pipeline) -> tuple[Mechanism, System]:
    """Mechanism with the split of the scene's first sub-cycled run, and the system that marches it."""
    from pipeline.stages.runs import sub_cycled

    for one in run.scene.simulation.run:
        if one.integrator in ("sub-cycling", "reversible-sub-cycling"):
            chosen = one.split == "auto" and run.scene.simulation.step == "auto"
            plan = sub_cycled(run, one, "", None if chosen else one.step or _any_step(run))
            return plan.mechanism, plan.system
    return run.mechanism, run.system


def _any_step(run: Pipeline) -> float:
    """The scene's fast step, which only a split that is chosen depends on [s]."""
    step = run.scene.simulation.step
    return step if isinstance(step, float) else 1.0


def summary_of_maps(maps: list[Map], file: str) -> dict[str, Any]:
    """Give the maps' figures in plain numbers."""
    rows = [
        {
            "substeps": m.substeps,
            "coupling": m.coupling,
            "spectral_radius": float(m.rho.max()),
            "stable_share": float(1 - m.unstable.mean()),
            "map": {"omega_l": m.omega_l.tolist(), "omega_s": m.omega_s.tolist(), "rho": m.rho.tolist()},
        }
        for m in maps
    ]
    return {"maps": rows, "files": [file]}


def summary_of_scene(found: SceneStability) -> dict[str, Any]:
    """Give a scene's limits in plain numbers."""
    step, substeps = found.recommended
    return {
        "coupling": found.coupling,
        "slow_coordinates": found.n_slow,
        "along": found.along,
        "duration_s": found.duration,
        "worst_time_s": found.limits[0].worst_time,
        "critical_step_s": found.limits[0].critical_step,
        "recommended": {"step_s": step, "substeps": substeps},
        "rows": [
            {
                "substeps": row.substeps,
                "critical_step_s": row.critical_step,
                "worst_time_s": row.worst_time,
                "sudden_step_s": row.sudden_step,
                "growth_rate_per_s": row.growth_rate,
            }
            for row in found.limits
        ],
    }
