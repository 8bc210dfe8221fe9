"""Charts over time with differences from the first curve, and the style and the files that all charts share."""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogFormatterSciNotation

from fmd.core.arrays import Array
from fmd.core.files import whole_file
from fmd.core.html import prefix_for
from fmd.core.limits.shown import CHARTED_QUANTITIES, SEEN_ERROR
from fmd.render.chart_data import Band, Curve, HistoryFrame


@contextmanager
def open_figure(path: Path, size: tuple[float, float], dots_per_inch: int, padding: float = 0.04) -> Iterator[Figure]:
    """Open an empty figure [inches] and, unless an error occurs, save it in the format of the path's suffix.

    A PNG has so many dots per inch; contents have a padding around them [inches].
    """
    layout = ConstrainedLayoutEngine(w_pad=padding, h_pad=padding)
    figure = Figure(figsize=size, dpi=dots_per_inch, layout=layout)
    FigureCanvasAgg(figure)
    yield figure
    layout.execute(figure)
    figure.set_layout_engine("none")  # else saving draws all of it once more, for its layout alone
    with whole_file(path) as part:
        figure.savefig(part)


def style_axes(axes: Axes, xlabel: str, ylabel: str, title: str = "") -> None:
    """Label the axes, whose scales are set, add a grid, and leave out the frame's top and right."""
    axes.set_xlabel(xlabel, fontsize=12)
    axes.set_ylabel(ylabel, fontsize=12)
    axes.set_title(title, fontsize=14)
    axes.grid(True, which="major", color="0.88")
    axes.spines[["top", "right"]].set_visible(False)
    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "log":
            axis.set_major_formatter(_DecadeFormatter())
            axis.set_minor_formatter(_DecadeFormatter(minor_thresholds=(_FEW_DECADES, 0.4)))


class _DecadeFormatter(LogFormatterSciNotation):
    """Labels of a logarithmic axis: 300 and 0.02 as on other axes, powers of ten where it goes beyond."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        text = super().__call__(x, pos)
        assert self.axis is not None
        low, high = self.axis.get_view_interval()
        return f"{x:g}" if text and _PLAIN[0] <= low and high <= _PLAIN[1] else text


SIZE_INCHES = (10.0, 6.0)
DOTS_PER_INCH = 160
# The first curve is broad and pale, the others are thin, dark and dashed: all stay visible where they coincide.
DASHES = ((0, (6, 3)), (0, (1.2, 2)), (0, (8, 2, 1.5, 2)), (0, (3, 1.5)))
COLOURS = ("#1f5fa8", "#c8501e", "#2f8f4e", "#7a4fa3", "#8a6d1a", "#4a4a4a")
GREY = "#444444"
SHADE = "#f3e3b3"
PALENESS = 0.45
_ROUND_OFF = 1e-14  # of the values: differences up to that are none
_SHORT = 0.1  # of times: those are in milliseconds [s]
_FEW_DECADES = 1.5  # of a logarithmic axis: of more, powers of ten alone have labels
_PLAIN = (1e-3, 1e5)  # numbers between which a logarithmic axis has labels without powers of ten


def draw_chart(
    time: Array,
    curves: Sequence[Curve],
    path: Path,
    *,
    title: str,
    ylabel: str,
    component_labels: Sequence[str] = (),
    band: Band | None = None,
) -> None:
    """Draw curves over times (n_times,) [s] and, below, the difference of each further one from the first.

    All curves have one shape. The file is a PNG of 1600 × 960 pixels, PDF or SVG. ``ylabel`` is the quantity with its
    unit in brackets, e.g. ``velocity [m/s]``; lengths below 1 m are drawn in mm, µm or nm. Names of the components may
    be empty if there is only one.

    Raises
    ------
    ValueError
        There are no curves, or the shapes of times, curves and component labels disagree.
    """
    _check(time, curves, component_labels)
    time, time_label = time_axis(time)
    factor, label = fit_length(ylabel, _largest(curve.columns for curve in curves))
    with open_figure(path, SIZE_INCHES, DOTS_PER_INCH, padding=0.1) as figure:
        figure.suptitle(title, fontsize=15)
        differences = [curve.columns - curves[0].columns for curve in curves[1:]]
        upper, lower = _add_frames(
            figure, two=_largest(differences) > _ROUND_OFF * _largest(curve.columns for curve in curves)
        )
        below = _add_differences(lower, time, differences, ylabel) if lower is not upper else label
        for number, curve in enumerate(curves):
            _add_lines(upper, time, factor * curve.columns, number, alone=len(curves) == 1)
        stated = _add_errors(upper, time, curves[0], factor)
        if band is not None:
            upper.axhspan(factor * band.low, factor * band.high, color=SHADE, linewidth=0, zorder=0)
        for axes, text in ((upper, label), (lower, below)):
            axes.margins(x=0)
            axes.autoscale_view()
            axes.tick_params(labelsize=11)
            style_axes(axes, time_label if axes is lower else "", text)
            if len(text) > 32 and axes is upper:  # letters of an axis label, from which on they are smaller
                axes.yaxis.label.set_fontsize(10)
        figure.align_ylabels()
        _add_legends(figure, curves, component_labels, band, stated)


def _add_frames(figure: Figure, *, two: bool) -> tuple[Axes, Axes]:
    """Add an upper frame, and a lower one a third as high unless both are one."""
    if two:
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
        return upper, lower
    axes = figure.add_subplot()
    return axes, axes


def _check(time: Array, curves: Sequence[Curve], component_labels: Sequence[str]) -> None:
    """Raise ``ValueError`` unless times, curves and component labels fit together."""
    if not curves:
        raise ValueError("a chart needs at least one curve")
    n_components = curves[0].columns.shape[1]
    for curve in curves:
        if curve.columns.shape != (len(time), n_components):
            raise ValueError(
                f"curve {curve.label!r} has shape {curve.values.shape}, "
                f"expected {len(time)} times and {n_components} components"
            )
    if len(component_labels) != n_components and (component_labels or n_components > 1):
        raise ValueError(f"{len(component_labels)} component labels for {n_components} components")


def time_axis(time: Array) -> tuple[Array, str]:
    """Return times as an axis has them, short ones in milliseconds, and its label."""
    return (1e3 * time, "time [ms]") if time[-1] < _SHORT else (time, "time [s]")


def fit_length(label: str, largest: float) -> tuple[float, str]:
    """Return a factor on values, and their axis label, so that lengths in m up to ``largest`` are in mm, µm or nm."""
    if not label.endswith("[m]") or not 0 < largest < 1:
        return 1.0, label
    factor, unit = next(
        ((1 / size, unit) for size, unit in ((1e-3, "mm"), (1e-6, "µm")) if largest >= size), (1e9, "nm")
    )
    return factor, f"{label.removesuffix('[m]')}[{unit}]"


def _largest(arrays: Iterable[Array]) -> float:
    """Return the largest finite absolute value, 0 of nothing."""
    return max((float(np.max(np.abs(a[np.isfinite(a)]), initial=0.0)) for a in arrays), default=0.0)


def _line(x: Array, y: Array, number: int, colour: str, label: str = "", *, alone: bool = False) -> Line2D:
    """Return the line of curve ``number``: broad and pale for the first of several, else thin and dark or dashed."""
    if alone:
        return Line2D(x, y, color=colour, linewidth=2.0, label=label)
    if number == 0:
        red, green, blue = PALENESS + (1 - PALENESS) * np.array(to_rgb(colour))
        return Line2D(x, y, color=(red, green, blue), linewidth=3.5, label=label)
    dashes = DASHES[(number - 1) % len(DASHES)]
    return Line2D(x, y, color=colour, linewidth=1.5, linestyle=dashes, label=label)


def _add_lines(axes: Axes, time: Array, columns: Array, number: int, *, alone: bool = False) -> None:
    """Add a curve's lines, coloured by component, or by curve if there is only one component."""
    for component, values in enumerate(columns.T):
        colour = COLOURS[(component if columns.shape[1] > 1 else number) % len(COLOURS)]
        axes.add_line(_line(time, values, number, colour, alone=alone))


