"""Open chains of rigid bodies against closed forms and against published equations of motion.

Rod and slider of Miao, Zhu, Shi & Chen (Comput Mech 41, 2008), double pendulum, free body of Euler and Jacobi, heavy
symmetric top, free fall, welded bodies.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from scipy.special import ellipj, ellipk

from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.links import Link, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import constant
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.protocol import evaluate
from fmd.integrators.scipy_ivp import ScipyIvp
from fmd.integrators.subcycling import Subcycling
from fmd.reduction.body import MarkerShapes
from fmd.scene.joints.fixed import FIXED
from fmd.scene.joints.free import FREE
from fmd.scene.joints.prismatic import PRISMATIC
from fmd.scene.joints.revolute import REVOLUTE
from fmd.scene.joints.spherical import SPHERICAL

X, Y, Z = np.eye(3)
NOWHERE = np.zeros(3)
G = 9.81
DOWN = -G * Z
CLOSELY = ScipyIvp("DOP853", 1e-12)
BOTH = pytest.mark.parametrize("method", [CLOSELY, CentralDifference(1e-3)], ids=["dop853", "central-difference"])


def compiled(tree: CompiledSystem, q: Array, v: Array) -> Array:
    a = np.full(tree.n, np.nan)
    evaluate(tree.parameters, 0.0, np.asarray(q, dtype=float), np.asarray(v, dtype=float), a)
    return a


def by_hand(accelerations: Callable[[Array, Array], Sequence[float]], q0: Array, v0: Array, times: Array) -> Array:
    """Positions by SciPy's DOP853, shape (n_times, n)."""
    n = len(q0)
    solution = solve_ivp(
        lambda t, y: np.r_[y[n:], accelerations(y[:n], y[n:])],
        (0.0, times[-1]),
        np.r_[q0, v0],
        method="DOP853",
        rtol=1e-12,
        atol=1e-16,
        t_eval=times,
    )
    return np.asarray(solution.y[:n].T)


def order_of(steps: Array, errors: Sequence[float]) -> float:
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


def box_inertia(mass: float, sizes: Sequence[float]) -> Array:
    """Inertia tensor of a box about its centre: m (b² + c²)/12 about a."""
    squares = np.square(sizes)
    return np.asarray(np.diag(mass * (squares.sum() - squares) / 12))


# Rod and slider --------------------------------------------------------------------------------------------------

TORQUE = 100 * np.pi / 180  # N m: the paper's 100, taken per degree
TEN_SECONDS = np.linspace(0.0, 10.0, 1001)
START = np.array([0.0, 0.15]), np.zeros(2)


@pytest.fixture(scope="module")
def rod_slider() -> CompiledSystem:
    """A rod of 2 m and 2 kg; 5 kg on it, 1 m from the joint, held there by 1000 N/m."""
    rod = rigid_integrals(2.0, X, np.diag([0.0, 2 / 3, 2 / 3]))  # m l²/12 across
    slider = rigid_integrals(5.0, NOWHERE, np.zeros((3, 3)))
    links = [
        Link("rod", rod, REVOLUTE, axis=Z, load=constant(TORQUE)),
        Link("slider", slider, PRISMATIC, 0, place=MarkerShapes(X), axis=X, spring=1000.0),
    ]
    return CompiledSystem(Mechanism(links, fast_joints=["slider"]))


def rod_slider_by_hand(q: Array, v: Array) -> Sequence[float]:
    """Lagrange's equations of ``T = ½ (m l²/3 + M r²) θ̇² + ½ M ẋ²`` with r = 1 m + x, V = ½ k x² and the torque."""
    r = 1.0 + q[1]
    return (TORQUE - 2 * 5 * r * v[1] * v[0]) / (2 * 2**2 / 3 + 5 * r**2), r * v[0] ** 2 - 1000 * q[1] / 5


@pytest.fixture(scope="module")
def rod_slider_motion() -> Array:
    return by_hand(rod_slider_by_hand, *START, TEN_SECONDS)


def test_rod_and_slider_obey_lagranges_equations(rod_slider: CompiledSystem) -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        q, v = rng.normal(size=(2, 2))
        assert compiled(rod_slider, q, v) == pytest.approx(rod_slider_by_hand(q, v), rel=1e-13)


