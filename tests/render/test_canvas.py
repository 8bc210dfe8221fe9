"""Canvases: which lines are drawn, and how the picture is reduced from the window."""

import numpy as np
import pytest
from numpy.typing import NDArray

from fmd.render.canvas import add_part_by_values, choose_outline, keep_windows, open_canvas
from fmd.render.projection import fit_projection, oblique_axes
from fmd.render.surface import Surface, build_skin


def test_lines_that_would_smear_a_picture_are_left_out(block: Surface) -> None:
    assert block.outline_spacing == pytest.approx(0.0235, rel=0.1)  # 20 mm × 25 mm × 26.7 mm
    opacities = []
    for pixels in (4000, 400, 100, 40):
        axes = next(oblique_axes(block.points))
        outline = choose_outline(block, fit_projection(axes, block.points, (pixels, pixels)))
        opacities.append(outline.opacity)
        assert outline.elements == (pixels >= 100)
    assert opacities[0] == opacities[1] > opacities[2]


def test_a_picture_has_its_size_whatever_the_fineness_and_shows_the_part_moved(beam: Surface) -> None:
    projection = fit_projection(next(oblique_axes(beam.points)), beam.points, (160, 90))
    skin, values = build_skin(beam), np.zeros(len(beam.points))
    for fineness in (1, 2, 3):
        with open_canvas(projection, fineness) as canvas:
            assert canvas.picture().min() == 255  # nothing is drawn yet
            part = add_part_by_values(canvas, beam, skin, values, (0.0, 1.0), "turbo")
            before = canvas.picture()
            part.move(beam.points + np.array([10.0, 0.0, 0.0]))
            after = canvas.picture()
        assert before.shape == (90, 160, 3)
        assert before.min() < 100
        assert after.min() == 255  # out of the picture


def test_a_kept_window_shows_nothing_of_the_picture_before(beam: Surface) -> None:
    axes, skin, values = next(oblique_axes(beam.points)), build_skin(beam), np.zeros(len(beam.points))
    projections = [fit_projection(axes, points, (160, 90)) for points in (beam.points, beam.points * 3.0)]

    def draw(number: int) -> NDArray[np.uint8]:
        with open_canvas(projections[number], 2) as canvas:
            add_part_by_values(canvas, beam, skin, values, (0.0, 1.0), "turbo")
            return canvas.picture()

    alone = [draw(0), draw(1)]
    with keep_windows():
        in_one = [draw(0), draw(1), draw(0)]
        with open_canvas(projections[0], 2) as canvas:
            assert canvas.picture().min() == 255
    assert not np.array_equal(*alone)
    for picture, expected in zip(in_one, [*alone, alone[0]], strict=True):
        assert np.array_equal(picture, expected)
