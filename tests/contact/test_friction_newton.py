"""Friction of many points by Newton's method: Signorini's and Coulomb's conditions, from the flexibility by NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController

from fmd.contact.half_space import half_space_flexibility
from fmd.contact.touching_body import ContactPlane, ContactPoints, TouchingBody
from fmd.core.arrays import Array
from fmd.core.limits.contact import KNOWN_RESPONSES
from fmd.dynamics.compiled_system.shared import share_system
from fmd.dynamics.links import Link, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.system import remember_contacts
from fmd.integrators import fixed_step
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.protocol import evaluate
from fmd.kernels.kernel import kernel
from fmd.scene.joints.free import FREE

FRICTION, SUNK = 0.5, 1e-3


@kernel
def remember(p: Any, t: float, q: Array, v: Array) -> None:
    remember_contacts(p, t, q, v)


class Column:
    """A rigid plate on a square foot of n × n points before a half-space of E 1 on a column, which bends and shears."""

    def __init__(self, n: int, height: float, friction: float = FRICTION) -> None:
        self.friction = friction
        at = np.arange(n) - 0.5 * (n - 1)
        x = np.stack([*(own.ravel() for own in np.meshgrid(at, at, indexing="ij")), np.zeros(n * n)], axis=1)
        axes = [1, 2, 0]  # the inward normal is z
        self.G = half_space_flexibility(x[:, :2], (1.0, 1.0), 1.0, 0.3)[:, axes][..., axes].copy()
        length, second = height * n, n**4 / 12
        bent, sheared = length**2 / (2 * second), length**3 / (3 * second) + 2.6 * length / n**2
        for a in range(2):  # turns and moves of the column's end by forces aside and along it
            turn, aside = np.zeros((n * n, 3)), np.zeros((n * n, 3))
            turn[:, 2], aside[:, a] = x[:, a], 1.0
            for u, v, soft in ((turn, turn, length / second), (aside, aside, sheared), (turn, aside, bent)):
                self.G += soft * np.einsum("ia,jb->iajb", u, v)
                self.G += soft * np.einsum("ia,jb->iajb", v, u) if u is not v else 0.0
        foot = ContactPoints(x, {"foot": np.ones(n * n)}, np.zeros((n * n, 3, 0)), self.G, {"foot": np.arange(n * n)})
        plane = ContactPlane("floor", np.zeros(3), np.array([0.0, 0.0, 1.0]), friction, "foot")
        link = Link("plate", rigid_integrals(1.0, np.zeros(3), np.eye(3)), FREE)
        self.mechanism = Mechanism([link], contacts=[TouchingBody("plate", foot, (plane,))])
        self.system = share_system(self.mechanism)
        self.parameters = self.system.parameters
        self.step(sunk=-1.0)

    def step(self, sunk: float, aside: Array | float = 0.0, turn: Array | float = 0.0) -> tuple[Array, float]:
        """Go on to a place; return forces (n_points, 3), and how far they are from the conditions, over the largest."""
        p, c, q, v = self.parameters, self.parameters.contact, self.mechanism.rest_positions, np.zeros(6)
        q[:2], q[2], q[3:6] = aside, -sunk, 0.5 * np.asarray(turn)
        q[6] = np.sqrt(1.0 - q[3:6] @ q[3:6])
        t = 1.0 if np.isnan(c.clock[0]) else c.clock[0] + 1.0
        evaluate(p, t, q, v, np.zeros(6))
        assert c.clock[1] == 0.0
        force = c.force.copy()
        D = np.einsum("ika,iajb,jlb->ikjl", c.turned, self.G, c.turned)
        pull = force - (c.free + np.einsum("ikjl,jl->ik", D, force)) / D.max()
        normal, size = np.maximum(0.0, pull[:, 0]), np.linalg.norm(pull[:, 1:], axis=1)
        share = np.minimum(1.0, self.friction * normal / np.maximum(size, 1e-300))
        fault = force - np.column_stack([normal, share[:, None] * pull[:, 1:]])
        remember(p, t, q, v)
        return force, float(np.abs(fault).max() / max(force[:, 0].max(), 1e-300))


@pytest.mark.parametrize("height", [0.0, 1.0, pytest.param(8.0, marks=pytest.mark.long)])
def test_forces_of_random_steps_keep_gaps_cones_and_directions(height: float) -> None:
    """Steps that press, push, rock and twist a column, as points open, stick and slip, some by sweeps, some not."""
    column, rng, states = Column(8, height), np.random.default_rng(34), np.zeros(3)
    place, aside, turn = SUNK, np.zeros(2), np.zeros(3)
    for k in range(24):
        size = (1e-3, 1e-1, 1.0)[k % 3]
        place, aside = SUNK * (1.0 + 0.2 * size * rng.standard_normal()), aside + 1e-4 * size * rng.standard_normal(2)
        turn = (1.0 - size) * turn + 6e-4 * size * rng.standard_normal(3)
        force, fault = column.step(place, aside, turn)
        assert fault < 1e-8
        held = np.linalg.norm(force[:, 1:], axis=1) < FRICTION * force[:, 0] * (1.0 - 1e-9)
        pressed = force[:, 0] > 0.0
        states += [(~pressed).sum(), (pressed & held).sum(), (pressed & ~held).sum()]
    assert column.parameters.contact.inverted[0] == 1
    assert (states > 30).all()


@pytest.mark.parametrize("height", [32.0, 1000.0])
def test_a_tall_column_settles_at_once_as_it_twists(height: float) -> None:
    """By points' flexibilities with all others held: their own are mostly the column's, thousands of times as large."""
    column = Column(12, height)
    column.step(SUNK)
    for k in range(1, 7):
        _, fault = column.step(SUNK, 0.0, np.array([0.0, 0.0, k * 2.5e-5]))
        assert fault < 1e-8
    assert column.parameters.contact.swept[0] == 0


def test_the_first_touch_before_a_plane_takes_no_sweeps() -> None:
    """Its stiffness is known before, and what has come below the plane is taken to stick."""
    column = Column(12, 1.0)
    _, fault = column.step(SUNK, np.array([3e-4, 1e-4]))
    assert fault < 1e-8
    assert column.parameters.contact.swept[0] == 0


def test_a_foot_that_sticks_takes_no_more_products_once_its_motion_is_known() -> None:
    """13 combinations of a body's place and turn; of few turns fewer count."""
    column, rng, known = Column(8, 1.0), np.random.default_rng(5), []
    for _ in range(40):
        move = 1e-8 * rng.standard_normal(6)
        _, fault = column.step(SUNK + move[2], move[:2], move[3:])
        assert fault < 1e-8
        known.append(int(column.parameters.contact.n_known[0]))
    assert known[20] == known[-1] <= 13


