"""Charts of fits, histories and what is left of them, and of sensitivities, a bar for each number."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.fitting import GAP
from fmd.render.charts import COLOURS, GREY, open_figure, style_axes


def draw_tornado(bars: Mapping[str, Sequence[tuple[str, float, float]]], path: Path, *, title: str, label: str) -> None:
    """Draw what numbers do to results, each in a frame of its own.

    By the results' names there are key, length of the bar and its error for each number that a result depends on; the
    label says what that length is.
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


_FEW = 12  # measured values, such as those of modes, that are drawn as large dots, each with its tick


@dataclass(frozen=True)
class FittedHistory:
    """A channel of a fit."""

    label: str  # its name with its unit in brackets
    measured: Array  # (n,): as it was measured
    first: Array  # (n,): the scene's before the fit
    fitted: Array  # (n,): the scene's after the fit
    sigma: float | Array  # (n,): standard deviation of its noise


def break_at_gaps(places: Array, values: Array) -> tuple[Array, Array]:
    """Return places (n,) in order and values, with NaN between two that are far apart: no line is drawn there."""
    steps = np.diff(places)
    after = 1 + np.flatnonzero(steps > GAP * np.median(steps)) if len(steps) else np.zeros(0, dtype=int)
    return np.insert(places, after, np.nan), np.insert(values, after, np.nan)


def draw_fit(axis: tuple[str, Array], histories: Sequence[FittedHistory], path: Path, *, title: str) -> None:
    """Draw each channel of a fit, one at least, and beside it what the fit leaves over the noise.

    The axis has the name, with its unit, and the values of what is measured over.
    """
    label, places = axis
    dot = 7 if len(places) <= _FEW else 3
    size = (11.0, 2.7 * len(histories) + 0.7)
    with open_figure(path, size, 120, padding=0.08) as figure:
        figure.suptitle(title, fontsize=14)
        frames = figure.subplots(len(histories), 2, squeeze=False, sharex=True, gridspec_kw={"width_ratios": [3, 2]})
        for (left, right), history in zip(frames, histories, strict=True):
            left.plot(places, history.measured, ".", markersize=dot, color="0.6", label="measured")
            first, fitted = (break_at_gaps(places, values) for values in (history.first, history.fitted))
            left.plot(*first, "--", linewidth=1.2, color=COLOURS[1], label="first")
            left.plot(*fitted, linewidth=1.4, color=COLOURS[0], label="fitted")
            style_axes(left, "", history.label)
            right.plot(
                places, (history.measured - history.fitted) / history.sigma, ".", markersize=dot, color=COLOURS[0]
            )
            for level in (-2.0, 2.0):
                right.axhline(level, color=GREY, linewidth=0.8, linestyle=":")
            style_axes(right, "", "residual / noise")
        for axes in frames[-1]:
            axes.set_xlabel(label, fontsize=12)
            if len(places) <= _FEW:
                axes.set_xticks(places)
            else:
                axes.locator_params(axis="x", nbins=5)  # labels of the narrow charts stay apart
        frames[0, 0].legend(fontsize=10, frameon=False)
