"""Results as tables for the terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

if TYPE_CHECKING:
    from pipeline.bench.work_precision import WorkPrecision
    from pipeline.output.explain import Forecast
    from pipeline.stability.limits import MechanismLimits
    from pipeline.stages.part import FlexiblePart
    from pipeline.sweep.study import Sweep
    from pipeline.verification.suite import Outcome

_COUPLED = 1e-6
_FATES = {"run": "run", "cached": "be read", "skipped": "be skipped", "open": "run or not"}
_TOLD = 0.01  # growth by a method itself
_FIGURES = ("quantity", "ours", "published", "difference", "allowed")


def print_run(summary: dict[str, Any], folder: Path) -> None:
    """Print what a run has found and written."""
    console = Console()
    console.print(_stages(summary))
    if "frequencies_hz" in summary:
        console.print(_frequencies(summary))
    console.print(_integrations(summary))
    for row in summary["integrations"]:
        if row["growth"] > 1 + _TOLD:
            console.print(
                f"note: {row['integrator']} {row['substeps']}:1 by itself makes small vibrations grow by "
                f"{100 * (row['growth'] - 1):.2g} % over the scene"
            )
    if "error_budget" in summary:
        console.print(_budget(summary["error_budget"]))
    if "accuracy" in summary:
        console.print(_rounds(summary["accuracy"]))
    if "bodies" in summary:
        _print_body(console, summary)
    for body, modes in summary["left_out_modes"].items():
        numbers = ", ".join(str(k) for k in modes)
        console.print(f"left out: modal coordinates {numbers} of {body}, which nothing excites (--keep-all)")
    for joint, position in summary["final"].get("joint_positions", {}).items():
        differences = [row["joint_differences"][joint] for row in summary["integrations"][1:]]
        apart = ", ".join(f"{difference:.3g}" for difference in differences)
        console.print(f"{joint}: {position:.6g} (SI) at the end" + (f"; the runs differ by {apart}" if apart else ""))
    console.print(f"{len(summary['files']) + 1} files in {folder}/: summary.json, {', '.join(summary['files'])}")


def print_plan(plan: Forecast, steps: bool) -> None:
    """Print what a run will cost, and what it will do stage by stage if ``steps`` are wanted."""
    console = Console()
    if steps:
        table = _table("Plan", "stage", "body", "will", "last time", "why", wide=4)
        for step in plan.steps:
            table.add_row(step.stage, step.body, _FATES[step.fate], _last_time(step.seconds), step.why)
        console.print(table)
    console.print(f"forecast: {plan.line}")


def _last_time(seconds: float | None) -> str:
    return "" if seconds is None else f"{seconds:.3g} s"


def mesh_figures(part: FlexiblePart) -> dict[str, Any]:
    """Gather what there is to tell of a mesh."""
    mesh = part.mesh
    return {
        "nodes": len(mesh.points),
        "elements": len(mesh.cells),
        "parts": {name: len(cells) for name, cells in mesh.parts.items()},
        "faces": list(mesh.faces),
        "element_type": mesh.cell_type,
        "order": part.order,
        "volume_m3": mesh.volume,
        "mass_kg": part.mass,
        "min_quality": float(mesh.quality.min()),
        "notes": list(mesh.notes),
    }


def _print_body(console: Console, summary: dict[str, Any]) -> None:
    for name, body in summary["bodies"].items():
        for note in body["mesh_notes"]:
            console.print(f"mesh of {name}: {note}")
        coupled = body["coupling"] > _COUPLED and not body["prescribed"]
        if coupled and any(
            row["substeps"] > 1 and row["integrator"] == "sub-cycling" for row in summary["integrations"]
        ):
            console.print(
                f"note: rotation and modes of {name} couple through the mass matrix ({body['coupling']:.2f}), so "
                'sub-cycling is weakly unstable at every step; simulation.frame = "joint-conforming" removes that, and '
                "reversible-sub-cycling stays stable"
            )
        if body["stiffened"]:
            critical = body["critical_spin_rad_s"]
            softens = f"; without, it would lose its stiffness at {critical:.4g} rad/s" if critical else ""
            console.print(
                f"{name} is stiffened by its inertia loads: it turns at up to {body['largest_spin_rad_s']:.4g} rad/s, "
                f"its lowest frequency is {2 * math.pi * body['frequencies_in_frame_hz'][0]:.4g} rad/s{softens}"
            )
    if "worst_stress" not in summary:
        return
    stress = summary["worst_stress"]
    line = f"largest von Mises stress {stress['von_mises_pa'] / 1e6:.4g} MPa at t = {stress['time_s'] * 1e3:.4g} ms"
    if "peak_tip_deflection_m" in summary:
        line += f"; largest tip deflection {summary['peak_tip_deflection_m'] * 1e3:.4g} mm"
    console.print(line)


def _budget(budget: dict[str, Any]) -> Table:
    """Relative errors by source; of a body's frequencies only the worst."""
    from pipeline.accuracy.error_estimates import NO_PART, SOURCES

    title = f"Error budget [%]: what is stated is {budget['safety']:g} times the root of their squares"
    table = _table(title, "quantity", "mesh", "modes", "time", "stress", "stated")
    shown: dict[str, dict[str, Any]] = {}
    for row in budget["rows"]:
        group = row["quantity"].partition(", frequency")[0] if ", frequency" in row["quantity"] else row["quantity"]
        if group not in shown or row["total"] > shown[group]["total"]:
            shown[group] = row
    for row in shown.values():
        parts = [
            _percent(part) if isinstance(part := row[source], float) else "–" if part == NO_PART else "?"
            for source in SOURCES
        ]
        stated = _percent(row["total"])
        table.add_row(row["quantity"], *parts, f"> {stated}" if "?" in parts else stated)
    return table


