"""Colour maps, and the stresses that belong to the ends of their scale."""

from __future__ import annotations

from difflib import get_close_matches

import numpy as np
from numpy.typing import NDArray

from pipeline.core.arrays import Array

STRESS = "von Mises [MPa]"
COMMON = frozenset({"turbo", "viridis", "plasma", "inferno", "magma", "cividis", "coolwarm"})  # Matplotlib has them all


def require_colour_map(name: str) -> None:
    """Raise ``ValueError`` with similar names unless Matplotlib has a colour map of that name."""
    if name in COMMON:
        return
    from matplotlib import colormaps

    if name not in colormaps:
        near = get_close_matches(name, list(colormaps), n=4, cutoff=0.5)
        hint = f"did you mean {', '.join(near)}?" if near else "e.g. turbo, viridis, cividis, coolwarm"
        raise ValueError(f"there is no colour map {name!r}; {hint}")


def sample_colours(colour_map: str, n: int) -> NDArray[np.uint8]:
    """Return n colours of a map from its lower to its upper end, shape (n, 3), 0 … 255."""
    from matplotlib import colormaps

    return np.asarray(colormaps[colour_map](np.linspace(0, 1, n), bytes=True)[:, :3])


def stress_limits(stress: Array) -> tuple[float, float]:
    """Return the limits of the colour scale [Pa]: from 0, or the least stress if negative, to the largest."""
    low, high = min(0.0, float(stress.min())), float(stress.max())
    return (low, high) if low < high else (low, low + 1e6)


def limits_in_megapascals(clim_pa: tuple[float, float]) -> tuple[float, float]:
    """Convert limits of the colour scale from Pa to MPa; raise ``ValueError`` unless they ascend."""
    if not clim_pa[0] < clim_pa[1]:
        raise ValueError(f"clim_pa = {clim_pa}: the highest colour needs a larger stress than the lowest")
    return clim_pa[0] * 1e-6, clim_pa[1] * 1e-6
