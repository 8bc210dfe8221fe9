"""What a body does in space, against the nodes of its finite element model moved one by one."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.spatial.transform import Rotation

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.dynamics.links import Link
from fmd.dynamics.mechanism import Mechanism
from fmd.fem.assembly import assemble
from fmd.fem.markers import face_marker
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.protocol import Integrator, State, Trajectory
from fmd.integrators.subcycling import Subcycling
from fmd.meshes.bar import hexahedral_bar
from fmd.recovery.motion import Motion
from fmd.reduction.body import FlexibleBody, free_frame_body, reduced_body
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.mode_families import lowest_modes
from fmd.scene.joints.revolute import REVOLUTE

N_TIMES = 7


def hinged(body: FlexibleBody) -> Mechanism:
    """Put a body on a hinge to the ground."""
    hinge = {"joint_name": "hub", "axis": body.axis, "joint_rotation": body.joint_rotation, "section": body.joint}
    return Mechanism([Link("bar", body.integrals, REVOLUTE, omega=body.omega, markers=body.markers, **hinge)])


def trajectory(times: Array, q: Array, v: Array) -> Trajectory:
    """Make up a trajectory: only times, coordinates and rates matter here."""
    return Trajectory("made up", 1.0, 1, times, q, v, 0, 0, 0.0, State(0, q[-1], v[-1], 0 * v[-1]))


@pytest.fixture(scope="module")
def fe() -> FEModel:
    """A bar of 300 × 40 × 20 mm, small enough to move all of its nodes."""
    mesh = SolidMesh(*hexahedral_bar(0.3, 0.04, 0.02, (6, 2, 1)))
    return assemble(mesh, 2, Material(E=1e9, nu=0.3, rho=1500.0))


@pytest.fixture(scope="module")
def frames(fe: FEModel) -> dict[str, FlexibleBody]:
    """The bar on its joint: in joint-conforming modes about z and about an oblique axis, and in free modes."""
    modes = lowest_modes(FreeBodySolver(fe), 6)
    faces = fe.discretisation.mesh.faces
    markers = {name: face_marker(fe.discretisation, faces[face]) for name, face in (("root", "x-"), ("tip", "x+"))}
    given = fe, modes.omega, modes.shapes, markers, "root"
    return {
        "about z": reduced_body(*given, np.array([[0.0, 0.0, 1.0]])),
        "oblique": reduced_body(*given, np.array([[1.0, -2.0, 3.0]]) / np.sqrt(14)),
        "free": free_frame_body(*given, np.array([0.0, 0.0, 1.0])),
    }


@pytest.fixture(scope="module", params=["about z", "oblique", "free"])
def body(request: pytest.FixtureRequest, frames: dict[str, FlexibleBody]) -> FlexibleBody:
    """The bar in each of its frames."""
    return frames[request.param]


@pytest.fixture(scope="module")
def motion(body: FlexibleBody) -> Motion:
    """Random states of the bar."""
    rng = np.random.default_rng(1)
    q, v = rng.normal(size=(2, N_TIMES, 1 + len(body.omega)))
    q[:, 1:] *= 1e-3
    return Motion(hinged(body), trajectory(np.arange(float(N_TIMES)), q, v), "bar.tip")


def nodes(motion: Motion, body: FlexibleBody) -> tuple[Array, Array]:
    """Positions and velocities of all nodes in space, both of shape (n_times, n_nodes, 3)."""
    q, v = motion.trajectory.q, motion.trajectory.v
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


def test_the_centre_of_mass_is_the_mean_of_all_points(motion: Motion, body: FlexibleBody, fe: FEModel) -> None:
    r, _ = nodes(motion, body)
    weights = fe.m @ np.ones(len(fe.x))
    assert motion.centre_of_mass == pytest.approx(np.einsum("i,tia->ta", weights, r) / weights.sum(), abs=1e-12)


def test_the_velocity_of_the_centre_of_mass_is_the_mean_of_all_velocities(
    motion: Motion, body: FlexibleBody, fe: FEModel
) -> None:
    _, rates = nodes(motion, body)
    weights = fe.m @ np.ones(len(fe.x))
    assert motion.centre_velocity == pytest.approx(np.einsum("i,tia->ta", weights, rates) / weights.sum(), abs=1e-12)


def test_the_velocity_of_the_centre_of_mass_is_the_slope_of_its_position(motion: Motion) -> None:
    slope = (moved(motion, 1e-5).centre_of_mass - moved(motion, -1e-5).centre_of_mass) / 2e-5
    assert motion.centre_velocity == pytest.approx(slope, rel=1e-7, abs=1e-9)


def test_the_angular_velocity_of_the_centre_of_mass_is_the_slope_of_its_polar_angle(
    motion: Motion, body: FlexibleBody
) -> None:
    e = body.axis
    right = np.cross(e, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)

    def polar(some: Motion) -> Array:
        return np.asarray(np.arctan2(some.centre_of_mass @ np.cross(e, right), some.centre_of_mass @ right))

    turn = np.angle(np.exp(1j * (polar(moved(motion, 1e-6)) - polar(moved(motion, -1e-6)))))
    assert motion.centre_angular_velocity == pytest.approx(turn / 2e-6, rel=1e-6)


def test_the_tip_is_the_mean_of_its_face(motion: Motion, body: FlexibleBody, fe: FEModel) -> None:
    r, _ = nodes(motion, body)
    marker = face_marker(fe.discretisation, fe.discretisation.mesh.faces["x+"])
    assert motion.tip_position == pytest.approx(np.stack([marker.translation(at) for at in r]), abs=1e-12)


def test_an_undeformed_body_turns_as_a_whole(motion: Motion, body: FlexibleBody) -> None:
    still = motion.trajectory.q.copy()
    still[:, 1:] = 0.0
    rigid = replace(motion, trajectory=replace(motion.trajectory, q=still))
    turns = Rotation.from_rotvec(still[:, :1] * body.axis)
    # The bar lies along x from the joint, so that the tip is at (0.3, 0, 0) m and the centre of mass halfway.
    assert rigid.tip_position == pytest.approx(turns.apply([0.3, 0.0, 0.0]), abs=1e-12)
    assert rigid.centre_of_mass == pytest.approx(turns.apply([0.15, 0.0, 0.0]), abs=1e-12)
    assert rigid.tip_deflection == pytest.approx(np.zeros((N_TIMES, 3)), abs=1e-15)
    assert np.array_equal(rigid.joint_position("hub"), still[:, 0])


def test_vectors_of_the_frame_are_turned_as_by_a_rotation_vector(motion: Motion, body: FlexibleBody) -> None:
    r = np.random.default_rng(2).normal(size=(5, 3))
    for k, angle in enumerate(motion.trajectory.q[:, 0]):
        turn = Rotation.from_rotvec(angle * body.axis)
        assert motion.placed("bar", r, k) == pytest.approx(turn.apply(r), abs=1e-12)


def test_a_body_that_doesnt_move_has_no_velocity_and_no_kinetic_energy(motion: Motion) -> None:
    still = replace(motion, trajectory=replace(motion.trajectory, v=np.zeros_like(motion.trajectory.v)))
    assert np.array_equal(still.centre_angular_velocity, np.zeros(N_TIMES))
    assert np.array_equal(still.centre_velocity, np.zeros((N_TIMES, 3)))
    assert np.array_equal(still.energies[0], np.zeros(N_TIMES))


# Angles and deflection -------------------------------------------------------------------------------------------


def test_the_joints_section_turns_with_the_frame_and_with_the_face(
    motion: Motion, body: FlexibleBody, fe: FEModel
) -> None:
    root = face_marker(fe.discretisation, fe.discretisation.mesh.faces["x-"])
    bent = np.array([body.axis @ root.rotation(body.shapes @ q) for q in motion.modal("bar")])
    assert motion.joint_position("hub") == pytest.approx(motion.trajectory.q[:, 0] + bent, abs=1e-12)
    ahead, behind = (moved(motion, dt).joint_position("hub") for dt in (1e-3, -1e-3))
    slope = (ahead - behind) / 2e-3  # exact: the angle is linear
    assert motion.joint_rate("hub") == pytest.approx(slope, rel=1e-9, abs=1e-9)


def test_a_turn_of_all_points_is_no_deflection(frames: dict[str, FlexibleBody]) -> None:
    # A body whose first shape is the small rotation itself: it turns the joint's section and carries the tip along.
    body = frames["oblique"]
    markers = dict(body.markers)
    for name, marker in body.markers.items():
        translation, rotation = np.zeros((2, 3, 6))
        translation[:, 0], rotation[:, 0] = np.cross(body.axis, marker.position), body.axis
        markers[name] = replace(marker, translation=translation, rotation=rotation)
    q = np.zeros((1, 7))
    q[0, 1] = 1e-3
    turned = Motion(hinged(replace(body, markers=markers)), trajectory(np.zeros(1), q, 0 * q), "bar.tip")
    assert turned.tip_deflection == pytest.approx(np.zeros((1, 3)), abs=1e-16)
    assert turned.tip_displacement[0] == pytest.approx(1e-3 * np.cross(body.axis, body.markers["tip"].position))
    assert turned.joint_position("hub") == pytest.approx([1e-3], rel=1e-12)


def test_a_deflection_is_the_same_in_every_frame(frames: dict[str, FlexibleBody]) -> None:
    # The two bases about z span the same deformations but for a small rotation of the whole, which makes the one
    # frame run ahead of the other: what is seen from the section at the joint can't depend on it.
    conforming, free = frames["about z"], frames["free"]
    spin = np.cross(free.axis, free.x)
    basis = np.concatenate([spin[:, :, None], free.shapes], axis=2).reshape(-1, 7)
    for mode in range(6):
        q = np.eye(7)[[mode + 1]]
        same = np.linalg.lstsq(basis, conforming.shapes[:, :, mode].ravel())[0]
        assert basis @ same == pytest.approx(conforming.shapes[:, :, mode].ravel(), abs=1e-8)
        one, other = (
            Motion(hinged(some), trajectory(np.zeros(1), state, 0 * state), "bar.tip")
            for some, state in ((conforming, q), (free, same[None]))
        )
        assert one.tip_deflection == pytest.approx(other.tip_deflection, abs=1e-8)
        assert one.joint_position("hub") == pytest.approx(other.joint_position("hub"), abs=1e-7)


# Energy ----------------------------------------------------------------------------------------------------------


def test_kinetic_energy_is_that_of_all_points(motion: Motion, body: FlexibleBody, fe: FEModel) -> None:
    _, rates = nodes(motion, body)
    want = [0.5 * np.sum(velocity * (fe.m @ velocity)) for velocity in rates]
    assert motion.energies[0] == pytest.approx(want, rel=1e-10)


def test_strain_energy_is_that_of_the_finite_elements(motion: Motion, body: FlexibleBody, fe: FEModel) -> None:
    fields = [(body.shapes @ q).ravel() for q in motion.modal("bar")]
    # The modes' own accuracy shows: they are eigenvectors to a residual only.
    assert motion.energies[1] == pytest.approx([0.5 * u @ (fe.K @ u) for u in fields], rel=1e-6)


@pytest.fixture(scope="module")
def run() -> Pipeline:
    return Pipeline(load_scene("beam-paper"))


def marched(run: Pipeline, method: Integrator, times: Array) -> Motion:
    """Motion of the beam from rest."""
    return Motion(run.mechanism, method.march(run.system, *run.start, times), "beam.tip")


@pytest.fixture(scope="module")
def driven(run: Pipeline) -> Motion:
    """The beam of the scene over its torque pulse, in steps of 1 µs with output at every fourth."""
    return marched(run, CentralDifference(1e-6), np.arange(25_001) * 4e-6)


def test_the_torques_work_at_the_joint_is_the_energy_gained(driven: Motion) -> None:
    # The torque acts on the section at the joint: W = ∫ τ d(joint angle).
    load, (kinetic, strain) = driven.mechanism.links[0].load, driven.energies
    assert load.breakpoints == pytest.approx((0.0, driven.times[-1]))
    torque = load.values(driven.times)[:, 0]
    work = simpson(torque * driven.joint_rate("hub"), x=driven.times)
    assert work == pytest.approx((kinetic + strain)[-1], rel=1e-6)
    # The frame's own angle is another one: work counted with it is wrong.
    frame_rate = driven.trajectory.v[:, 0]
    assert abs(simpson(torque * frame_rate, x=driven.times) / work - 1) > 1e-5


def test_the_pulse_brings_the_beam_to_the_scenes_speed(run: Pipeline, driven: Motion) -> None:
    # Angular momentum is the torque's impulse, whatever the modes do: J · 20 rad/s, with J = m (4L² + c²)/12 of a bar
    # of length L and depth c about its end.
    inertia = 0.17 * (4 * 0.34**2 + 0.025**2) / 12
    assert run.body.inertia_about_joint == pytest.approx(inertia, rel=1e-9)
    spun = driven.kinematics.angular_momentum[-1]
    assert spun[2] == pytest.approx(inertia * 20.0, rel=1e-6)
    assert np.isnan(spun[:2]).all()  # its inertia was integrated about z alone


def test_a_motion_ends_with_its_joints_energies_and_tip(driven: Motion) -> None:
    final = driven.final()
    assert final["joint_positions"] == {"hub": driven.joint_position("hub")[-1]}
    assert final["joint_rates"]["hub"] == pytest.approx(20.0, rel=0.1)
    assert final["tip"]["position_m"] == driven.tip_position[-1].tolist()
    assert final["tip"]["deflection_m"] == driven.tip_deflection[-1].tolist()


def test_motions_differ_by_their_tips_and_joints(run: Pipeline) -> None:
    times = np.linspace(0.0, 0.05, 11)
    one, other = (marched(run, method, times) for method in (CentralDifference(1e-5), Subcycling(1e-5, 10)))
    apart = other.differences(one)
    assert apart["tip_difference_m"] == pytest.approx(
        np.linalg.norm(other.tip_position - one.tip_position, axis=1).max()
    )
    assert 0 < apart["tip_deflection_difference_m"] < apart["tip_difference_m"]
    assert 0 < apart["joint_differences"]["hub"] < 1e-3
    assert set(one.differences(one)["joint_differences"].values()) == {0.0}