def _rounds(accuracy: dict[str, Any]) -> Table:
    """What was tried for a wanted accuracy; the last met it, but for what was given up."""
    but = "" if accuracy["met"] else " but for what is told below"
    title = f"Accuracy: {_percent(accuracy['wanted'])} % wanted and met{but}"
    table = _table(title, "round", "chosen", "stated [%]", "worst in", "most from", wide=1)
    for k, found in enumerate(accuracy["rounds"]):
        chosen = [
            f"{name}: {body['mesh'].get('divisions') or body['mesh'].get('size') or body['mesh'].get('blade')}, "
            f"{body['modes']} modes, {body['enrich']}"
            for name, body in found["bodies"].items()
        ]
        worst = found["worst"]
        text = "; ".join([*chosen, f"time {found['integration_error']:.1g}"])
        table.add_row(str(k + 1), text, _percent(worst["stated"]), worst["quantity"], worst["dominant"])
    return table


def given_up(rows: Sequence[dict[str, Any]]) -> str:
    """What was not refined for, in words."""
    return "; ".join(
        f"'{row['quantity']}', stated {_percent(row['stated'])} %, most from {row['dominant']}" for row in rows
    )


def _percent(part: float) -> str:
    """A relative error in percent, to two digits."""
    return f"{100 * part:.2g}" if part >= 1e-5 else "<.001"


def print_frequencies(result: dict[str, Any]) -> None:
    """Print a scene's frequencies."""
    console = Console()
    console.print(_frequencies(result))
    if "speed_rad_s" in result:
        table = _table(f"On a hub that turns at {result['speed_rad_s']:.6g} rad/s", "mode", "Hz")
        for k, frequency in enumerate(result["rotating_frequencies_hz"]):
            table.add_row(str(k + 1), f"{frequency:.4f}")
        console.print(table)
    console.print(f"{result['rigid_modes']} rigid-body modes, {result['dofs']} unknowns{_factor(result)}")


def _factor(result: dict[str, Any]) -> str:
    factor = result["factor"]
    if factor is None:
        return ""
    return (
        f"; factor by {factor['solver']} in {factor['order']} order, {factor['nonzeros'] / 1e6:.3g} million nonzeros "
        f"of {factor['unknowns']} unknowns, {factor['memory'] / 1e6:.3g} MB"
    )


