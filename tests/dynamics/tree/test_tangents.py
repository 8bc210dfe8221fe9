"""Derivatives of a chain's forces by its rates, against differences: exact but for round-off, as Q̂ is of degree 2."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.core.arrays import Array
from pipeline.core.formula import parse_formula
from pipeline.dynamics.links import PRISMATIC, REVOLUTE
from pipeline.dynamics.mechanism import Mechanism
from pipeline.dynamics.signals.signal import constant, formula
from pipeline.dynamics.tree.kernels import mass_and_force
from pipeline.dynamics.tree.tangents import velocity_tangents

Make = Callable[..., Any]
WEIGHT = (1.0, -2.0, -9.81)


def tangents(tree: Mechanism, q: Array, v: Array, U: Array, t: float) -> tuple[Array, Array]:
    """``−∂Q̂/∂v u`` for each row u of U, by the kernel and by differences."""
    p, n = tree.parameters, tree.n
    found = np.zeros((n, n))

    def force(rates: Array) -> Array:
        mass_and_force(p, t, q, rates)
        return p.Q.copy()

    want = np.array([-0.5 * (force(v + u) - force(v - u)) for u in U])
    force(v)
    velocity_tangents(p, t, q, v, U, 0, np.zeros((len(tree.links), n, 9)), np.zeros((9, 12)), found)
    return found, want


@pytest.mark.parametrize("seed", range(3))
def test_the_forces_slopes_along_any_rates_are_half_the_difference(chain: Make, name: str, seed: int) -> None:
    some = chain(name, gravity=WEIGHT)
    q, v = some.state(seed)
    U = np.random.default_rng(seed).normal(size=(some.tree.n, some.tree.n))
    found, want = tangents(some.tree, q, v, U, 0.0)
    assert found == pytest.approx(want, abs=1e-12 * np.abs(want).max())


@pytest.mark.parametrize("joint", [REVOLUTE, PRISMATIC])
def test_what_a_prescribed_joint_does_counts_too(chain: Make, name: str, joint: int) -> None:
    motion, none = formula(parse_formula("0.3*sin(2*t) + 0.8*t")), np.zeros(0)
    tree = chain(name).tree
    driven = {"motion": motion, "spring": 0.0, "rest": 0.0, "damper": 0.0, "load": constant(0.0)}
    links = [
        replace(link, **driven, joint_rotation=none) if link.joint == joint else link  # type: ignore[arg-type]
        for link in tree.links
    ]
    tree = Mechanism(links, gravity=tree.gravity)
    rng = np.random.default_rng(0)
    q, v = tree.rest_positions + 0.1 * rng.normal(size=tree.n_positions), rng.normal(size=tree.n)
    found, want = tangents(tree, q, v, rng.normal(size=(tree.n, tree.n)), 0.4)
    assert found == pytest.approx(want, abs=1e-12 * max(1.0, np.abs(want).max(initial=0.0)))
