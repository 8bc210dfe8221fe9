"""A slider-crank and a four-bar with a pin in a wider bore for a joint, against SciPy; and with nearly no clearance."""

from bisect import bisect_right
from cmath import exp
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fmd import Pipeline, load_scene
from fmd.contact.round_laws import DEPTH, LOAD, POWER, RoundLaw, joint_modulus, pin_law
from fmd.core.arrays import Array
from tests.contact.test_rigid_contacts import scene

CRANK, ROD, RATE = 0.05, 0.12, 100.0  # of the slider-crank that Flores and others have: lengths [m]; [rad/s]
M_ROD, I_ROD, M_SLIDER = 0.21, 2.5e-5, 0.14
I_ROCKER = 3e-4  # of a rocker in the slider's place, about its pivot [kg m²]
RADIUS, WIDTH, STEEL = 0.01, 0.02, {"E": 207e9, "nu": 0.3}


@dataclass(frozen=True)
class Follower:
    """The last body: a slider, or with a ``length`` a rocker about a ``pivot`` on the slider's way."""

    inertia: float = M_SLIDER
    length: float = 0.0
    pivot: float = 0.0

    def place(self, s: float) -> complex:
        """Return the bore's place in the plane of complex numbers."""
        return self.pivot + self.length * exp(1j * s) if self.length else complex(s)

    def lever(self, s: float) -> complex:
        """Return its velocity for a unit rate of the coordinate."""
        return 1j * self.length * exp(1j * s) if self.length else 1.0 + 0.0j

    def with_joint(self, angle: Array) -> tuple[Array, Array]:
        """Return the rod's angle and the follower's coordinate by that of the crank, without clearance."""
        x, y = CRANK * np.cos(angle), CRANK * np.sin(angle)
        if not self.length:
            s = x + np.sqrt(ROD**2 - y**2)
            return np.arctan2(-y, s - x), s
        way = np.hypot(self.pivot - x, y)
        along = (way**2 + ROD**2 - self.length**2) / (2.0 * way)
        b = np.arctan2(-y, self.pivot - x) + np.arccos(along / ROD)
        return b, np.arctan2(y + ROD * np.sin(b), x + ROD * np.cos(b) - self.pivot)

    def start(self) -> Array:
        """Rod's angle, coordinate and their rates at the start, where the crank points at the slider."""
        b, s = (float(own) for own in self.with_joint(np.array(0.0)))
        columns = np.array([-1j * ROD * exp(1j * b), self.lever(s)])
        return np.concatenate([[b, s], np.linalg.solve([columns.real, columns.imag], [0.0, RATE * CRANK])])


SLIDER, ROCKER = Follower(), Follower(I_ROCKER, length=0.08, pivot=0.1)


def linkage(follower: Follower, clearance: float, duration: float, **contact: Any) -> Pipeline:
    def axis(at: float) -> dict[str, Any]:
        return {"start": [at, 0, -WIDTH / 2], "end": [at, 0, WIDTH / 2], **STEEL}

    bodies = {
        "crank": {
            "mass": 0.3,
            "inertia": [1e-5] * 3,
            "marker": {"hub": {"at": [0, 0, 0]}, "end": {"at": [CRANK, 0, 0]}},
        },
        "rod": {
            "mass": M_ROD,
            "centre": [ROD / 2, 0, 0],
            "inertia": [I_ROD] * 3,
            "marker": {"big": {"at": [0, 0, 0]}, "small": {"at": [ROD, 0, 0]}},
            "surface": {"journal": {"type": "pin", "radius": RADIUS, **axis(ROD)}},
        },
        "last": {
            "mass": M_SLIDER,
            "inertia": [I_ROCKER] * 3,
            "marker": {"middle": {"at": [0, 0, 0]}},
            "surface": {"bore": {"type": "bore", "radius": RADIUS + clearance, **axis(follower.length)}},
        },
    }
    b, s, turn, rate = follower.start()
    z = {"type": "revolute", "axis": [0, 0, 1]}
    joints = {
        "hub": z | {"parent": "ground", "child": "crank.hub"},
        "big": z | {"parent": "crank.end", "child": "rod.big", "angle": b, "rate": turn - RATE},
        "guide": z | {"parent": "ground.pivot", "child": "last.middle", "angle": s, "rate": rate},
    }
    if not follower.length:
        slide = {"type": "prismatic", "axis": [1, 0, 0], "position": s, "rate": rate}
        joints["guide"] = slide | {"parent": "ground.pivot", "child": "last.middle"}
    fit = {"between": ["last.bore", "rod.journal"], **contact}
    own = scene({k: {"shape": "rigid"} | body for k, body in bodies.items()}, joints, {"fit": fit}, duration)
    motion = {"type": "motion", "joint": "hub", "angle": {"formula": f"{RATE}*t", "unit": "rad"}}
    own["simulation"]["tip"] = "last.middle"
    ground = {"pivot": {"at": [follower.pivot, 0, 0]}}
    return Pipeline(load_scene(own | {"drive": {"turn": motion}, "ground": ground}))


