"""The command line: ``fmd``. Everything heavy is loaded by the command that needs it."""

from __future__ import annotations

import json as json_format
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

if TYPE_CHECKING:
    from pipeline.stages import Pipeline

app = App(
    name="fmd",
    help="From the shape of a flexible part to its stress in motion. SCENE is a ready scene's name or a TOML file.",
    help_format="plaintext",
    help_formatter="plain",
)

Set = Annotated[
    list[str] | None,
    Parameter(name="--set", negative=(), help="Override a value: key=value, e.g. body.beam.length=300mm."),
]
Json = Annotated[bool, Parameter(name="--json", negative=(), help="Print one JSON object and nothing else.")]
Repair = Annotated[bool, Parameter(name="--repair", negative=(), help="Mend meshes from files where that is safe.")]
NoCache = Annotated[bool, Parameter(name="--no-cache", negative=(), help="Compute all, keep nothing.")]


@app.command
def run(
    scene: str,
    *,
    out: Path | None = None,
    set_: Set = None,
    no_pictures: Annotated[bool, Parameter(negative=())] = False,
    no_budget: Annotated[bool, Parameter(negative=())] = False,
    explain: Annotated[bool, Parameter(negative=())] = False,
    dry_run: Annotated[bool, Parameter(negative=())] = False,
    keep_all: Annotated[bool, Parameter(negative=())] = False,
    repair: Repair = False,
    no_cache: NoCache = False,
    json: Json = False,
) -> None:
    """Do everything that a scene asks for: mesh, modes, motion, stress, pictures, an error budget.

    Parameters
    ----------
    scene
        Name of a ready scene, or path of a TOML file.
    out
        Folder for the results; out/SCENE by default.
    no_pictures
        Draw nothing.
    no_budget
        Don't estimate the errors of the results.
    explain
        Print first which stages will run, come from the cache or are skipped, why, and what each took last.
    dry_run
        Print that and do nothing else.
    keep_all
        Integrate modes that neither loads nor motion can excite, too.
    """
    from pipeline.outputs import write_results

    pipeline = _pipeline(scene, set_, no_cache, repair, keep_all)
    folder = out or Path("out") / pipeline.scene.name
    plan = None
    if explain or dry_run:
        from pipeline.plan import plan_of

        plan = plan_of(pipeline, not no_pictures, not no_budget)
        if not json:
            from pipeline.tables import print_plan

            print_plan(plan)
        if dry_run:
            if json:
                _print_json({"plan": plan.summary()})
            return
    summary = write_results(pipeline, folder, pictures=not no_pictures, budget=not no_budget)
    if json:
        _print_json(summary if plan is None else {"plan": plan.summary(), **summary})
    else:
        from pipeline.tables import print_run

        print_run(summary, folder)


@app.command
def mesh(
    scene: str,
    *,
    out: Path | None = None,
    set_: Set = None,
    repair: Repair = False,
    no_cache: NoCache = False,
    json: Json = False,
) -> None:
    """Mesh alone: counts, volume, mass and the smallest scaled Jacobian.

    Parameters
    ----------
    scene
        Name of a ready scene, or path of a TOML file.
    out
        File to write the mesh to, in the format of its suffix: .vtu, .msh, .inp ...
    """
    pipeline = _pipeline(scene, set_, no_cache, repair)
    if out is not None:
        from pipeline.fem.export import write_mesh

        write_mesh(pipeline.mesh, out)
    from pipeline.tables import mesh_figures

    _print(mesh_figures(pipeline.part), json)


@app.command
def modes(
    scene: str,
    *,
    speed: str | None = None,
    set_: Set = None,
    repair: Repair = False,
    no_cache: NoCache = False,
    json: Json = False,
) -> None:
    """Modes alone: frequencies beside the scene's reference.

    Parameters
    ----------
    scene
        Name of a ready scene, or path of a TOML file.
    speed
        Rate of rotation about the joint, e.g. "20 rad/s": the frequencies on a hub that turns so, too.
    """
    from pipeline.frequencies import frequency_table, rotating_table

    pipeline = _pipeline(scene, set_, no_cache, repair)
    result = frequency_table(pipeline)
    if speed is not None:
        result |= rotating_table(pipeline, _rate("--speed", speed))
    result["seconds"] = dict(pipeline.log.seconds)
    if json:
        _print_json(result)
    else:
        from pipeline.tables import print_frequencies

        print_frequencies(result)


