"""Pictures of a field: its worst point is seen, labelled and in the colour that it has in the bar."""

from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from fmd.render.camera import Camera
from fmd.render.pictures import draw_field
from fmd.render.surface import Surface
from tests.render.test_pictures import SIZE, distance_to_top_colour


def test_the_worst_point_has_the_colour_of_its_end_of_the_bar(tmp_path: Path, block: Surface) -> None:
    """With the colours turned round the smallest value has the warmest one."""
    distance = np.linalg.norm(block.points - block.points.max(axis=0), axis=1)
    labelled = {}
    for label in ("3·10⁵ repeats", ""):
        path = tmp_path / f"life-{len(label)}.png"
        projection = draw_field(
            block, 5.0 + 40.0 * distance, path, title="Life", quantity="log₁₀ of the repeats", limits=(5.0, 11.0),
            weights=-distance + distance.max(), label=label, camera=Camera(size=SIZE, colour_map="turbo"),
        )  # fmt: skip
        labelled[label] = iio.imread(path)
    picture = labelled["3·10⁵ repeats"]
    (worst,) = projection.pixels(block.points[[int(distance.argmin())]])
    assert picture.shape[:2] == SIZE[::-1]
    assert distance_to_top_colour(picture, worst) > 60
    assert (labelled[""] != picture).any()
    turned = tmp_path / "turned.png"
    draw_field(
        block, 40.0 * distance, turned, title="Life", quantity="x", limits=(0.0, 6.0), weights=-distance + 1.0,
        label="", camera=Camera(size=SIZE, colour_map="light turbo_r"),
    )  # fmt: skip
    column, row = np.round(worst).astype(int)
    around = iio.imread(turned)[row - 3 : row + 4, column - 3 : column + 4, :3].astype(float)
    assert np.abs(around - [122, 4, 3]).max(axis=-1).min() < 40  # turbo's dark red, a face turned from the light


def test_a_field_that_does_not_fit_is_refused(tmp_path: Path, block: Surface) -> None:
    values, more = np.zeros(len(block.points)), {"title": "", "quantity": "", "label": ""}
    with pytest.raises(ValueError, match="limits = "):
        draw_field(block, values, tmp_path / "a.png", limits=(1.0, 1.0), weights=values, **more)
    for fields in ((values[1:], values), (values, values[1:])):
        with pytest.raises(ValueError, match=r"values|weights"):
            draw_field(block, fields[0], tmp_path / "a.png", limits=(0.0, 1.0), weights=fields[1], **more)
