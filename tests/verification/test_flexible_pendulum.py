"""A heavy flexible pendulum, from a scene file to its motion, against a planar model written out here.

And against the compound pendulum of a rigid body, when it is stiff; and against itself, turned in space.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from scipy.special import ellipk

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.recovery.motion import Motion
from fmd.reduction.body import FlexibleBody

pytestmark = pytest.mark.slow

G = 9.81
LENGTH, DEPTH, WIDTH, RHO = 0.34, 0.025, 0.010, 2000.0  # as models/beam.toml

PENDULUM = """
title = "Heavy flexible pendulum"

[body.bar]
shape = "bar"
length = "340 mm"
depth = "25 mm"
width = "10 mm"
E = "5 MPa"
nu = 0.34
rho = "2000 kg/m^3"
mesh = {{ divisions = [16, {across}] }}
modes = {{ count = 4, family = "in-plane bending", enrich = "none" }}
marker = {{ root = {{ face = "x-" }}, tip = {{ face = "x+" }} }}

[joint.hinge]
type = "revolute"
parent = "ground"
child = "bar.root"
axis = {axis}
angle = "{angle} rad"

[simulation]
duration = "1 s"
output_step = "10 ms"
tip = "bar.tip"
stiffening = "off"
gravity = [{gravity}]

[[simulation.run]]
integrator = "runge-kutta"
tolerance = 1e-11
"""


def pipeline_of(
    folder: Path,
    *overrides: str,
    angle: float = 0.0,
    gravity: Array | None = None,
    axis: str = "[0, 0, 1]",
    across: str = "2, 1",
) -> Pipeline:
    weight = [0.0, -G, 0.0] if gravity is None else gravity
    quantities = ", ".join(f'"{float(g)!r} m/s^2"' for g in weight)
    file = folder / "pendulum.toml"
    file.write_text(PENDULUM.format(angle=repr(angle), gravity=quantities, axis=axis, across=across))
    return Pipeline(load_scene(file, overrides))


def motion_of(pipeline: Pipeline) -> Motion:
    return pipeline.motion


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Motion:
    """The pendulum's motion from 0.3 rad."""
    return motion_of(pipeline_of(tmp_path_factory.mktemp("here"), angle=0.3))


def by_hand(body: FlexibleBody, angle: float, times: Array) -> tuple[Array, Array]:
    """Angle and modal coordinates of the pendulum from rest, (n_times,) and (n_times, n).

    With p = (1, q), ``A = G_xx + G_yy``, ``B = G_xy − G_yx``, a point at R(θ) (U_x p, U_y p) gives

        T = ½ θ̇² pᵀ A p + θ̇ pᵀ B ṗ + ½ q̇ᵀ q̇,   V = ½ qᵀ ω² q + g (sin θ c_x + cos θ c_y)

    for modes of unit mass, c being the first moments; a stiffened body has its geometric stiffness in A and a
    second-order displacement in c, and the energy ``½ s·N s + s·g q̇`` of ``s = q̇ᵀ displacement2 q`` with the inertia
    N⁻¹ of the rigid body in its plane and ``g = N W`` with its coupling W of frame and modes.
    """
    integrals, n = body.integrals, len(body.omega)
    A, B = integrals.G[0, 0] + integrals.G[1, 1], integrals.G[0, 1] - integrals.G[1, 0]
    displacement2 = integrals.displacement2[:2] if integrals.displacement2.size else np.zeros((2, n, n))
    cx, cy = integrals.S[:2, 0]
    N = np.linalg.inv([[integrals.mass, 0, -cy], [0, integrals.mass, cx], [-cy, cx, A[0, 0]]])
    g, N = (N @ np.concatenate([integrals.S[:2, 1:], B[:1, 1:]]))[:2], N[:2, :2]

    def rates(t: float, y: Array) -> Array:
        theta, q, omega, dq = y[0], y[1 : 1 + n], y[1 + n], y[2 + n :]
        p, dp = np.r_[1.0, q], np.r_[0.0, dq]
        c = integrals.S[:2] @ p + 0.5 * displacement2 @ q @ q
        slopes = integrals.S[:2, 1:] + displacement2 @ q
        h = (p @ B)[1:]
        f = displacement2 @ q
        M = np.block([[np.array([[p @ A @ p]]), h[None]], [h[:, None], np.eye(n) + g.T @ f + f.T @ g + f.T @ N @ f]])
        turning = -2 * omega * (p @ A @ dp) - G * (np.cos(theta) * c[0] - np.sin(theta) * c[1])
        bending = omega**2 * (A @ p)[1:] + 2 * omega * (B @ dp)[1:] - body.omega**2 * q
        bending -= G * (np.sin(theta) * slopes[0] + np.cos(theta) * slopes[1])
        bending -= (g + N @ f).T @ (displacement2 @ dq @ dq)
        return np.r_[omega, dq, np.linalg.solve(M, np.r_[turning, bending])]

    start = np.r_[angle, np.zeros(1 + 2 * n)]
    end = (0.0, times[-1])
    y = solve_ivp(rates, end, start, method="DOP853", rtol=1e-11, atol=1e-17, t_eval=times).y.T
    return y[:, 0], y[:, 1 : 1 + n]


