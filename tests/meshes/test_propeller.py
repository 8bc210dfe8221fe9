"""The propeller's mesh: its counts, its symmetry, its shape and its faces."""

from math import pi, radians
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from fmd.fem.mesh import SolidMesh
from fmd.meshes.propeller import mesh as mesh_propeller
from fmd.scene.propeller import Propeller

PAPER = Propeller(
    shape="propeller",
    blades=6,
    bore=0.08,
    hub=0.15,
    root=0.26,
    diameter=0.9,
    length=0.11,
    chord=(0.095, 0.115, 0.1, 0.055),
    thickness=(0.034, 0.02, 0.009),
    pitch=(radians(62), radians(42), radians(30)),
    camber=0.03,
    edge=0.3,
    E=70e9,
    nu=0.3,
    rho=2780.0,
    modes={"count": 1},
    mesh={"order": 1, "sleeve": (66, 10, 3), "joint": (10, 8, 12), "blade": (10, 8, 27), "growth": 4.0},
)


def divided(table: Propeller, **counts: Any) -> Propeller:
    """Return a propeller of other numbers of elements, or of other elements."""
    return table.model_copy(update={"mesh": table.mesh.model_copy(update=counts)})


COARSE = divided(PAPER, sleeve=(30, 4, 2), joint=(4, 3, 4), blade=(4, 3, 6), growth=2.0)


@pytest.fixture(scope="module")
def coarse() -> SolidMesh:
    return SolidMesh(*mesh_propeller(COARSE))


def turn(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def test_the_papers_counts_give_its_20_700_elements() -> None:
    mesh = SolidMesh(*mesh_propeller(PAPER))
    # Miao et al. (2008), section 3.3
    assert {name: len(cells) for name, cells in mesh.parts.items()} == {"sleeve": 1980, "joints": 5760, "blades": 12960}
    # sleeve 66 · 11 · 4, joints and blades 6 · 99 points on each of 12 and 27 further levels
    assert len(mesh.points) == 66 * 11 * 4 + 6 * 99 * (12 + 27)
    assert mesh.quality.min() >= 0.3
    assert mesh.sectors == 6
    assert np.hypot(*mesh.points[:, :2].T).max() == pytest.approx(0.45, rel=1e-9)


def test_every_point_belongs_to_a_cell_and_neighbours_share_theirs(coarse: SolidMesh) -> None:
    assert np.array_equal(np.unique(coarse.cells), np.arange(len(coarse.points)))
    assert len(np.unique(coarse.points.round(9), axis=0)) == len(coarse.points)


@pytest.mark.parametrize("blades", [2, 3, 5, 6, 11])
def test_a_turn_carries_the_mesh_into_itself(blades: int) -> None:
    table = divided(COARSE.model_copy(update={"blades": blades}), sleeve=(5 * blades, 4, 2))
    mesh = SolidMesh(*mesh_propeller(table))
    turned = mesh.points @ turn(2 * pi / blades).T
    assert cKDTree(mesh.points).query(turned)[0].max() < 1e-15
    # each part's cells come sector by sector
    for cells in mesh.parts.values():
        first, second, *_ = np.split(mesh.points[mesh.cells[cells]].mean(axis=1), blades)
        assert first @ turn(2 * pi / blades).T == pytest.approx(second, abs=1e-12)


def test_a_sleeve_alone_has_the_volume_of_a_ring_of_flat_sides() -> None:
    mesh = SolidMesh(*mesh_propeller(PAPER))
    cells = mesh.cells[mesh.parts["sleeve"]]
    sleeve = SolidMesh(mesh.points, cells, mesh.cell_type, {}, {})
    # a prism over a ring between two regular polygons of 66 corners
    polygon = 0.5 * 66 * np.sin(2 * pi / 66)
    assert sleeve.volume == pytest.approx(polygon * (0.075**2 - 0.04**2) * 0.11, rel=1e-9)


def test_straight_blades_have_their_chord_and_thickness() -> None:
    """No twist, no camber, square edges: away from the joint the blade is a slab of chord × thickness."""
    straight = {"chord": (0.08,), "thickness": (0.012,), "pitch": (pi / 2,), "camber": 0.0, "edge": 1.0}
    mesh = SolidMesh(*mesh_propeller(COARSE.model_copy(update=straight)))
    outer = mesh.points[mesh.faces["tip-1"]]
    assert np.ptp(outer[:, 2]) == pytest.approx(0.08, rel=1e-9)
    # the thickness is measured on the cylinder of the radius
    assert 0.45 * np.ptp(np.arctan2(outer[:, 1], outer[:, 0])) == pytest.approx(0.012, rel=1e-9)


def test_the_pitch_turns_the_chord_against_the_plane_of_rotation() -> None:
    pitched = {"chord": (0.08,), "thickness": (0.004,), "pitch": (radians(30),), "camber": 0.0, "edge": 1.0}
    mesh = SolidMesh(*mesh_propeller(COARSE.model_copy(update=pitched)))
    tip = mesh.points[mesh.faces["tip-1"]]
    y, z = 0.45 * np.arctan2(tip[:, 1], tip[:, 0]), tip[:, 2]
    direction = np.linalg.svd(np.column_stack([y, z]))[2][0]
    # half a degree: the thickness turns the axis of the section a little
    assert abs(np.degrees(np.arctan2(direction[1], direction[0])) % 180 - 30) < 0.5


def test_faces_are_where_their_names_say(coarse: SolidMesh) -> None:
    radius = np.hypot(*coarse.points[:, :2].T)
    assert radius[coarse.faces["bore"]] == pytest.approx(0.04, rel=1e-9)
    assert coarse.points[coarse.faces["back"], 2] == pytest.approx(-0.055)
    assert coarse.points[coarse.faces["front"], 2] == pytest.approx(0.055)
    assert radius[coarse.faces["tip-4"]] == pytest.approx(0.45, rel=1e-9)
    # the fourth of six blades is opposite to the first; camber shifts its tip by a little
    x, y, _ = coarse.points[coarse.faces["tip-4"]].mean(axis=0)
    assert np.degrees(np.arctan2(y, -x)) == pytest.approx(0.0, abs=2)
    # a blade that screws along z as it turns about it pushes the medium back with its lower side
    pressure, suction = (coarse.points[coarse.faces[f"{side}-1"]] for side in ("pressure", "suction"))
    assert pressure[:, 2].mean() < suction[:, 2].mean() - 0.003
