"""Adjoints of marches, and gradients of weighted histories, against tangents of the same steps."""

import re
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

import fmd as package
from fmd.core.errors import StabilityError
from fmd.fitting import frozen_run, result_function
from fmd.fitting.frozen_run import FrozenRun
from fmd.fitting.parameters import find_parameter
from fmd.fitting.tangents import march_tangents
from fmd.integrators import adjoint as march_adjoint
from fmd.integrators import runge_kutta_adjoint
from fmd.integrators.generalized_alpha import GeneralizedAlpha
from fmd.integrators.runge_kutta import RungeKutta
from fmd.output.channels import find_all_channels
from tests.fitting.test_tangents import (
    CENTRES,
    OTHERS,
    SMALL_ARM,
    SPATIAL,
    SPRINGS,
    balanced,
    chain,
    fast_slides,
    four_bar,
    numbers_of_random,
    revolute,
    spatial,
    spatial_chain,
)
from tests.verification.test_random_mechanisms import SI, random_scene

KEYS = [*SPRINGS, *OTHERS, "joint.drive.rate", "joint.pin.rest"]
TURNING = [SPRINGS[0], *OTHERS, "joint.drive.rate", "body.coupler.inertia.1"]
MORE = ("joint.drive.rate=-0.3 rad/s", "joint.pin.rest=-50 deg")  # negative numbers, as well
SHORT = "simulation.duration=0.06 s"
LOOPS = (four_bar, spatial)


def driven(method: str) -> dict[str, Any]:
    """The four-bar with a crank that a motor turns: a mechanism without a freedom."""
    tables = four_bar(method)
    tables["joint"]["drive"] = revolute("ground", "crank.a")
    angle = {"formula": "1.4 + 0.3*sin(30*t)", "unit": "rad"}
    tables["drive"] = {"turn": {"type": "motion", "joint": "drive", "angle": angle}}
    return tables


SIZES = ["body.coupler.mass", "body.crank.marker.b.at.0"]


def differ(frozen: FrozenRun, keys: list[str]) -> tuple[Any, Any]:
    """Return derivatives of a random weighted sum of all output by the adjoint, and by tangents of the same steps."""
    motion, times = frozen.at({}), frozen.times
    assert motion.plan is not None
    directions = [frozen.direction(motion, find_parameter(frozen.run.scene, key)) for key in keys]
    known = [each for each in directions if each is not None]
    assert len(known) == len(keys)
    system, q0, v0 = motion.plan.marched
    rng = np.random.default_rng(0)
    by_q, by_v = (rng.normal(size=(len(times), size)) for size in (system.n_positions, system.n))
    found = march_adjoint.pull_back(motion.plan.integrator, system, q0, v0, times, by_q, by_v, known)
    tangents = march_tangents(replace(motion.plan, excited=None), known, times)
    return found, np.array([(by_q * each.q).sum() + (by_v * each.v).sum() for each in tangents])


