"""Universal, constant-velocity, cylindrical, planar and screw joints in random mechanisms: mass points and energies."""

import numpy as np
import pytest

from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.linear_forces import linearise_forces
from tests.dynamics.compiler import kane
from tests.dynamics.compiler.comparison import TIME, difference, interpreted
from tests.dynamics.compiler.mechanisms import EACH, JOINTS, MORE_JOINTS, SEEDS, random_mechanism

KINDS = (*MORE_JOINTS, *MORE_JOINTS, *JOINTS)


@EACH
def test_mass_points_on_more_joints_accelerate_alike_by_dalemberts_principle(seed: int) -> None:
    made = random_mechanism(seed, seed % 2 == 0, KINDS)
    (q, v), n = made.state(seed), made.mechanism.n
    compiled = made.compiled
    a = interpreted(compiled, "accelerations", (n,), q=q, v=v)
    assert difference(a, kane.accelerations(made, TIME, q, v)) < 1e-8
    assert difference(compiled.accelerations(TIME, q, v), a) < 1e-11
    residual = interpreted(compiled, "residual", (n,), q=q, v=v, a=a)
    M, Q = kane.mass_and_force(made, TIME, q, v)
    assert np.abs(residual).max() < 1e-10 * (np.abs(M @ a).max() + np.abs(Q).max())


@EACH
def test_frames_energies_and_damping_on_more_joints_are_those_of_the_points(seed: int) -> None:
    made = random_mechanism(seed, False, KINDS)
    (q, v), mechanism = made.state(seed), made.mechanism
    motion = Kinematics(mechanism, np.array([TIME]), q[None], v[None])
    energies = interpreted(made.compiled, "energies", (2,), q=q, v=v)
    assert np.concatenate(motion.energies) == pytest.approx(energies, rel=1e-10)
    velocities, spins = kane.velocities(made, TIME, q, v)
    m = np.concatenate([body.m for body in made.points])
    assert energies[0] == pytest.approx(0.5 * float(m @ (velocities**2).sum(axis=1)), rel=1e-10)
    for frame, (origin, R, _), spin in zip(motion.frames, kane.frames(made, TIME, q), spins, strict=True):
        assert frame.origin[0] == pytest.approx(np.real(origin), abs=1e-12)
        assert frame.rotation[0] == pytest.approx(np.real(R), abs=1e-12)
        assert frame.spin[0] == pytest.approx(spin, abs=1e-12)
    compiled, none = made.compiled, np.zeros(mechanism.n)
    _, by_v, _ = compiled.tangents(compiled.signal_values(0.0), mechanism.rest_positions, none, none)
    if not any(link.motion for link in mechanism.links):
        assert pytest.approx(by_v, abs=1e-10) == linearise_forces(mechanism).C


def test_every_joint_occurs() -> None:
    found = {link.joint for seed in SEEDS for link in random_mechanism(seed, False, KINDS).mechanism.links}
    assert set(MORE_JOINTS) <= found
