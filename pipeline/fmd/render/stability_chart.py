"""Stability maps over two Courant numbers: growth in colours, and a surface of stable and unstable."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm

from fmd.core.arrays import Array, require_shape
from fmd.core.data_classes import dataclass
from fmd.render.charts import open_figure

LEAST_GROWTH, MOST_GROWTH = 1e-6, 10.0  # ends of the colour scale
SURFACE_LINES = 50
_STABLE = 1e-9  # excess of a spectral radius over 1 that counts as stable


@dataclass(frozen=True, slots=True)
class Panel:
    """A stability map with its heading, one panel of a figure."""

    omega_s: Array  # (n_s,): Courant numbers of the fast coordinates
    omega_l: Array  # (n_l,): Courant numbers of the slow coordinates
    rho: Array  # (n_l, n_s): spectral radius of a major cycle
    title: str

    def __post_init__(self) -> None:
        require_shape("rho", self.rho, (len(self.omega_l), len(self.omega_s)))


def draw_stability(panels: Sequence[Panel], path: Path, *, title: str) -> None:
    """Draw stability maps side by side; a single one stands beside its surface of 0 (stable) and 1."""
    single = len(panels) == 1
    columns = 2 if single else min(len(panels), 3)
    rows = -(-len(panels) // columns)
    size = (11, 5.2) if single else (4.0 * columns + 1.2, 3.7 * rows + 0.8)
    with open_figure(path, size, 90) as figure:
        figure.suptitle(title, fontsize=15)
        if single:
            _add_surface(figure.add_subplot(1, 2, 1, projection="3d"), panels[0])
        maps = [figure.add_subplot(rows, columns, 2 if single else number) for number in range(1, len(panels) + 1)]
        colours = [_add_map(axes, panel) for axes, panel in zip(maps, panels, strict=True)]
        bar = figure.colorbar(colours[-1], ax=maps, shrink=0.85)
        bar.set_label("growth of a major cycle, ρ − 1", fontsize=11)


def _add_map(axes: Axes, panel: Panel) -> Any:
    """Add a panel's growth in colours and the limits of central differences; return the colours."""
    growth = np.where(panel.rho > 1 + _STABLE, np.clip(panel.rho - 1, LEAST_GROWTH, MOST_GROWTH), np.nan)
    axes.set_facecolor("#eef3ee")
    colours = axes.pcolormesh(
        panel.omega_s,
        panel.omega_l,
        growth,
        norm=LogNorm(LEAST_GROWTH, MOST_GROWTH),
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


def _add_surface(axes: Any, panel: Panel) -> None:
    """Add a panel as a surface that is 0 where the scheme is stable and 1 elsewhere."""
    every_s, every_l = (max(1, len(omega) // SURFACE_LINES) for omega in (panel.omega_s, panel.omega_l))
    unstable = (panel.rho > 1 + _STABLE)[::every_l, ::every_s].astype(float)
    x, y = np.meshgrid(panel.omega_s[::every_s], panel.omega_l[::every_l])
    axes.plot_surface(x, y, unstable, color="#e8a13a", linewidth=0, rcount=SURFACE_LINES, ccount=SURFACE_LINES)
    axes.set_zlim(0, 1)
    axes.set_zticks([0, 1])
    axes.set_xlabel(r"$\Omega_S$", fontsize=12)
    axes.set_ylabel(r"$\Omega_L$", fontsize=12)
    axes.set_title("0 = stable, 1 = unstable", fontsize=12)
    axes.view_init(elev=28, azim=-128)
