"""Draw error and run time over the load of linear modes, pieces and modes with derivatives, from the measured table.

Run from the project's root: ``python benchmarks/nonlinear_modes_chart.py``. Writes ``nonlinear-modes.png`` into
``docs/charts``.
"""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path += [str(HERE), str(HERE.parent)]
from table_format import Row, read_rows  # noqa: E402

from fmd.render.charts import COLOURS  # noqa: E402
from fmd.render.figure import open_figure, style_axes  # noqa: E402

CASES = {
    "plane": ("pulled in a plane", "P L²/EI", "statics [s]"),
    "space": ("pulled at 45°, bends and twists", "force / 8.896 N", "statics [s]"),
    "release": ("let go in a plane", "P L²/EI before", "march of 1 s [s]"),
}
PATH = HERE.parent / "docs" / "charts" / "nonlinear-modes.png"
FAMILIES = {"linear": COLOURS[5], "pieces": COLOURS[0], "derivatives": COLOURS[1]}
STYLES = ("-", "--", ":", "-.", (0, (6, 1, 1, 1, 1, 1)))
SIGNS = "os^Dv"


def draw() -> None:
    """Draw a row of two frames for each case."""
    rows = read_rows("nonlinear_modes")
    with open_figure(PATH, (10, 10.5), 70, padding=0.1) as figure:
        frames = figure.subplots(len(CASES), 2)
        for (left, right), (case, (title, load, time)) in zip(frames, CASES.items(), strict=True):
            models: dict[str, list[Row]] = {}
            for row in rows:
                if row["case"] == case:
                    models.setdefault(row["model"], []).append(row)
            counts = dict.fromkeys(FAMILIES, 0)
            for model, points in models.items():
                family = next(name for name in FAMILIES if name in model)
                number, counts[family] = counts[family], counts[family] + 1
                look = {"color": FAMILIES[family], "linestyle": STYLES[number], "marker": SIGNS[number]}
                x = [float(row["load"]) for row in points]
                for axes, key in ((left, "error_percent"), (right, "seconds")):
                    axes.loglog(
                        x, [float(row[key]) for row in points], **look, linewidth=1.4, markersize=4, label=model
                    )
            ticks = [float(row["load"]) for row in next(iter(models.values()))]
            for axes in (left, right):
                axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
                axes.set_xticks([], minor=True)
            style_axes(left, load, "error [%]", title)
            style_axes(right, load, time, title)
            right.legend(loc="center left", bbox_to_anchor=(1.02, 0.5), fontsize=9, frameon=False, handlelength=3)


if __name__ == "__main__":
    draw()
