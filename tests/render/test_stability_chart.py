"""Stability maps: unstable regions are coloured, stable ones are not."""

from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.render.stability_chart import Panel, draw_stability

pytestmark = pytest.mark.slow

OMEGA = np.linspace(0.05, 3.0, 40)


def panel(unstable_share: float, n: int = 40) -> Panel:
    omega, rho = np.linspace(0.05, 3.0, n), np.ones((n, n))
    rho[:, : round(n * unstable_share)] = 3.0
    return Panel(omega, omega, rho, "β = 0.1")


def red_pixels(path: Path) -> int:
    picture: Array = iio.imread(path)[:, :, :3].astype(float)
    plan = picture[:, picture.shape[1] // 2 : -150]  # right of the surface, left of the colour bar
    return int(np.count_nonzero((plan[..., 0] > 120) & (plan[..., 1] < 80)))


def test_the_unstable_region_is_as_large_as_it_is(tmp_path: Path) -> None:
    count = []
    for share in (0.0, 0.25, 0.5):
        path = tmp_path / f"map-{share}.png"
        draw_stability([panel(share)], path, title="Two degrees of freedom")
        count.append(red_pixels(path))
    assert count[0] == 0
    assert count[2] == pytest.approx(2 * count[1], rel=0.1)


def test_several_maps_stand_in_rows_of_three(tmp_path: Path) -> None:
    sizes = []
    for n in (2, 4):
        draw_stability([panel(0.3, 5)] * n, tmp_path / "maps.png", title="Couplings")
        sizes.append(iio.imread(tmp_path / "maps.png").shape[:2])
    assert sizes[1][1] > sizes[0][1]
    assert sizes[1][0] > sizes[0][0]


def test_a_map_that_does_not_fit_its_axes_is_refused() -> None:
    with pytest.raises(ValueError, match="rho has shape"):
        Panel(OMEGA, OMEGA, np.ones((39, 40)), "")
