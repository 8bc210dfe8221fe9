"""Stability limits of a hinged strip in two pieces: marches live below them, and grow above them as predicted."""

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.core.errors import StabilityError
from fmd.integrators.subcycling import Subcycling
from fmd.stages.stability_limits import find_scene_limits
from tests.verification.test_large_deflection import FORCE, strip

DURATION, OFF = 0.2, 1e-9  # s; of the modal coordinates at the start
HINGED = [
    'joint.clamp={ type = "revolute", parent = "ground", child = "strip.root", axis = [0, 1, 0] }',
    "simulation.start=undeformed",
    f'simulation.duration="{DURATION} s"',
]
TIMES = np.linspace(0.0, DURATION, 401)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Pipeline:
    folder = tmp_path_factory.mktemp("strip")
    strip(folder, PIECES=2, ALONG=4, LOAD="0 N", **FORCE)
    return Pipeline(load_scene(folder / "strip.toml", HINGED))


def vibrate(run: Pipeline, step: float, substeps: int) -> Array:
    """March from modes a little off their rest; return the largest of them over time, shape (n_times,)."""
    q, v = run.start
    moved = q + np.r_[0.0, np.full(len(q) - 1, OFF)]
    return np.abs(Subcycling(step, substeps).march(run.system, moved, v, TIMES).q[:, 1:]).max(axis=1)


def test_pieces_live_below_the_limit_of_central_difference_and_diverge_above_it(run: Pipeline) -> None:
    limit = find_scene_limits(run, [1], along=False).limits[0].critical_step
    assert limit == pytest.approx(2 / run.system.highest_frequency, rel=1e-6)
    assert vibrate(run, 0.98 * limit, 1).max() < 100 * OFF
    with pytest.raises(StabilityError):
        vibrate(run, 1.02 * limit, 1)


def test_pieces_live_below_the_limit_of_sub_cycling_and_grow_at_the_stated_rate_above_it(run: Pipeline) -> None:
    """The hinge is slow and couples with the modes through the mass matrix: by β = 0.93 its cycles feed them."""
    found = find_scene_limits(run, [2], along=False)
    (row,) = found.limits
    assert (found.n_slow, found.coupling) == (1, pytest.approx(0.93, abs=0.01))
    assert row.critical_step < 0.1 * row.sudden_step
    assert vibrate(run, 0.98 * row.critical_step, 2).max() < 1000 * OFF  # tenfold growth is allowed up to there
    size = vibrate(run, 0.25 * row.sudden_step, 2)
    grown = np.log(size[-40:].max() / size[160:200].max())  # beats are shorter than 20 ms
    assert grown / (0.5 * DURATION) == pytest.approx(0.5 * row.growth_rate, rel=0.1)  # as the step
    with pytest.raises(StabilityError):
        vibrate(run, 1.02 * row.sudden_step, 2)