def test_rod_and_slider_move_as_by_lagranges_equations(rod_slider: CompiledSystem, rod_slider_motion: Array) -> None:
    march = CLOSELY.march(rod_slider, *START, TEN_SECONDS)
    assert march.q == pytest.approx(rod_slider_motion, abs=1e-11)


def test_the_rod_turns_as_far_as_in_the_papers_fourth_figure(
    rod_slider: CompiledSystem, rod_slider_motion: Array
) -> None:
    # With the slider on its place the inertia is 2·2²/3 + 5·1² = 7.667 kg m² and ½ τ/J t² is 652° at 10 s. The slider's
    # vibration and the stretch of the spring, some mm, change that by less than 1 %.
    held = np.degrees(0.5 * TORQUE / (2 * 2**2 / 3 + 5) * 10**2)
    assert held == pytest.approx(652.2, abs=0.05)
    assert np.degrees(rod_slider_motion[-1, 0]) == pytest.approx(held, rel=0.01)
    for method in (CentralDifference(1e-3), Subcycling(1e-3, 5), Subcycling(1e-3, 10)):
        march = method.march(rod_slider, *START, TEN_SECONDS)
        assert np.degrees(march.q[-1, 0]) == pytest.approx(held, rel=0.01)
        assert np.abs(march.q[:, 1]).max() < 0.2  # figs. 5 and 7


def test_central_difference_is_of_second_order_on_rod_and_slider(
    rod_slider: CompiledSystem, rod_slider_motion: Array
) -> None:
    steps = 1e-3 / 2.0 ** np.arange(4)
    marches = [CentralDifference(step).march(rod_slider, *START, TEN_SECONDS) for step in steps]
    for coordinate in (0, 1):
        errors = [np.abs(march.q - rod_slider_motion)[:, coordinate].max() for march in marches]
        assert order_of(steps, errors) == pytest.approx(2, abs=0.1)


@pytest.mark.parametrize("m", [5, 10])
def test_sub_cycling_is_of_its_declared_order_on_rod_and_slider(
    rod_slider: CompiledSystem, rod_slider_motion: Array, m: int
) -> None:
    # Rod and slider don't couple through the mass matrix, and a cycle holds how the centrifugal force changes.
    assert Subcycling(1.0, m).order(rod_slider) == 2
    steps = 5e-4 / 2.0 ** np.arange(4)
    marches = [Subcycling(step, m).march(rod_slider, *START, TEN_SECONDS) for step in steps]
    errors = [np.abs(march.q - rod_slider_motion)[:, 1].max() for march in marches]
    assert order_of(steps, errors) == pytest.approx(2, abs=0.1)


def test_one_spring_sets_the_frequency_of_the_fast_set(rod_slider: CompiledSystem) -> None:
    # √(k/M) with the rod held
    assert rod_slider.highest_fast_frequency == pytest.approx(np.sqrt(1000 / 5), rel=1e-14)
    assert rod_slider.n_slow == 1


# Double pendulum -------------------------------------------------------------------------------------------------


class Pendulum(NamedTuple):
    """One of two: mass, length to the next joint, distance of its centre of mass, inertia about that."""

    mass: float
    length: float
    centre: float
    inertia: float


PENDULA = {
    "points": (Pendulum(1.3, 0.7, 0.7, 0.0), Pendulum(0.8, 1.1, 1.1, 0.0)),
    "rods": (Pendulum(1.3, 0.7, 0.35, 1.3 * 0.7**2 / 12), Pendulum(0.8, 1.1, 0.55, 0.8 * 1.1**2 / 12)),
}


@pytest.fixture(scope="module", params=PENDULA.values(), ids=PENDULA.keys())
def pendula(request: pytest.FixtureRequest) -> tuple[Pendulum, Pendulum]:
    return request.param  # type: ignore[no-any-return]


def double_pendulum(one: Pendulum, two: Pendulum) -> CompiledSystem:
    """Hanging along -y at angle 0, turning about z; the second joint's angle is relative to the first body."""
    integrals = [
        rigid_integrals(part.mass, -part.centre * Y, part.inertia * np.diag([1.0, 0.0, 1.0])) for part in (one, two)
    ]
    links = [
        Link("one", integrals[0], REVOLUTE),
        Link("two", integrals[1], REVOLUTE, 0, place=MarkerShapes(-one.length * Y)),
    ]
    return CompiledSystem(Mechanism(links, gravity=-G * Y))


