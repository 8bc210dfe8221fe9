"""Charts of sensitivities: a bar for each number that a result depends on, the longest on top."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from fmd.render.charts import COLOURS, GREY
from fmd.render.figure import open_figure, style_axes


def draw_tornado(bars: Mapping[str, Sequence[tuple[str, float, float]]], path: Path, *, title: str, label: str) -> None:
    """Draw what numbers do to results, each in a frame of its own.

    Parameters
    ----------
    bars : mapping of str to sequence of tuple
        Key, length of the bar and its error for each number that a result depends on, by the results' names.
    label : str
        What the bars' length is.
    """
    heights = [1.0 + 0.34 * len(rows) for rows in bars.values()]
    with open_figure(path, (9.0, sum(heights) + 0.5), 130, padding=0.08) as figure:
        figure.suptitle(title, fontsize=14)
        frames = figure.subplots(len(bars), 1, squeeze=False, gridspec_kw={"height_ratios": heights})[:, 0]
        for axes, name in zip(frames, bars, strict=True):
            rows = sorted(bars[name], key=lambda row: abs(row[1]))
            places, values = np.arange(len(rows)), np.array([value for _, value, _ in rows])
            colours = [COLOURS[0] if value >= 0 else COLOURS[1] for value in values]
            errors = [error for _, _, error in rows]
            axes.barh(places, values, color=colours, height=0.66, xerr=errors, ecolor=GREY, capsize=3)
            axes.axvline(0.0, color=GREY, linewidth=0.8)
            span = max(float(np.abs(values).max(initial=0.0)), 1e-12)
            axes.set_xlim(min(values.min(), 0.0) - 0.18 * span, max(values.max(), 0.0) + 0.18 * span)
            for place, value in zip(places, values, strict=True):
                side = "left" if value >= 0 else "right"
                axes.text(value + np.copysign(0.02 * span, value), place, f"{value:.3g}", va="center", ha=side)
            axes.set_yticks(places, [key for key, _, _ in rows])
            style_axes(axes, "", "", name)
            axes.set_axisbelow(True)
        frames[-1].set_xlabel(label, fontsize=12)
