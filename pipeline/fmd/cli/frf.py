"""``fmd frf``: frequency responses of a scene, linearised about a state, and random vibration."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from fmd.accuracy.error_estimates import percent
from fmd.cli.inputs import DEFAULTS, Options, read_quantity, settle
from fmd.cli.options import Flag, Folder, Names, SceneName, print_json
from fmd.cli.tables import open_console, print_files, print_table, print_warnings
from fmd.core.errors import InputError
from fmd.core.limits.shown import TABLE_POLES
from fmd.output.stated_errors import with_plain_error

if TYPE_CHECKING:
    from fmd.output.responses import FrequencyResponse


def frf(
    scene: SceneName,
    *,
    in_: Annotated[Names, Parameter(name="--in")],
    out: Annotated[Names, Parameter(name="--out")],
    to: str,
    from_: Annotated[str | None, Parameter(name="--from")] = None,
    points: int = 1000,
    about: str = "start",
    psd: str | None = None,
    no_budget: Flag = False,
    folder: Folder = None,
    options: Options = DEFAULTS,
) -> None:
    """Frequency response of outputs to inputs: a chart, a table, a NetCDF file; poles, damping and zeros.

    Parameters
    ----------
    in_
        What acts, e.g. plate.side.z (a force), plate.side.rz (a moment), drive.NAME, JOINT.torque, JOINT.force, or
        ground.z (an acceleration of the ground); give it several times for several.
    out
        What answers, e.g. plate.tip.z, plate.tip.z.acceleration, JOINT.position, or a component of stress,
        plate.root.xx; give it several times for several.
    to
        Highest frequency, e.g. "2 kHz".
    from_
        Lowest frequency; a thousandth of the highest by default.
    points
        Number of evenly spaced frequencies; more are added about each resonance.
    about
        State of linearisation: start, equilibrium, steady, or a time of the first run in seconds.
    psd
        Spectral density of a random input, in its SI unit squared per Hz: a number, a formula of f in Hz, or a .csv
        file of frequencies and densities. Root mean squares of the outputs are printed.
    no_budget
        Don't estimate the errors of the response.
    """
    highest = read_quantity("--to", to, "frequency")
    lowest = None if from_ is None else read_quantity("--from", from_, "frequency")
    if not highest > 0 or not (lowest is None or 0 <= lowest < highest):
        raise InputError("--to", "", to, "must be above zero and above the lowest frequency")
    if not 2 <= points <= 100_000:
        raise InputError("--points", "", points, "must be 2 … 100000")
    from fmd.output.responses import compute_response, write_response

    run = settle(options.open(scene, linear=True))
    density = None if psd is None else (psd, Path(), ("--psd", ""))
    found = compute_response(run, in_, out, highest, lowest, points, about, density)
    found = found if no_budget else found.with_errors(run)
    where = folder or Path("out") / run.scene.name
    files = write_response(found, where / "frf.png", f"{run.scene.title}: frequency response")
    if options.json:
        print_json(_as_data(found, files))
    else:
        _print(found)
        print_files(where, files)


def _as_data(found: FrequencyResponse, files: list[str]) -> dict[str, Any]:
    """Return the response of the first output to the first input, and those of all pairs if there are more."""
    first = found.values[:, 0, 0]
    data = {
        "frequencies_hz": found.frequencies_hz.tolist(),
        "real": first.real.tolist(),
        "imaginary": first.imag.tolist(),
        **found.summary(),
        "files": files,
    }
    if found.values[0].size > 1:
        data["responses"] = [
            {"input": name, "output": output, "real": values.real.tolist(), "imaginary": values.imag.tolist()}
            for k, (name, _) in enumerate(found.inputs)
            for j, (output, _) in enumerate(found.outputs)
            for values in (found.values[:, j, k],)
        ]
    return data


def _say_error(row: dict[str, Any]) -> str:
    """Return a line about the largest error of a pair's response, or about why none is stated."""
    if "why" in row:
        return f"errors not stated: {row['why']}"
    size = f"{row['error']:.3g} {row['unit']}, {percent(row['of_largest'])} % of its largest value"
    return f"{row['output']} by {row['input']} is off by up to {size}"


def _print(found: FrequencyResponse) -> None:
    console, summary = open_console(), found.summary()
    pairs = list(zip(summary["poles_hz"], summary["damping"], strict=True))
    rows = [(k, *pair) for k, pair in enumerate(pairs[:TABLE_POLES], start=1)]
    print_table(f"Poles about {summary['about']}", {"pole": "{}", "Hz": "{:.4f}", "damping ratio": "{:.4g}"}, rows)
    if len(pairs) > TABLE_POLES:
        console.print(f"and {len(pairs) - TABLE_POLES} more, up to {pairs[-1][0]:.4g} Hz")
    for pair, zeros in summary["zeros_hz"].items():
        console.print(f"zeros of {pair}: {', '.join(f'{zero:.4f}' for zero in zeros) or 'none'} Hz", soft_wrap=True)
    for row in summary.get("random", ()):
        rate = f"{row['crossings_hz']:.4g} upward crossings of zero a second"
        console.print(f"RMS of {row['output']}: {with_plain_error(row['rms'], row['error'], row['unit'])}, {rate}")
    for row in summary["largest_errors"]:
        console.print(_say_error(row), soft_wrap=True)
    if summary["holds_to_hz"] is not None and found.frequencies_hz[-1] > summary["holds_to_hz"]:
        console.print(f"above {summary['holds_to_hz']:.4g} Hz, half of what the modes reach, more modes are needed")
    print_warnings(summary["warnings"])
