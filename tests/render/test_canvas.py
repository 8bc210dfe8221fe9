"""Canvases: which lines are drawn, and how the picture is reduced from the window."""

import pytest

from pipeline.render.canvas import choose_outline
from pipeline.render.projection import fit_projection, oblique_axes
from pipeline.render.surface import Surface


def test_lines_that_would_smear_a_picture_are_left_out(block: Surface) -> None:
    assert block.outline_spacing == pytest.approx(0.0235, rel=0.1)  # 20 mm × 25 mm × 26.7 mm
    opacities = []
    for pixels in (4000, 400, 100, 40):
        axes = next(oblique_axes(block.points))
        outline = choose_outline(block, fit_projection(axes, block.points, (pixels, pixels)))
        opacities.append(outline.opacity)
        assert outline.elements == (pixels >= 100)
    assert opacities[0] == opacities[1] > opacities[2]