def _add_errors(axes: Axes, time: Array, curve: Curve, factor: float) -> bool:
    """Shade what the truth of a curve lies within, where that is broader than a line; return whether it is."""
    seen = False
    for component, (values, error) in enumerate(zip(curve.columns.T, curve.errors, strict=False)):
        if error > SEEN_ERROR * np.ptp(curve.columns[np.isfinite(curve.columns)]):
            low, high = factor * (values - error), factor * (values + error)
            axes.fill_between(time, low, high, color=COLOURS[component % len(COLOURS)], alpha=0.2, linewidth=0)
            seen = True
    return seen


def _add_differences(axes: Axes, time: Array, differences: Sequence[Array], ylabel: str) -> str:
    """Add each further curve's difference from the first, in a power of a thousand of the unit; return the label."""
    scale, ylabel = fit_length(ylabel, _largest(differences))
    differences = [scale * difference for difference in differences]
    exponent = 3 * math.floor(math.log10(_largest(differences)) / 3)
    for number, difference in enumerate(differences, start=1):
        _add_lines(axes, time, difference / 10.0**exponent, number)
    factor = f"$10^{{{exponent}}}$" if exponent else ""
    unit = ylabel.partition("[")[2].partition("]")[0]
    inside = f"{factor} {unit}".strip()
    return f"difference\n[{inside}]" if inside else "difference"


def _add_legends(
    figure: Figure, curves: Sequence[Curve], component_labels: Sequence[str], band: Band | None, stated: bool
) -> None:
    """Add the curves' names below the frames and the components' names beside them."""
    none = np.empty(0)
    runs: list[Line2D | Patch] = [
        _line(none, none, number, GREY if len(component_labels) > 1 else COLOURS[number % len(COLOURS)], c.label)
        for number, c in enumerate(curves)
        if len(curves) > 1
    ]
    if band is not None:
        runs.append(Patch(color=SHADE, linewidth=0, label=band.label))
    if stated:
        first = f"stated error of {curves[0].label}" if len(curves) > 1 else "stated error"
        runs.append(Patch(color=COLOURS[0], alpha=0.2, linewidth=0, label=first))
    n_columns = max(1, 100 // (8 + max(len(curve.label) for curve in curves)))
    if runs:
        figure.legend(
            handles=runs,
            loc="outside lower center",
            ncols=n_columns,
            fontsize=12,
            frameon=False,
            handlelength=3.5,
        )
    if len(component_labels) > 1:
        components = [
            Line2D(none, none, color=colour, linewidth=3.5, label=label)
            for colour, label in zip(itertools.cycle(COLOURS), component_labels, strict=False)
        ]
        figure.legend(handles=components, loc="outside right center", fontsize=12, frameon=False, handlelength=1.2)


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
