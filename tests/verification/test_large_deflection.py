"""Solids in pieces against the elastica, a closed circle, and rods that bend and twist far."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipeinc, ellipkinc

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.dynamics.kinematics import Kinematics
from tests.verification.bathe_bend import END, SONNEVILLE, bend
from tests.verification.rods import bend_rod, torsion_of_rectangle

STRIP = """
title = "Strip"
[body.strip]
shape = "bar"
length = "LENGTH m"
depth = "DEPTH m"
width = "WIDTH m"
E = "MODULUS Pa"
nu = POISSON
rho = "2700 kg/m^3"
mesh = { divisions = [ALONG, 1, 1] }
modes = { count = 1, enrich = "none" }
marker = { root = { face = "x-" }, tip = { face = "x+" } }
pieces = PIECES

[joint.clamp]
type = "fixed"
parent = "ground"
child = "strip.root"

[drive.load]
type = "point KIND"
marker = "strip.tip"
direction = DIRECTION
KIND = "LOAD"

[simulation]
duration = "1 ms"
output_step = "1 ms"
start = "equilibrium"
tip = "strip.tip"
stiffening = "STIFFENING"
run = [{ integrator = "auto" }]
"""
# 1 m long, E I = 1 N m² about y
USUAL = {"LENGTH": 1, "DEPTH": 0.02, "WIDTH": 0.006, "MODULUS": 12 / (0.02 * 0.006**3), "POISSON": 0.0, "ALONG": 32}
FORCE = {"KIND": "force", "DIRECTION": [0, 0, 1], "STIFFENING": "auto"}
MOMENT = {"KIND": "torque", "DIRECTION": [0, -1, 0], "STIFFENING": "auto"}


def strip(folder: Path, **values: Any) -> Pipeline:
    text = STRIP
    for key, value in (USUAL | values).items():
        text = text.replace(key, str(value))
    (folder / "strip.toml").write_text(text)
    return Pipeline(load_scene(folder / "strip.toml"))


def end_of(run: Pipeline) -> Array:
    """Return the place of the tip at rest under the loads of the start, shape (3,)."""
    body, _, marker = run.scene.simulation.tip.partition(".")
    rest = Kinematics(run.mechanism, np.zeros(1), run.start[0][None], run.start[1][None])
    return rest.marker_position(run.mechanism.number_of(body), marker)[0]


def elastica(load: float) -> Array:
    """Return the end (x, z) of a cantilever of unit length under a dead load P L²/EI, by elliptic integrals."""

    def integral(function: Any, k: float) -> float:
        return float(function(np.pi / 2, k * k) - function(np.arcsin(np.sqrt(0.5) / k), k * k))

    k = brentq(lambda k: integral(ellipkinc, k) - np.sqrt(load), np.sqrt(0.5) * (1 + 1e-14), 1 - 1e-12, xtol=1e-15)
    return np.array([np.sqrt(2 * (2 * k * k - 1) / load), 1 - 2 * integral(ellipeinc, k) / np.sqrt(load)])


@pytest.mark.long  # four pieces do, below, and six roll up to a circle
def test_six_pieces_follow_the_elastica_to_an_end_that_hangs_down(tmp_path: Path) -> None:
    end, exact = end_of(strip(tmp_path, PIECES=6, LOAD="10 N", **FORCE)), elastica(10)
    assert np.linalg.norm(end[[0, 2]] - exact) < 6e-3 * np.linalg.norm(exact - [1, 0])


def test_the_error_falls_with_the_square_of_the_pieces_and_faster_with_second_order(tmp_path: Path) -> None:
    exact = elastica(2)
    slopes = {}
    for stiffening in ("off", "on"):
        errors = [
            np.linalg.norm(
                end_of(strip(tmp_path, PIECES=n, LOAD="2 N", **FORCE | {"STIFFENING": stiffening}))[[0, 2]] - exact
            )
            for n in (2, 4)
        ]
        slopes[stiffening] = np.log2(errors[0] / errors[1])
    assert slopes["off"] == pytest.approx(2.0, abs=0.15)
    assert slopes["on"] > 2.8


def test_a_moment_rolls_a_strip_up_to_a_closed_circle(tmp_path: Path) -> None:
    end = end_of(strip(tmp_path, PIECES=6, LOAD=f"{2 * np.pi!r} N m", **MOMENT))
    assert np.linalg.norm(end) < 1e-3  # of the length: the start of the circle


def test_the_princeton_beam_bends_and_twists_as_a_rod(tmp_path: Path) -> None:
    """Dowell & Traybar's beam under 8.896 N: data as in Exudyn's and MBDyn's tests of it."""
    depth, width, E, nu, length = 12.3777e-3, 3.2024e-3, 71.7e9, 0.31, 0.508
    G, load = E / (2 * (1 + nu)), 8.896 * np.array([0, np.sqrt(0.5), np.sqrt(0.5)])
    sizes = {"LENGTH": length, "DEPTH": depth, "WIDTH": width, "MODULUS": E, "POISSON": nu, "ALONG": 48}
    run = strip(tmp_path, PIECES=4, LOAD="8.896 N", **sizes, **FORCE | {"DIRECTION": load.tolist()})
    bending = G * torsion_of_rectangle(depth, width), E * depth * width**3 / 12, E * width * depth**3 / 12
    A = depth * width
    exact = bend_rod(length, bending, (E * A, G * A * 5 / 6, G * A * 5 / 6), load)
    assert np.linalg.norm(end_of(run) - exact) < 5e-3 * np.linalg.norm(exact - [length, 0, 0])


