"""Rigid bodies that touch with triangles of a file: flexibility against closed forms, shocks against Hertz."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import Delaunay

from fmd import Pipeline, load_scene
from fmd.contact.triangle_field import points_of_triangles, surface_flexibility
from fmd.core.arrays import Array, IntArray
from fmd.core.errors import InputError
from fmd.output.contacts import contact_figures, contact_warnings
from tests.contact.test_contact_points import BLOCK
from tests.contact.test_rigid_contacts import MASS, NU, RADIUS, SPEED, STEEL, STIFF, E, free, scene

SHEAR = E / (2.0 * (1.0 + NU))


def grid(half: float, n: int) -> tuple[Array, IntArray]:
    """Even places (n², 2) on a square of sides 2 half, and triangles between them, counter-clockwise."""
    side = np.linspace(-half, half, n)
    x = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    k = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    return x, np.concatenate([np.stack(own, axis=1) for own in ((k, k + n, k + n + 1), (k, k + n + 1, k + 1))])


def disk(radius: float, n: int) -> tuple[Array, IntArray]:
    """Places on n rings of a disk, 6 more on each, and triangles between them."""
    rings = [np.zeros((1, 2))]
    for k in range(1, n + 1):
        turn = 2.0 * np.pi * (np.arange(6 * k) + 0.5 * (k % 2)) / (6 * k)
        rings.append(radius * k / n * np.stack([np.cos(turn), np.sin(turn)], axis=1))
    x = np.concatenate(rings)
    triangles = Delaunay(x).simplices.astype(np.int64)
    a, b, c = x[triangles].transpose(1, 0, 2)
    turned = np.linalg.det(np.stack([b - a, c - a], axis=1)) < 0.0
    triangles[turned] = triangles[turned][:, ::-1]
    return x, triangles


def write_stl(path: Path, x: Array, triangles: IntArray) -> None:
    """Write a text file in millimetres of places [m]."""
    facets = ["facet normal 0 0 0\nouter loop"]
    lines = ["solid part"]
    for own in 1e3 * x[triangles]:
        lines += [*facets, *(f"vertex {a:.12g} {b:.12g} {c:.12g}" for a, b, c in own), "endloop\nendfacet"]
    path.write_text("\n".join([*lines, "endsolid part\n"]))


@pytest.mark.parametrize("shape", ["disk", "square"])
def test_a_flat_punch_is_as_stiff_as_closed_forms_say(shape: str) -> None:
    """Disk ``2 E* a``, aside ``8 G a/(2 − ν)`` (Johnson, 3.4, 7.3); square ``1.1523 E* L`` (capacity 0.36679 L)."""
    flat, triangles = disk(1e-3, 11) if shape == "disk" else grid(1e-3, 20)
    points = points_of_triangles("skin", np.pad(flat, ((0, 0), (0, 1))), triangles, E, NU)
    n = len(flat)
    inverse = np.linalg.inv(points.G.reshape(3 * n, 3 * n)).reshape(n, 3, n, 3).sum(axis=(0, 2))
    exact = 2.0 * STIFF * 1e-3 if shape == "disk" else 1.1523 * STIFF * 2e-3
    assert inverse[2, 2] == pytest.approx(exact, rel=0.03)
    if shape == "disk":
        assert inverse[0, 0] == pytest.approx(8.0 * SHEAR * 1e-3 / (2.0 - NU), rel=0.03)


def test_flexibility_turns_with_its_places() -> None:
    rng = np.random.default_rng(0)
    x, areas, normals = rng.standard_normal((20, 3)), rng.uniform(0.001, 0.002, 20), rng.standard_normal((20, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    R = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    turned = np.einsum("ab,ibjc,dc->iajd", R, surface_flexibility(x, areas, normals, E, NU), R)
    np.testing.assert_allclose(surface_flexibility(x @ R.T, areas, normals @ R.T, E, NU), turned, rtol=1e-9, atol=1e-18)


def cap(path: Path, reach: float, n: int) -> None:
    """Write the pole of a ball of `RADIUS`, up to a reach beside its axis, which points along z."""
    flat, triangles = disk(reach, n)
    height = np.sqrt(RADIUS**2 - (flat**2).sum(axis=1))
    write_stl(path, np.column_stack([flat, height]), triangles)


def body(file: Path, turn: float = 0.0) -> dict[str, Any]:
    surface = {"type": "file", "file": str(file), **STEEL, "rotation": [turn, 0, 0]}
    own = {"shape": "rigid", "mass": MASS, "inertia": [0.4 * MASS * RADIUS**2] * 3}
    return own | {"marker": {"centre": {"at": [0, 0, 0]}}, "surface": {"skin": surface}}


def test_triangles_that_do_not_turn_around_the_outside_are_refused() -> None:
    """Bodies would pass through them from outside; a sheet may face either way."""
    x = np.vstack([np.zeros(3), 1e-3 * np.eye(3)])
    around = np.array([[0, 2, 1], [0, 3, 2], [0, 1, 3], [1, 2, 3]])
    for fine in (around, around[:3], around[:3, ::-1]):
        assert points_of_triangles("skin", x, fine, E, NU).areas["skin"].min() > 0.0
    with pytest.raises(ValueError, match="is inside out"):
        points_of_triangles("skin", x, around[:, ::-1], E, NU)
    for lost in range(4):
        mixed = around.copy()
        mixed[lost] = mixed[lost, ::-1]
        with pytest.raises(ValueError, match="neighbouring triangles that turn unlike ways"):
            points_of_triangles("skin", x, mixed, E, NU)


def test_two_balls_of_triangles_strike_as_hertz_says(tmp_path: Path) -> None:
    """Approach of two balls ``(15 m* v²/(16 E* √R*))^0.4`` with ``m* = m/2``, ``R* = R/2``; both give way."""
    cap(tmp_path / "fine.stl", 2e-4, 7)
    cap(tmp_path / "coarse.stl", 2.2e-4, 6)
    bodies = {"low": body(tmp_path / "coarse.stl"), "high": body(tmp_path / "fine.stl", np.pi)}
    apart = RADIUS + 1e-7
    joints = {
        "one": free("low.centre", [0, 0, -apart], [0, 0, SPEED]),
        "two": free("high.centre", [0, 0, apart], [0, 0, -SPEED]),
    }
    table = scene(bodies, joints, {"hit": {"between": ["low.skin", "high.skin"]}}, 1.2e-4)
    run = Pipeline(load_scene(table))
    hit = contact_figures(run)["contacts"]["hit"]
    stiff, radius, mass, speed = 0.5 * STIFF, 0.5 * RADIUS, 0.5 * MASS, 2.0 * SPEED
    approach = (15.0 / 16.0 * mass * speed**2 / (stiff * np.sqrt(radius))) ** 0.4
    force = 4.0 / 3.0 * stiff * np.sqrt(radius) * approach**1.5
    assert hit["largest_force_n"] == pytest.approx(force, rel=0.02)
    assert hit["largest_pressure_pa"] == pytest.approx(1.5 * force / (np.pi * radius * approach), rel=0.03)
    assert hit["end_s"] - hit["begin_s"] == pytest.approx(2.9432 * approach / speed, rel=0.08)  # in whole steps
    assert hit["impulse_n_s"][2] == pytest.approx(2.0 * MASS * SPEED, rel=1e-3)


def box(path: Path, height: float = 0.01) -> None:
    """Write a box of sides of 20 mm, and twice a height."""
    flat, triangles = grid(0.01, 6)
    faces, corners = list[Array](), list[IntArray]()
    for axis in range(3):
        for side in (1.0, -1.0):
            x = np.insert(flat, 2, 0.01 * side, axis=1)[:, [(2 - axis) % 3, (3 - axis) % 3, (4 - axis) % 3]]
            corners.append((triangles if side > 0.0 else triangles[:, ::-1]) + len(flat) * len(faces))
            faces.append(x * [1.0, 1.0, height / 0.01])
    write_stl(path, np.concatenate(faces), np.concatenate(corners))


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_a_box_of_triangles_that_is_dropped_keeps_its_energy(tmp_path: Path, tilt: float) -> None:
    box(tmp_path / "box.stl")
    joint = free("box.centre", [0, 0, 0.02], [0, 0, -0.5]) | {"rotate": [tilt, 0.5 * tilt, 0]}
    floor = {"between": ["ground", "box.skin"], "normal": [0, 0, 1]}
    run = Pipeline(load_scene(scene({"box": body(tmp_path / "box.stl")}, {"free": joint}, {"floor": floor}, 0.03)))
    own, kinetic = run.motion.contacts["floor"], run.motion.energies[0]
    assert own.largest[0] > 0.0
    assert kinetic[-1] == pytest.approx(kinetic[0], rel=0.01)
    if tilt == 0.0:
        assert own.impulse[-1, 2] == pytest.approx(MASS * 1.0, rel=0.01)
        assert own.largest[1] == pytest.approx(4e-4, rel=0.02)


@pytest.mark.parametrize("turn", [1, -1])
def test_a_sheet_that_looks_the_wrong_way_is_warned_of(tmp_path: Path, turn: int) -> None:
    """What comes from its back passes through it; the sign of a gap alone doesn't tell."""
    flat, triangles = disk(2e-4, 3)
    write_stl(tmp_path / "low.stl", np.pad(flat, ((0, 0), (0, 1))), triangles[:, ::turn])
    cap(tmp_path / "high.stl", 2e-4, 4)
    bodies = {"low": body(tmp_path / "low.stl"), "high": body(tmp_path / "high.stl", np.pi)}
    joints = {"one": free("low.centre", [0, 0, 0], [0, 0, 0]), "two": free("high.centre", [0, 0, 0.0101], [0, 0, 0])}
    run = Pipeline(load_scene(scene(bodies, joints, {"hit": {"between": ["low.skin", "high.skin"]}}, 1e-6)))
    said = [own["text"] for own in contact_warnings(run) if own["code"] == "contact-facing"]
    assert ["look the same way where they are nearest" in text for text in said] == [True] * (turn < 0)


