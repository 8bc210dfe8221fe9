"""Charts of a fit: measured, first and fitted histories, and what the fit leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fmd.core.arrays import Array
from fmd.render.charts import COLOURS, GREY
from fmd.render.figure import open_figure, style_axes

_FEW = 12  # measured values, such as those of modes, that are drawn as large dots, each with its tick


@dataclass(frozen=True)
class FittedHistory:
    """A channel of a fit.

    Attributes
    ----------
    label : str
        Its name with its unit in brackets.
    measured, first, fitted : ndarray, shape (n,)
        As it was measured, and the scene's before and after the fit.
    sigma : float or ndarray, shape (n,)
        Standard deviation of its noise.
    """

    label: str
    measured: Array
    first: Array
    fitted: Array
    sigma: float | Array


def draw_fit(axis: tuple[str, Array], histories: Sequence[FittedHistory], path: Path, *, title: str) -> None:
    """Draw each channel of a fit, and beside it what the fit leaves over the noise.

    Parameters
    ----------
    axis : tuple of str and ndarray, shape (n,)
        Over what is measured: its name with its unit, and its values.
    histories : sequence of FittedHistory
        At least one.
    """
    label, places = axis
    dot = 7 if len(places) <= _FEW else 3
    size = (11.0, 2.7 * len(histories) + 0.7)
    with open_figure(path, size, 120, padding=0.08) as figure:
        figure.suptitle(title, fontsize=14)
        frames = figure.subplots(len(histories), 2, squeeze=False, sharex=True, gridspec_kw={"width_ratios": [3, 2]})
        for (left, right), history in zip(frames, histories, strict=True):
            left.plot(places, history.measured, ".", markersize=dot, color="0.6", label="measured")
            left.plot(places, history.first, "--", linewidth=1.2, color=COLOURS[1], label="first")
            left.plot(places, history.fitted, linewidth=1.4, color=COLOURS[0], label="fitted")
            style_axes(left, "", history.label)
            right.plot(
                places, (history.measured - history.fitted) / history.sigma, ".", markersize=dot, color=COLOURS[0]
            )
            for level in (-2.0, 2.0):
                right.axhline(level, color=GREY, linewidth=0.8, linestyle=":")
            style_axes(right, "", "left over, of noise")
        for axes in frames[-1]:
            axes.set_xlabel(label, fontsize=12)
            if len(places) <= _FEW:
                axes.set_xticks(places)
        frames[0, 0].legend(fontsize=10, frameon=False)
