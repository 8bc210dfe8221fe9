"""``fmd stability``: the largest safe step of a scene, and maps of the two-degree-of-freedom system."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from fmd.cli.inputs import DEFAULTS, Options
from fmd.cli.options import Flag, SceneName, print_json
from fmd.cli.tables import open_console, print_files, print_table
from fmd.core.errors import InputError

if TYPE_CHECKING:
    from fmd.stability.limits import MechanismLimits


def stability(
    scene: SceneName = "",
    *,
    two_dof: Flag = False,
    substeps: int = 0,
    coupling: Annotated[list[float] | None, Parameter(negative=())] = None,
    law: Flag = False,
    resolution: int = 400,
    along: Flag = False,
    out: Path | None = None,
    options: Options = DEFAULTS,
) -> None:
    """Largest safe step: of a scene's mechanism, or as a map for the two-degree-of-freedom system.

    Parameters
    ----------
    two_dof
        Map the two-degree-of-freedom system of the paper's Figs. 2 and 3 instead.
    substeps
        Fast steps to a slow one; 2 for a map, 1 to 20 for a scene by default.
    coupling
        Inertial coupling of the map, 0 ≤ β < 1; give it several times for several maps.
    law
        With --two-dof: fit the law of the weak instability for each ratio from 2 to 20 instead of mapping one.
    resolution
        Points of a map each way.
    along
        Look for the worst state along the scene's first run, not only at its reference state.
    out
        Folder for the picture; out/stability by default.
    """
    if two_dof == bool(scene):
        raise InputError("stability", "", scene or None, "give a scene, e.g. beam, or --two-dof")
    if two_dof:
        substeps, couplings = substeps or 2, coupling or [0.0]
        _require_map(substeps, couplings, resolution)
        if law:
            _fit_laws(options.json)
        else:
            _draw_maps(substeps, couplings, resolution, out or Path("out") / "stability", options.json)
        return
    if not 0 <= substeps <= 1000:
        raise InputError("--substeps", "", substeps, "must be 1 … 1000")
    from fmd.output.stability_results import summarise_limits
    from fmd.stages.stability_limits import find_scene_limits

    run = options.solve(scene)
    result = find_scene_limits(run, [1, substeps] if substeps else list(range(1, 21)), along)
    if options.json:
        print_json(summarise_limits(result))
        return
    _print_limits(run.scene.title, result)
    if run.scene.contact:
        text = "contacts count as closed; opening and closing feed the highest modes from half of the largest step on"
        open_console().print(text)


def _require_map(substeps: int, couplings: list[float], resolution: int) -> None:
    """Raise `InputError` unless maps can be made with these options."""
    if not all(0 <= beta < 1 for beta in couplings):
        raise InputError("--coupling", "", couplings, "must be 0 ≤ β < 1")
    if not 1 <= substeps <= 1000 or not 2 <= resolution <= 2000:
        raise InputError("--substeps", "", substeps, "must be 1 … 1000, and --resolution 2 … 2000")


def _draw_maps(substeps: int, couplings: list[float], resolution: int, folder: Path, json: bool) -> None:
    """Draw the maps of one ratio, and print the stable share of each."""
    from fmd.output.stability_results import summarise_maps, write_maps

    summary = summarise_maps(*write_maps(substeps, couplings, resolution, folder))
    if json:
        print_json(summary if len(summary["maps"]) > 1 else summary | summary["maps"][0])
        return
    columns = {"β": "{:g}", "m": "{}", "stable share": "{:.2f} %", "largest ρ": "{:.4g}"}
    rows = [(r["coupling"], r["substeps"], 100 * r["stable_share"], r["spectral_radius"]) for r in summary["maps"]]
    print_table("Two degrees of freedom", columns, rows)
    print_files(folder, summary["files"])


def _fit_laws(json: bool) -> None:
    """Print the fitted law of the weak instability for each ratio."""
    from fmd.stability.two_dof import fit_growth_law

    rows: list[dict[str, Any]] = [asdict(law) for law in map(fit_growth_law, range(2, 21))]
    if json:
        print_json({"rows": rows})
        return
    columns = {"m": "{}", "c": "{:.4g}", "m(m − 1)/4": "{:g}", "power of β": "{:.4f}", "power of Ω_S": "{:.4f}"}
    cells = [
        (m, row["factor"], m * (m - 1) / 4, row["coupling_power"], row["courant_power"], 100 * row["misfit"])
        for row in rows
        for m in [int(row["substeps"])]
    ]
    print_table("ρ − 1 = c β² Ω_S²/(1 − β²)", columns | {"misfit": "{:.2g} %"}, cells)


def _print_limits(title: str, result: MechanismLimits) -> None:
    """Print the largest stable step of each ratio, and the step for the scene's error."""
    columns = {"m": "{}", "largest stable fast step": "{:.4g} s", "sudden beyond": "{:.4g} s"}
    columns |= {"growth at half of that": "{}"} | ({"worst at": "{}"} if result.along else {})
    rows = []
    for row in result.limits:
        grows = f"{row.growth_rate:.3g} 1/s" if row.growth_rate else "none"
        when = [f"{row.worst_time:.3g} s" if row.worst_time else "rest"] if result.along else []
        rows.append((row.substeps, row.critical_step, row.sudden_step, grows, *when))
    print_table(title, columns, rows)
    console = open_console()
    step, substeps = result.recommended
    console.print(
        f"stable: by the method itself small vibrations grow less than tenfold in the scene's {result.duration:g} s, "
        + ("along its motion" if result.along else "about the reference state (--along: about its motion too)")
    )
    console.print(
        f"{result.n_slow} slow coordinates, inertial coupling β = {result.coupling:.3g}; for the scene's error: "
        f"a step of {step:.3g} s, {substeps}:1"
    )
