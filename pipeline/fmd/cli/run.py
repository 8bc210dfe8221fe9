"""``fmd run``: a whole scene, and its results in the terminal."""

import math
import sys
from pathlib import Path
from typing import Any

from fmd.accuracy.error_estimates import percent
from fmd.cli.inputs import DEFAULTS, Options
from fmd.cli.options import Flag, Folder, Repair, SceneName, print_json
from fmd.cli.tables import open_console, print_frequencies, print_table, print_warnings
from fmd.core.errors import AccuracyError, InputError
from fmd.core.html import scaled
from fmd.core.limits.shown import BRIEF
from fmd.core.limits.stability import COUPLED, GROWING
from fmd.output.explain import Forecast, forecast_run
from fmd.output.mechanism_figures import describe_periodic
from fmd.output.output_kinds import kind_named
from fmd.output.stated_errors import (
    ERROR_COLUMNS,
    error_cells,
    largest_deflection,
    largest_stress,
    run_time,
    with_plain_error,
    worst_details,
)
from fmd.output.summary import UNMET, UNMOVED
from fmd.output.write import write_results

_FATES = {"run": "run", "cached": "be read", "skipped": "be skipped", "open": "run or not"}


def run(
    scene: SceneName,
    *,
    out: Folder = None,
    no_pictures: Flag = False,
    no_budget: Flag = False,
    budget_seconds: float | None = None,
    explain: Flag = False,
    dry_run: Flag = False,
    keep_all: Flag = False,
    repair: Repair = False,
    options: Options = DEFAULTS,
) -> None:
    """Do everything that a scene lists: mesh, modes, motion, stress, pictures, an error budget.

    Parameters
    ----------
    no_pictures
        Draw nothing.
    no_budget
        Don't estimate the errors of the results.
    budget_seconds
        Time that their estimates may take [s]; three times that of the run by default, less for long runs.
    explain
        Print first which stages will run, come from the cache or are skipped, why, and what each took last; then all
        warnings and notes.
    dry_run
        Print that and do nothing else.
    keep_all
        Integrate modes that neither loads nor motion can excite, too.
    """
    if budget_seconds is not None and not budget_seconds > 0:
        mend = "must be a time above 0; --no-budget estimates nothing"
        raise InputError("--budget-seconds", "", budget_seconds, mend)
    if budget_seconds is not None and no_budget:
        raise InputError("--budget-seconds", "", budget_seconds, "can't stand beside --no-budget")
    solved = options.open(scene, repair=repair, keep_all=keep_all)
    folder = out or Path("out") / solved.scene.name
    every_step = explain or dry_run
    # At a terminal a forecast is worth the time that looking through the cache takes.
    wanted = every_step or (not options.json and sys.stdout.isatty() and solved.is_settled)
    forecast = forecast_run(solved, not no_pictures, not no_budget) if wanted else None
    if forecast and not options.json:
        _print_forecast(forecast, every_step)
    if dry_run:
        if forecast and options.json:
            print_json({"plan": forecast.summary()})
        return
    summary = write_results(solved, folder, not no_pictures, not no_budget, budget_seconds)
    if options.json:
        print_json({"plan": forecast.summary(), **summary} if forecast else summary)
    else:
        _print_run(summary, folder, explain)
    _require_sound(summary, folder)


def _require_sound(summary: dict[str, Any], folder: Path) -> None:
    """Raise ``AccuracyError`` if the wanted accuracy isn't met, or if a load acted in a run and nothing moved."""
    texts = {warning["code"]: warning["text"] for warning in reversed(summary["warnings"])}
    for code in (UNMET, UNMOVED):
        if code in texts:
            raise AccuracyError(f"{texts[code]}; what was computed is in {folder}/")


