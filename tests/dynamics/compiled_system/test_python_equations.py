"""Equations of motion as functions of arrays, for solvers and loads of one's own."""

from collections.abc import Callable

import numpy as np
import pytest

import fmd
from fmd import Result, load
from fmd.dynamics.compiled_system.equations import OwnLoad


@pytest.fixture(scope="module")
def arm() -> Result:
    return load("arm", "output=[]", 'simulation.run=[{integrator="auto"}]', "simulation.duration=0.1 s")


def four_bar() -> Result:
    """Return a crank, a coupler and a rocker of rods, on hinges that make a loop with the ground."""
    rods = {
        name: fmd.Rod(mass=mass, length=length, marker={"a": {"at": [0, 0, 0]}, "b": {"at": [length, 0, 0]}})
        for name, mass, length in (("crank", 1.0, 0.3), ("coupler", 2.0, 1.0), ("rocker", 1.5, 0.8))
    }
    ends = {"A": ("ground", "crank.a"), "B": ("crank.b", "coupler.a"), "D": ("ground.D", "rocker.a")}
    hinges = {
        name: fmd.Revolute(parent=parent, child=child, axis=[0, 0, 1])
        for name, (parent, child) in (ends | {"C": ("coupler.b", "rocker.b")}).items()
    }
    scene = fmd.Scene(
        title="Four-bar linkage",
        ground={"D": fmd.GroundPlace(at=[1.0, 0, 0])},
        body=rods,
        joint=hinges | {"A": hinges["A"].model_copy(update={"angle": 1.0, "rate": 2.0})},
        simulation=fmd.Simulation(
            duration=1.0, output_step=0.01, tip="coupler.b", gravity=[0, -9.81, 0], run=[fmd.AutoRun()]
        ),
    )
    return fmd.solve(scene)


@pytest.mark.parametrize(
    ("drive", "load_of"),
    [
        (
            '{type="torque", joint="shoulder", torque="7 N m"}',
            lambda system: lambda t, q, v: 7.0 * system.joint_jacobian("shoulder", q, t),
        ),
        (
            '{type="point force", marker="forearm.wrist", direction=[3, 4, 0], force="5 N"}',
            lambda system: lambda t, q, v: system.marker_jacobian("forearm.wrist", q, t).T @ np.array([3.0, 4.0, 0.0]),
        ),
    ],
    ids=["torque", "force"],
)
def test_a_load_of_ones_own_does_what_the_scenes_own_does(drive: str, load_of: Callable[..., OwnLoad]) -> None:
    plain = ("output=[]", "simulation.stiffening=off")  # which depends on the scene's loads
    driven, free = load("arm", *plain, f"drive={{own={drive}}}").system, load("arm", *plain, "drive={}").system
    q, v = free.mechanism.rest_positions, np.random.default_rng(3).standard_normal(free.n)
    q[:2] = 0.4, -1.1
    without = free.accelerations(0.0, q, v)
    want = driven.accelerations(0.0, q, v) - without
    found = free.accelerations(0.0, q, v, load_of(free)) - without
    assert found == pytest.approx(want, abs=1e-9 * np.abs(want).max())
    assert np.abs(want).min() > 1e-3


def test_jacobians_give_rates(arm: Result) -> None:
    motion = arm.motion
    for k in (3, 40):
        q, v = motion.trajectory.q[k], motion.trajectory.v[k]
        assert arm.system.joint_jacobian("elbow", q) @ v == pytest.approx(motion.joint_rate("elbow")[k], rel=1e-12)
        assert arm.system.marker_jacobian("forearm.wrist", q) @ v == pytest.approx(
            motion.kinematics.marker_velocity(motion.mechanism.number_of("forearm"), "wrist")[k], rel=1e-12, abs=1e-15
        )


def test_the_rate_of_a_prescribed_motion_is_no_part_of_a_jacobian() -> None:
    """The slider's velocity by its own rate is the rod's direction, however fast the rod is turned."""
    turned = '{motor={type="motion", joint="hinge", angle={formula="0.5 + 3*t", unit="rad"}}}'
    system = load("rod-slider", "output=[]", f"drive={turned}").system
    t, q = 0.3, np.array([0.15])
    assert system.names == ("slide.position",)
    direction = np.array([np.cos(0.5 + 3 * t), np.sin(0.5 + 3 * t), 0.0])
    assert system.marker_jacobian("slider.centre", q, t)[:, 0] == pytest.approx(direction, abs=1e-12)
    assert system.joint_jacobian("slide", q, t) == pytest.approx([1.0], abs=1e-12)


