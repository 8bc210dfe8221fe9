"""Poses of a mechanism: joints moved through their range, loops that follow, prescribed motions over their time."""

import numpy as np
import pytest

from fmd import load
from fmd.stages.poses import find_clips, run_at_poses, undeformed_start


def clips_of(scene, *overrides):
    run = load(scene, *overrides).run
    return run, {clip.name: clip for clip in find_clips(run, undeformed_start(run), 0.5)}


def test_a_hinge_makes_a_whole_turn_and_carries_what_is_on_it():
    run, clips = clips_of("arm")
    elbow = clips["elbow"]
    assert elbow.values[[0, elbow.start, -1]] == pytest.approx(elbow.values[elbow.start] + np.array([-np.pi, 0, np.pi]))
    posed = run_at_poses(run, elbow.times, elbow.q).motion.kinematics
    number = run.mechanism.number_of
    hinge = posed.marker_position(number("forearm"), "elbow")
    assert np.ptp(hinge, axis=0) == pytest.approx(np.zeros(3), abs=1e-12)  # what carries it stays
    away = posed.marker_position(number("forearm"), "wrist") - hinge
    turned = elbow.values - elbow.values[elbow.start]
    c, s = np.cos(turned), np.sin(turned)
    x, y, _ = away[elbow.start]
    assert away[:, 0] == pytest.approx(c * x - s * y, abs=1e-12)
    assert away[:, 1] == pytest.approx(s * x + c * y, abs=1e-12)


def test_stops_end_a_slider():
    stop = 'joint.elbow.stop={low="-30 deg", high="100 deg", stiffness="1 kN m/rad"}'
    _, clips = clips_of("arm", stop)
    assert np.degrees(clips["elbow"].values[[0, -1]]) == pytest.approx([-30.0, 100.0])


def test_prescribed_motions_move_a_slider_crank_as_its_triangle_says():
    run, clips = clips_of("slider-crank")
    assert list(clips) == ["time"]  # nothing else is free
    over = clips["time"]
    angle = 150.0 * over.times
    slider = run_at_poses(run, over.times, over.q).motion.kinematics.marker_position(
        run.mechanism.number_of("slider"), "pin"
    )
    x = 0.15 * np.cos(angle) + np.sqrt(0.3**2 - (0.15 * np.sin(angle)) ** 2)
    assert slider == pytest.approx(np.column_stack([x, 0 * x, 0 * x]), abs=1e-9)
    assert np.ptp(x) == pytest.approx(0.3, rel=0.02)  # both dead centres are passed


def test_loops_end_a_slider_where_they_would_open():
    run, clips = clips_of("suspension")
    hinge = clips["upper"]
    assert hinge.values[0] < hinge.values[hinge.start] < hinge.values[-1]
    assert run_at_poses(run, hinge.times, hinge.q).motion.constraint_residual < 1e-8