def pendulum_by_lagrange(one: Pendulum, two: Pendulum) -> Callable[[Array, Array], Array]:
    """Lagrange's equations in the angles φ from the vertical; see `test_a_double_pendulum_…` for the source."""

    def accelerations(phi: Array, rate: Array) -> Array:
        coupling = two.mass * one.length * two.centre
        c, s = np.cos(phi[0] - phi[1]), np.sin(phi[0] - phi[1])
        M = np.array(
            [
                [one.inertia + one.mass * one.centre**2 + two.mass * one.length**2, coupling * c],
                [coupling * c, two.inertia + two.mass * two.centre**2],
            ]
        )
        Q = [
            -coupling * s * rate[1] ** 2 - (one.mass * one.centre + two.mass * one.length) * G * np.sin(phi[0]),
            coupling * s * rate[0] ** 2 - two.mass * two.centre * G * np.sin(phi[1]),
        ]
        return np.asarray(np.linalg.solve(M, Q))

    return accelerations


def test_a_double_pendulum_obeys_lagranges_equations(pendula: tuple[Pendulum, Pendulum]) -> None:
    # Landau & Lifshitz, Mechanics, §5, problem 1: L = ½ (m₁ + m₂) l₁² φ̇₁² + ½ m₂ l₂² φ̇₂² + m₂ l₁ l₂ φ̇₁ φ̇₂ cos(φ₁ - φ₂)
    # + (m₁ + m₂) g l₁ cos φ₁ + m₂ g l₂ cos φ₂ for points; a body has its centre's distance for l in its own terms, and
    # ½ I φ̇² besides.
    tree, lagrange = double_pendulum(*pendula), pendulum_by_lagrange(*pendula)
    rng = np.random.default_rng(1)
    for _ in range(20):
        phi, rate = rng.uniform(-np.pi, np.pi, 2), 3.0 * rng.normal(size=2)
        want = lagrange(phi, rate)
        found = compiled(tree, np.r_[phi[0], phi[1] - phi[0]], np.r_[rate[0], rate[1] - rate[0]])
        assert np.cumsum(found) == pytest.approx(want, rel=1e-12, abs=1e-12 * np.abs(want).max())


def test_a_double_pendulum_moves_as_by_lagranges_equations(pendula: tuple[Pendulum, Pendulum]) -> None:
    # Thrown from 2 rad and 2.5 rad it tumbles: errors grow a hundredfold a second, so over 3 s only.
    phi, times = np.array([2.0, 2.5]), np.linspace(0.0, 3.0, 31)
    want = by_hand(pendulum_by_lagrange(*pendula), phi, np.zeros(2), times)
    march = CLOSELY.march(double_pendulum(*pendula), np.r_[phi[0], phi[1] - phi[0]], np.zeros(2), times)
    assert np.ptp(want, axis=0).min() > 1.0
    assert np.cumsum(march.q, axis=1) == pytest.approx(want, abs=1e-8)


# Free body -------------------------------------------------------------------------------------------------------

INERTIA = np.array([1.0, 2.0, 3.0])
MASS = 2.5


class Tumble(NamedTuple):
    """Euler's free body by Jacobi: Landau & Lifshitz, Mechanics, §37, for M² > 2 E I₂."""

    energy: float
    momentum2: float

    @property
    def modulus2(self) -> float:
        """k²."""
        a, b, c = INERTIA
        E, M2 = self.energy, self.momentum2
        return (b - a) * (2 * E * c - M2) / ((c - b) * (M2 - 2 * E * a))

    @property
    def pace(self) -> float:
        """τ/t."""
        a, b, c = INERTIA
        return float(np.sqrt((c - b) * (self.momentum2 - 2 * self.energy * a) / (a * b * c)))

    @property
    def period(self) -> float:
        """4 K/pace; the middle axis turns over twice in it."""
        return float(4 * ellipk(self.modulus2) / self.pace)

    def spin(self, t: Array) -> Array:
        """Angular velocity along the principal axes, shape (…, 3)."""
        a, b, c = INERTIA
        E, M2 = self.energy, self.momentum2
        sn, cn, dn, _ = ellipj(self.pace * np.asarray(t), self.modulus2)
        return np.stack(
            [
                np.sqrt((2 * E * c - M2) / (a * (c - a))) * cn,
                np.sqrt((2 * E * c - M2) / (b * (c - b))) * sn,
                np.sqrt((M2 - 2 * E * a) / (c * (c - a))) * dn,
            ],
            axis=-1,
        )


