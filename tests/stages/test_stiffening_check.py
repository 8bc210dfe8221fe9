"""How fast bodies turn with all of them rigid, and what that does to their stiffness."""

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.errors import InputError
from fmd.stages.buckling import _extreme_parts
from fmd.stages.mechanism import build_mechanism, place_joints
from fmd.stages.stiffening_check import check_stiffening_loads, critical_rate, rigid_spins

QUICK = ["body.beam.mesh.divisions=[12, 2, 1]"]


@pytest.fixture(scope="module")
def beam() -> Pipeline:
    return Pipeline(load_scene("beam-paper", QUICK))


def test_the_beams_pulse_brings_it_to_the_scenes_speed(beam: Pipeline) -> None:
    check = beam.stiffening_loads["beam"]
    assert check.largest_rate == pytest.approx(20.0, rel=1e-4)  # DOP853's tolerance
    assert check.first_frequency == beam.parts["beam"].body.omega[0]
    assert not check.stiffened


def test_a_damper_hardly_slows_it(beam: Pipeline) -> None:
    damped = load_scene("beam-paper", [*QUICK, "joint.hub.damper=1e-9 N m s"])
    check = check_stiffening_loads(damped, {"beam": beam.parts["beam"].body})["beam"]
    assert check.largest_rate == pytest.approx(20.0, rel=1e-3)


def test_a_scene_that_ends_early_turns_as_fast_as_it_gets(beam: Pipeline) -> None:
    half = load_scene("beam-paper", [*QUICK, "simulation.duration=50 ms"])
    check = check_stiffening_loads(half, {"beam": beam.parts["beam"].body})["beam"]
    assert check.largest_rate == pytest.approx(10.0, rel=1e-4)  # 10 (1 − cos(π t/0.1 s))


def test_a_body_loses_its_stiffness_where_spin_takes_as_much_as_there_is(beam: Pipeline) -> None:
    body = beam.parts["beam"].body
    critical = critical_rate(body, np.array([0.0, 0.0, 5.0]))
    D = (body.integrals.G[0, 0] + body.integrals.G[1, 1])[1:, 1:]
    softest = np.linalg.eigvalsh(np.diag(body.omega**2) - critical**2 * 0.5 * (D + D.T))[0]
    assert softest == pytest.approx(0.0, abs=1e-9 * body.omega[0] ** 2)
    assert critical_rate(body, np.zeros(3)) == np.inf


def test_without_stiffening_a_body_that_would_diverge_is_refused(beam: Pipeline) -> None:
    fast = load_scene("beam-paper", [*QUICK, "drive.spin_up.speed=2000 rad/s", "simulation.stiffening='off'"])
    with pytest.raises(InputError, match="body 'beam' would diverge: it turns at up to 2000 rad/s"):
        check_stiffening_loads(fast, {"beam": beam.parts["beam"].body})
    assert check_stiffening_loads(fast, {}) == {}


def test_each_rigid_body_has_its_own_spin() -> None:
    scene = load_scene("rod-slider", ["simulation.duration=1 s"])
    mechanism = build_mechanism(scene, {})
    spins = rigid_spins(mechanism, *place_joints(scene, mechanism.rigid), 1.0)
    assert set(spins) == {"rod", "slider"}
    assert np.array_equal(spins["rod"], spins["slider"])  # the slider slides on the rod
    assert spins["rod"][-1, 2] == pytest.approx(np.pi / 180 * 100 / (23 / 3), rel=0.01)


def test_a_run_with_its_own_bodies_is_the_same_mechanism() -> None:
    # Estimates of the error budget are runs with changed bodies: what was left out of the run must be left out of them.
    run = Pipeline(load_scene("beam-paper", [*QUICK, "simulation.stiffening=on", "simulation.error=0.1"]))
    other = run.with_bodies(run.bodies)
    assert run.parts["beam"].stiffened.joint_displacement2.any()
    assert not run.mechanism.links[0].joint_displacement2.size  # no moment acts there that counts
    assert not other.mechanism.links[0].joint_displacement2.size
    assert np.array_equal(run.mechanism.links[0].integrals.stiffening, other.mechanism.links[0].integrals.stiffening)
    assert run.with_bodies(run.bodies, stiffening_loads={}).mechanism.links[0].joint_displacement2.any()


def test_extreme_eigenvalues_of_a_motion_are_those_of_all_its_matrices() -> None:
    rng = np.random.default_rng(0)
    for _ in range(100):
        k = int(rng.integers(1, 7))
        K = rng.normal(size=(int(rng.integers(1, 60)), k, k))
        K = K + K.swapaxes(1, 2) + rng.choice([-3.0, 0.0, 3.0, 8.0]) * np.eye(k)
        K *= rng.lognormal(0.0, 2.0, size=(len(K), 1, 1)) * rng.choice([0.01, 0.3, 1.0, 3.0])
        every, (lowest, highest) = np.linalg.eigvalsh(K), _extreme_parts(K)
        assert max(-lowest.min(), 0.0) == pytest.approx(max(-every.min(), 0.0), rel=1e-13)
        assert max(-lowest.min(), highest.max()) == pytest.approx(np.abs(every).max(), rel=1e-13)
        assert ((lowest < -1.0) == (every[:, 0] < -1.0)).all()


def test_moments_that_no_shape_in_a_plane_answers_to_are_shared_by_none() -> None:
    """Modes that stretch the rod turn its ends by round-off, to which moments of 1e16 N m were fitted."""
    plane = ["body.rod.mesh.divisions=[6,1,1]", "simulation.duration=2 ms", "output=[]"]
    run = Pipeline(load_scene("slider-crank", [*plane, 'simulation.run=[{integrator="runge-kutta"}]']))
    wrenches = np.abs(run.stiffening_loads["rod"].loads.wrenches)
    assert wrenches[..., 2:].max() < 1e-6 < wrenches[..., :2].max()
