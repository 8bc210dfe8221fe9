"""Campbell diagram: frequencies over the rate of rotation, with the lines of its multiples."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pipeline.core.arrays import Array
from pipeline.core.files import whole_file

_MULTIPLES = 4


def draw_campbell(rates: Array, frequencies_hz: Array, path: Path, *, title: str) -> None:
    """Draw frequencies over rates, and the first multiples of the rate itself.

    Parameters
    ----------
    rates : ndarray, shape (n_rates,)
        Rates of rotation [rad/s].
    frequencies_hz : ndarray, shape (n_rates, n_modes)
        [Hz]; not a number where there is none.
    path : Path
        PNG, PDF or SVG.
    """
    figure = Figure(figsize=(10, 6), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    top = 1.05 * float(np.nanmax(frequencies_hz))
    for multiple in range(1, _MULTIPLES + 1):
        line = multiple * rates / (2 * np.pi)
        axes.plot(rates, line, color="0.65", linewidth=0.9, linestyle=(0, (5, 3)), zorder=1)
        last = np.flatnonzero(line <= top)[-1]
        axes.annotate(f"{multiple} ×", (rates[last], line[last]), color="0.4", fontsize=10, ha="right", va="bottom")
    for mode, values in enumerate(frequencies_hz.T, start=1):
        axes.plot(rates, values, linewidth=1.8, label=f"mode {mode}")
    axes.set_xlim(rates[0], rates[-1])
    axes.set_ylim(0.0, top)
    axes.set_xlabel("rate of rotation [rad/s]", fontsize=12)
    axes.set_ylabel("frequency [Hz]", fontsize=12)
    axes.set_title(title, fontsize=14)
    axes.grid(True, color="0.88")
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside right center", fontsize=11, frameon=False)
    with whole_file(path) as part:
        figure.savefig(part)