# Near the separatrix, M² = 2 E I₂, where the body lingers about its middle axis.
TUMBLE = Tumble(energy=4.0, momentum2=2 * 4.0 * 2.0 * (1 + 1e-3))
WHERE = np.array([0.1, -0.2, 0.3])  # centre of mass


def free_body(centre: Array = NOWHERE, gravity: Array = NOWHERE) -> CompiledSystem:
    body = Link("body", rigid_integrals(MASS, centre, np.diag(INERTIA)), FREE)
    return CompiledSystem(Mechanism([body], gravity=gravity))


def thrown(centre: Array, spin: Array, velocity: Array) -> tuple[Array, Array]:
    """Start with the centre of mass at the origin and the body's axes along the ground's."""
    return np.r_[-centre, 0.0, 0.0, 0.0, 1.0], np.r_[velocity - np.cross(spin, centre), spin]


@pytest.mark.parametrize("centre", [NOWHERE, WHERE], ids=["centre", "elsewhere"])
def test_a_thrown_body_spins_as_jacobis_functions_and_falls_as_a_parabola(centre: Array) -> None:
    # Weight has no moment about the centre of mass; what point of the body carries its frame doesn't matter.
    tree, velocity = free_body(centre, DOWN), np.array([1.0, -2.0, 3.0])
    times = np.linspace(0.0, 2 * TUMBLE.period, 81)
    march = CLOSELY.march(tree, *thrown(centre, TUMBLE.spin(np.zeros(1))[0], velocity), times)
    assert march.v[:, 3:] == pytest.approx(TUMBLE.spin(times), abs=1e-8)
    found = march.q[:, :3] + Rotation.from_quat(march.q[:, 3:]).apply(centre)
    assert found == pytest.approx(np.outer(times, velocity) + 0.5 * np.outer(times**2, DOWN), abs=1e-8)


def test_the_middle_axis_turns_over_with_the_period_of_the_elliptic_integral() -> None:
    # The angular momentum, fixed in space, is along the middle axis up to cn, dn ≈ 0 at a quarter of the period, and
    # against it at three quarters.
    T = TUMBLE.period
    assert TUMBLE.modulus2 == pytest.approx(1, abs=0.01)
    start = thrown(NOWHERE, TUMBLE.spin(np.zeros(1))[0], NOWHERE)
    march = CLOSELY.march(free_body(), *start, T * np.array([0.0, 0.25, 0.5, 0.75, 1.0]))
    momentum = np.array([0.0, INERTIA[1] * TUMBLE.spin(np.array([T / 4]))[0, 1], 0.0])
    assert np.linalg.norm(momentum) / np.sqrt(TUMBLE.momentum2) > 0.99
    body = Rotation.from_quat(march.q[:, 3:])
    in_space = body.apply(INERTIA * march.v[:, 3:])
    assert in_space == pytest.approx(np.tile(INERTIA * TUMBLE.spin(np.zeros(1))[0], (5, 1)), abs=1e-9)
    along = body.apply(Y) @ in_space[0] / np.linalg.norm(in_space[0])
    top = momentum[1] / np.sqrt(TUMBLE.momentum2)
    assert along == pytest.approx([0.0, top, 0.0, -top, 0.0], abs=1e-8)
    assert march.v[-1] == pytest.approx(march.v[0], abs=1e-8)


def test_momentum_and_energy_of_a_free_body_drift_at_second_order_of_the_step() -> None:
    # Euler's equations conserve both; central differences take the gyroscopic moment at an extrapolated rate.
    momentum, energy = np.transpose([drift_of_a_spin(INERTIA, step) for step in STEPS])
    assert order_of(STEPS, momentum) == pytest.approx(2, abs=0.1)
    assert order_of(STEPS, energy) == pytest.approx(2, abs=0.1)


