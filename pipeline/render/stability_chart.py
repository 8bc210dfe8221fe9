"""Maps of stability over two Courant numbers: as a surface of 0 and 1, and in plan with the growth in colours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from pipeline.core.arrays import Array, require_shape
from pipeline.core.files import whole_file

FAINTEST = 1e-6  # growth of a cycle that is just told from none in the colours
MOST = 10.0
COARSE = 50  # lines of the surface


@dataclass(frozen=True, slots=True)
class Panel:
    """One map.

    Attributes
    ----------
    omega_s, omega_l : ndarray, shapes (n_s,) and (n_l,)
        Courant numbers of the fast and of the slow coordinates.
    rho : ndarray, shape (n_l, n_s)
        Spectral radius of a major cycle.
    title : str
        What is written above.
    """

    omega_s: Array
    omega_l: Array
    rho: Array
    title: str

    def __post_init__(self) -> None:
        require_shape("rho", self.rho, (len(self.omega_l), len(self.omega_s)))


def draw_stability(panels: Sequence[Panel], path: Path, *, title: str, tolerance: float = 1e-9) -> None:
    """Draw maps in plan, side by side; one map alone stands beside the surface of what is stable (0) and not (1).

    Parameters
    ----------
    panels : sequence of Panel
        At least one.
    path : Path
        PNG, PDF or SVG.
    tolerance : float
        By how much a spectral radius may exceed 1 and count as stable.
    """
    alone = len(panels) == 1
    columns = 2 if alone else min(len(panels), 3)
    rows = -(-len(panels) // columns)
    figure = Figure(
        figsize=(11, 5.2) if alone else (4.0 * columns + 1.2, 3.7 * rows + 0.8), dpi=90, layout="constrained"
    )
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=15)
    if alone:
        _add_surface(figure.add_subplot(1, 2, 1, projection="3d"), panels[0], tolerance)
    colours: Any = None
    plans: list[Axes] = []
    for number, panel in enumerate(panels):
        axes = figure.add_subplot(rows, columns, 2 if alone else number + 1)
        colours = _add_plan(axes, panel, tolerance)
        plans.append(axes)
    bar = figure.colorbar(colours, ax=plans, shrink=0.85)
    bar.set_label("growth of a major cycle, ρ − 1", fontsize=11)
    with whole_file(path) as part:
        figure.savefig(part)


def _add_plan(axes: Axes, panel: Panel, tolerance: float) -> Any:
    growth = np.where(panel.rho > 1 + tolerance, np.clip(panel.rho - 1, FAINTEST, MOST), np.nan)
    axes.set_facecolor("#eef3ee")
    colours = axes.pcolormesh(
        panel.omega_s,
        panel.omega_l,
        growth,
        norm=LogNorm(FAINTEST, MOST),
        cmap="YlOrRd",
        shading="nearest",
        rasterized=True,
    )
    axes.plot([2, 2, 0], [0, 2, 2], color="0.3", linewidth=1.0, linestyle=(0, (4, 3)))
    axes.set_xlim(0, panel.omega_s[-1])
    axes.set_ylim(0, panel.omega_l[-1])
    axes.set_aspect("equal")
    axes.set_xlabel(r"$\Omega_S = \omega_S h$", fontsize=11)
    axes.set_ylabel(r"$\Omega_L = \omega_L m h$", fontsize=11)
    axes.set_title(panel.title, fontsize=12)
    return colours


def _add_surface(axes: Any, panel: Panel, tolerance: float) -> None:
    every_s, every_l = (max(1, len(omega) // COARSE) for omega in (panel.omega_s, panel.omega_l))
    unstable = (panel.rho > 1 + tolerance)[::every_l, ::every_s].astype(float)
    x, y = np.meshgrid(panel.omega_s[::every_s], panel.omega_l[::every_l])
    axes.plot_surface(x, y, unstable, color="#e8a13a", linewidth=0, rcount=COARSE, ccount=COARSE)
    axes.set_zlim(0, 1)
    axes.set_zticks([0, 1])
    axes.set_xlabel(r"$\Omega_S$", fontsize=12)
    axes.set_ylabel(r"$\Omega_L$", fontsize=12)
    axes.set_title("0 = stable, 1 = unstable", fontsize=12)
    axes.view_init(elev=28, azim=-128)