@pytest.mark.parametrize("stiffening", [pytest.param("off", marks=pytest.mark.long), "on"])  # has all terms of "off"
def test_the_pendulum_moves_as_the_planar_model(tmp_path: Path, stiffening: str) -> None:
    run = pipeline_of(tmp_path, f"simulation.stiffening={stiffening}", "simulation.duration=0.65 s", angle=0.3)
    motion, body = motion_of(run), run.body
    assert body.integrals.displacement2.size == (0 if stiffening == "off" else 3 * 4 * 4)
    theta, q = by_hand(body, 0.3, motion.times)
    section = q @ body.joint_rotation
    assert motion.joint_position("hinge") == pytest.approx(theta + section, abs=1e-8)
    assert motion.modal("bar") == pytest.approx(q, abs=1e-8)
    tip = body.markers["tip"]
    R = Rotation.from_rotvec(np.outer(theta, [0, 0, 1]))
    displacement2 = tip.displacement2[:3] if tip.displacement2.size else np.zeros((3, *2 * [q.shape[1]]))
    placed = tip.position + q @ tip.translation.T + 0.5 * np.einsum("ti,kij,tj->tk", q, displacement2, q)
    assert motion.tip_position == pytest.approx(R.apply(placed), abs=1e-8)
    assert np.ptp(theta) > 2.5  # it swings through, …
    assert np.abs(motion.tip_displacement[:, 1]).max() > 1e-3  # … and bends


def test_the_pendulum_keeps_its_energy(here: Motion) -> None:
    energy = np.sum(here.energies, axis=0)
    mass = RHO * LENGTH * DEPTH * WIDTH
    assert energy[0] == pytest.approx(mass * G * LENGTH / 2 * np.sin(0.3), rel=1e-9)
    assert energy == pytest.approx(np.full(energy.size, energy[0]), abs=1e-9 * mass * G * LENGTH)


@pytest.mark.parametrize("amplitude", [0.5, 1.5])
def test_a_stiff_pendulum_has_the_period_of_the_compound_pendulum(tmp_path: Path, amplitude: float) -> None:
    # T = 4 √(J/(m g d)) K(sin² φ₀/2), J = m (L²/3 + depth²/12), d = L/2. The bar bends by the order of the square of
    # the ratio of rates, (9 rad/s)²/(2π 350 Hz)² = 2e-5.
    run = pipeline_of(tmp_path, "body.bar.E=5 GPa", "body.bar.modes.count=2", angle=amplitude - np.pi / 2)
    motion = motion_of(run)
    phi = motion.joint_position("hinge") + np.pi / 2
    period = 4 * np.sqrt((LENGTH**2 / 3 + DEPTH**2 / 12) / (G * LENGTH / 2)) * ellipk(np.sin(amplitude / 2) ** 2)
    falling = np.flatnonzero((phi[:-1] > 0) & (phi[1:] <= 0))[0]
    rising = np.flatnonzero((phi[:-1] < 0) & (phi[1:] >= 0))[0]
    crossings = [
        np.interp(0.0, sign * phi[k : k + 2], motion.times[k : k + 2]) for sign, k in ((-1, falling), (1, rising))
    ]
    assert np.diff(crossings) == pytest.approx(period / 2, rel=1e-4)
    assert crossings[0] == pytest.approx(period / 4, rel=1e-4)