def _print_forecast(forecast: Forecast, every_step: bool) -> None:
    """Print how long a run will take, and stage by stage what it will do if every step is wanted."""
    if every_step:
        columns = {"stage": "{}", "body": "{}", "will": "{}", "last time": "{:.3g} s", "why": "{}"}
        rows = [(step.stage, step.body, _FATES[step.fate], step.seconds, step.why) for step in forecast.steps]
        print_table("Plan", columns, rows, wide=4)
    open_console().print(f"forecast: {forecast.line}")


def _print_run(summary: dict[str, Any], folder: Path, explain: bool) -> None:
    """Print what a run has found, its first warnings and its tables; stages, notes and all warnings if explained."""
    console = open_console()
    for line in _answers(summary):
        console.print(line)
    if explain:
        for line in (*(f"warning: {warning['text']}" for warning in summary["warnings"]), *_notes(summary)):
            console.print(line)
        _print_stages(summary)
    else:
        print_warnings(summary["warnings"], "summary.json, --explain")
    if "frequencies_hz" in summary:
        print_frequencies(summary)
    _print_integrations(summary)
    if "error_budget" in summary:
        _print_budget(summary["error_budget"], summary.get("bodies", {}))
    if "accuracy" in summary:
        _print_rounds(summary["accuracy"])
    console.print(f"{len(summary['files']) + 1} files in {folder}/: summary.json, {', '.join(summary['files'])}")


