"""``fmd fit``: numbers of a scene from measurements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from fmd.cli.inputs import DEFAULTS, Options, settle
from fmd.cli.options import Folder, SceneName, Several, print_json
from fmd.cli.tables import open_console, print_files, print_records, print_warnings, tell_apart
from fmd.core.errors import InputError, as_input_error
from fmd.core.files import refusing
from fmd.core.limits.fitting import SAME_CHI2
from fmd.core.units import parse_percentage, parse_quantity
from fmd.scene.fit import FitTable
from fmd.sweep.points import split_names

if TYPE_CHECKING:
    from fmd.fitting.fit_result import Fit
    from fmd.stages.pipeline import Pipeline


def fit(
    scene: SceneName,
    *,
    to: Several = None,
    vary: Several = None,
    sigma: Several = None,
    prior: Several = None,
    shift: Several = None,
    starts: int | None = None,
    out: Folder = None,
    options: Options = DEFAULTS,
) -> None:
    """Fit numbers of a scene to measurements; what the data can't determine is refused first.

    What isn't given stands in the scene's table [fit], if it has one.

    Parameters
    ----------
    to
        File of histories ("time [s]", "forearm.wrist.position.y [mm]", …), of modes ("frequency [Hz]", "damping",
        shapes), or of responses as fmd frf writes them: CSV, MAT, NetCDF, or UFF with markers for its nodes,
        "test.uff; 1=plate.a; 2=plate.b". Several are fitted together; what an experiment has of its own follows its
        file: "heavy.csv; body.gripper.mass=0.8 kg", also another scene, "heavy.csv; heavy.toml".
    vary
        Keys of numbers, with bounds or without: joint.elbow.spring=10..200, or body.arm.length="0.5 m..0.7 m".
    sigma
        Standard deviation of a channel's noise: elbow.position="0.1 deg", frequency=0.2%; that of histories is
        estimated from the data by default.
    prior
        Standard deviation of what is known of a number beforehand, about the scene's value: body.arm.E=5%.
    shift
        Bounds of how much later the clock of a channel, or of all (time), starts than the motion: time="-5ms..5ms".
    starts
        Number of searches, one from the scene's values and others from between the bounds.
    """
    from fmd.fitting.experiment_files import read_experiments
    from fmd.fitting.fit import fit_scene
    from fmd.fitting.fit_files import write_fit
    from fmd.fitting.varied import read_shifts, read_varied

    if starts is not None and starts < 1:
        raise InputError("--starts", "", starts, "must be 1 or more")
    run = settle(options.open(scene, linear=True))
    table = run.scene.fit or FitTable()
    varied = read_varied(run, split_names("--vary", vary or table.vary), split_names("--prior", prior or table.prior))
    runs = _open_experiments(run, scene, options, to, [each.parameter.key for each in varied])
    experiments = read_experiments(runs, dict(map(_read_sigma, split_names("--sigma", sigma or table.sigma))))
    histories = [channel.name for each in experiments if each.in_time for channel in each.channels]
    varied += read_shifts(split_names("--shift", shift or table.shift), histories)
    found = fit_scene(experiments, varied, starts or table.starts, run.store.monitor)
    folder = out or Path("out") / f"{run.scene.name}-fit"
    with refusing("--out", folder):
        written = write_fit(found, run.scene, folder, scene, [file for _, file in runs], options.set_ or ())
    if options.json:
        print_json({"scene": run.scene.name, **found.summary(), "files": written})
    else:
        _print(found)
        print_files(folder, written)


def _open_experiments(
    run: Pipeline, scene: str, options: Options, to: Sequence[str] | None, varied: Sequence[str]
) -> list[tuple[Pipeline, str]]:
    """Return stages and file of each experiment, of the command or, if it names none, of the scene."""
    experiments, folder = (run.scene.fit or FitTable()).experiment, Path(run.scene.file).parent
    files = to or [each.text(str(folder / each.file)) for each in experiments]
    if not files:
        mend = "is missing: a file of measurements, here or in the scene, [[fit.experiment]]"
        raise InputError("--to", "", None, mend)
    return [_open_experiment(run, scene, options, text, varied) for text in files]


def _open_experiment(
    run: Pipeline, scene: str, options: Options, text: str, varied: Sequence[str]
) -> tuple[Pipeline, str]:
    """Return the stages of an experiment's scene, and its file, from ``FILE; SCENE; key=value``."""
    file, *own = (part.strip() for part in text.split(";"))
    nodes = [part for part in own if part.partition("=")[0].strip().isdigit()]
    own, file = [part for part in own if part not in nodes], "; ".join([file, *nodes])
    if not own:
        return run, file
    scenes, settings = [part for part in own if "=" not in part], [part for part in own if "=" in part]
    if len(scenes) > 1:
        raise InputError("--to", file, "; ".join(scenes), "is more than one scene")
    for setting in settings:
        if (key := setting.partition("=")[0].strip()) in varied:
            raise InputError("--to", file, setting, f"is fitted; leave it out, or leave {key} out of --vary")
    given = replace(options, set_=[*(options.set_ or ()), *settings])
    return settle(given.open(scenes[0] if scenes else scene, linear=True)), file


def _read_sigma(text: str) -> tuple[str, float]:
    """Read a channel's noise, ``elbow.position=0.1 deg`` or ``elbow.position=0.002``, that of modes in per cent."""
    from fmd.fitting.experiment_files import RELATIVE

    name, _, given = (part.strip() for part in text.partition("="))
    try:
        value = float(given)
    except ValueError:
        with as_input_error("--sigma", name, given):
            value = parse_percentage(given) if name in RELATIVE else parse_quantity(given)[0]
    if not value > 0:
        raise InputError("--sigma", name, given, "must be above zero")
    return name, value


def _print(found: Fit) -> None:
    summary = found.summary()
    columns = {"number": "key", "first": "start:.5g", "fitted": "fitted", "95 % from": "low", "to": "high"}
    rows = [
        row
        | dict(zip(("fitted", "low", "high"), tell_apart(row["value"], *row["interval"]), strict=True))
        | {"at": "at its bound" if row["at_bound"] else ""}
        for row in summary["parameters"]
    ]
    bounds = {"bound": "at"} if any(row["at"] for row in rows) else {}
    print_records("Fit", columns | {"unit": "unit"} | bounds, rows)
    console = open_console()
    console.print(
        f"chi-squared {found.chi2:.5g} of {found.n_free} degrees of freedom (probability {found.probability:.2g}); "
        f"{found.evaluations} evaluations, {found.model.solved} motions or linear models"
    )
    for each in summary["noise"]:
        origin = "estimated from its values" if each["estimated"] else "as given"
        white = summary["whiteness"].get(each["channel"])
        told = "" if white is None else f"; residuals are white with probability {white:.2g}"
        console.print(f"noise of {each['channel']}: {each['sigma']:.3g} {each['unit']}, {origin}{told}")
    for alike in summary["assurance"].values():
        console.print(f"modal assurance criterion: {', '.join(f'{value:.3f}' for value in alike)}")
    if len(summary["starts"]) > 1:
        best = summary["starts"][0]["chi2"]
        same = sum(each["chi2"] <= best + SAME_CHI2 for each in summary["starts"])
        console.print(f"{same} of {len(summary['starts'])} starts came to these numbers")
    keys = [row["key"] for row in summary["parameters"]]
    for k, key in enumerate(keys):
        for partner in found.after.partners(k):
            if partner > k:
                r = summary["correlation"][k][partner]
                console.print(f"{key} and {keys[partner]} go together: correlation {r:+.3f}")
    print_warnings(summary["warnings"], "fit.json")