# Elsewhere in space ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("turn", [0.7, -2.0])
def test_turning_start_and_weight_about_the_hinge_turns_the_motion(tmp_path: Path, here: Motion, turn: float) -> None:
    R = Rotation.from_rotvec([0.0, 0.0, turn])
    there = motion_of(pipeline_of(tmp_path, angle=0.3 + turn, gravity=R.apply([0.0, -G, 0.0])))
    assert there.joint_position("hinge") == pytest.approx(here.joint_position("hinge") + turn, abs=1e-8)
    assert there.tip_position == pytest.approx(R.apply(here.tip_position), abs=1e-8)
    assert there.tip_displacement == pytest.approx(here.tip_displacement, abs=1e-8)


def test_turning_bar_hinge_and_weight_about_the_bar_turns_the_motion(tmp_path: Path, here: Motion) -> None:
    # By 90° about x: y becomes z, and z becomes −y. The mesh is new, so modes may change their signs, not the motion.
    R = Rotation.from_rotvec([np.pi / 2, 0.0, 0.0])
    sizes = ("body.bar.depth=10 mm", "body.bar.width=25 mm")
    there = motion_of(
        pipeline_of(tmp_path, *sizes, angle=0.3, gravity=np.array([0.0, 0.0, -G]), axis="[0, -1, 0]", across="1, 2")
    )
    assert there.joint_position("hinge") == pytest.approx(here.joint_position("hinge"), abs=1e-8)
    assert there.tip_position == pytest.approx(R.apply(here.tip_position), abs=1e-8)


def test_the_hinge_and_its_bar_may_be_turned_over(tmp_path: Path, here: Motion) -> None:
    # The axis upside down: angles change their sign, nothing else does.
    there = motion_of(pipeline_of(tmp_path, angle=-0.3, axis="[0, 0, -2]"))
    assert there.joint_position("hinge") == pytest.approx(-here.joint_position("hinge"), abs=1e-8)
    assert there.tip_position == pytest.approx(here.tip_position, abs=1e-8)


def test_a_pendulum_on_a_place_elsewhere_swings_alike(tmp_path: Path) -> None:
    # The hinge is on a rigid body welded to the ground.
    shift = np.array([0.3, -0.2, 0.1])
    here = pipeline_of(tmp_path, angle=0.3)
    file = tmp_path / "moved.toml"
    text = (tmp_path / "pendulum.toml").read_text().replace('parent = "ground"', 'parent = "base.here"')
    base = (
        '[body.base]\nshape = "rigid"\nmass = "1 kg"\ninertia = ["1 kg m^2", "1 kg m^2", "1 kg m^2"]\n'
        'marker = { zero = { at = ["0 m", "0 m", "0 m"] }, here = { at = ["0.3 m", "-0.2 m", "0.1 m"] } }\n'
        '[joint.weld]\ntype = "fixed"\nparent = "ground"\nchild = "base.zero"\n'
    )
    file.write_text(text.replace("[simulation]", base + "[simulation]"))
    there = Pipeline(load_scene(file))
    one, other = motion_of(here), motion_of(there)
    assert other.joint_position("hinge") == pytest.approx(one.joint_position("hinge"), abs=1e-8)
    assert other.tip_position == pytest.approx(one.tip_position + shift, abs=1e-8)
    assert there.mechanism.n == here.mechanism.n
