"""Colour maps, and the stresses that belong to the ends of their scale."""

from collections.abc import Callable, Mapping
from difflib import get_close_matches

import numpy as np
from numpy.typing import NDArray

from fmd.core.arrays import Array

STRESS = "von Mises [MPa]"
LIGHT_TURBO = "light turbo"
UNCOLOURED = "#c3c9d1"  # of a flexible body without stress
_TURNED = "_r"  # ends the name of a map that runs backwards, as in Matplotlib
COMMON = frozenset(
    {LIGHT_TURBO, LIGHT_TURBO + _TURNED, "turbo", "viridis", "plasma", "inferno", "magma", "cividis", "coolwarm"}
)
_LIGHT = (0.84, 0.88, 0.93)  # lower end of ``light turbo``, in place of turbo's near black
_JOIN = 0.36  # from here on it is turbo: green, before which turbo passes dark blue
_USUAL_SHARE = 0.99  # of all values that the colours of a film tell apart


def require_colour_map(name: str) -> None:
    """Raise ``ValueError`` with similar names unless Matplotlib has a colour map of that name."""
    if name in COMMON:
        return
    from matplotlib import colormaps

    if name not in colormaps:
        near = get_close_matches(name, list(colormaps), n=4, cutoff=0.5)
        hint = f"did you mean {', '.join(near)}?" if near else "e.g. light turbo, turbo, viridis, cividis"
        raise ValueError(f"there is no colour map {name!r}; {hint}")


def sample_colours(colour_map: str, n: int) -> NDArray[np.uint8]:
    """Return n colours of a map from its lower to its upper end, shape (n, 3), 0 … 255.

    ``light turbo`` is turbo with a light lower end: a part without stress is no black silhouette.
    """
    from matplotlib import colormaps

    if colour_map == LIGHT_TURBO + _TURNED:
        return sample_colours(LIGHT_TURBO, n)[::-1].copy()
    x = np.linspace(0, 1, n)
    if colour_map != LIGHT_TURBO:
        return np.asarray(colormaps[colour_map](x, bytes=True)[:, :3])
    turbo = colormaps["turbo"]
    share = np.clip(x / _JOIN, 0, 1)[:, None]
    # On the way to green through cyan, as turbo itself does.
    middle, join = np.array([0.35, 0.72, 0.90]), np.array(turbo(_JOIN)[:3])
    light = (1 - share) ** 2 * np.array(_LIGHT) + 2 * share * (1 - share) * middle + share**2 * join
    return np.asarray(np.rint(255 * np.where(share < 1, light, turbo(x)[:, :3])), dtype=np.uint8)


def stress_limits(stress: Array) -> tuple[float, float]:
    """Return the limits of the colour scale [Pa]: from 0, or the least stress if negative, to the largest."""
    low, high = min(0.0, float(stress.min())), float(stress.max())
    return (low, high) if low < high else (low, low + 1e6)


def usual_limits(stress: Array) -> tuple[float, float]:
    """Return limits of a colour scale [Pa]: to the 99th percentile of all values, not one instant's peak.

    Where hardly anything is left between them, they are those of `stress_limits`.
    """
    low, high = stress_limits(stress)
    usual = float(np.quantile(stress, _USUAL_SHARE))
    least = min(0.0, float(np.quantile(stress, 1 - _USUAL_SHARE)))
    return (least, usual) if usual - least > 1e-3 * (high - low) else (low, high)


# Of what a film's colour scale spans, and of which of its frames each scale is taken.
FILM_RANGES: Mapping[str, tuple[Callable[[Array], tuple[float, float]], bool]] = {
    "largest": (stress_limits, False),
    "usual": (usual_limits, False),
    "frame": (stress_limits, True),
}


def film_limits(stress: Array, span: str) -> Array:
    """Return the limits of a film's colour scale in each frame of stress (n_frames, n_points), (n_frames, 2) [Pa].

    The span is ``largest``, to the largest stress of all frames; ``usual``, to their 99th percentile; ``frame``, to the
    largest of each frame.
    """
    limits, in_each = FILM_RANGES[span]
    if in_each:
        return np.array([limits(values) for values in stress])
    return np.tile(limits(stress), (len(stress), 1))


def limits_in_megapascals(clim_pa: tuple[float, float]) -> tuple[float, float]:
    """Convert limits of the colour scale from Pa to MPa; raise ``ValueError`` unless they ascend."""
    if not clim_pa[0] < clim_pa[1]:
        raise ValueError(f"clim_pa = {clim_pa}: the highest colour needs a larger stress than the lowest")
    return clim_pa[0] * 1e-6, clim_pa[1] * 1e-6
