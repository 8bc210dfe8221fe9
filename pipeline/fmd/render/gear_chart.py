"""Two gears in mesh over a pitch: transmission error, stiffness, shares of the load and stress at the roots."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fmd.core.arrays import Array
from fmd.render.charts import COLOURS, open_figure, style_axes


def draw_gear_mesh(angle: Array, columns: Sequence[Array], pairs: range, path: Path, *, title: str) -> None:
    """Draw what the table of two gears in mesh has, over the pinion's angle (n,) [degrees].

    Columns are transmission error [µm], stiffness [N/µm], and of each pair the share of the load, the stress at the
    pinion's and at the wheel's root and the pressure [MPa]; the last pair to come into contact is first.
    """
    error, stiffness, *rest = columns
    share, pinion, wheel, pressure = (rest[k * len(pairs) : (k + 1) * len(pairs)] for k in range(4))
    with open_figure(path, (11, 7), 120, padding=0.08) as figure:
        figure.suptitle(title, fontsize=15)
        frames = figure.subplots(2, 2, sharex=True)
        frames[0, 0].plot(angle, error, color=COLOURS[0])
        frames[0, 1].plot(angle, stiffness, color=COLOURS[0])
        for k in pairs:
            touches, colour = share[k] > 0.0, COLOURS[k % len(COLOURS)]
            name = "last pair" if k == 0 else f"pair {k} before"
            frames[1, 0].plot(angle[touches], share[k][touches], color=colour, label=name)
            frames[1, 1].plot(angle[touches], pinion[k][touches], color=colour, label=f"pinion's root, {name}")
            frames[1, 1].plot(angle[touches], wheel[k][touches], color=colour, linestyle="--", label=f"wheel's, {name}")
            frames[1, 1].plot(angle[touches], pressure[k][touches], color=colour, linestyle=":", label=f"flank, {name}")
        labels = ("transmission error [µm]", "stiffness [N/µm]", "share of the load", "stress, pressure [MPa]")
        for number, (frame, label) in enumerate(zip(frames.flat, labels, strict=True)):
            style_axes(frame, "pinion's angle [°]" if number > 1 else "", label)
            frame.margins(x=0)
            low, high = frame.get_ylim()
            frame.set_ylim(min(0.0, low), high + 0.05 * np.abs(high))
        for frame in frames[1]:
            frame.legend(fontsize=8, frameon=False)