@app.command
def campbell(
    scene: str,
    *,
    to: str,
    points: int = 41,
    out: Path | None = None,
    set_: Set = None,
    no_cache: NoCache = False,
    json: Json = False,
) -> None:
    """Campbell diagram: frequencies on a turning hub over its rate of rotation, as a table and a chart.

    Parameters
    ----------
    scene
        Name of a ready scene, or path of a TOML file.
    to
        Highest rate of rotation, e.g. "8000 rpm".
    points
        How many rates, from 0 on.
    out
        Folder for the results; out/SCENE by default.
    """
    import numpy as np

    from pipeline.checks import InputError
    from pipeline.frequencies import campbell as compute

    pipeline = _pipeline(scene, set_, no_cache)
    highest = _rate("--to", to)
    if not highest > 0:
        raise InputError("--to", "", to, "must be above zero")
    if not 2 <= points <= 10_000:
        raise InputError("--points", "", points, "must be 2 … 10000")
    folder = out or Path("out") / pipeline.scene.name
    rates = np.linspace(0.0, highest, points)
    table, files = compute(pipeline, rates, folder)
    if json:
        rows = [
            {"rate_rad_s": rate, "frequencies_hz": row[np.isfinite(row)].tolist()}
            for rate, row in zip(rates.tolist(), table, strict=True)
        ]
        _print_json({"rows": rows, "files": files})
    else:
        from pipeline.tables import print_campbell

        print_campbell(pipeline.scene.title, rates, table, folder, files)


@app.command
def bench(
    scenes: list[str] | None = None,
    /,
    *,
    out: Path = Path("out/bench"),
    set_: Set = None,
    peer: Annotated[bool, Parameter(negative=())] = False,
    stability: Annotated[bool, Parameter(negative=())] = False,
    json: Json = False,
) -> None:
    """Run time against error: every integrator on a scene's mechanism, as a table, a CSV and a chart.

    Parameters
    ----------
    scenes
        Ready scenes or TOML files; by default rod-slider, the beam with 5, 20 and 60 modes, and the arm.
    out
        Folder for the CSV and the chart of each.
    peer
        Exudyn's solvers beside ours where a scene has them as a peer; needs the extra 'bench'.
    stability
        Stress tests of stability instead: long marches below and above the limits, against the prediction.
    """
    if stability:
        _stress_test(out, json)
        return
    from dataclasses import asdict, replace
    from math import isfinite

    from pipeline.bench import READY, peer_rows, write_bench
    from pipeline.bench import bench as compare

    rows: list[dict[str, Any]] = []
    chosen = [(Path(scene).stem, scene, ()) for scene in scenes] if scenes else READY
    for name, scene, overrides in chosen:
        pipeline = _pipeline(scene, [*overrides, *(set_ or [])], no_cache=False)
        result = compare(pipeline)
        if peer:
            result = replace(result, rows=(*result.rows, *peer_rows(name)))
        files = write_bench(pipeline, result, out, name)
        for row in result.rows:
            figures = {key: None if isinstance(x, float) and not isfinite(x) else x for key, x in asdict(row).items()}
            rows.append({"scene": name, **figures})
        if not json:
            from pipeline.tables import print_bench

            print_bench(pipeline.scene.title, result, out, files)
    if json:
        _print_json({"rows": rows})


@app.command
def stability(
    scene: str = "",
    *,
    two_dof: Annotated[bool, Parameter(negative=())] = False,
    substeps: int = 0,
    coupling: Annotated[list[float] | None, Parameter(negative=())] = None,
    scheme: Annotated[str, Parameter(name="--scheme")] = "sub-cycling",
    law: Annotated[bool, Parameter(negative=())] = False,
    resolution: int = 400,
    along: Annotated[bool, Parameter(negative=())] = False,
    out: Path | None = None,
    set_: Set = None,
    no_cache: NoCache = False,
    json: Json = False,
) -> None:
    """Which step is safe: for a scene's mechanism, or as a map for the two-degree-of-freedom system.

    Parameters
    ----------
    scene
        Name of a ready scene, or path of a TOML file.
    two_dof
        Map the two-degree-of-freedom system of the paper's Figs. 2 and 3 instead.
    substeps
        Fast steps to a slow one; 2 for a map, 1 to 20 for a scene by default.
    coupling
        Inertial coupling of the map, 0 ≤ β < 1; give it several times for several maps.
    scheme
        What is mapped: "sub-cycling", the paper's, or "reversible".
    law
        With --two-dof: fit the law of the weak instability for each ratio from 2 to 20 instead of mapping one.
    resolution
        Points of a map each way.
    along
        Look for the worst state along the scene's first run, not only at its reference state.
    out
        Folder for the picture; out/stability by default.
    """
    from pipeline import stability as study
    from pipeline.checks import InputError

    if two_dof == bool(scene):
        raise InputError("stability", "", scene or None, "give a scene, e.g. beam, or --two-dof")
    if two_dof:
        substeps, couplings = substeps or 2, coupling or [0.0]
        study.require_map(substeps, couplings, scheme, resolution)
        if law:
            _weak_growth(json)
        else:
            _two_dof_maps(substeps, couplings, scheme, resolution, out or Path("out") / "stability", json)
        return
    if not 0 <= substeps <= 1000:
        raise InputError("--substeps", "", substeps, "must be 1 … 1000")
    run = _pipeline(scene, set_, no_cache)
    result = study.scene_stability(run, [1, substeps] if substeps else list(range(1, 21)), along)
    if json:
        _print_json(study.summary_of_scene(result))
    else:
        from pipeline.tables import print_stability

        print_stability(run.scene.title, result)