def test_the_energy_of_a_symmetric_free_body_drifts_at_third_order_of_the_step() -> None:
    # Its rates turn about the axis of symmetry, ω̇ = iΩω. The extrapolation is that of Adams and Bashforth, whose method
    # errs by h² in the phase of such an oscillator and by h³ in its amplitude: that alone has to do with the energy.
    momentum, energy = np.transpose([drift_of_a_spin(np.array([2.0, 2.0, 3.0]), step) for step in STEPS])
    assert order_of(STEPS, momentum) == pytest.approx(2, abs=0.1)
    assert order_of(STEPS, energy) == pytest.approx(3, abs=0.1)


STEPS = 0.01 / 2.0 ** np.arange(4)


def drift_of_a_spin(inertia: Array, step: float) -> tuple[float, float]:
    """Largest change of angular momentum in space and of energy over 10 s."""
    tree = CompiledSystem(Mechanism([Link("body", rigid_integrals(MASS, NOWHERE, np.diag(inertia)), FREE)]))
    start = thrown(NOWHERE, np.array([1.5, 0.7, -1.1]), NOWHERE)
    march = CentralDifference(step).march(tree, *start, np.linspace(0.0, 10.0, 101))
    momentum = Rotation.from_quat(march.q[:, 3:]).apply(inertia * march.v[:, 3:])
    energy = 0.5 * march.v[:, 3:] ** 2 @ inertia
    return float(np.linalg.norm(momentum - momentum[0], axis=1).max()), float(np.abs(energy - energy[0]).max())


def test_central_difference_follows_jacobis_functions_at_second_order() -> None:
    start = thrown(NOWHERE, TUMBLE.spin(np.zeros(1))[0], NOWHERE)
    times, steps = np.linspace(0.0, TUMBLE.period, 41), 0.004 / 2.0 ** np.arange(4)
    marches = [CentralDifference(step).march(free_body(), *start, times) for step in steps]
    errors = [np.abs(march.v[:, 3:] - TUMBLE.spin(times)).max() for march in marches]
    assert order_of(steps, errors) == pytest.approx(2, abs=0.1)


def test_a_quaternion_stays_unit_over_a_hundred_thousand_steps() -> None:
    start = thrown(WHERE, np.array([3.0, -4.0, 5.0]), NOWHERE)
    march = CentralDifference(1e-3).march(free_body(WHERE), *start, np.linspace(0.0, 100.0, 100_001))
    assert march.end.step >= 100_000
    assert np.abs(np.linalg.norm(march.q[:, 3:], axis=1) - 1).max() < 1e-14


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_steady_spin_about_a_principal_axis_is_exact_at_any_step(axis: int) -> None:
    # A quarter turn a step and more: a rotation's step is its own exponential.
    spin, step = 1.7 * np.eye(3)[axis], 1.0
    times = step * np.arange(101)
    march = CentralDifference(step).march(free_body(), *thrown(NOWHERE, spin, NOWHERE), times)
    assert np.array_equal(march.v[:, 3:], np.tile(spin, (101, 1)))
    want = np.column_stack([np.outer(np.sin(0.85 * times), np.eye(3)[axis]), np.cos(0.85 * times)])
    assert march.q[:, 3:] == pytest.approx(want, abs=1e-13)


# Heavy top -------------------------------------------------------------------------------------------------------

TOP_MASS, TOP_CENTRE, TOP_ACROSS, TOP_ALONG = 1.2, 0.4, 0.05, 0.03  # kg, m; kg m² about the centre of mass
TILT, TOP_SPIN = 0.6, 100.0  # rad; rad/s about its own axis, in space


@pytest.fixture(scope="module")
def top() -> CompiledSystem:
    integrals = rigid_integrals(TOP_MASS, TOP_CENTRE * Z, np.diag([TOP_ACROSS, TOP_ACROSS, TOP_ALONG]))
    return CompiledSystem(Mechanism([Link("top", integrals, SPHERICAL)], gravity=DOWN))