def by_scipy(follower: Follower, clearance: float, times: Array, restitution: float) -> tuple[Array, float]:
    """March the rod's angle and the follower's coordinate; return the latter and the largest force.

    The journal is a point on the rod, pushed along its line to the bore's centre; places are complex numbers. Marches
    end where the gap closes or opens. A shock's fastest speed of the approach is a state of its own, which begins with
    the speed at which the gap closes: a crank that pushes on as they touch makes it faster.
    """
    table, _ = pin_law(RADIUS, RADIUS + clearance, WIDTH, joint_modulus((207e9, 0.3), (207e9, 0.3)))
    loss, rows, largest = RoundLaw(table, restitution).loss, [[float(x) for x in row] for row in table], 0.0
    depths = [row[DEPTH] for row in rows]

    def apart(t: float, y: Array) -> tuple[complex, complex, float]:
        """Journal against bore: its place, its direction and how fast it goes along that."""
        crank, rod = CRANK * exp(1j * RATE * t), ROD * exp(1j * y[0])
        d = crank + rod - follower.place(y[1])
        n = d / max(abs(d), 1e-30)
        return d, n, ((1j * (RATE * crank + y[2] * rod) - y[3] * follower.lever(y[1])) * n.conjugate()).real

    def depth(t: float, y: Array) -> float:
        return abs(apart(t, y)[0]) - clearance

    def size(deep: float, rate: float, fastest: float) -> float:
        row = rows[max(0, bisect_right(depths, deep) - 1)]
        return max(0.0, row[LOAD] * (deep / row[DEPTH]) ** row[POWER] * (1.0 + loss * rate / max(rate, fastest, 1e-30)))

    def slopes(t: float, y: Array) -> Array:
        (d, n, rate), crank, rod = apart(t, y), CRANK * exp(1j * RATE * t), ROD * exp(1j * y[0])
        inside = abs(d) > clearance
        f = -size(abs(d) - clearance, rate, y[4]) * n if inside else 0j  # on the journal
        turn = (-1j * rod.conjugate() * (f + M_ROD / 2 * RATE**2 * crank)).real / (I_ROD + M_ROD * ROD**2 / 4)
        push = -(follower.lever(y[1]) * f.conjugate()).real / follower.inertia
        if not inside or rate < y[4]:
            return np.array([y[2], y[3], turn, push, 0.0])
        there = follower.lever(y[1])
        speed = 1j * (RATE * crank + y[2] * rod) - y[3] * there
        faster = (1j * turn - y[2] ** 2) * rod - RATE**2 * crank - push * there
        faster -= 1j * y[3] ** 2 * there if follower.length else 0.0
        along = (faster * n.conjugate()).real + (speed * n.conjugate()).imag ** 2 / abs(d)
        return np.array([y[2], y[3], turn, push, max(0.0, along)])

    depth.terminal = True  # type: ignore[attr-defined]
    t, y, inside, found = 0.0, np.append(follower.start(), 0.0), False, np.zeros(len(times))
    while t < times[-1]:
        depth.direction = -1.0 if inside else 1.0  # type: ignore[attr-defined]
        step = 5e-6 if inside else 1e-4
        run = solve_ivp(
            slopes, (t, times[-1]), y, "DOP853", events=depth, rtol=1e-9, atol=1e-12, max_step=step, dense_output=True
        )
        now = (times >= t) & (times <= run.t[-1])
        if now.any():
            found[now] = run.sol(times[now])[1]
        for at in np.linspace(t, run.t[-1], 200) if inside else ():
            state = run.sol(at)
            d, _, rate = apart(at, state)
            largest = max(largest, size(abs(d) - clearance, rate, state[4]) if abs(d) > clearance else 0.0)
        t, y, inside = float(run.t[-1]), run.y[:, -1].copy(), not inside
        y[4] = apart(t, y)[2] if inside else 0.0
    return found, largest


@pytest.mark.parametrize(
    ("follower", "duration"),
    [(SLIDER, 5e-3), pytest.param(ROCKER, 5e-3, marks=pytest.mark.long)],
    ids=["slider-crank", "four-bar"],
)
def test_a_linkage_with_a_clearance_moves_as_an_independent_model_does(follower: Follower, duration: float) -> None:
    run = linkage(follower, 0.5e-3, duration, restitution=0.9)
    own, places = run.motion.contacts["fit"], run.motion.trajectory.q[:, -1]
    exact, largest = by_scipy(follower, 0.5e-3, run.motion.times, 0.9)
    assert own.figures["largest_force_n"] > 0.0
    moved = (follower.length or 1.0) * (places - exact)
    np.testing.assert_allclose(moved, 0.0, atol=0.01 * 0.5e-3)  # of the clearance, over some shocks
    assert own.figures["largest_force_n"] == pytest.approx(largest, rel=0.01)


def test_the_pin_stays_in_its_bore_and_friction_and_loss_take_energy() -> None:
    run = linkage(SLIDER, 0.5e-3, 8e-3, restitution=0.9, friction=0.1)
    own = run.motion.contacts["fit"]
    assert own.friction_work[-1] > 0.0
    assert own.damping_work[-1] > 0.0
    assert abs(own.energy_error[-1]) < 0.01 * run.motion.energies[0].max()


@pytest.mark.parametrize("follower", [SLIDER, ROCKER], ids=["slider-crank", "four-bar"])
def test_with_little_clearance_a_contact_is_in_the_place_of_a_joint(follower: Follower) -> None:
    run = linkage(follower, 1e-5, 4e-3, restitution=0.5)
    rod, exact = follower.with_joint(RATE * run.motion.times)
    along = [(follower.lever(s) * exp(-1j * b)).real for b, s in zip(rod, exact, strict=True)]
    np.testing.assert_allclose(along * (run.motion.trajectory.q[:, -1] - exact), 0.0, atol=2e-5)
