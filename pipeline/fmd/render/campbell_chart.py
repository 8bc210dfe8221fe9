"""Campbell diagrams: frequencies over the rate of rotation, with the multiples of that rate."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fmd.core.arrays import Array
from fmd.render.charts import open_figure, style_axes

_APART = 0.045  # least distance of labels, over the chart's width or height


def draw_campbell(
    rates: Array,
    frequencies_hz: Array,
    path: Path,
    *,
    title: str,
    unit: str = "rad/s",
    orders: Sequence[float] | None = None,
    crossings: Sequence[tuple[float, float]] = (),
    unstable: Sequence[tuple[float, float]] = (),
) -> None:
    """Draw frequencies (n_rates, n_modes) [Hz] over the rate of rotation, and multiples of the rate, 1 to 4 by default.

    Rates (n_rates,) are in ``unit``, ``rad/s`` or ``rpm``; NaN stands where a rate has fewer modes. Crossings, of rates
    and frequencies, are marked, and ranges of rates shaded in which a vibration grows.
    """
    once = rates / (60 if unit == "rpm" else 2 * np.pi)  # revolutions in a second
    top = 1.05 * float(np.nanmax(frequencies_hz))
    with open_figure(path, (10, 6), 120) as figure:
        axes = figure.add_subplot()
        labelled: list[tuple[float, float]] = []
        for multiple in range(1, 5) if orders is None else orders:
            line = multiple * once
            axes.plot(rates, line, color="0.65", linewidth=0.9, linestyle=(0, (5, 3)), zorder=1)
            last = np.flatnonzero(line <= top)[-1]
            place = (rates[last] / rates[-1], line[last] / top)
            # Low multiples lie close together; each label that fits is drawn.
            if all(abs(place[0] - x) > _APART or abs(place[1] - y) > _APART for x, y in labelled):
                labelled.append(place)
                at = (rates[last], line[last])
                axes.annotate(f"{multiple:g} ×", at, color="0.4", fontsize=10, ha="right", va="bottom")
        for mode, values in enumerate(frequencies_hz.T, start=1):
            axes.plot(rates, values, linewidth=1.8, label=f"mode {mode}")
        for number, (start, end) in enumerate(unstable):
            label = "grows" if not number else None
            axes.axvspan(start, end, color="tab:red", alpha=0.15, linewidth=0.0, zorder=0, label=label)
        if crossings:
            axes.plot(*zip(*crossings, strict=True), "o", color="0.15", markersize=4, zorder=5)
        axes.set_xlim(rates[0], rates[-1])
        axes.set_ylim(0.0, top)
        style_axes(axes, f"rate of rotation [{unit}]", "frequency [Hz]", title)
        figure.legend(loc="outside right center", fontsize=11, frameon=False)
