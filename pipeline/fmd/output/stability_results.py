"""Stability maps as pictures, and the figures of maps and limits in plain numbers for JSON."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fmd.stability.limits import MechanismLimits
from fmd.stability.two_dof import StabilityMap, stability_map


def write_maps(
    substeps: int, couplings: Sequence[float], resolution: int, folder: Path
) -> tuple[list[StabilityMap], str]:
    """Draw the stability of the two-degree-of-freedom system for one ratio, a panel for each inertial coupling.

    Returns the map of each coupling, and the name of the picture in the folder.
    """
    from fmd.render.stability_chart import Panel, draw_stability

    maps = [stability_map(substeps, coupling, resolution) for coupling in couplings]
    name = f"two-dof-{substeps}-substeps.png"
    panels = [Panel(m.omega_s, m.omega_l, m.rho, f"β = {m.coupling:g}") for m in maps]
    title = f"Sub-cycling with {substeps} fast steps to a slow one"
    draw_stability(panels, folder / name, title=title)
    return maps, name


def summarise_maps(maps: Sequence[StabilityMap], file: str) -> dict[str, Any]:
    """Return the figures of stability maps, and the name of their picture, under the keys of ``--json``."""
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


def summarise_limits(limits: MechanismLimits) -> dict[str, Any]:
    """Return the largest stable steps of a mechanism under the keys of ``--json``."""
    step, substeps = limits.recommended
    return {
        "coupling": limits.coupling,
        "slow_coordinates": limits.n_slow,
        "along": limits.along,
        "duration_s": limits.duration,
        "worst_time_s": limits.limits[0].worst_time,
        "critical_step_s": limits.limits[0].critical_step,
        "recommended": {"step_s": step, "substeps": substeps},
        "rows": [
            {
                "substeps": row.substeps,
                "critical_step_s": row.critical_step,
                "worst_time_s": row.worst_time,
                "sudden_step_s": row.sudden_step,
                "growth_rate_per_s": row.growth_rate,
            }
            for row in limits.limits
        ],
    }
