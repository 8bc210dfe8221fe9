"""Variants marched at once: each moves as it does alone, compiled once, and what is no variant is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fmd.core.errors import StabilityError
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.compiler.variants import CompiledVariants
from fmd.dynamics.links import Link
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import half_sine
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.variants import march_variants
from fmd.scene.joints.prismatic import PRISMATIC
from fmd.scene.joints.revolute import REVOLUTE
from tests.dynamics.compiler.mechanisms import PointMechanism, random_mechanism

STEP, TIMES = 0.002, np.linspace(0.0, 0.1, 8)


def without_rotations_in_space() -> list[int]:
    """Seeds of random mechanisms whose positions are as many as their rates."""
    made = {seed: random_mechanism(seed).mechanism for seed in range(60)}
    return [seed for seed, mechanism in made.items() if mechanism.n == mechanism.n_positions][:6]


def varied(mechanism: Mechanism, seed: int) -> Mechanism:
    """Another spring, damper, modal damping, mass, gravity and load of each body."""
    rng = np.random.default_rng([seed, 3])

    def change(link: Link) -> Link:
        along = link.joint in (REVOLUTE, PRISMATIC) and link.motion is None
        joint = {"spring": rng.uniform(0, 20), "damper": rng.uniform(0, 1), "rest": rng.uniform(-0.1, 0.1)}
        joint |= {"load": half_sine(0.01, 0.05, rng.uniform(-1, 1))}
        own = joint if along else {}
        integrals = link.integrals
        if not len(link.omega):
            factor = rng.uniform(0.5, 2.0)
            integrals = replace(integrals, G=factor * integrals.G, S=factor * integrals.S, mass=factor * integrals.mass)
        return replace(link, integrals=integrals, damping=rng.uniform(0, 0.1, len(link.omega)), **own)

    links = [change(link) for link in mechanism.links]
    loads = [replace(load, size=half_sine(0.0, 0.06, rng.uniform(-1, 1))) for load in mechanism.loads]
    return replace(mechanism, links=links, loads=loads, gravity=rng.normal(size=3))


def with_damping(made: PointMechanism) -> Mechanism:
    links = [replace(link, damping=np.full(len(link.omega), 0.01)) for link in made.mechanism.links]
    return replace(made.mechanism, links=links)


@pytest.mark.parametrize("seed", without_rotations_in_space())
def test_each_variant_moves_as_it_does_alone(seed: int) -> None:
    made = random_mechanism(seed)
    mechanisms = [with_damping(made), *(varied(with_damping(made), k) for k in range(10))]  # more than eight lanes
    starts = [made.state(k) for k in range(len(mechanisms))]
    q0, v0 = (np.array(x) for x in zip(*starts, strict=True))
    found = march_variants(mechanisms, STEP, q0, v0, TIMES, workers=2)
    for k in (0, 3, 7, 8, 10):
        alone = CentralDifference(STEP).march(CompiledSystem(mechanisms[k]), q0[k], v0[k], TIMES)
        size = max(1.0, np.abs(alone.v).max())
        assert found.q[k] == pytest.approx(alone.q, abs=1e-10 * size)
        assert found.v[k] == pytest.approx(alone.v, abs=1e-9 * size)


def test_what_all_variants_have_in_common_may_be_another_number_in_the_next_march() -> None:
    seed = without_rotations_in_space()[0]
    made = random_mechanism(seed)
    for weight in (9.81, 1.62):
        moon = replace(with_damping(made), gravity=np.array([0.0, -weight, 0.0]))
        links = [replace(link, damping=np.full(len(link.omega), 0.02)) for link in moon.links]
        mechanisms = [moon, replace(moon, links=links)]
        found = march_variants(mechanisms, STEP, *made.state(seed), TIMES)
        alone = CentralDifference(STEP).march(CompiledSystem(moon), *made.state(seed), TIMES)
        assert found.q[0] == pytest.approx(alone.q, abs=1e-10 * max(1.0, np.abs(alone.v).max()))


def test_what_is_the_same_for_all_is_no_input() -> None:
    mechanism = with_damping(random_mechanism(without_rotations_in_space()[0]))
    heavier = replace(mechanism, gravity=2.0 * mechanism.gravity + 1.0)
    same, other = CompiledVariants([mechanism, mechanism]), CompiledVariants([mechanism, heavier])
    assert same.constants.shape == (0, 2)
    assert other.constants.shape == (3, 2)
    assert same.leap() != other.leap()


def test_what_is_no_variant_is_refused() -> None:
    mechanism = random_mechanism(without_rotations_in_space()[0]).mechanism
    moved = replace(mechanism, links=[replace(mechanism.links[0], place=np.ones(3)), *mechanism.links[1:]])
    with pytest.raises(ValueError, match="differ in more than"):
        CompiledVariants([mechanism, moved])
    seed = next(k for k in range(60) if k not in without_rotations_in_space() and _turns_in_space(k))
    with pytest.raises(ValueError, match="spherical or free joints"):
        CompiledVariants([random_mechanism(seed).mechanism])


def _turns_in_space(seed: int) -> bool:
    mechanism = random_mechanism(seed).mechanism
    return mechanism.n != mechanism.n_positions


def test_a_variant_that_diverges_is_named() -> None:
    seed = without_rotations_in_space()[0]
    mechanism = random_mechanism(seed).mechanism
    q0, v0 = random_mechanism(seed).state(0)
    with pytest.raises(StabilityError, match="the march of variant 0 diverged"):
        march_variants([mechanism], 1e3, q0, v0, np.array([1e6]))