@pytest.mark.long  # the Princeton beam bends and twists, too
def test_bathes_bend_moves_as_published_in_all_three_directions(tmp_path: Path) -> None:
    moved = end_of(bend(tmp_path, pieces=6, along=24)) - END
    assert moved == pytest.approx(SONNEVILLE, rel=0.01)


def test_equal_pieces_are_reduced_once(tmp_path: Path) -> None:
    run = strip(tmp_path, PIECES=16, LOAD="1 N", **FORCE)
    parts = list(run.parts.values())
    assert len(parts) == 16
    assert len({id(part.results) for part in parts}) == 3  # the first, the last, and those between
    _ = run.bodies
    assert parts[7].body is parts[8].body
    assert sum(run.bodies[part.name].integrals.mass for part in parts) == pytest.approx(run.part.mass, rel=1e-9)


def test_a_part_in_pieces_is_one_part_in_its_results(tmp_path: Path) -> None:
    """Under a small load stress and displacement are those of the part in one piece."""
    small = FORCE | {"LOAD": "1e-3 N", "ALONG": 18}
    whole = strip(tmp_path, PIECES=1, **small)
    one = whole.variant(load_scene(tmp_path / "strip.toml", ["body.strip.modes.boundary=interface"]))
    divided = strip(tmp_path, PIECES=3, **small)
    assert len(one.stress_of("strip").nodes) == len(divided.stress_of("strip").nodes)
    nodes = one.wholes["strip"].surface.nodes
    u, v = (run.deform("strip", [0], nodes)[0] for run in (one, divided))
    assert u == pytest.approx(v, abs=2e-4 * np.abs(u).max())
    s, t = (run.stress_of("strip").measure_at(np.array([0]))[0] for run in (one, divided))
    assert s == pytest.approx(t, abs=0.02 * s.max())
    assert divided.motion.tip_deflection[0] == pytest.approx(one.motion.tip_deflection[0], rel=1e-3, abs=1e-9)
    names = divided.division.divided["strip"].frequencies_hz
    assert names[0] == pytest.approx(22.3733 / (2 * np.pi) * np.sqrt(1 / (2700 * 0.02 * 0.006)), rel=2e-3)  # free–free


def test_energy_and_momenta_of_a_thrown_strip_stay(tmp_path: Path) -> None:
    strip(tmp_path, PIECES=2, ALONG=8, LOAD="0 N", **FORCE)
    overrides = [
        'joint.clamp={ type = "free", parent = "ground", child = "strip.root" }',
        'drive.load.force={ times = ["0 s", "20 ms", "21 ms"], values = [30, 30, 0], unit = "N", beyond = "zero" }',
        "simulation.start=undeformed",
        "simulation.duration=60 ms",
        'simulation.run=[{ integrator = "runge-kutta", tolerance = 1e-9 }]',
    ]
    run = Pipeline(load_scene(tmp_path / "strip.toml", overrides))
    motion, free = run.motion, run.motion.times > 0.0215
    energy = sum(motion.energies)[free]
    assert np.ptp(energy) < 1e-7 * energy[0]
    for values in (motion.kinematics.momentum[free], motion.kinematics.angular_momentum[free]):
        assert np.abs(values - values[0]).max() < 1e-7 * np.linalg.norm(values[0])
    assert max(deformation.rotation for deformation in run.deformations.values()) > 0.1


def test_pieces_of_half_a_width_are_as_flexible_as_the_bar_in_one_piece(tmp_path: Path) -> None:
    """A force at a corner bends, shears and twists; averaged sections would add 8 % to the torsion."""
    short = {"LENGTH": 0.04, "DEPTH": 0.02, "WIDTH": 0.02, "MODULUS": 70e9, "POISSON": 0.33, "ALONG": 4}
    short |= FORCE | {"1, 1]": "2, 2]", "LOAD": "0.1 N", "STIFFENING": "off"}
    short['"strip.tip"\ndirection'] = '"strip.corner"\ndirection'
    short["tip = { face"] = 'corner = { at = ["40 mm", "10 mm", "10 mm"] }, tip = { face'
    moved = []
    for pieces in (1, 4):
        run = strip(tmp_path, PIECES=pieces, **short)
        if pieces == 1:
            run = run.variant(load_scene(tmp_path / "strip.toml", ["body.strip.modes.boundary=interface"]))
        rest = Kinematics(run.mechanism, np.zeros(1), run.start[0][None], run.start[1][None])
        moved.append(rest.marker_position(run.mechanism.number_of("strip"), "corner")[0] - [0.04, 0.01, 0.01])
    assert np.linalg.norm(moved[1] - moved[0]) < 1e-4 * np.linalg.norm(moved[0])


def test_a_family_of_modes_bends_a_strip_in_pieces_as_all_modes_do(tmp_path: Path) -> None:
    ends, sizes = [], []
    for family in ("any", "out-of-plane bending"):
        chosen = FORCE | {"count = 1": f'count = 1, family = "{family}"'}
        run = strip(tmp_path, PIECES=3, ALONG=12, LOAD="1 N", **chosen)
        ends.append(end_of(run))
        sizes.append(run.system.n)
    assert ends[1] == pytest.approx(ends[0], abs=1e-5)
    assert sizes[1] < sizes[0] / 2
