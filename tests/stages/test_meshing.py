"""Meshes of ready shapes."""

import pytest

from fmd import Pipeline, load_scene
from fmd.core.cache import Cache


@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_a_tiny_bar_and_a_huge_one_are_meshed(scale: float) -> None:
    size = {"length": 100 * scale, "depth": 10 * scale, "width": 2 * scale}
    keys = [f"body.beam.{name}={value} m" for name, value in size.items()]
    mesh = Pipeline(load_scene("beam-paper", [*keys, "body.beam.mesh.divisions=[10,2,1]"]), Cache(None)).mesh
    assert mesh.volume == pytest.approx(2000 * scale**3, rel=1e-12)
    assert len(mesh.faces["x+"]) == 6
