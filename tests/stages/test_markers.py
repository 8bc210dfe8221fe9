"""Markers and supports of a scene on the mesh of a body."""

import numpy as np
import pytest

from fmd import load_scene
from fmd.core.cache import Cache
from fmd.core.errors import InputError
from fmd.stages.part import FlexiblePart
from fmd.stages.store import StageStore

SMALL = "body.beam.mesh.divisions=[6, 2, 1]"


def beam(*overrides: str) -> FlexiblePart:
    return FlexiblePart(load_scene("beam-paper", [SMALL, *overrides]), "beam", StageStore(Cache(None)))


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


@pytest.mark.parametrize(
    ("where", "place"),
    [
        ('at=["0.2 m", "3 mm", "-1 mm"]', [0.2, 0.003, -0.001]),
        ('node=["0.168 m", "1 mm", "4 mm"]', [0.17, 0.0, 0.005]),
        ('edge=[["340 mm", "-12.5 mm", "5 mm"], ["340 mm", "12.5 mm", "5 mm"]]', [0.34, 0.0, 0.005]),
        ('edge=["y-", "z+"]', [0.17, -0.0125, 0.005]),
    ],
)
def test_markers_at_points_nodes_and_edges_lie_where_the_scene_says(where: str, place: list[float]):
    marker = beam(f"body.beam.marker.own={{{where}}}").markers["own"]
    assert marker.position == pytest.approx(place, abs=1e-9)


def test_a_marker_in_the_middle_of_the_tip_moves_as_the_tips_face():
    part = beam('body.beam.marker.middle={at=["340 mm", "0 m", "0 m"]}', 'body.beam.marker.side={edge=["x+", "z+"]}')
    tip, middle, side = (part.body.markers[name] for name in ("tip", "middle", "side"))
    across, about = tip.translation[1], tip.rotation[2]
    for other in (middle, side):
        assert other.translation[1] == pytest.approx(across, rel=0.02, abs=0.005 * np.abs(across).max())
        assert other.rotation[2, :2] == pytest.approx(about[:2], rel=0.02)  # whose waves are long beside an element


@pytest.mark.parametrize(
    ("where", "message"),
    [
        (
            'at=["0.4 m", "0 m", "0 m"]',
            r"marker.own = .*: lies outside the body; the node nearest to it is at \[0.34 m",
        ),
        ('edge=["y-", "y+"]', r"marker.own = .*: the faces have no node in common"),
        ('edge=["y-", "z"]', r"marker.own.edge = .*: no such face; did you mean 'z-'"),
        ('edge=["y-"]', r"marker.own.edge = \['y-'\]: must be two different points, or the names of two faces"),
        ('edge=[["0 m", "0 m", "0 m"], ["1 m", "0 m", 0]]', r"marker.own.edge.*: needs a unit"),
        ('edge=[["0 m", "9 m", "0 m"], ["1 m", "9 m", "0 m"]]', r"marker.own = .*: no node of the mesh lies there"),
        ('at=["0.3 m", "0 m", "0 m"], face="x-"', r"marker.own.at = .*: can't stand beside face: a marker's place"),
        (
            'node=["0.3 m", "0 m", "0 m"], attachment="rigid"',
            r"attachment = 'rigid': needs a face; a marker at a point",
        ),
    ],
)
def test_markers_that_lie_nowhere_are_refused(where: str, message: str):
    with pytest.raises(InputError, match=message):
        beam(f"body.beam.marker.own={{{where}}}").markers  # noqa: B018


@pytest.mark.parametrize(("attachment", "rtol"), [(None, 0.03), ("averaged", 0.3)])
def test_a_broad_clamped_face_is_a_real_clamp_by_default(attachment: str | None, rtol: float) -> None:
    """Square cantilever plates have 3.494, 8.547 and 21.44 √(D/ρh)/a² (Leissa, J Sound Vib 31, 1973, ν = 0.3)."""
    a, h, E, rho = 0.3, 0.004, 70e9, 2700.0
    root = {"face": "x-"} | ({"attachment": attachment} if attachment else {})
    part = clamped_part([f"{a} m", f"{h} m", f"{a} m"], [8, 1, 8], root)
    exact = np.array([3.494, 8.547, 21.44]) * np.sqrt(E * h**2 / (12 * (1 - 0.3**2) * rho)) / a**2 / (2 * np.pi)
    errors = np.abs(part.modes.frequencies_hz[:3] / exact - 1)
    assert errors.max() < rtol
    assert part.markers["root"].rigid == (attachment is None)
    assert (errors[1] > 0.2) == (attachment is not None)  # averaged, the root's edge bends as the plate twists


def test_the_end_of_a_slender_bar_that_is_clamped_stays_averaged() -> None:
    part = clamped_part(["0.4 m", "0.01 m", "0.02 m"], [10, 1, 1], {"face": "x-"})
    assert not part.markers["root"].rigid
    beam = 1.8751**2 * np.sqrt(70e9 * 0.01**2 / 12 / 2700.0) / 0.4**2 / (2 * np.pi)
    assert part.modes.frequencies_hz[0] == pytest.approx(beam, rel=5e-3)


def clamped_part(sizes: list[str], divisions: list[int], root: dict[str, str]) -> FlexiblePart:
    bar = {"shape": "bar", "E": "70 GPa", "nu": 0.3, "rho": "2700 kg/m^3", "mesh": {"order": 2, "divisions": divisions}}
    bar |= dict(zip(("length", "depth", "width"), sizes, strict=True))
    bar |= {"modes": {"count": 3, "boundary": "joint"}, "marker": {"root": root, "tip": {"face": "x+"}}}
    joint = {"clamp": {"type": "fixed", "parent": "ground", "child": "bar.root"}}
    times = {"duration": "1 ms", "output_step": "1 ms", "tip": "bar.tip", "run": [{"integrator": "auto"}]}
    scene = load_scene({"title": "clamp", "body": {"bar": bar}, "joint": joint, "simulation": times})
    return FlexiblePart(scene, "bar", StageStore(Cache(None)))