@pytest.fixture(scope="module", params=[0, 1], ids=["slow", "fast"])
def precession(request: pytest.FixtureRequest) -> float:
    """Steady rate Ω about the vertical: ``I₁ cos θ Ω² − I₃ ω₃ Ω + m g l = 0`` (Goldstein, Classical Mechanics, §5.7).

    I₁ is about the joint. The slow root is nearly m g l/(I₃ ω₃).
    """
    about_joint = TOP_ACROSS + TOP_MASS * TOP_CENTRE**2
    roots = np.roots([about_joint * np.cos(TILT), -TOP_ALONG * TOP_SPIN, TOP_MASS * G * TOP_CENTRE])
    assert np.isreal(roots).all()
    return float(np.sort(roots)[request.param])


def precessing(rate: float) -> tuple[Array, Array]:
    """Top's axis in the plane of x and z; its angular velocity Ω ẑ + (ω₃ − Ω cos θ) along its own axis."""
    body = Rotation.from_rotvec(TILT * Y)
    spin = body.inv().apply(rate * Z) + (TOP_SPIN - rate * np.cos(TILT)) * Z
    return body.as_quat(), spin


def top_axis(rate: float, times: Array) -> Array:
    turn = rate * times
    return np.column_stack(
        [np.sin(TILT) * np.cos(turn), np.sin(TILT) * np.sin(turn), np.full(times.size, np.cos(TILT))]
    )


def test_a_top_precesses_steadily_at_the_rate_of_the_closed_form(top: CompiledSystem, precession: float) -> None:
    times = np.linspace(0.0, 2 * np.pi / precession, 21)  # once around
    march = CLOSELY.march(top, *precessing(precession), times)
    axis = Kinematics(top.mechanism, times, march.q, march.v).frames[0].rotation @ Z
    assert axis == pytest.approx(top_axis(precession, times), abs=1e-8)
    assert march.v[:, 2] == pytest.approx(np.full(21, TOP_SPIN), rel=1e-12)  # no moment about a top's own axis


def test_central_difference_precesses_a_top_at_second_order(top: CompiledSystem, precession: float) -> None:
    times, steps = np.linspace(0.0, 1.0, 11), 1e-3 / 2.0 ** np.arange(4)
    errors = []
    for step in steps:
        march = CentralDifference(step).march(top, *precessing(precession), times)
        axis = Rotation.from_quat(march.q).apply(Z)
        errors.append(np.abs(axis - top_axis(precession, times)).max())
    assert order_of(steps, errors) == pytest.approx(2, abs=0.1)


# Fall and weld ---------------------------------------------------------------------------------------------------


@BOTH
def test_a_body_falls_freely_on_a_parabola(method: CentralDifference | ScipyIvp) -> None:
    # Of constant accelerations central differences make no error, between the steps neither.
    times, velocity = np.sort(np.random.default_rng(2).uniform(0.0, 3.0, 50)), np.array([1.0, -2.0, 3.0])
    start = thrown(NOWHERE, NOWHERE, velocity)
    march = method.march(free_body(gravity=DOWN), *start, times)
    assert march.q[:, :3] == pytest.approx(np.outer(times, velocity) + 0.5 * np.outer(times**2, DOWN), abs=1e-11)
    assert march.v[:, :3] == pytest.approx(velocity + np.outer(times, DOWN), abs=1e-11)
    assert np.array_equal(march.q[:, 3:], np.tile([0.0, 0.0, 0.0, 1.0], (50, 1)))


@BOTH
def test_a_body_slides_down_an_incline(method: CentralDifference | ScipyIvp) -> None:
    # s = ½ (g·e) t² along the axis e, whatever the body's inertia.
    axis = np.array([0.6, 0.0, -0.8])
    integrals = rigid_integrals(MASS, WHERE, np.diag(INERTIA))
    sledge = Link("sledge", integrals, PRISMATIC, place=MarkerShapes(np.array([1.0, 2.0, 3.0])), axis=axis)
    tree = CompiledSystem(Mechanism([sledge], gravity=DOWN))
    times = np.linspace(0.0, 2.0, 21)
    march = method.march(tree, np.zeros(1), np.zeros(1), times)
    assert march.q[:, 0] == pytest.approx(0.5 * 0.8 * G * times**2, abs=1e-11)
    origin = Kinematics(tree.mechanism, times, march.q, march.v).frames[0].origin
    assert origin[-1] == pytest.approx([1.0, 2.0, 3.0] + march.q[-1, 0] * axis)


