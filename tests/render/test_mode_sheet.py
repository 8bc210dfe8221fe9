"""Sheets of modes: every shape and its label are there."""

from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from scipy.ndimage import binary_dilation, label

from fmd.render.camera import Camera
from fmd.render.mode_sheet import draw_mode_sheet
from fmd.render.surface import Surface


@pytest.mark.parametrize("n_modes", [1, 5, 6])
def test_a_sheet_shows_all_its_modes_and_their_labels(tmp_path: Path, propeller: Surface, n_modes: int) -> None:
    radius = np.linalg.norm(propeller.points[:, :2], axis=1, keepdims=True)
    shapes = np.stack([radius**2 * np.array([0, 0, (-1.0) ** k]) for k in range(n_modes)], axis=-1)
    labels = [f"mode {k + 1}, 131.0 Hz" for k in range(n_modes)]
    camera = Camera((-60, 40), size=(900, 600))
    draw_mode_sheet(propeller, shapes, labels, tmp_path / "sheet.png", title="", camera=camera)
    picture = iio.imread(tmp_path / "sheet.png")[:540, :, :3].astype(int)
    top = np.array([122, 4, 3])  # turbo's dark red, which a tip has in each mode
    red = np.all(np.abs(picture - top) < 30, axis=-1)
    _, n_places = label(binary_dilation(red, iterations=12))
    assert n_places >= n_modes
    assert picture[:40].min() == 255  # no title, and nothing that reaches there


def test_a_sheet_of_modes_that_do_not_fit_is_refused(tmp_path: Path, block: Surface) -> None:
    shapes = np.ones((len(block.points), 3, 2))
    path = tmp_path / "sheet.png"
    with pytest.raises(ValueError, match="shapes has shape"):
        draw_mode_sheet(block, shapes, ["one"], path, title="")
    with pytest.raises(ValueError, match="at least one"):
        draw_mode_sheet(block, shapes[:, :, :0], [], path, title="")
    with pytest.raises(ValueError, match="zero everywhere"):
        draw_mode_sheet(block, 0 * shapes, ["one", "two"], path, title="")
    with pytest.raises(ValueError, match="whole parts"):
        draw_mode_sheet(block, shapes, ["one", "two"], path, title="", camera=Camera(zoom=2))
