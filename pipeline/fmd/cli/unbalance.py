"""``fmd unbalance``: response of a rotor in bearings to an unbalance, or to a force that goes round."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fmd.cli.inputs import DEFAULTS, Options, read_quantity
from fmd.cli.options import Flag, Folder, SceneName, print_json
from fmd.cli.tables import open_console, print_files, print_table, print_warnings
from fmd.core.errors import InputError, as_input_error
from fmd.core.units import parse_quantity

if TYPE_CHECKING:
    from fmd.output.unbalance import CircularResponse


def unbalance(
    scene: SceneName,
    *,
    at: str,
    to: str,
    of: str = "",
    force: str = "",
    order: float = 1.0,
    points: int = 400,
    no_budget: Flag = False,
    out: Folder = None,
    options: Options = DEFAULTS,
) -> None:
    """Unbalance response: radius and phase of the orbits of a rotor's axis over its speed, and its critical speeds.

    Parameters
    ----------
    at
        Marker of the unbalance or of the force, "body.marker".
    to
        Highest rate of rotation, e.g. "8000 rpm".
    of
        Unbalance, mass times distance from the axis, e.g. "500 g mm".
    force
        Size of a force in place of an unbalance, e.g. "10 N".
    order
        How often the force goes round in a turn of the rotor; below 0 it goes round backwards.
    points
        Number of rates.
    no_budget
        Don't estimate the errors of the radii.
    """
    highest = read_quantity("--to", to, "angular rate", above_zero=True)
    if not 3 <= points <= 100_000:
        raise InputError("--points", "", points, "must be 3 … 100000")
    goes_round = _read_forcing(of, force, order)
    from fmd.output.unbalance import compute_circular_response, with_orbit_errors, write_circular_response

    pipeline = options.solve(scene)
    rates = highest * np.arange(1, points + 1) / points
    response = compute_circular_response(pipeline, at, goes_round, rates, order)
    if not no_budget:
        response = with_orbit_errors(response, pipeline, at, goes_round, order)
    folder = out or Path("out") / pipeline.scene.name
    files = write_circular_response(response, folder)
    if options.json:
        found = {"rows": response.rows(), "criticals": response.critical_rows()}
        print_json({**found, "warnings": list(response.warnings), "files": files})
        return
    _print_orbits(response, to)
    print_warnings(response.warnings)
    print_files(folder, files)


def _read_forcing(of: str, force: str, order: float) -> Callable[[float], float]:
    """Return the size of the force that goes round [N] at a rate of rotation [rad/s], of which one must be given."""
    if bool(of) == bool(force):
        mend = "can't stand beside --force" if of else "give an unbalance, e.g. '500 g mm', or --force, e.g. '10 N'"
        raise InputError("--of", "", of, mend)
    if force:
        constant = read_quantity("--force", force, "force", above_zero=True)
        return lambda rate: constant
    if order != 1.0:
        raise InputError("--order", "", order, "belongs to --force: an unbalance goes round with the rotor")
    size = _read(of, "--of", "kg*m", "an unbalance such as '500 g mm'")
    return lambda rate: size * rate**2


def _print_orbits(response: CircularResponse, to: str) -> None:
    """Print the largest orbits with their errors, or that there are none below the highest rate of rotation."""
    from fmd.output.campbell import RPM

    columns = {"marker": "{}", "rpm": "{:.2f}", "± rpm": "{}", "radius [mm]": "{:.4g}", "± mm": "{}"}
    columns["amplification"] = "{:.3g}"
    rows = [
        (one.marker, one.rate / RPM, _error(one.rate_error, 1 / RPM), 1e3 * one.amplitude, error, factor)
        for one in response.criticals
        for error in [_error(one.amplitude_error, 1e3)]
        for factor in [None if np.isnan(one.amplification) else one.amplification]
    ]
    if rows:
        print_table(f"{response.title}, largest orbits", columns, rows)
    else:
        largest = 1e3 * float(response.amplitude[-1].max())
        text = f"{response.title}: no orbit is largest below {to}; at it the largest radius is {largest:.4g} mm"
        open_console().print(text, soft_wrap=True)
    if isinstance(response.errors, str):
        open_console().print(f"errors not stated: {response.errors}", soft_wrap=True)


def _error(size: float | None, factor: float) -> str:
    """Return an error in another unit, or an empty text if none is stated."""
    return "" if size is None else f"{factor * size:.2g}"


def _read(text: str, option: str, unit: str, what: str) -> float:
    """Read a quantity with a unit of its own, in SI units."""
    with as_input_error(option, "", text):
        value, found = parse_quantity(text)
    if found != parse_quantity(f"1 {unit}")[1] or not value > 0.0:
        raise InputError(option, "", text, f"must be {what}, above zero")
    return value