def test_flat_boxes_beside_each_other_are_not_warned_of(tmp_path: Path) -> None:
    """Mean normals at their nearest edges are alike."""
    box(tmp_path / "box.stl", 0.004)
    bodies = {"left": body(tmp_path / "box.stl"), "right": body(tmp_path / "box.stl")}
    joints = {f"to_{name}": free(f"{name}.centre", [0.0205 * k, 0, 0], [0, 0, 0]) for k, name in enumerate(bodies)}
    run = Pipeline(load_scene(scene(bodies, joints, {"hit": {"between": ["left.skin", "right.skin"]}}, 1e-6)))
    assert not [own for own in contact_warnings(run) if own["code"] == "contact-facing"]


@pytest.mark.parametrize(
    ("contact", "fault"),
    [
        ({"between": ["ground", "one.skin"], "normal": [0, 0, 1], "restitution": 0.5}, "round rigid surfaces alone"),
        ({"between": ["one.skin", "two.round"]}, "is of triangles, which touch planes, one another"),
        ({"between": ["one.fine", "two.skin"]}, "of which contacts take 1000"),
        ({"between": ["one.torn", "two.skin"]}, "corners far nearer to one another"),
    ],
)
def test_surfaces_of_triangles_that_cant_be_followed_are_refused(
    tmp_path: Path, contact: dict[str, Any], fault: str
) -> None:
    cap(tmp_path / "cap.stl", 2e-4, 3)
    cap(tmp_path / "fine.stl", 2e-4, 19)
    x, triangles = grid(1e-3, 4)
    x[5] = x[6] + 1e-9
    write_stl(tmp_path / "torn.stl", np.pad(x, ((0, 0), (0, 1))), triangles)
    bodies = {"one": body(tmp_path / "cap.stl"), "two": body(tmp_path / "cap.stl", np.pi)}
    for name in ("fine", "torn"):
        bodies["one"]["surface"][name] = bodies["one"]["surface"]["skin"] | {"file": str(tmp_path / f"{name}.stl")}
    bodies["two"]["surface"]["round"] = {"type": "ball", "radius": RADIUS, **STEEL}
    joints = {"one": free("one.centre", [0, 0, 0], [0, 0, 0]), "two": free("two.centre", [0, 0, 0.03], [0, 0, 0])}
    with pytest.raises(InputError, match=fault):
        _ = Pipeline(load_scene(scene(bodies, joints, {"hit": contact}, 1e-4))).mechanism


