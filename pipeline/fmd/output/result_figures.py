"""Figures of results that are asked for by name: numbers, and extremes of histories, with their errors."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from fmd.output.channels import ResultChannel, find_channels
from fmd.output.error_columns import NOT_COMPARED
from fmd.output.variable_errors import VariableErrors
from fmd.stages.pipeline import Pipeline


def result_figures(run: Pipeline, names: Sequence[str], histories: bool = False) -> dict[str, dict[str, Any]]:
    """Return the figures of results by the names that they are asked for, as `find_channels` takes them, and their own.

    Each has ``unit``, ``error`` (a number if one is stated, else why not), and ``value`` or, of a history,
    ``smallest``, ``largest``, ``rms`` and, if they are kept, ``history``, its values over the output times.

    Raises
    ------
    InputError
        The run has no such result.
    """
    errors = VariableErrors(run)
    return {
        name: {channel.name: _figures(run, channel, errors, histories) for channel in find_channels(run, name)}
        for name in names
    }


def _figures(run: Pipeline, channel: ResultChannel, errors: VariableErrors, histories: bool) -> dict[str, Any]:
    known = channel.errors_of
    error = errors.of_quantity(known) if isinstance(known, str) else errors.of(known)
    shared = {"unit": channel.unit, "error": error if known else NOT_COMPARED}
    worst = channel.largest or channel.shortest
    values = np.asarray(worst(run) if worst else channel.read(run))
    if not values.ndim:
        return {**shared, "value": float(values) if np.isfinite(values) else None}
    figures = {"smallest": values.min(), "largest": values.max(), "rms": np.sqrt(np.mean(values**2))}
    return {
        **shared,
        **{name: float(value) for name, value in figures.items()},
        **({"history": values.tolist()} if histories else {}),
    }