def test_without_friction_nothing_is_solved_once_the_motion_of_the_pressed_points_is_known() -> None:
    """Gaps of a plane's foot have three combinations; where no more are kept, others take their place."""
    column, rng, known = Column(8, 1.0, 0.0), np.random.default_rng(6), []
    c = column.parameters.contact
    for k in range(20):
        move = 1e-8 * rng.standard_normal(6) * [1, 1, 1, 1e-3, 1e-3, 1e-3]  # normals are kept for 1e-4
        _, fault = column.step(SUNK + move[2], move[:2], move[3:])
        assert fault < 1e-9
        known.append(int(c.n_pressed[0]))
        c.n_pressed[0] = KNOWN_RESPONSES if k == 0 else c.n_pressed[0]
    assert known[:2] == [1, 2]  # for a step's end is looked at twice
    assert known[6] == known[-1] <= 4
    tilts = (0, 3, 6, 4, 2, 5, 1, 0, 7)  # points open and close
    rocks = [column.step(SUNK, 0.0, np.array([0.0, 2e-4 * k, 0.0])) for k in tilts]
    assert max(fault for _, fault in rocks) < 1e-9
    assert (rocks[-1][0][:, 0] == 0.0).sum() > 8


def test_marches_with_contacts_have_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two, each waits for the other: steps of 144 points took ten times as long."""
    march, seen, column = fixed_step._march, list[set[int]](), Column(2, 1.0)
    of_numpy = [pool.filepath for pool in ThreadpoolController().lib_controllers if "numpy" in pool.filepath]
    pools = ThreadpoolController().select(filepath=of_numpy)

    def spy(*arguments: Any) -> Any:
        seen.append({pool.num_threads for pool in pools.lib_controllers})
        return march(*arguments)

    monkeypatch.setattr(fixed_step, "_march", spy)
    with pools.limit(limits=2):
        q, v = column.system.mechanism.rest_positions, np.zeros(6)
        CentralDifference(1e-3).march(column.system, q, v, np.array([2e-3]))
        assert seen[-1] == {1}
        assert all(pool.num_threads == 2 for pool in pools.lib_controllers)
