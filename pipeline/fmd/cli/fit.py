"""``fmd fit``: numbers of a scene from measured histories."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from fmd.cli.inputs import DEFAULTS, Options, settle
from fmd.cli.options import Folder, Names, SceneName, print_json
from fmd.cli.sensitivities import split_names
from fmd.cli.tables import open_console, print_files, print_table, print_warnings
from fmd.core.errors import InputError
from fmd.core.units import parse_quantity

if TYPE_CHECKING:
    from fmd.fitting.fit import Fit

Several = Annotated[list[str] | None, Parameter(negative=())]


def fit(
    scene: SceneName,
    *,
    to: str,
    vary: Names,
    sigma: Several = None,
    prior: Several = None,
    out: Folder = None,
    options: Options = DEFAULTS,
) -> None:
    """Fit numbers of a scene to measured histories; what the data can't determine is refused first.

    Parameters
    ----------
    to
        CSV file: times in its first column, a result in each other, named with units as files of histories are, e.g.
        "time [s]" and "forearm.wrist.position.y [mm]".
    vary
        Keys of numbers, with bounds or without: joint.elbow.spring=10..200, or body.arm.length="0.5 m..0.7 m".
    sigma
        Standard deviation of a channel's noise: elbow.position="0.1 deg"; estimated from the data by default.
    prior
        Standard deviation of what is known of a number beforehand, about the scene's value: body.arm.E=5%.
    """
    from fmd.fitting.fit import fit_scene
    from fmd.fitting.fit_files import write_fit
    from fmd.fitting.varied import read_varied

    run = settle(options.open(scene))
    sigmas = dict(_read_sigma(text) for text in split_names("--sigma", sigma or []))
    varied = read_varied(run, split_names("--vary", vary), split_names("--prior", prior or []))
    found = fit_scene(run, to, varied, sigmas)
    folder = out or Path("out") / f"{run.scene.name}-fit"
    try:
        files = write_fit(found, folder, scene, to, options.set_ or ())
    except OSError as error:
        raise InputError("--out", "", str(folder), f"can't be written: {error.strerror or error}") from error
    if options.json:
        print_json({"scene": run.scene.name, **found.summary(), "files": files})
    else:
        _print(found)
        print_files(folder, files)


def _read_sigma(text: str) -> tuple[str, float]:
    """Read the noise of a channel, ``elbow.position=0.1 deg`` or, in the SI unit, ``elbow.position=0.002``."""
    name, _, given = (part.strip() for part in text.partition("="))
    try:
        value = float(given)
    except ValueError:
        try:
            value, _ = parse_quantity(given)
        except ValueError as error:
            raise InputError("--sigma", name, given, str(error)) from None
    if not value > 0:
        raise InputError("--sigma", name, given, "must be above zero")
    return name, value


def _print(found: Fit) -> None:
    summary = found.summary()
    rows: list[tuple[Any, ...]] = []
    for row in summary["parameters"]:
        low, high = row["interval"]
        at = "at its bound" if row["at_bound"] else ""
        rows.append((row["key"], row["start"], row["value"], low, high, row["unit"], at))
    columns = {
        "number": "{}",
        "first": "{:.5g}",
        "fitted": "{:.6g}",
        "95 % from": "{:.6g}",
        "to": "{:.6g}",
        "unit": "{}",
    }
    print_table("Fit", {**columns, "": "{}"}, rows)
    console = open_console()
    console.print(
        f"chi-squared {found.chi2:.5g} of {found.n_free} degrees of freedom (probability {found.probability:.2g}); "
        f"{found.evaluations} evaluations, {found.model.marches} motions"
    )
    for each in summary["noise"]:
        origin = "estimated from its values" if each["estimated"] else "as given"
        white = summary["whiteness"][each["channel"]]
        console.print(
            f"noise of {each['channel']}: {each['sigma']:.3g} {each['unit']}, {origin}; "
            f"residuals are white with probability {white:.2g}"
        )
    keys = [row["key"] for row in summary["parameters"]]
    for k, key in enumerate(keys):
        for partner in found.after.partners(k):
            if partner > k:
                r = summary["correlation"][k][partner]
                console.print(f"{key} and {keys[partner]} go together: correlation {r:+.3f}")
    print_warnings(summary["warnings"], "fit.json")