def test_a_body_on_a_spring_and_a_damper_swings_out_about_its_weight() -> None:
    # s = s₀ (1 − exp(−ζωt) (cos ω_d t + ζω/ω_d sin ω_d t)) with k s₀ = m g, ω² = k/m, 2ζω = c/m: a step response.
    spring, damper = 100.0, 4.0
    integrals = rigid_integrals(MASS, WHERE, np.diag(INERTIA))
    weight = Link("weight", integrals, PRISMATIC, axis=-Z, spring=spring, damper=damper)
    tree = CompiledSystem(Mechanism([weight], gravity=DOWN))
    times, decay = np.linspace(0.0, 3.0, 31), damper / (2 * MASS)
    omega = np.sqrt(spring / MASS - decay**2)
    swing = np.exp(-decay * times) * (np.cos(omega * times) + decay / omega * np.sin(omega * times))
    march = CLOSELY.march(tree, np.zeros(1), np.zeros(1), times)
    assert march.q[:, 0] == pytest.approx(MASS * G / spring * (1 - swing), abs=1e-11)


def boxes_welded() -> tuple[list[Link], list[Link]]:
    """Two boxes with a fixed joint between them, on a free joint; and one body of the same inertia."""
    place, centres = np.array([0.5, -0.3, 0.2]), (np.array([0.1, 0.2, 0.0]), np.array([0.0, 0.4, -0.1]))
    masses = 2.0, 3.0
    inertias = box_inertia(2.0, (1.0, 0.5, 0.2)), box_inertia(3.0, (0.3, 0.8, 0.6))
    at = centres[0], place + centres[1]
    centre = (masses[0] * at[0] + masses[1] * at[1]) / 5.0
    total = np.zeros((3, 3))
    for mass, inertia, where in zip(masses, inertias, at, strict=True):  # Steiner
        arm = where - centre
        total += inertia + mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    integrals = [rigid_integrals(mass, c, inertia) for mass, c, inertia in zip(masses, centres, inertias, strict=True)]
    two = [Link("one", integrals[0], FREE), Link("two", integrals[1], FIXED, 0, place=MarkerShapes(place))]
    return two, [Link("one", rigid_integrals(5.0, centre, total), FREE)]


def test_two_welded_bodies_are_one_of_summed_inertia() -> None:
    two, one = (CompiledSystem(Mechanism(links, gravity=DOWN)) for links in boxes_welded())
    rng, times = np.random.default_rng(3), np.linspace(0.0, 1.0, 11)
    for _ in range(5):
        e = rng.normal(size=4)
        q, v = np.r_[rng.normal(size=3), e / np.linalg.norm(e)], rng.normal(size=6)
        assert two.mass_matrix(q) == pytest.approx(one.mass_matrix(q), abs=1e-13)
        want = compiled(one, q, v)
        assert compiled(two, q, v) == pytest.approx(want, abs=1e-12 * np.abs(want).max())
    marches: list[Any] = [CentralDifference(1e-3).march(tree, q, v, times) for tree in (two, one)]
    assert marches[0].q == pytest.approx(marches[1].q, abs=1e-11)


@pytest.mark.parametrize("joint", [REVOLUTE, SPHERICAL, PRISMATIC])
def test_a_body_carried_by_welded_ones_moves_as_on_one(joint: int) -> None:
    # The next joint is at the same place, seen from either body's frame.
    two, one = boxes_welded()
    place, integrals = np.array([0.2, 0.7, -0.4]), rigid_integrals(1.5, WHERE, np.diag(INERTIA))
    axis = np.array([1.0, 2.0, -2.0])
    chains = []
    for links, offset in ((two, two[1].place.position), (one, NOWHERE)):
        carried = Link("next", integrals, joint, len(links) - 1, place=MarkerShapes(place - offset), axis=axis)
        chains.append(CompiledSystem(Mechanism([*links, carried], gravity=DOWN)))
    rng = np.random.default_rng(4)
    q, v = rng.normal(size=chains[0].n_positions), rng.normal(size=chains[0].n)
    for first in (3, 7) if joint == SPHERICAL else (3,):
        q[first : first + 4] /= np.linalg.norm(q[first : first + 4])
    want = compiled(chains[1], q, v)
    assert compiled(chains[0], q, v) == pytest.approx(want, abs=1e-12 * np.abs(want).max())
