"""Adjoint of a march by central difference, and gradients of weighted histories, against tangents of the same steps."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import fmd as package
from fmd.fitting import adjoint, frozen_run
from fmd.fitting.frozen_run import FrozenRun
from fmd.fitting.parameters import find_parameter
from fmd.fitting.tangents import march_tangents
from fmd.integrators import adjoint as march_adjoint
from fmd.output.channels import find_channels
from tests.fitting.test_tangents import OTHERS, SPRINGS, chain, spatial_chain

KEYS = [*SPRINGS, *OTHERS, "joint.drive.rate", "joint.pin.rest"]
TURNING = [SPRINGS[0], *OTHERS, "joint.drive.rate"]
MORE = ("joint.drive.rate=-0.3 rad/s", "joint.pin.rest=-50 deg")  # negative numbers, as well


@pytest.mark.parametrize(
    ("make", "keys", "kept"), [(chain, KEYS, 2**20), (chain, KEYS, 750), (spatial_chain, TURNING, 750)]
)
def test_an_adjoint_is_the_transpose_of_the_tangents(
    make: Any, keys: list[str], kept: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By springs, a damper, a load and a start, of random weights on all output.

    Also in sections of 250 steps and less, and where a body turns in space.
    """
    monkeypatch.setattr(march_adjoint, "MOST_STEPS_KEPT", kept)
    frozen = FrozenRun(package.load(make("central-difference"), *MORE[: 1 + (make is chain)]).run)
    motion, times = frozen.at({}), frozen.times
    assert motion.plan is not None
    directions = [frozen.direction(motion, find_parameter(frozen.run.scene, key)) for key in keys]
    known = [each for each in directions if each is not None]
    assert len(known) == len(keys)
    system, q0, v0 = motion.plan.marched
    rng = np.random.default_rng(0)
    by_q, by_v = (rng.normal(size=(len(times), size)) for size in (system.n_positions, system.n))
    method = motion.plan.integrator
    assert isinstance(method, march_adjoint.CentralDifference)
    found = march_adjoint.pull_back(method, system, q0, v0, times, by_q, by_v, known)
    expected = [(by_q * each.q).sum() + (by_v * each.v).sum() for each in march_tangents(motion.plan, known, times)]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def test_a_gradient_by_many_numbers_is_that_of_the_jacobian(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of places and of an energy that has the springs in it; by masses, which the adjoint leaves to tangents, too."""
    result = package.load(chain("central-difference"), *MORE)
    function = package.ResultFunction(
        result, of=["coupler.b.position.y", "potential_energy"], to=[*KEYS, "body.coupler.mass"]
    )
    weights = np.random.default_rng(0).normal(size=function(function.start).shape)
    expected = weights @ function.jacobian(function.start)
    monkeypatch.setattr(adjoint, "FEWEST_BY_ADJOINT", len(KEYS))
    again = replace(function)
    found = again.vjp(again.start, weights)
    assert again._frozen.marches == 3  # the motion, its adjoint, and the tangent by the mass
    np.testing.assert_allclose(found * again.start, expected * again.start, rtol=0, atol=1e-6 * np.abs(found).max())


def test_few_numbers_and_results_of_no_time_or_several_take_tangents(monkeypatch: pytest.MonkeyPatch) -> None:
    frozen = FrozenRun(package.load(chain("central-difference"), *MORE).run)
    motion = frozen.at({})
    parameters = [find_parameter(frozen.run.scene, key) for key in SPRINGS]
    (place,) = find_channels(frozen.run, "coupler.b.position.y")
    weights = np.ones(len(frozen.times))
    assert adjoint.find_gradient(frozen, motion, parameters, [place], weights) == {}
    monkeypatch.setattr(adjoint, "FEWEST_BY_ADJOINT", 2)
    (mass,) = find_channels(frozen.run, "mass")
    assert adjoint.find_gradient(frozen, motion, parameters, [mass], np.ones(1)) == {}
    accelerated = replace(place, read=lambda run: np.gradient(run.motion.trajectory.v[:, 0]))
    assert adjoint.find_gradient(frozen, motion, parameters, [accelerated], weights) == {}
    assert len(adjoint.find_gradient(frozen, motion, parameters, [place], weights)) == 2


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
    monkeypatch.setattr(adjoint, "FEWEST_BY_ADJOINT", fewest)
    result = package.load(chain("central-difference"), *MORE)
    function = package.ResultFunction(result, of=["coupler.b.position.y"], to=OTHERS)
    x = np.array([0.0, 1.0])
    weights = function(x)
    for take in (function.vjp, function.jvp):
        with pytest.raises(package.InputError, match=r"joint\.drive\.damper = 0\.0: is 0, .*; take a small value"):
            take(x, weights if take == function.vjp else x)