app.command("pipeline.sweep.command:sweep", help="A scene at every combination of values, on all cores or a cluster.")
app.command("pipeline.cli_more:new", help="Write a commented scene to start from.")
app.command("pipeline.cli_more:report", help="One web page of all results, to be opened without a network.")
app.register_install_completion_command(help="Let the shell complete commands and options (bash, zsh, fish).")


@app.command
def verify(
    cases: list[str] | None = None,
    /,
    *,
    out: Path = Path("out/verification"),
    no_cache: NoCache = False,
    json: Json = False,
) -> None:
    """Published and closed-form results beside ours; ends with status 3 if one is out of its tolerance.

    Parameters
    ----------
    cases
        Names of cases, e.g. fv52; all by default.
    out
        Folder for the table as CSV and JSON.
    """
    from pipeline.cache import Cache
    from pipeline.verification.suite import carry_out, require_within

    found, summary = carry_out(cases or (), out, Cache(None) if no_cache else None)
    if json:
        _print_json(summary)
    else:
        from pipeline.tables import print_verification

        print_verification(found, out, summary["files"])
    require_within(found)


@app.command
def doctor(*, json: Json = False) -> None:
    """Tell what this machine lacks, and the command that mends it."""
    from pipeline.doctor import information, problems
    from pipeline.folders import cache_folder

    found = problems(cache_folder())
    if json:
        _print_json({"ok": not found, "problems": [{"what": p.what, "mend": p.mend} for p in found]})
    else:
        for name, value in information().items():
            print(f"{name}: {value}")
        for problem in found:
            print(f"lacking: {problem.what}\n  mend: {problem.mend}")
        print("this machine can do everything" if not found else f"{len(found)} to mend")
    if found:
        raise SystemExit(3)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; what must be mended ends with status 2, a failed check with 3, each with one message."""
    try:
        app(sys.argv[1:] if arguments is None else arguments)
    except KeyboardInterrupt:
        _fail("interrupted", 130)
    except OSError as error:  # a full disk, a folder that can't be written, a library that isn't there
        _fail(f"{error}; `fmd doctor` tells what this machine lacks", 2)
    except Exception as error:
        from pipeline.checks import AccuracyError, InputError  # here: they load NumPy, which --help does without

        if not isinstance(error, InputError | AccuracyError):
            raise
        _fail(error, 2 if isinstance(error, InputError) else 3)


def _fail(message: object, status: int) -> None:
    print(f"fmd: {message}", file=sys.stderr)
    raise SystemExit(status)


def _rate(option: str, text: str) -> float:
    """Read an angular rate from the command line [rad/s]."""
    from pipeline.checks import InputError
    from pipeline.units import to_si

    try:
        return to_si(text, "angular rate")
    except ValueError as error:
        raise InputError(option, "", text, str(error)) from None


def _weak_growth(json: bool) -> None:
    from pipeline.stability import laws

    rows = laws()
    if json:
        _print_json({"rows": rows})
        return
    from pipeline.tables import print_laws

    print_laws(rows)


def _two_dof_maps(
    substeps: int, couplings: list[float], scheme: str, resolution: int, folder: Path, json: bool
) -> None:
    from pipeline.stability import summary_of_maps, two_dof

    found = summary_of_maps(*two_dof(substeps, couplings, resolution, scheme, folder))
    if json:
        _print_json(found if len(found["maps"]) > 1 else found | found["maps"][0])
        return
    from pipeline.tables import print_maps

    print_maps(found, folder)


def _stress_test(out: Path, json: bool) -> None:
    from pipeline.progress import bars
    from pipeline.stress_test import stress_test

    with bars("stability") as advance:
        found = stress_test(out, advance)
    if json:
        _print_json({"rows": found, "files": ["stability.csv"]})
        return
    from pipeline.tables import print_stress_test

    print_stress_test(found, out)


def _pipeline(
    scene: str, overrides: list[str] | None, no_cache: bool, repair: bool = False, keep_all: bool = False
) -> Pipeline:
    from pipeline.cache import Cache
    from pipeline.progress import bars
    from pipeline.scene import load_scene
    from pipeline.sources import load_repaired
    from pipeline.stages import Pipeline

    loaded = load_repaired(scene, overrides or ()) if repair else load_scene(scene, overrides or ())
    return Pipeline(loaded, Cache(None) if no_cache else None, bars, keep_all)


def _print(result: dict[str, Any], json: bool) -> None:
    if json:
        _print_json(result)
        return
    for key, value in result.items():
        print(f"{key.replace('_', ' '):15s} {value}")


def _print_json(result: dict[str, Any]) -> None:
    print(json_format.dumps(result, indent=1, allow_nan=False))
