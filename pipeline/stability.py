"""Which step is safe: maps of the two-degree-of-freedom system, and the limits of a scene's own mechanism."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.checks import Array
from pipeline.studies.amplification import STABLE, growth
from pipeline.studies.splitting import frequencies, recommended_step
from pipeline.studies.two_dof import SCHEMES, growth_law, stability_map

__all__ = ["SCHEMES", "laws", "scene_stability", "summary_of_maps", "summary_of_scene", "two_dof"]

if TYPE_CHECKING:
    from pipeline.dynamics.tree import Tree
    from pipeline.stages import Pipeline
    from pipeline.studies.two_dof import Map

_BISECTIONS = 40
_COARSE = 200


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
    """What one ratio allows in one state.

    Attributes
    ----------
    substeps : int
        m; 1 is plain central difference.
    critical_step : float
        Largest fast step at which no mode grows faster than the weak instability makes it [s].
    growth_rate : float
        Fastest growth at half of that step [1/s]: 0 unless slow and fast coordinates couple through the mass matrix.
    """

    substeps: int
    critical_step: float
    growth_rate: float


@dataclass(frozen=True)
class SceneStability:
    """A scene's limits.

    Attributes
    ----------
    coupling : float
        Largest canonical correlation of slow and fast coordinates in the mass matrix, β of the two-dof system.
    limits : tuple of Limit
        For each ratio, in the state where plain central difference has its shortest step.
    time : float
        When that is [s]: 0 for the reference state.
    n_slow : int
        Number of slow coordinates.
    recommended : tuple of float and int
        Fast step [s] and ratio for the scene's wanted error, the ratio 1 if any other would let a mode grow.
    """

    coupling: float
    limits: tuple[Limit, ...]
    time: float
    n_slow: int
    recommended: tuple[float, int]


def scene_stability(run: Pipeline, ratios: list[int], along: bool) -> SceneStability:
    """Find the limits of a scene's mechanism at its reference state or, ``along`` its first run, at the worst.

    The split is that of the scene's first sub-cycled run; without one, the joints are slow.
    """
    tree = _split_tree(run)
    K = tree.linear_stiffness
    worst, time = tree.mass_matrix(tree.rest_positions), 0.0
    if along:
        q, times = _positions(run, tree)
        for k in range(0, len(times), max(1, len(times) // _COARSE)):
            M = tree.mass_matrix(q[k], times[k])
            if _highest(M, K) > _highest(worst, K) * (1 + 1e-12):
                worst, time = M, float(times[k])
    limits = tuple(find_limit(worst, K, tree.n_slow, m) for m in ratios)
    best = recommended_step(worst, K, tree.n_slow, run.scene.simulation.error, run.scene.simulation.duration)
    return SceneStability(mass_coupling(worst, tree.n_slow), limits, time, tree.n_slow, best)


def find_limit(M: Array, K: Array, n_slow: int, substeps: int) -> Limit:
    """Bisect the fast step up to which a major cycle's growth stays weak: below that of one that is really unstable.

    A weakly unstable cycle multiplies a mode by ``1 + c β² Ω²/(1 − β²)``, an unstable one by Ω² − 2 or so: between them
    lies a jump, whose place is the limit.
    """
    upper = 2.02 / _highest(M[n_slow:, n_slow:], K[n_slow:, n_slow:]) if n_slow < len(M) else np.inf
    upper = min(upper, 2.02 / (substeps * _highest(M[:n_slow, :n_slow], K[:n_slow, :n_slow])) if n_slow else np.inf)
    if substeps == 1:
        upper = 2.02 / _highest(M, K)
    weak = _weakest(M, K, n_slow, substeps, upper)
    low, high = 0.0, upper
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        allowed = 1 + STABLE + 4 * weak * (middle / upper) ** 2
        if growth(M, K, n_slow, middle, substeps) <= allowed:
            low = middle
        else:
            high = middle
    half = 0.5 * low
    radius = growth(M, K, n_slow, half, substeps) if half else 1.0
    rate = np.log(radius) / (substeps * half) if radius > 1 + STABLE else 0.0
    return Limit(substeps, low, float(rate))


def _weakest(M: Array, K: Array, n_slow: int, substeps: int, upper: float) -> float:
    """Growth of a cycle at a small step, carried to the step ``upper`` by its square."""
    small = 0.05 * upper
    return max(growth(M, K, n_slow, small, substeps) - 1, 0.0) * (upper / small) ** 2


def mass_coupling(M: Array, n_slow: int) -> float:
    """Largest ``x_Lᵀ M_LS x_S`` for ``x_Lᵀ M_LL x_L = x_Sᵀ M_SS x_S = 1``: 0 without coupling, always below 1."""
    if not 0 < n_slow < len(M):
        return 0.0
    L, S = (np.linalg.cholesky(M[part, part]) for part in (slice(0, n_slow), slice(n_slow, None)))
    return float(np.linalg.norm(np.linalg.solve(L, np.linalg.solve(S, M[n_slow:, :n_slow]).T), 2))


def _highest(M: Array, K: Array) -> float:
    return float(frequencies(M, K).max(initial=1e-150))


def _split_tree(run: Pipeline) -> Tree:
    """The scene's chain with the split of its first sub-cycled run."""
    from pipeline.mechanism import chain_of
    from pipeline.studies.splitting import split_at

    tree = chain_of(run.scene, run.bodies).tree
    for one in run.scene.simulation.run:
        if one.integrator == "sub-cycling" and not isinstance(one.split, str):
            return chain_of(run.scene, run.bodies, *split_at(tree, one.split)).tree
    return tree


def _positions(run: Pipeline, tree: Tree) -> tuple[Array, Array]:
    """Positions of a tree over the scene's first run, whatever the order in which that keeps them."""
    motion: Any = run.first_motion
    if run.is_rotor:
        return motion.trajectory.q, motion.times
    q = motion.trajectory.q.copy()
    for k in range(len(tree.links)):
        here, there = tree.layout.position[k], motion.tree.layout.position[k]
        n = tree.links[k].n_positions
        q[:, here : here + n] = motion.trajectory.q[:, there : there + n]
        to, of = tree.modes_of(k) + tree.n_positions - tree.n, motion.tree.modes_of(k) + tree.n_positions - tree.n
        q[:, to] = motion.trajectory.q[:, of]
    return q, motion.times


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
        "worst_time_s": found.time,
        "critical_step_s": found.limits[0].critical_step,
        "recommended": {"step_s": step, "substeps": substeps},
        "rows": [
            {"substeps": row.substeps, "critical_step_s": row.critical_step, "growth_rate_per_s": row.growth_rate}
            for row in found.limits
        ],
    }
