"""Modes that nothing excites: what is left out stays at rest when it is integrated, too."""

from dataclasses import replace

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.dynamics.excited_modes import excited_part, reached

FLAT = ["body.beam.mesh.divisions=[12, 2, 1]", "simulation.duration=20 ms", "body.beam.modes.family='any'"]
TILTED = """
[drive.tilt]
type = "point force"
marker = "beam.tip"
direction = [0, 0, 1]
force = "0.01 N"
"""


def both_ways(overrides: list[str], scene: str = "beam"):
    run = Pipeline(load_scene(scene, overrides))
    plan = next(iter(run.plans.values()))
    times = run.output_times
    return plan, plan.march(times), replace(plan, excited=None).march(times)


def test_a_beam_turned_in_its_plane_leaves_its_other_modes_at_rest() -> None:
    plan, part, whole = both_ways(FLAT)
    assert plan.excited is not None
    left_out = np.array(plan.excited.left_out["beam"])
    assert 0 < len(left_out) < plan.system.n - 1
    assert not part.q[:, 1 + left_out].any()
    # Integrated, they answer to nothing but round-off.
    largest = np.abs(whole.q[:, 1:]).max()
    assert np.abs(whole.q[:, 1 + left_out]).max() < 1e-6 * largest
    assert np.abs(part.q - whole.q)[:, 1:].max() < 1e-6 * largest
    assert np.abs(part.v - whole.v)[:, 1:].max() < 1e-6 * np.abs(whole.v[:, 1:]).max()


def test_a_force_across_the_plane_excites_them_too(tmp_path) -> None:
    from importlib.resources import files

    ready = files("fmd.models").joinpath("beam.toml").read_text(encoding="utf-8")
    (tmp_path / "tilted.toml").write_text(ready + TILTED, encoding="utf-8")
    plan, part, whole = both_ways(FLAT, str(tmp_path / "tilted.toml"))
    bending = [] if plan.excited is None else list(plan.excited.left_out["beam"])
    moved = np.abs(whole.q).max(axis=0)
    modes = plan.mechanism.modes_of(0)
    assert moved[modes].max() > 0.0
    assert moved[modes[bending]].max(initial=0.0) < 1e-6 * moved[modes].max()
    assert np.abs(part.q - whole.q).max() < 1e-6 * np.abs(whole.q).max()
    assert len(bending) < len(modes) - 2


def test_what_is_reached_is_what_forces_and_couplings_lead_to() -> None:
    omega, tolerance = np.array([1.0, 2.0, 3.0, 4.0, 5.0]), 1e-6
    force, coupling = np.array([0.0, 1.0, 1e-9, 0.0, 0.0]), np.zeros((5, 5))
    assert reached(omega, [force], [coupling], tolerance).tolist() == [False, True, False, False, False]
    coupling[3, 1] = coupling[4, 3] = 0.1  # one-sided couplings count both ways
    assert reached(omega, [force], [coupling], tolerance).tolist() == [False, True, False, True, True]
    assert not reached(omega, [np.full(5, 1e-12)], [coupling], tolerance).any()


@pytest.mark.parametrize("keep_all", [False, True])
def test_keep_all_integrates_every_mode(keep_all: bool) -> None:
    run = Pipeline(load_scene("beam-paper", FLAT), keep_all=keep_all)
    plan = next(iter(run.plans.values()))
    assert (plan.excited is None) == keep_all
    assert excited_part(plan.mechanism, plan.start[0], 1e-6) is not None
