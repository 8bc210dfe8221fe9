"""Marches of many states with numbers of their own, eight in the lanes of each step, against each march by itself."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.core.errors import StabilityError
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.lanes import arrange_lanes
from fmd.scene.joints.prismatic import PRISMATIC
from fmd.scene.joints.revolute import REVOLUTE
from tests.dynamics.compiler.mechanisms import PointMechanism, random_mechanism

METHOD, TIMES = CentralDifference(0.002), np.array([0.0, 0.0031, 0.0032, 0.05, 0.1])
STIFFER = 1e9  # times a spring: no step is stable


SEEDS = (3, 4, 5, 9, 13)  # of random mechanisms with numbers, whose steps can be taken in lanes


@pytest.fixture(autouse=True)
def groups(lanes: Any) -> list[int]:
    """Return the number of groups of each call in lanes."""
    return lanes.groups


def sprung(seed: int) -> PointMechanism:
    """A random mechanism with springs, rests and dampers in all joints that may have some."""
    made, rng = random_mechanism(seed), np.random.default_rng([seed, 5])
    links = [
        replace(link, spring=rng.uniform(1, 20), rest=rng.uniform(0.01, 0.1), damper=rng.uniform(0.1, 1))
        if link.joint in (REVOLUTE, PRISMATIC) and link.motion is None
        else link
        for link in made.mechanism.links
    ]
    return replace(made, mechanism=replace(made.mechanism, links=links))


def variants(seed: int, count: int) -> tuple[CompiledSystem, list[CompiledSystem], Array]:
    """A system, others with numbers of their own, and a state of each with its numbers behind it."""
    made, rng = sprung(seed), np.random.default_rng([seed, 7])
    first = CompiledSystem(made.mechanism)
    factors = rng.uniform(0.5, 2.0, (count, len(first.compiled.numbers)))
    own = [CompiledSystem(first.compiled.with_numbers(factor * first.compiled.numbers)) for factor in factors]
    states = [np.concatenate([*made.state(k), system.compiled.numbers]) for k, system in enumerate(own)]
    return first, own, np.array(states)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("count", [11, 14])  # a group of eight, and too few for another; two groups
def test_each_lane_moves_as_its_mechanism_does_alone_beside_one_that_diverges(
    seed: int, count: int, groups: list[int]
) -> None:
    first, systems, states = variants(seed, count)
    assert first.leap_in_lanes
    number = first.compiled.numbers.size
    lost = 4
    states[lost, -number:] *= STIFFER
    found = METHOD.marches(first, states, TIMES)
    assert groups == [count // 7]
    for k, (march, system) in enumerate(zip(found, systems, strict=True)):
        if k == lost:
            assert march is None
            continue
        alone = METHOD.march(system, *np.split(states[k, :-number], [first.n_positions]), TIMES)
        assert march is not None
        size = max(1.0, np.abs(alone.v).max())
        assert march.q == pytest.approx(alone.q, abs=1e-12 * size)
        assert march.v == pytest.approx(alone.v, abs=1e-11 * size)
        assert alone.end is not None
        assert march.end is not None
        assert march.end.values == pytest.approx(alone.end.values, rel=1e-9, abs=1e-9 * size)
        assert march.evaluations == alone.evaluations


def test_lanes_begin_at_steps_of_their_own_and_one_that_diverges_is_told(groups: list[int]) -> None:
    first, _, states = variants(SEEDS[0], 17)
    start, values = METHOD.start(first, *np.split(states[0, : first.n_positions + first.n], 2)), states
    values = METHOD.starts(first, states)
    steps = np.array([0, 5, 0, 5, 40, 0, 0, 5, 5, 0, 5, 0, 5, 0, 0, 0, 5])
    found = METHOD.ends(first, start, values, steps, 20)
    assert groups == [2]  # eight of nine that begin at 0, seven at 5, none at 40
    number = first.compiled.numbers.size
    for row, own, step in zip(found, values, steps.tolist(), strict=True):
        system = CompiledSystem(first.compiled.with_numbers(own[-number:]))
        last = np.array([(step + 19) * METHOD.step])
        alone = METHOD.resume(system, replace(start.with_values(own[:-number]), step=step), last).end
        assert alone is not None
        assert row[:-number] == pytest.approx(alone.values, rel=1e-10, abs=1e-10)
    values[7, -number:] *= STIFFER
    with pytest.raises(StabilityError, match="central-difference diverges at t = "):
        METHOD.ends(first, start, values, steps, 200)


def test_marches_side_by_side_begin_together_and_none_is_left_out() -> None:
    first = np.repeat([0, 7, 3], [9, 1, 8])
    rows, alone = arrange_lanes(first)
    assert rows.shape == (2, 8)
    assert first[alone].tolist() == [0, 7]
    assert sorted([*np.unique(rows).tolist(), *alone.tolist()]) == [*range(18)]
    assert all(len({*first[row].tolist()}) == 1 for row in rows)