@pytest.mark.parametrize(
    ("make", "keys", "kept", "more"),
    [
        (chain, [*KEYS, SIZES[0]], 2**20, MORE),
        (chain, KEYS, 750, MORE),
        (spatial_chain, TURNING, 750, MORE[:1]),
        (four_bar, [SPRINGS[0], SIZES[1]], 5000, [SHORT]),
        pytest.param(four_bar, [*SPRINGS, *OTHERS, *SIZES], 2**20, [SHORT], marks=pytest.mark.long),
        (driven, SIZES[1:], 2**20, [SHORT]),
        (spatial, SPATIAL[1:3], 2**20, [SHORT]),
        (balanced, CENTRES, 2**20, [SHORT]),
        *(
            pytest.param(partial(spatial, seed=seed), SPATIAL, 5000, [SHORT], marks=pytest.mark.long)
            for seed in range(1, 7)
        ),
    ],
)
def test_an_adjoint_is_the_transpose_of_the_tangents(
    make: Any, keys: list[str], kept: int, more: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By springs, dampers, loads, starts, masses and lengths.

    In sections of some 250 steps, too, where bodies turn in space, and where loops close.
    """
    monkeypatch.setattr(march_adjoint, "MOST_STEPS_KEPT", kept)
    found, expected = differ(FrozenRun(package.load(make("central-difference"), *more).run), keys)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


OTHER_METHODS = ("{integrator='runge-kutta',tolerance=1e-8}", "{integrator='generalized-alpha',step='0.5 ms'}")


@pytest.mark.parametrize("run", OTHER_METHODS)
@pytest.mark.parametrize(
    ("make", "kept"), [(spatial_chain, 750), *(pytest.param(each, 2000, marks=pytest.mark.long) for each in LOOPS)]
)
def test_adjoints_of_other_methods_are_the_transposes_of_their_tangents(
    run: str, make: Any, kept: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stage by stage, and through equations for a step's end; in sections, of quaternions and of loops, too."""
    monkeypatch.setattr(march_adjoint, "MOST_STEPS_KEPT", kept)
    short = (f"simulation.run=[{run}]", "simulation.duration=0.04 s")
    frozen = FrozenRun(package.load(make("central-difference"), *short).run)
    found, expected = differ(frozen, [SPRINGS[0], "joint.drive.damper", "body.coupler.mass"])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("make", "kept", "step"), [(chain, 300, "1 ms"), pytest.param(four_bar, 2**20, "0.2 ms", marks=pytest.mark.long)]
)
def test_an_adjoint_of_the_exponential_method_is_the_transpose_of_its_tangents(
    make: Any, kept: int, step: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also by a load, of which sums over a loop's evaluations cancel but for a hundred-thousandth."""
    monkeypatch.setattr(march_adjoint, "MOST_STEPS_KEPT", kept)
    run = (f"simulation.run=[{{integrator='exponential',step='{step}'}}]", SHORT, "joint.drive.rate=-0.3 rad/s")
    frozen = FrozenRun(package.load(make("central-difference"), *run[: 3 if make is chain else 2]).run)
    found, expected = differ(frozen, [*OTHERS, "joint.drive.rate"][: 3 if make is chain else 2])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


SLIDING = ["body.block.mass", "joint.slide.spring", "drive.push.force", "joint.drive.rate", SIZES[1]]


@pytest.mark.parametrize(("parent", "kept"), [("crank.a", 2000), ("block.a", 2**20)])
def test_an_adjoint_of_sub_cycling_is_the_transpose_of_its_tangents(
    parent: str, kept: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of fast slides that don't couple, in sections, and of slides that do; one has a load and a damper."""
    monkeypatch.setattr(march_adjoint, "MOST_STEPS_KEPT", kept)
    tables = fast_slides("sub-cycling")
    tables["joint"]["other"]["parent"] = parent
    frozen = FrozenRun(package.load(tables, SHORT).run)
    assert frozen.plan.marched[0].takes_whole_cycles == (parent == "crank.a")
    found, expected = differ(frozen, SLIDING)
    assert np.abs(expected).min() > 1e-4 * np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


@pytest.mark.long
@pytest.mark.parametrize("seed", range(24))
def test_adjoints_of_sub_cycled_random_mechanisms_are_the_transposes_of_their_tangents(seed: int) -> None:
    """Of fast coordinates of all kinds, with bodies that turn in space."""
    run = "simulation.run=[{integrator='sub-cycling',substeps=4,forces='tangents'}]"
    frozen = FrozenRun(package.load(random_scene(seed, SI), run, "simulation.step=auto").run)
    found, expected = differ(frozen, numbers_of_random(frozen.run.scene))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


LONG = ("simulation.step=10 ms", "simulation.duration=0.06 s")


def long_steps() -> dict[str, Any]:
    scene = four_bar("central-difference") | {"title": "Long steps"}
    scene["simulation"]["run"] = [{"integrator": "central-difference"}]
    return scene


def test_numbers_that_change_shapes_have_a_reason_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    frozen = FrozenRun(package.load(long_steps(), *LONG).run)
    spring, other = (find_parameter(frozen.run.scene, key) for key in SPRINGS)
    direction = frozen.direction
    monkeypatch.setattr(frozen, "direction", lambda *given: direction(*given) if given[1] is spring else None)
    motion = frozen.at({}, by=[spring, other])
    assert frozen.beside(motion, spring).lacking.startswith("loops were linearised anew within ")
    assert frozen.beside(motion, other).lacking.startswith("shapes of bodies")


def test_an_adjoint_says_when_a_long_step_closes_loops_otherwise_and_differences_serve(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(result_function, "FEWEST_BY_ADJOINT", 1)
    function = package.ResultFunction(package.load(long_steps(), *LONG), of=["crank.b.position.y"], to=SPRINGS[:1])
    weights = np.ones(len(function(function.start)))
    found = function.vjp(function.start, weights)
    assert re.fullmatch(
        r"loops were linearised anew within \d+ projections; take a step below 0\.01 s", function.lacking
    )
    (high,), (low,) = (([function(function.start * (1.0 + side)) @ weights]) for side in (1e-4, -1e-4))
    np.testing.assert_allclose(found * function.start, (high - low) / 2e-4, rtol=1e-5)
    monkeypatch.setattr(march_adjoint, "WEIGHTS_LEFT", -1.0)
    free = package.ResultFunction(package.load(chain("central-difference")), of=["crank.b.position.y"], to=SPRINGS[:1])
    free.vjp(free.start, np.ones(len(free(free.start))))
    assert free.lacking.startswith("corrections left 0.0e+00 of the adjoint's weights")


def test_an_adjoint_refuses_what_it_can_not_check(monkeypatch: pytest.MonkeyPatch) -> None:
    """Corrections that have left NaN, and steps that were not found; other errors of a gradient go on to the user."""
    run = package.load(chain("generalized-alpha"), SHORT).run
    system, q0, v0 = next(iter(run.plans.values())).marched
    method, times = GeneralizedAlpha(1e-3), np.array([0.01, 0.02])
    weights = np.ones((2, system.n_positions)), np.ones((2, system.n))
    with pytest.raises(package.AccuracyError, match="the step at t = 0 s was not found; take a smaller step"):
        march_adjoint.pull_back(method, system, q0, v0 + 1e120, times, *weights, [])
    with monkeypatch.context() as context:
        context.setattr(runge_kutta_adjoint, "MOST_BEGINS_KEPT", 2 * (system.n_positions + system.n))
        with pytest.raises(march_adjoint.NotTakenBackError, match="runge-kutta: more than 2 steps aren't kept"):
            march_adjoint.pull_back(RungeKutta(1e-8), system, q0, v0, times, *weights, [])
    unknown = (np.zeros(system.n_positions), np.zeros(system.n), np.nan)
    with monkeypatch.context() as context:
        context.setattr(march_adjoint, "take_back", lambda *_: unknown)
        with pytest.raises(march_adjoint.NotTakenBackError, match="corrections left nan"):
            march_adjoint.pull_back(method, system, q0, v0, times, *weights, [])

    def fail(*_: Any) -> None:
        raise StabilityError("it diverges")

    monkeypatch.setattr(result_function, "FEWEST_BY_ADJOINT", 1)
    monkeypatch.setattr(result_function, "find_gradient", fail)
    function = package.ResultFunction(package.load(chain("central-difference")), of=["crank.b.position.y"], to=SPRINGS)
    with pytest.raises(StabilityError, match="it diverges"):
        function.vjp(function.start, np.ones(len(function(function.start))))


RANDOM = [(3, ""), *((1, run) for run in OTHER_METHODS)]
MORE_RANDOM = [(seed, run) for seed in range(24) for run in ("", *OTHER_METHODS) if (seed, run) not in RANDOM]


@pytest.mark.parametrize(
    ("seed", "run"), [*RANDOM, *(pytest.param(*each, marks=pytest.mark.long) for each in MORE_RANDOM)]
)
def test_adjoints_of_random_mechanisms_are_the_transposes_of_their_tangents(seed: int, run: str) -> None:
    """Of trees of rigid and flexible bodies on all kinds of joints, by numbers of all kinds."""
    frozen = FrozenRun(package.load(random_scene(seed, SI), *([f"simulation.run=[{run}]"] if run else [])).run)
    found, expected = differ(frozen, numbers_of_random(frozen.run.scene))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def test_inertia_of_rigid_bodies_and_gravity_are_inputs_and_dimensions_are_variants() -> None:
    frozen = FrozenRun(package.load(spatial_chain("central-difference"), SHORT).run)
    motion = frozen.at({})
    for key in ("body.coupler.mass", "body.coupler.centre.0", "body.coupler.inertia.1", "simulation.gravity.1"):
        direction = frozen.direction(motion, find_parameter(frozen.run.scene, key))
        assert direction is not None
        assert direction.lifted
        assert not direction.variants
    direction = frozen.direction(motion, find_parameter(frozen.run.scene, SIZES[1]))
    assert direction is not None
    assert len(direction.variants) >= 2


def test_a_gradient_by_many_numbers_is_that_of_the_jacobian(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of places and of an energy that has the springs in it; by a mass, too."""
    result = package.load(chain("central-difference"), *MORE)
    function = package.ResultFunction(
        result, of=["coupler.b.position.y", "potential_energy"], to=[*KEYS, "body.coupler.mass"]
    )
    weights = np.random.default_rng(0).normal(size=function(function.start).shape)
    expected = weights @ function.jacobian(function.start)
    monkeypatch.setattr(result_function, "FEWEST_BY_ADJOINT", len(KEYS))
    again = replace(function)
    found = again.vjp(again.start, weights)
    assert again._frozen.marches == 2  # the motion, and its adjoint
    np.testing.assert_allclose(found * again.start, expected * again.start, rtol=0, atol=1e-6 * np.abs(found).max())


def test_a_gradient_says_why_it_is_by_tangents(monkeypatch: pytest.MonkeyPatch) -> None:
    """With few numbers, results of no time or of several, and other methods."""
    frozen = FrozenRun(package.load(chain("central-difference"), *MORE).run)
    motion = frozen.at({})
    parameters = [find_parameter(frozen.run.scene, key) for key in SPRINGS]
    place, mass = find_all_channels(frozen.run, ["coupler.b.position.y", "mass"])
    highest = replace(place, read=lambda run: place.read(run).max())
    assert result_function.lacks_adjoint(frozen, motion, parameters, [place]).startswith(
        "2 numbers: tangents are as quick"
    )
    monkeypatch.setattr(result_function, "FEWEST_BY_ADJOINT", 2)
    assert result_function.lacks_adjoint(frozen, motion, parameters, [place]) == ""
    for channels in ([mass], [highest], [highest, place]):
        assert result_function.lacks_adjoint(frozen, motion, parameters, channels) == "results that are no histories"
    accelerated = replace(place, read=lambda run: np.gradient(run.motion.trajectory.v[:, 0]))
    assert result_function.lacks_adjoint(frozen, motion, parameters, [accelerated]).endswith("several times at once")
    function = package.ResultFunction(package.load(four_bar("sub-cycling"), *MORE), of=[place.name], to=SPRINGS)
    function.vjp(function.start, np.ones(len(frozen.times)))
    assert function.lacking == "sub-cycling of loops"


def test_a_gradient_of_the_tip_and_of_a_history_is_that_of_the_jacobian(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(result_function, "FEWEST_BY_ADJOINT", 2)
    result = package.load("arm", *SMALL_ARM, "simulation.duration=0.02 s", "body.forearm.mesh.divisions=[8,1,1]")
    keys = ["joint.elbow.spring", "joint.elbow.damper"]
    function = package.ResultFunction(result, of=["tip", "forearm.wrist.position.y"], to=keys)
    weights = np.random.default_rng(0).normal(size=function(function.start).shape)
    found = function.vjp(function.start, weights)
    np.testing.assert_array_equal(found, weights @ function.jacobian(function.start))
    place = package.ResultFunction(result, of=["forearm.wrist.position.y"], to=keys)
    place.jacobian(place.start)
    place.vjp(place.start, weights[1:])
    assert place.lacking == "the Jacobian at these numbers was known"


def test_scenes_beside_one_are_kept_of_as_many_numbers_as_march_together(monkeypatch: pytest.MonkeyPatch) -> None:
    run = package.load(chain("central-difference"), *MORE).run
    parameters = [find_parameter(run.scene, key) for key in KEYS]
    found = []
    for count in (len(KEYS), 2):
        monkeypatch.setattr(frozen_run, "LANES", count)
        frozen = FrozenRun(run)
        motion = frozen.at({}, by=parameters)
        found.append([frozen.beside(motion, each).high.motion.trajectory.q for each in parameters])
        assert len({number for number, _ in motion.variants}) == count
        assert frozen.marches == 1 + -(-len(KEYS) // count)
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-12)


@pytest.mark.parametrize("fewest", [1, 40])
def test_derivatives_by_a_number_that_is_0_are_refused(fewest: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the adjoint and by tangents; values are had."""
    monkeypatch.setattr(result_function, "FEWEST_BY_ADJOINT", fewest)
    result = package.load(chain("central-difference"), *MORE)
    function = package.ResultFunction(result, of=["coupler.b.position.y"], to=OTHERS)
    x = np.array([0.0, 1.0])
    weights = function(x)
    for take in (function.vjp, function.jvp):
        with pytest.raises(package.InputError, match=r"joint\.drive\.damper = 0\.0: is 0, .*; take a small value"):
            take(x, weights if take == function.vjp else x)
