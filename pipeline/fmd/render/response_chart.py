"""Frequency responses: magnitude by units, and phase."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.shown import BAND_OPACITY, LEAST_OF_BAND
from fmd.render.charts import COLOURS, open_figure, style_axes

_WIDE = 1e4  # ratio of frequencies from which their axis is logarithmic


class ResponseCurve(NamedTuple):
    """Response of one output to the input."""

    label: str
    unit: str  # of the response, e.g. ``m/N``
    values: Array  # complex, shape (n_frequencies,); real values have no phase, such as spectral densities
    error: Array | None = None  # stated size of the values' errors, drawn as a band where it can be seen


def draw_response(
    frequencies_hz: Array, curves: Sequence[ResponseCurve], path: Path, *, title: str, along: str = "frequency [Hz]"
) -> None:
    """Draw magnitudes, a frame for each unit, and below them the phases; a unit without phase has a frame, too.

    Frequencies (n_frequencies,) [Hz] ascend; ``along`` labels their axis if they are something else.
    """
    units = list(dict.fromkeys(curve.unit for curve in curves))
    rows = len(units) + 1
    with open_figure(path, (10, 2.2 + 2.2 * rows), 120) as figure:
        figure.suptitle(title, fontsize=15)
        frames = figure.subplots(rows, 1, sharex=True, squeeze=False, height_ratios=[*[3] * len(units), 2])[:, 0]
        for number, curve in enumerate(curves):
            colour = COLOURS[number % len(COLOURS)]
            magnitude = np.abs(curve.values)
            frame = frames[units.index(curve.unit)]
            frame.plot(frequencies_hz, np.where(magnitude > 0, magnitude, np.nan), color=colour, label=curve.label)
            if curve.error is not None:
                low = np.maximum(magnitude - curve.error, LEAST_OF_BAND * magnitude)
                frame.fill_between(
                    frequencies_hz, low, magnitude + curve.error, color=colour, alpha=BAND_OPACITY, linewidth=0
                )
            if not np.iscomplexobj(curve.values):
                continue
            phase = np.degrees(np.angle(curve.values))
            jump = np.abs(np.diff(phase, prepend=phase[0])) > 270.0
            frames[-1].plot(frequencies_hz, np.where(jump, np.nan, phase), color=colour, linewidth=1.2)
        for frame, unit in zip(frames, units, strict=False):
            frame.set_yscale("log")
            real = any(curve.unit == unit and not np.iscomplexobj(curve.values) for curve in curves)
            style_axes(frame, "", f"{'spectral density' if real else 'magnitude'}\n[{unit}]")
        frames[-1].set_ylim(-190, 190)
        frames[-1].set_yticks([-180, -90, 0, 90, 180])
        if frequencies_hz[0] > 0 and frequencies_hz[-1] > _WIDE * frequencies_hz[0]:
            frames[-1].set_xscale("log")
        style_axes(frames[-1], along, "phase [°]")
        frames[-1].set_xlim(frequencies_hz[0], frequencies_hz[-1])
        figure.align_ylabels()
        handles = [line for frame in frames[:-1] for line in frame.get_lines()]
        figure.legend(handles=handles, loc="outside lower center", ncols=2, fontsize=12, frameon=False)
