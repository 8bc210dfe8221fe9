"""Sheets of charts over time: a frame for each quantity of a history."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fmd.core.arrays import Array
from fmd.core.html import prefix_for
from fmd.core.limits.shown import CHARTED_QUANTITIES, SEEN_ERROR
from fmd.render.chart_data import HistoryFrame
from fmd.render.charts import COLOURS, open_figure, style_axes, time_axis

_FRAME_INCHES = (6.4, 3.0)


def draw_histories(time: Array, frames: Sequence[HistoryFrame], path: Path, *, title: str) -> None:
    """Draw quantities over time (n_times,) [s], two frames in a row; of very many the first."""
    shown, left_out = frames[:CHARTED_QUANTITIES], max(len(frames) - CHARTED_QUANTITIES, 0)
    time, label = time_axis(time)
    columns = min(len(shown), 2)
    rows = math.ceil(len(shown) / columns)
    size = (columns * _FRAME_INCHES[0], rows * _FRAME_INCHES[1] + 0.4)
    with open_figure(path, size, 110, padding=0.08) as figure:
        figure.suptitle(f"{title} ({left_out} more quantities)" if left_out else title, fontsize=14)
        for number, frame in enumerate(shown, start=1):
            axes = figure.add_subplot(rows, columns, number)
            by, prefix = prefix_for(float(np.abs(frame.columns).max()), frame.unit)
            for k, values in enumerate(frame.columns.T):
                colour = COLOURS[k % len(COLOURS)]
                axes.plot(time, values / by, color=colour, linewidth=1.6)
                if frame.error is not None and frame.error > SEEN_ERROR * float(np.ptp(values)):
                    low, high = (values - frame.error) / by, (values + frame.error) / by
                    axes.fill_between(time, low, high, color=colour, alpha=0.2, linewidth=0)
            last = number > len(shown) - columns
            style_axes(axes, label if last else "", f"[{prefix}{frame.unit}]", frame.name)
            axes.title.set_fontsize(12)
            axes.margins(x=0)
            if len(frame.components) > 1:
                axes.legend(axes.get_lines(), frame.components, fontsize=9, frameon=False, ncols=len(frame.components))
        figure.align_ylabels()