def _print_stages(summary: dict[str, Any]) -> None:
    results = {
        "motion": f"{len(summary['integrations'])} runs to t = {summary['final']['time_s']:g} s",
        "pictures": f"{len(summary['files']) - 1} files",
    }
    if "frequencies_hz" in summary:
        results |= {
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
        results["stress"] = f"{summary['worst_stress']['von_mises_pa'] / 1e6:.4g} MPa at worst"
    rows = []
    for stage, seconds in summary["seconds"].items():
        if seconds < BRIEF and stage not in results:
            continue
        partly = "partly " if stage in summary["stages_run"] else ""
        cached = f"{partly}from the cache; " if stage in summary["stages_cached"] else ""
        rows.append((stage, seconds, (cached + results.get(stage, "")).rstrip("; ")))
    rows += [(stage, None, "not needed") for stage in summary["stages_skipped"]]
    print_table("Stages", {"stage": "{}", "seconds": "{:.3f}", "result": "{}"}, rows, wide=2)


def _print_integrations(summary: dict[str, Any]) -> None:
    rows = [
        (
            row["integrator"] + (f" {row['substeps']}:1" if row["substeps"] > 1 else ""),
            scaled(row["step_s"], "s", 3),
            *run_time(row, summary["integrations"][0]),
            f"{row['evaluations']} + {row['fast_evaluations']}",
            scaled(row["tip_difference_m"], "m", 3),
        )
        for row in summary["integrations"]
    ]
    columns = {"method": "{}", "step": "{}", "run time": "{}", "ratio": "{}", "solutions + fast": "{}"}
    columns["tip differs by"] = "{}"
    print_table("Integration: run times are of time integration alone, the least on this machine", columns, rows)


def _print_budget(budget: dict[str, Any], bodies: dict[str, Any]) -> None:
    """Print the table of relative errors by source; of a body's frequencies, of joints and markers only the worst."""
    title = f"Error budget [%]: what is stated is {budget['safety']:g} times the root of their squares"
    worst: dict[str, dict[str, Any]] = {}
    for row in budget["rows"]:
        group = row["quantity"].partition(", frequency")[0] if ", frequency" in row["quantity"] else row["quantity"]
        if group not in worst or (row["total"] or 0.0) > (worst[group]["total"] or 0.0):
            worst[group] = row

    def name(quantity: str) -> str:
        body, is_frequency, _ = quantity.partition(", frequency")
        return f"{quantity}, {bodies[body]['boundary']}" if is_frequency else quantity

    rows = [(name(row["quantity"]), *error_cells(row)) for row in (*worst.values(), *worst_details(budget))]
    print_table(title, dict.fromkeys(("quantity", *ERROR_COLUMNS), "{}"), rows)


def _print_rounds(accuracy: dict[str, Any]) -> None:
    """Print the table of refinements for a target accuracy: settings and worst quantity of each round."""
    met = "met" if accuracy["met"] else "met but for the quantities named below"
    if accuracy["ended_by"]:
        met = f"not met; the results are those of round {accuracy['chosen_round']}"
    rows = []
    for k, settings in enumerate(accuracy["rounds"]):
        chosen = [
            f"{name}: {body['mesh'].get('divisions') or body['mesh'].get('size') or body['mesh'].get('blade')}, "
            f"{body['modes']} modes, {body['enrich']}"
            for name, body in settings["bodies"].items()
        ]
        worst = settings["worst"]
        text = "; ".join([*chosen, f"time {settings['integration_error']:.1g}"])
        rows.append((k + 1, text, percent(worst["stated"]), worst["quantity"], worst["dominant"]))
    columns = dict.fromkeys(("round", "chosen", "stated [%]", "worst in", "most from"), "{}")
    print_table(f"Accuracy: {percent(accuracy['wanted'])} % requested, {met}", columns, rows, wide=1)


def _describe_contact(own: dict[str, Any], errors: dict[str, Any]) -> str:
    """Write when a contact's bodies touch, its largest force and its impulse, with what is stated of their errors."""
    if own["begin_s"] is None:
        return "nothing touches"
    values = {"largest_force_n": (own["largest_force_n"], "N"), "impulse_n_s": (math.hypot(*own["impulse_n_s"]), "N s")}
    stated = {key: errors.get(key, {}) for key in values}
    force, impulse = (with_plain_error(value, stated[key].get("total"), unit) for key, (value, unit) in values.items())
    lacking = next((f", errors {each['why']}" for each in stated.values() if each.get("why")), "")
    return f"{own['begin_s']:.6g} to {own['end_s']:.6g} s, largest force {force}, impulse {impulse}{lacking}"


def _describe_teeth(own: dict[str, Any]) -> str:
    """Write the transmission error of gears in motion, the forces between their teeth, and how long these part."""
    error, varies = (scaled(own[key], "m") for key in ("mean_transmission_error_m", "peak_to_peak_m"))
    least, largest = (scaled(own[key], "N") for key in ("least_force_n", "largest_force_n"))
    apart = f", apart for {own['apart']:.1%} of the time" if own["apart"] else ""
    return f"transmission error {error}, varies by {varies}; force {least} to {largest}{apart}"


def _answers(summary: dict[str, Any]) -> list[str]:
    """Write what a run has found, a line each: stress, deflection, joints, responses, lives."""
    lines = []
    if "worst_stress" in summary:
        stress = summary["worst_stress"]
        where = f" in {stress['body']}" if len(summary.get("bodies", ())) > 1 else ""
        when = f"at t = {scaled(stress['time_s'], 's')}"
        line = f"largest von Mises stress {largest_stress(summary)}{where} {when}"
        if summary.get("peak_tip_deflection_m"):  # none of a tip at a body's own joint
            line += f"; largest tip deflection {largest_deflection(summary)}"
        lines.append(line)
    if "periodic" in summary:
        lines.append(describe_periodic(summary["periodic"]))
    for response in summary.get("responses", ()):
        kind = kind_named(response["type"]).response
        assert kind is not None  # it has made this
        lines += kind.describe(response)
    for name, own in summary.get("contacts", {}).items():
        lines.append(f"contact {name}: {_describe_contact(own, summary.get('contact_errors', {}).get(name, {}))}")
    lines += [f"gear mesh {name}: {_describe_teeth(own)}" for name, own in summary.get("gear_meshes", {}).items()]
    for file, life in summary.get("fatigue", {}).items():
        repeats, place = life["repeats_to_failure"], f"node {life['node']} of {life['body']}"
        lasts = "nothing is damaged" if repeats is None else f"{place} lasts {repeats:.3g} repeats of the motion"
        if repeats is not None and (interval := life["repeats_interval"]) is not None:
            low, high = ("∞" if end is None else f"{end:.3g}" for end in interval)
            lasts += f" ({low} to {high})"
        lines.append(f"{file}: {lasts}")
    for body, own in summary.get("plies", {}).items():
        for name, worst in own.items():
            place = f"ply {worst['ply']} ({worst['material']}, {worst['angle_deg']:.3g}°), {worst['face']} face"
            error = summary["stated_errors"].get(f"plies.{body}.{name}.value", "")
            index = with_plain_error(worst["value"], None if isinstance(error, str) else error, "").rstrip()
            why = f"; its error is {error}" if isinstance(error, str) and error else ""
            lines.append(f"{body}: {name} index {index} in {place}, element {worst['element']}{why}")
    for joint, position in summary["final"].get("joint_positions", {}).items():
        unit = summary["joint_units"][joint]
        differences = [f"{row['joint_differences'][joint]:.3g}" for row in summary["integrations"][1:]]
        apart = f"; the runs differ by {', '.join(differences)} {unit}" if differences else ""
        lines.append(f"{joint}: {position:.6g} {unit} at the end{apart}")
    return lines


def _notes(summary: dict[str, Any]) -> list[str]:
    """Write what lies behind a run's results, a line each: growth, model errors, bodies, modes that are left out."""
    lines = [
        f"note: {row['integrator']} {row['substeps']}:1 by itself makes small vibrations grow by "
        f"{100 * (row['growth'] - 1):.2g} % over the scene"
        for row in summary["integrations"]
        if row["growth"] > 1 + GROWING
    ]
    lines += [
        f"note: {row['integrator']} {row['substeps']}:1 carries forces on from cycle to cycle, which is cheapest here"
        for row in summary["integrations"]
        if row["forces"] == "carried"
    ]
    lines += [
        f"note: {row['integrator']} {row['substeps']}:1 takes {ratio:.2g} times as long as central-difference here, "
        "and forces carried on from cycle to cycle were not accurate or not stable enough: take central-difference"
        for row in summary["integrations"]
        if (ratio := row["part_over_plain"] or 0.0) > 1
    ]
    lines += [
        f"model: {each['text']}"
        + f" ({percent(each['error'])} % of '{each['quantity']}'{'' if each['counted'] else ', not counted'})"
        * bool(each["quantity"])
        for each in summary.get("error_budget", {}).get("model", ())
    ]
    sub_cycled = any(row["substeps"] > 1 and row["integrator"] == "sub-cycling" for row in summary["integrations"])
    for name, body in summary.get("bodies", {}).items():
        lines += _notes_on_body(name, body, sub_cycled)
    for name, modes in summary["left_out_modes"].items():
        numbers = ", ".join(str(k) for k in modes)
        lines.append(f"left out: modal coordinates {numbers} of {name}, which nothing excites (--keep-all)")
    return lines


def _notes_on_body(name: str, body: dict[str, Any], sub_cycled: bool) -> list[str]:
    """Collect the notes on a body: repairs of its mesh, inertial coupling with its joint, stiffening."""
    lines = [f"mesh of {name}: {note}" for note in body["mesh_notes"]]
    if sub_cycled and body["coupling"] > COUPLED and not body["prescribed"]:
        lines.append(
            f"note: rotation and modes of {name} couple through the mass matrix ({body['coupling']:.2f}), so "
            'sub-cycling is weakly unstable at every step; simulation.frame = "joint-conforming" removes that, and '
            "reversible-sub-cycling stays stable"
        )
    if body["stiffened"]:
        critical = body["critical_spin_rad_s"]
        spins = critical and body["largest_spin_rad_s"] >= critical
        softens = f"; without, it would lose its stiffness at {critical:.4g} rad/s" if spins else ""
        change = body["stiffness_change"]
        by = "" if change is None else f", which change its stiffness by up to {percent(change)} %"
        lines.append(f"{name} is stiffened by the loads through it{by}{softens}")
    return lines
