"""``fmd linearise``: a scene as a linear state-space model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from cyclopts import Parameter

from fmd.accuracy.error_estimates import percent
from fmd.cli.inputs import DEFAULTS, Options, settle
from fmd.cli.options import Flag, Folder, Names, SceneName, print_json
from fmd.cli.tables import open_console, print_files, print_table, print_warnings
from fmd.core.errors import InputError, as_input_error
from fmd.core.limits.responses import LITTLE_OFF
from fmd.core.units import parse_percentage

if TYPE_CHECKING:
    from fmd.accuracy.response_errors import BandErrors
    from fmd.responses.model_reduction import ReducedModel
    from fmd.responses.state_space import StateSpace
    from fmd.stages.linear_model import LinearModel


def linearise(
    scene: SceneName,
    *,
    in_: Annotated[Names | None, Parameter(name="--in")] = None,
    out: Annotated[Names | None, Parameter(name="--out")] = None,
    about: str = "start",
    order: int | None = None,
    error: str | None = None,
    format_: Annotated[Literal["npz", "mat"] | None, Parameter(name="--format")] = None,
    no_budget: Flag = False,
    folder: Folder = None,
    options: Options = DEFAULTS,
) -> None:
    """State-space model A, B, C, D of a scene, with names and units, as .npz and .mat.

    Parameters
    ----------
    in_
        Inputs, as for fmd frf; all drives of the scene by default.
    out
        Outputs, as for fmd frf; the tip's displacement and all joints' positions by default.
    about
        State of linearisation: start, equilibrium, steady, or a time of the first run in seconds.
    order
        Reduce the model to so many states.
    error
        Reduce the model to as few states as this error allows, e.g. "1 %".
    format_
        Write this format alone.
    no_budget
        Don't estimate errors.
    """
    from fmd.accuracy.response_errors import estimate_band_errors
    from fmd.output.responses import write_model
    from fmd.stages.linear_model import default_inputs, default_outputs, linearise_scene

    require_reduction(order, error)
    run = settle(options.open(scene, linear=True))
    inputs, outputs = in_ or default_inputs(run.scene), out or default_outputs(run.scene)
    linear = linearise_scene(run, inputs, outputs, about)
    whole, reduced = linear, reduce_states(linear.model, order, error)
    if reduced is not None:
        linear = replace(linear, model=reduced.model)
    request = (inputs, outputs, about)
    errors = None if no_budget else estimate_band_errors(run, whole, request, None if reduced is None else linear)
    where = folder or Path("out") / run.scene.name
    files = write_model(linear, where, (".npz", ".mat") if format_ is None else (f".{format_}",), errors)
    if options.json:
        print_json(_summarise(linear, reduced, len(whole.model.states), errors) | {"files": files})
        return
    _print_model(linear, reduced, len(whole.model.states), errors)
    print_files(where, files)


def _summarise(
    linear: LinearModel, reduced: ReducedModel | None, n_states: int, errors: BandErrors | None
) -> dict[str, Any]:
    """Return a model's channels, poles and errors as plain numbers; so many states it had before reduction."""
    model = linear.model
    found: dict[str, Any] = {
        kind: [{"name": channel.name, "unit": channel.unit} for channel in getattr(model, kind)]
        for kind in ("states", "inputs", "outputs")
    }
    if reduced is not None:
        found["reduction"] = {"states_of_whole": n_states, "error": reduced.error, "bound": reduced.bound}
    found |= {"about": linear.about, "poles_hz": model.poles_hz.tolist(), "damping": model.damping.tolist()}
    found |= {"holds_to_hz": linear.holds_to_hz, "warnings": linear.warnings}
    if errors is not None:
        stated = {"edges_hz": errors.edges_hz.tolist(), "of_largest": errors.shares.tolist()}
        found["errors"] = {"why": errors.why} if errors.why else stated
    return found


def _print_model(linear: LinearModel, reduced: ReducedModel | None, n_states: int, errors: BandErrors | None) -> None:
    """Print a model's channels, and how far it holds; so many states it had before reduction."""
    for kind in ("inputs", "outputs", "states"):
        rows = [(k, channel.name, channel.unit) for k, channel in enumerate(getattr(linear.model, kind), start=1)]
        print_table(f"{kind.capitalize()} about {linear.about}", {"number": "{}", "name": "{}", "unit": "{}"}, rows)
    if reduced is not None:
        open_console().print(
            f"{len(reduced.model.states)} of {n_states} states: responses are off by {100 * reduced.error:.2g} % of an "
            f"output's largest (bound: {100 * reduced.bound:.2g} %)"
        )
    if linear.holds_to_hz is not None:
        open_console().print(
            f"holds up to {linear.holds_to_hz:.4g} Hz, half of what the modes reach; more modes reach further"
        )
    if errors is not None:
        open_console().print(_describe_errors(errors))
    print_warnings(linear.warnings)


def _describe_errors(errors: BandErrors) -> str:
    """Say how far responses are off at low frequencies, and up to the highest that the model holds to."""
    if errors.why:
        return f"errors not stated: {errors.why}"
    edges, shares = errors.edges_hz, np.maximum.accumulate(errors.shares)
    within = int(np.searchsorted(shares, LITTLE_OFF, side="right"))
    low = f"within {100 * LITTLE_OFF:g} % of a range's largest response up to {edges[within]:.4g} Hz, "
    return f"{low if 0 < within < len(shares) else ''}within {percent(float(shares[-1]))} % up to {edges[-1]:.4g} Hz"


def require_reduction(order: int | None, error: str | None) -> None:
    """Refuse an order or an error that no model can have, before one is computed."""
    if order is not None and error is not None:
        raise InputError("--order", "", order, "can't stand beside --error")
    if order is not None and order < 1:
        raise InputError("--order", "", order, "must be 1 or more states")
    if error is not None:
        with as_input_error("--error", "", error):
            parse_percentage(error)


def reduce_states(model: StateSpace, order: int | None, error: str | None) -> ReducedModel | None:
    """Return a model with fewer states, as ``--order`` or ``--error`` requests it; ``None`` if neither does."""
    if order is None and error is None:
        return None
    from fmd.responses.model_reduction import ModelReduction

    option, value = ("--order", order) if error is None else ("--error", error)
    with as_input_error(option, "", value):
        reduction = ModelReduction(model)
        return reduction.to_order(order) if order is not None else reduction.to_error(parse_percentage(error))
