"""Markers and supports of a scene on the mesh of a body."""

import numpy as np
import pytest

from pipeline import load_scene
from pipeline.core.cache import Cache
from pipeline.core.errors import InputError
from pipeline.stages.part import FlexiblePart
from pipeline.stages.store import StageStore

SMALL = "body.beam.mesh.divisions=[6, 2, 1]"


def beam(*overrides: str) -> FlexiblePart:
    return FlexiblePart(load_scene("beam", [SMALL, *overrides]), "beam", StageStore(Cache(None)))


def test_a_marker_on_a_face_lies_in_the_faces_middle():
    markers = beam().markers
    assert markers["tip"].position == pytest.approx([0.34, 0.0, 0.0], abs=1e-12)
    assert np.ptp(beam().space.x[markers["tip"].nodes], axis=0) == pytest.approx([0.0, 0.025, 0.01], abs=1e-12)


def test_a_marker_in_a_plane_is_the_one_on_the_face_there():
    face, plane = beam().markers["tip"], beam('body.beam.marker.tip={plane="x = 340 mm"}').markers["tip"]
    assert np.array_equal(np.sort(plane.nodes), np.sort(face.nodes))


def test_a_plane_that_misses_the_body_is_refused_by_name():
    with pytest.raises(InputError, match=r"body\.beam\.marker\.tip = .*"):
        beam('body.beam.marker.tip={plane="x = 400 mm"}').markers  # noqa: B018


def test_supports_hold_the_unknowns_of_their_nodes_along_their_axes():
    held = beam('body.beam.support=[{face="x-", fixed=["x", "z"]}]', "body.beam.modes.boundary='free'")
    nodes = np.flatnonzero(np.abs(held.space.x[:, 0]) < 1e-12)
    assert held.fixed is not None
    assert np.array_equal(held.fixed, np.sort(np.r_[3 * nodes, 3 * nodes + 2]))
    assert beam().fixed is None