def test_loops_stay_closed_under_a_load_of_ones_own() -> None:
    """The change of the accelerations is that of Lagrange's equations of the first kind, M v̇ + Jᵀ λ = f, J v̇ = 0."""
    run = four_bar()
    system, (q, v), f = run.system, run.start, np.array([3.0, -1.0, 2.0])
    M, J = system.mass_matrix(q), system.constraint_jacobian(q)
    assert (M.shape, np.linalg.matrix_rank(J)) == ((3, 3), 2)
    n_rows = len(J)
    saddle = np.block([[M, J.T], [J, np.zeros((n_rows, n_rows))]])
    want = np.linalg.lstsq(saddle, np.r_[f, np.zeros(n_rows)], rcond=None)[0][:3]
    found = system.accelerations(0.0, q, v, lambda t, q, v: f) - system.accelerations(0.0, q, v)
    assert found == pytest.approx(want, abs=1e-10 * np.abs(want).max())
    assert J @ found == pytest.approx(0, abs=1e-10 * np.abs(want).max())


def test_coordinates_have_names_in_the_order_of_the_rates(arm: Result) -> None:
    names = arm.system.names
    assert names[:3] == ("shoulder.position", "elbow.position", "wrist.position")
    n_modes = len(arm.run.mechanism.links[1].omega)
    assert n_modes >= 5
    assert names[3:] == tuple(f"forearm.mode {k}" for k in range(1, 1 + n_modes))
    for joint in ("shoulder", "elbow"):
        assert arm.system.joint_jacobian(joint, arm.start[0])[names.index(f"{joint}.position")] == 1.0


def test_a_tree_has_no_constraints(arm: Result) -> None:
    assert arm.system.constraint_jacobian(arm.start[0]).shape == (0, arm.system.n)


def test_arrays_of_another_size_are_refused_before_machine_code_reads_them(arm: Result) -> None:
    (q, v), n = arm.start, arm.system.n
    for call in (
        lambda: arm.system.accelerations(0.0, q[:-1], v),
        lambda: arm.system.accelerations(0.0, q, v[:, None]),
        lambda: arm.system.position_rates(q, v[1:]),
        lambda: arm.system.mass_matrix(np.r_[q, 0.0]),
        lambda: arm.system.state_rates(0.0, np.r_[q, v, 0.0]),
        lambda: arm.system.constraint_jacobian(q[:-1]),
        lambda: arm.system.joint_jacobian("elbow", q[:-1]),
        lambda: arm.system.marker_jacobian("forearm.wrist", np.r_[q, 0.0]),
    ):
        with pytest.raises(ValueError, match=r"^(q|v|state) has shape .*, expected \(\d+,\)$"):
            call()
    for many in (q, q[None, :-1]):
        with pytest.raises(ValueError, match=rf"q has shape .*, expected \(n_states, {q.size}\)$"):
            arm.system.mass_matrices(many)
    with pytest.raises(ValueError, match=rf"load\(t, q, v\) has shape \(\), expected \({n},\)"):
        arm.system.accelerations(0.0, q, v, lambda t, q, v: 3.0)


def test_what_has_no_such_name_is_refused(arm: Result) -> None:
    q, _ = arm.start
    with pytest.raises(ValueError, match="no joint with one coordinate is named 'hub'; there are shoulder, elbow"):
        arm.system.joint_jacobian("hub", q)
    with pytest.raises(ValueError, match="no body is named 'leg'"):
        arm.system.marker_jacobian("leg.foot", q)
    with pytest.raises(ValueError, match="forearm has no marker foot"):
        arm.system.marker_jacobian("forearm.foot", q)


def test_a_bodys_matrices_and_shapes_belong_together(arm: Result) -> None:
    body = arm.parts["forearm"]
    omega2 = (2 * np.pi * body.frequencies_hz) ** 2
    assert body.Phi.shape == (body.K.shape[0], len(omega2))
    assert body.Phi.T @ body.M @ body.Phi == pytest.approx(np.eye(len(omega2)), abs=1e-9)
    assert body.Phi.T @ body.K @ body.Phi == pytest.approx(np.diag(omega2), abs=1e-9 * omega2.max())


def test_motions_are_a_labelled_data_set(arm: Result) -> None:
    motions = arm.to_xarray()
    assert list(motions.run.values) == list(arm.motions)
    assert motions["shoulder.position"].sel(run="auto").values == pytest.approx(
        arm.motions["auto"].joint_position("shoulder")
    )
