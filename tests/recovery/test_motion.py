"""What a body does in space, against the nodes of its finite element model moved one by one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pint
import pytest
import xarray
from scipy.integrate import simpson
from scipy.spatial.transform import Rotation

from meshes.bar import hexahedral_bar
from pipeline import Pipeline, load_scene
from pipeline.core.arrays import Array
from pipeline.dynamics.rotor.rotor import PlanarRotor, TorquePulse
from pipeline.fem.assembly import assemble
from pipeline.fem.markers import face_marker
from pipeline.fem.material import Material
from pipeline.fem.mesh import SolidMesh
from pipeline.fem.model import FEModel
from pipeline.integrators.central_difference import CentralDifference
from pipeline.integrators.protocol import State, Trajectory
from pipeline.integrators.subcycling import Subcycling
from pipeline.recovery.motion import Motion, motion_dataset
from pipeline.reduction.body import free_frame_body, reduced_body
from pipeline.reduction.eigen import FreeBodySolver
from pipeline.reduction.mode_families import lowest_modes

NO_TORQUE = TorquePulse(0.0, 1.0, 0.0)
N_TIMES = 7


def trajectory(times: Array, q: Array, v: Array) -> Trajectory:
    """Make up a trajectory: only times, coordinates and rates matter here."""
    return Trajectory("made up", 1.0, 1, times, q, v, 0, 0, 0.0, State(0, q[-1], v[-1], 0 * v[-1]))


@pytest.fixture(scope="module")
def fe() -> FEModel:
    """A bar of 300 × 40 × 20 mm, small enough to move all of its nodes."""
    mesh = SolidMesh(*hexahedral_bar(0.3, 0.04, 0.02, (6, 2, 1)))
    return assemble(mesh, 2, Material(E=1e9, nu=0.3, rho=1500.0))


@pytest.fixture(scope="module")
def frames(fe: FEModel) -> dict[str, PlanarRotor]:
    """The bar on its joint: in joint-conforming modes about z and about an oblique axis, and in free modes."""
    modes = lowest_modes(FreeBodySolver(fe), 6)
    faces = fe.discretisation.mesh.faces
    markers = {name: face_marker(fe.discretisation, faces[face]) for name, face in (("root", "x-"), ("tip", "x+"))}
    given = fe, modes.omega, modes.shapes, markers, "root"
    return {
        "about z": PlanarRotor(reduced_body(*given, np.array([[0.0, 0.0, 1.0]])), NO_TORQUE),
        "oblique": PlanarRotor(reduced_body(*given, np.array([[1.0, -2.0, 3.0]]) / np.sqrt(14)), NO_TORQUE),
        "free": PlanarRotor(free_frame_body(*given, np.array([0.0, 0.0, 1.0])), NO_TORQUE),
    }


@pytest.fixture(scope="module", params=["about z", "oblique", "free"])
def motion(request: pytest.FixtureRequest, frames: dict[str, PlanarRotor]) -> Motion:
    """Random states of the bar."""
    rotor = frames[request.param]
    rng = np.random.default_rng(1)
    q, v = rng.normal(size=(2, N_TIMES, rotor.n))
    q[:, 1:] *= 1e-3
    return Motion(rotor, trajectory(np.arange(float(N_TIMES)), q, v), "tip")


def nodes(motion: Motion) -> tuple[Array, Array]:
    """Positions and velocities of all nodes in space, both of shape (n_times, n_nodes, 3)."""
    body, q, v = motion.rotor.body, motion.trajectory.q, motion.trajectory.v
    r, rates = np.empty((2, len(q), *body.x.shape))
    for k in range(len(q)):
        R = Rotation.from_rotvec(q[k, 0] * body.axis).as_matrix()
        r[k] = (body.x + body.shapes @ q[k, 1:]) @ R.T
        rates[k] = np.cross(v[k, 0] * body.axis, r[k]) + (body.shapes @ v[k, 1:]) @ R.T
    return r, rates


def moved(motion: Motion, dt: float) -> Motion:
    """Let each state run on for a time at its present rates."""
    old = motion.trajectory
    return replace(motion, trajectory=replace(old, q=old.q + dt * old.v))


# Position and velocity -------------------------------------------------------------------------------------------


def test_the_centre_of_mass_is_the_mean_of_all_points(motion: Motion, fe: FEModel) -> None:
    r, _ = nodes(motion)
    weights = fe.m @ np.ones(len(fe.x))
    assert motion.com_position == pytest.approx(np.einsum("i,tia->ta", weights, r) / weights.sum(), abs=1e-12)


def test_the_velocity_of_the_centre_of_mass_is_the_mean_of_all_velocities(motion: Motion, fe: FEModel) -> None:
    _, rates = nodes(motion)
    weights = fe.m @ np.ones(len(fe.x))
    assert motion.com_velocity == pytest.approx(np.einsum("i,tia->ta", weights, rates) / weights.sum(), abs=1e-12)


def test_the_velocity_of_the_centre_of_mass_is_the_slope_of_its_position(motion: Motion) -> None:
    slope = (moved(motion, 1e-5).com_position - moved(motion, -1e-5).com_position) / 2e-5
    assert motion.com_velocity == pytest.approx(slope, rel=1e-7, abs=1e-9)


def test_the_angular_velocity_of_the_centre_of_mass_is_the_slope_of_its_polar_angle(motion: Motion) -> None:
    e = motion.rotor.body.axis
    right = np.cross(e, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)

    def polar(some: Motion) -> Array:
        return np.asarray(np.arctan2(some.com_position @ np.cross(e, right), some.com_position @ right))

    turn = np.angle(np.exp(1j * (polar(moved(motion, 1e-6)) - polar(moved(motion, -1e-6)))))
    assert motion.com_angular_velocity == pytest.approx(turn / 2e-6, rel=1e-6)


def test_the_tip_is_the_mean_of_its_face(motion: Motion, fe: FEModel) -> None:
    r, _ = nodes(motion)
    marker = face_marker(fe.discretisation, fe.discretisation.mesh.faces["x+"])
    assert motion.tip_position == pytest.approx(np.stack([marker.translation(at) for at in r]), abs=1e-12)


def test_an_undeformed_body_turns_as_a_whole(motion: Motion) -> None:
    still = motion.trajectory.q.copy()
    still[:, 1:] = 0.0
    rigid = replace(motion, trajectory=replace(motion.trajectory, q=still))
    body = rigid.rotor.body
    turns = Rotation.from_rotvec(still[:, :1] * body.axis)
    # The bar lies along x from the joint, so that the tip is at (0.3, 0, 0) m and the centre of mass halfway.
    assert rigid.tip_position == pytest.approx(turns.apply([0.3, 0.0, 0.0]), abs=1e-12)
    assert rigid.com_position == pytest.approx(turns.apply([0.15, 0.0, 0.0]), abs=1e-12)
    assert rigid.tip_deflection == pytest.approx(np.zeros(N_TIMES), abs=1e-15)
    assert np.array_equal(rigid.joint_angle, still[:, 0])


def test_vectors_of_the_frame_are_turned_as_by_a_rotation_vector(motion: Motion) -> None:
    r = np.random.default_rng(2).normal(size=(5, 3))
    for k, angle in enumerate(motion.frame_angle):
        turn = Rotation.from_rotvec(angle * motion.rotor.body.axis)
        assert motion.placed("any", r, k) == pytest.approx(turn.apply(r), abs=1e-12)


def test_a_body_that_doesnt_move_has_no_velocity_and_no_kinetic_energy(motion: Motion) -> None:
    still = replace(motion, trajectory=replace(motion.trajectory, v=np.zeros_like(motion.trajectory.v)))
    assert np.array_equal(still.com_angular_velocity, np.zeros(N_TIMES))
    assert np.array_equal(still.com_velocity, np.zeros((N_TIMES, 3)))
    assert np.array_equal(still.energies[0], np.zeros(N_TIMES))


# Angles and deflection -------------------------------------------------------------------------------------------


def test_the_joints_section_turns_with_the_frame_and_with_the_face(motion: Motion, fe: FEModel) -> None:
    body = motion.rotor.body
    root = face_marker(fe.discretisation, fe.discretisation.mesh.faces["x-"])
    bent = np.array([body.axis @ root.rotation(body.shapes @ q) for q in motion.q])
    assert motion.joint_angle == pytest.approx(motion.frame_angle + bent, abs=1e-12)
    slope = (moved(motion, 1e-3).joint_angle - moved(motion, -1e-3).joint_angle) / 2e-3  # exact: the angle is linear
    assert motion.joint_rate == pytest.approx(slope, rel=1e-9, abs=1e-9)


def test_a_turn_of_all_points_is_no_deflection(frames: dict[str, PlanarRotor]) -> None:
    # A body whose first shape is the small rotation itself: it turns the joint's section and carries the tip along.
    body = frames["oblique"].body
    markers = dict(body.markers)
    for name, marker in body.markers.items():
        translation, rotation = np.zeros((2, 3, 6))
        translation[:, 0], rotation[:, 0] = np.cross(body.axis, marker.position), body.axis
        markers[name] = replace(marker, translation=translation, rotation=rotation)
    q = np.zeros((1, 7))
    q[0, 1] = 1e-3
    turned = Motion(PlanarRotor(replace(body, markers=markers), NO_TORQUE), trajectory(np.zeros(1), q, 0 * q), "tip")
    assert turned.tip_deflection == pytest.approx([0.0], abs=1e-16)
    assert turned.joint_angle == pytest.approx([1e-3], rel=1e-12)


def test_a_deflection_is_the_same_in_every_frame(frames: dict[str, PlanarRotor]) -> None:
    # The two bases about z span the same deformations but for a small rotation of the whole, which makes the one
    # frame run ahead of the other: what is seen from the section at the joint can't depend on it.
    conforming, free = frames["about z"], frames["free"]
    spin = np.cross(free.body.axis, free.body.x)
    basis = np.concatenate([spin[:, :, None], free.body.shapes], axis=2).reshape(-1, 7)
    for mode in range(6):
        q = np.eye(7)[[mode + 1]]
        same = np.linalg.lstsq(basis, conforming.body.shapes[:, :, mode].ravel())[0]
        assert basis @ same == pytest.approx(conforming.body.shapes[:, :, mode].ravel(), abs=1e-8)
        one, other = (
            Motion(rotor, trajectory(np.zeros(1), state, 0 * state), "tip")
            for rotor, state in ((conforming, q), (free, same[None]))
        )
        assert one.tip_deflection == pytest.approx(other.tip_deflection, abs=1e-8)
        assert one.joint_angle == pytest.approx(other.joint_angle, abs=1e-7)


# Energy ----------------------------------------------------------------------------------------------------------


def test_kinetic_energy_is_that_of_all_points(motion: Motion, fe: FEModel) -> None:
    _, rates = nodes(motion)
    want = [0.5 * np.sum(velocity * (fe.m @ velocity)) for velocity in rates]
    assert motion.energies[0] == pytest.approx(want, rel=1e-10)


def test_strain_energy_is_that_of_the_finite_elements(motion: Motion, fe: FEModel) -> None:
    fields = [(motion.rotor.body.shapes @ q).ravel() for q in motion.q]
    # The modes' own accuracy shows: they are eigenvectors to a residual only.
    assert motion.energies[1] == pytest.approx([0.5 * u @ (fe.K @ u) for u in fields], rel=1e-6)


@pytest.fixture(scope="module")
def driven() -> Motion:
    """The beam of the scene over its torque pulse, in steps of 1 µs with output at every fourth."""
    rotor = Pipeline(load_scene("beam")).rotor
    times = np.arange(25_001) * 4e-6
    rest = np.zeros(rotor.n)
    return Motion(rotor, CentralDifference(1e-6).march(rotor, rest, rest, times), "tip")


def test_the_torques_work_at_the_joint_is_the_energy_gained(driven: Motion) -> None:
    # The torque acts on the section at the joint: W = ∫ τ d(joint angle).
    pulse, kinetic, strain = driven.rotor.pulse, *driven.energies
    assert driven.times[-1] == pytest.approx(pulse.start + pulse.duration)
    torque = pulse.peak * np.sin(np.pi * driven.times / pulse.duration)
    work = simpson(torque * driven.joint_rate, x=driven.times)
    assert work == pytest.approx((kinetic + strain)[-1], rel=1e-6)
    # The frame's own angle is another one: work counted with it is wrong.
    frame_rate = driven.trajectory.v[:, 0]
    assert abs(simpson(torque * frame_rate, x=driven.times) / work - 1) > 1e-5


def test_the_pulse_brings_the_beam_to_the_scenes_speed(driven: Motion) -> None:
    # Angular momentum is the torque's impulse, whatever the modes do: J · 20 rad/s, with J = m (4L² + c²)/12 of a bar
    # of length L and depth c about its end.
    inertia = 0.17 * (4 * 0.34**2 + 0.025**2) / 12
    body, v = driven.rotor.body, driven.trajectory.v[-1]
    p, G = np.r_[1.0, driven.q[-1]], driven.rotor.body.gram.G
    spun = body.gram.inertia(p)[2, 2] * v[0] + (p @ (G[0, 1] - G[1, 0]))[1:] @ v[1:]
    assert body.inertia_about_joint == pytest.approx(inertia, rel=1e-9)
    assert spun == pytest.approx(inertia * 20.0, rel=1e-6)


# The data set ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def dataset(driven: Motion) -> xarray.Dataset:
    rotor, rest, times = driven.rotor, np.zeros(driven.rotor.n), np.linspace(0.0, 0.2, 21)
    methods = {"central-difference": CentralDifference(1e-5), "sub-cycling 5:1": Subcycling(1e-5, 5)}
    return motion_dataset(
        {label: Motion(rotor, method.march(rotor, rest, rest, times), "tip") for label, method in methods.items()}
    )


def test_every_variable_of_the_data_set_has_a_unit(dataset: xarray.Dataset) -> None:
    registry = pint.UnitRegistry()
    numbers = [name for name, variable in dataset.variables.items() if variable.dtype.kind == "f"]
    assert set(dataset.data_vars) < set(numbers)
    for name in numbers:
        assert registry.Unit(dataset[name].attrs["units"]) is not None
    assert {"time", "mode"} < set(numbers)
    assert all(dataset[name].attrs["long_name"] for name in dataset.data_vars)


def test_the_data_set_holds_each_run_by_its_label(dataset: xarray.Dataset, driven: Motion) -> None:
    rotor, rest = driven.rotor, np.zeros(driven.rotor.n)
    again = Motion(rotor, Subcycling(1e-5, 5).march(rotor, rest, rest, dataset["time"].to_numpy()), "tip")
    run = dataset.sel(run="sub-cycling 5:1")
    names = ("joint_angle", "joint_rate", "frame_angle", "tip_deflection", "tip_position", "com_position")
    for name in (*names, "com_velocity", "com_angular_velocity"):
        assert np.array_equal(run[name], getattr(again, name))
    assert np.array_equal(run["modal_coordinates"], again.q)
    assert np.array_equal(run["kinetic_energy"], again.energies[0])
    assert np.array_equal(run["strain_energy"], again.energies[1])
    assert np.array_equal(dataset["mode"], rotor.body.omega / (2 * np.pi))


def test_the_data_set_comes_back_from_a_netcdf_file_as_it_was(dataset: xarray.Dataset, tmp_path: Path) -> None:
    dataset.to_netcdf(tmp_path / "motion.nc", engine="scipy")
    with xarray.open_dataset(tmp_path / "motion.nc", engine="scipy") as back:
        xarray.testing.assert_equal(back.load(), dataset)
        for name in dataset.variables:
            assert {key: back[name].attrs[key] for key in dataset[name].attrs} == dataset[name].attrs