def print_campbell(title: str, rates: Any, table: Any, folder: Path, files: list[str]) -> None:
    """Print a Campbell diagram's frequencies at a few of its rates."""
    console = Console()
    shown = table.shape[1] if table.shape[1] < 8 else 8
    chosen = _table(f"{title}: frequencies on a turning hub [Hz]", "rad/s", *(f"mode {k + 1}" for k in range(shown)))
    for k in range(0, len(rates), max(1, len(rates) // 10)):
        chosen.add_row(f"{rates[k]:.4g}", *(f"{value:.3f}" for value in table[k, :shown]))
    console.print(chosen)
    console.print(f"in {folder}/: {', '.join(files)}")


def print_bench(title: str, result: WorkPrecision, folder: Path, files: list[str]) -> None:
    """Print run time against error."""
    console = Console()
    table = _table(
        f"{title} (two references differ by {result.reference_error:.0e})", "method", "step", "seconds", "error"
    )
    for row in result.rows:
        table.add_row(row.integrator, f"{row.step_s:.3g}", f"{row.seconds:.3g}", f"{row.error:.2e}")
    console.print(table)
    console.print(f"in {folder}/: {', '.join(files)}")


def _table(title: str, *columns: str, wide: int = 0) -> Table:
    table = Table(title=title, title_justify="left")
    for k, column in enumerate(columns):
        table.add_column(column, justify="left" if k in (0, wide) else "right", no_wrap=k == 0)
    return table


def _stages(summary: dict[str, Any]) -> Table:
    table = _table("Stages", "stage", "seconds", "what came out", wide=2)
    outcome = {
        "motion": f"{len(summary['integrations'])} runs to t = {summary['final']['time_s']:g} s",
        "pictures": f"{len(summary['files']) - 1} files",
    }
    if "frequencies_hz" in summary:
        outcome |= {
            "assembly": f"{summary['dofs']} unknowns",
            "modes": f"{len(summary['frequencies_hz'])} modes of {summary['dofs']} unknowns, "
            f"{summary['rigid_modes']} rigid-body modes, residual {summary['residual']:.0e}",
            "body": "; ".join(
                f"{name}: {body['mass_kg']:.4g} kg, {body['frequencies_in_frame_hz'][0]:.4g} Hz on its joint, "
                f"coupling {body['coupling']:.0e}"
                for name, body in summary["bodies"].items()
            ),
        }
    if "worst_stress" in summary:
        outcome["stress"] = f"{summary['worst_stress']['von_mises_pa'] / 1e6:.4g} MPa at worst"
    for stage, seconds in summary["seconds"].items():
        partly = "partly " if stage in summary["stages_run"] else ""
        cached = f"{partly}from the cache; " if stage in summary["stages_cached"] else ""
        table.add_row(stage, f"{seconds:.3f}", (cached + outcome.get(stage, "")).rstrip("; "))
    for stage in summary["stages_skipped"]:
        table.add_row(stage, "", "not needed")
    return table


def _frequencies(result: dict[str, Any]) -> Table:
    table = _table("Frequencies", "mode", "Hz", "reference Hz", "difference")
    for k, frequency in enumerate(result["frequencies_hz"]):
        known = k < len(result["reference_hz"])
        table.add_row(
            str(k + 1),
            f"{frequency:.2f}",
            f"{result['reference_hz'][k]:.1f}" if known else "",
            f"{100 * result['relative_error'][k]:+.2f} %" if known else "",
        )
    return table


def _integrations(summary: dict[str, Any]) -> Table:
    table = _table("Integration", "method", "step", "run time", "ratio", "solutions + fast", "tip differs by")
    for row in summary["integrations"]:
        ratio = f" {row['substeps']}:1" if row["substeps"] > 1 else ""
        table.add_row(
            row["integrator"] + ratio,
            _scaled(row["step_s"], "s"),
            _scaled(row["seconds"], "s"),
            f"{row['ratio_to_plain']:.2f}",
            f"{row['evaluations']} + {row['fast_evaluations']}",
            _scaled(row["tip_difference_m"], "m"),
        )
    return table


def _scaled(value: float, unit: str) -> str:
    """Three digits with the prefix that fits: 1.23 ms."""
    for factor, prefix in ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n")):
        if abs(value) >= 0.9995 * factor:
            return f"{value / factor:.3g} {prefix}{unit}"
    return f"{value:.1e} {unit}" if value else f"0 {unit}"


def print_maps(found: dict[str, Any], folder: Path) -> None:
    """Print how much of each map is stable."""
    table = Table("β", "m", "stable share", "largest ρ", title="two degrees of freedom")
    for row in found["maps"]:
        share, radius = f"{100 * row['stable_share']:.2f} %", f"{row['spectral_radius']:.4g}"
        table.add_row(f"{row['coupling']:g}", str(row["substeps"]), share, radius)
    console = Console()
    console.print(table)
    console.print(f"{', '.join(found['files'])} in {folder}/")


def print_stability(title: str, found: MechanismLimits) -> None:
    """Print the limits of a scene's mechanism."""
    table = Table("m", "largest stable fast step", "sudden beyond", "growth at half of that", title=title)
    if found.along:
        table.add_column("worst at")
    for row in found.limits:
        grows = f"{row.growth_rate:.3g} 1/s" if row.growth_rate else "none"
        when = (f"{row.worst_time:.3g} s" if row.worst_time else "rest",) if found.along else ()
        table.add_row(str(row.substeps), f"{row.critical_step:.4g} s", f"{row.sudden_step:.4g} s", grows, *when)
    console = Console()
    console.print(table)
    step, substeps = found.recommended
    console.print(
        f"stable: by the method itself small vibrations grow less than tenfold in the scene's {found.duration:g} s, "
        + ("along its motion" if found.along else "about the reference state (--along: about its motion too)")
    )
    console.print(
        f"{found.n_slow} slow coordinates, inertial coupling β = {found.coupling:.3g}; for the scene's error: "
        f"a step of {step:.3g} s, {substeps}:1"
    )


def print_laws(rows: list[dict[str, float]]) -> None:
    """Print the fitted laws of the weak instability."""
    table = Table("m", "c", "m(m − 1)/4", "power of β", "power of Ω_S", "misfit", title="ρ − 1 = c β² Ω_S²/(1 − β²)")
    for row in rows:
        m, b, s = int(row["substeps"]), row["coupling_power"], row["courant_power"]
        expected, misfit = f"{m * (m - 1) / 4:g}", f"{100 * row['misfit']:.2g} %"
        table.add_row(str(m), f"{row['factor']:.4g}", expected, f"{b:.4f}", f"{s:.4f}", misfit)
    Console().print(table)


def print_stress_test(rows: list[dict[str, Any]], folder: Path) -> None:
    """Print what the stress tests of stability have found."""
    counts = ("marches", "cycles", "lived", "diverged", "undecided", "wrong")
    table = Table("family", *counts[:5], "predicted wrongly", "largest gain of energy")
    for row in rows:
        table.add_row(row["family"], *(str(row[key]) for key in counts), f"{row['drift']:.1e}")
    console = Console()
    console.print(table)
    console.print(f"stability.csv in {folder}/")


def print_sweep(
    found: Sweep, rows: Sequence[dict[str, Any]], seconds: float, folder: Path, files: Sequence[str]
) -> None:
    """Print a sweep's points, with those figures that fit a terminal."""
    shown = {
        "frequencies_hz.0": ("mode 1 Hz", ""),
        "worst_stress.von_mises_pa": ("stress", "Pa"),
        "peak_tip_deflection_m": ("tip", "m"),
        "run.0.stability_margin": ("limit/step", ""),
        "run.0.seconds": ("run time", "s"),
    }
    joints = [name for name in rows[0] if name.startswith("run.0.final.joint_positions.")]
    shown |= {name: (name.rpartition(".")[2], "") for name in joints[:2]}
    shown = {name: words for name, words in shown.items() if any(row.get(name) is not None for row in rows)}
    keys = [varied.key.rpartition(".")[2] for varied in found.varied]
    table = _table("Points", "", *keys, "status", *(name for name, _ in shown.values()))
    for column in table.columns:
        column.overflow = "fold"
    for number, (point, row) in enumerate(zip(found.points, rows, strict=True), start=1):
        figures = [_figure(row[name], unit) for name, (_, unit) in shown.items()]
        table.add_row(str(number), *point.values, str(row["status"]), *figures)
    console = Console()
    console.print(table)
    for message in dict.fromkeys(record.message for record in found.records if record.message):
        where = [str(number) for number, record in enumerate(found.records, start=1) if record.message == message]
        console.print(f"{', '.join(where)}: {message}", markup=False)
    counts = ", ".join(f"{number} {status}" for status, number in found.counts.items() if number)
    console.print(f"{len(rows)} points: {counts}; {found.computed} computed now, in {seconds:.1f} s")
    console.print(f"in {folder}/: {', '.join(files)}")


def _figure(value: float | None, unit: str) -> str:
    """Three digits with the prefix that fits; nothing for a figure that a point lacks."""
    if value is None:
        return ""
    large = next(((f, p) for f, p in ((1e9, "G"), (1e6, "M"), (1e3, "k")) if unit and abs(value) >= f), None)
    if large is not None:
        return f"{value / large[0]:.4g} {large[1]}{unit}"
    return _scaled(value, unit) if unit and abs(value) < 1 else f"{value:.4g} {unit}".rstrip()


def print_verification(found: Sequence[Outcome], folder: Path, files: list[str]) -> None:
    """Print published figures beside ours, case by case."""
    console = Console()
    for outcome in found:
        case = outcome.case
        table = _table(f"{case.name}: {case.title} ({case.source})", *_FIGURES)
        for figure in outcome.figures:
            difference = f"{100 * figure.difference:+.2g} %" + ("" if figure.holds else " OUT")
            numbers = (f"{figure.ours:.6g}", f"{figure.published:.6g}", difference, f"{100 * figure.tolerance:.2g} %")
            table.add_row(escape(figure.quantity), *numbers)  # [m] is no markup
        console.print(table if not outcome.error else f"{case.name} FAILED: {outcome.error}")
    n, wrong = sum(len(one.figures) for one in found), sum(not one.holds for one in found)
    console.print(
        f"{n} figures of {len(found)} cases in {sum(one.seconds for one in found):.1f} s"
        + (f", {wrong} cases out of tolerance" if wrong else ", all within their tolerances")
    )
    console.print(f"{', '.join(files)} in {folder}/")