def test_a_flexible_block_falls_on_stiff_triangles_as_on_the_ground(tmp_path: Path) -> None:
    flat, triangles = grid(0.15, 4)
    write_stl(tmp_path / "floor.stl", np.pad(flat, ((0, 0), (0, 1))), triangles)
    surface = {"type": "file", "file": str(tmp_path / "floor.stl"), "E": "1e18 Pa", "nu": 0.3}
    floor = {"shape": "rigid", "mass": 1.0, "inertia": [1.0] * 3, "marker": {"middle": {"at": [0, 0, 0]}}}
    floor |= {"surface": {"top": surface | {"rotation": ["-90 deg", "0 deg", "0 deg"]}}}
    held = {"type": "fixed", "parent": "ground", "child": "floor.middle"}
    joints = {"free": BLOCK["joint"]["free"] | {"position": ["0 m", "50.1 mm", "0 m"]}}
    short = {"simulation": BLOCK["simulation"] | {"duration": "6 ms", "output_step": "0.2 ms"}}
    table = BLOCK | {"body": BLOCK["body"] | {"floor": floor}, "joint": joints | {"held": held}} | short
    on_plane = Pipeline(load_scene(BLOCK | short | {"joint": joints})).motion.contacts["floor"]
    between = {"floor": {"between": ["floor.top", "block.bottom"]}}
    on_triangles = Pipeline(load_scene(table | {"contact": between})).motion.contacts["floor"]
    assert on_plane.impulse[-1, 1] > 0.0
    assert on_triangles.impulse[-1, 1] == pytest.approx(on_plane.impulse[-1, 1], rel=0.01)
    assert on_triangles.largest[0] == pytest.approx(on_plane.largest[0], rel=0.05)
