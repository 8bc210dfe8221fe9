"""Modal mass of displacements of second order, of a body of points that second order moves as a rigid one."""

from dataclasses import replace

import numpy as np

from fmd.core.arrays import EPSILON, Array
from fmd.reduction.inertia import inertia_integrals
from fmd.reduction.second_order import second_order_mass

N_MODES = 4


def random_forms(rng: np.random.Generator, count: int) -> Array:
    forms = rng.normal(size=(count, N_MODES, N_MODES))
    return np.asarray(forms + forms.swapaxes(1, 2))


def test_it_is_what_the_kinetic_energy_of_a_rigid_motion_of_second_order_adds() -> None:
    """Of points that move by ``Φ q + w + θ × x``, with w and θ quadratic in q, at their undeformed places."""
    rng = np.random.default_rng(3)
    x, m, Phi = rng.normal(size=(9, 3)), rng.uniform(0.1, 0.4, 9), rng.normal(size=(9, 3, N_MODES))
    move = random_forms(rng, 6)
    q, v = rng.normal(size=(2, N_MODES))
    velocity, more = Phi @ v, np.einsum("kij,i,j->k", move, v, q)
    rigid = more[:3] + np.cross(more[3:], x)
    integrals = inertia_integrals(x, np.diag(m), Phi)
    momenta = np.einsum("i,ia->a", m, rigid), np.einsum("i,ia->a", m, np.cross(x, rigid))
    units = np.eye(N_MODES)
    displacement2, rotation2 = np.zeros((2, 3, N_MODES, N_MODES))
    for i in range(N_MODES):
        for j in range(N_MODES):
            w = np.einsum("kij,i,j->k", move, units[i], units[j])
            field = w[:3] + np.cross(w[3:], x)
            displacement2[:, i, j], rotation2[:, i, j] = m @ field, m @ np.cross(x, field)
    assert np.allclose(np.einsum("aij,i,j->a", displacement2, v, q), momenta[0])
    c, J = m @ x, integrals.inertia(np.eye(1 + N_MODES)[0])
    W = np.concatenate([np.einsum("i,iak->ak", m, Phi), np.einsum("i,abc,ib,ick->ak", m, EPSILON, x, Phi)])
    mass = second_order_mass(float(m.sum()), c, J, W, displacement2, rotation2)
    assert mass is not None
    total = 0.5 * m @ ((velocity + rigid) ** 2).sum(axis=1) - 0.5 * m @ (velocity**2).sum(axis=1)
    assert np.isclose(0.5 * v @ mass.matrix(q) @ v, total, rtol=1e-12)
    M = replace(integrals, displacement2=displacement2, rotation2=rotation2).mass_matrix(np.r_[1.0, q])
    assert np.allclose(M[:3, 6:] @ v, m @ (velocity + rigid))
    assert np.allclose(M[3:6, 6:] @ v, m @ (np.cross(x + Phi @ q, velocity) + np.cross(x, rigid)))
    middle = m @ (x + Phi @ q) + 0.5 * np.einsum("aij,i,j->a", displacement2, q, q)
    assert np.allclose(M[3:6, :3], np.cross(middle, np.eye(3)).T)


def test_a_body_that_turns_about_one_axis_takes_no_momenta_across_its_plane() -> None:
    rng = np.random.default_rng(4)
    displacement2, rotation2, W = random_forms(rng, 3), random_forms(rng, 3), rng.normal(size=(6, N_MODES))
    plane = second_order_mass(
        2.0, np.array([0.3, 0.1, 7.0]), np.diag([0.0, 0.0, 1.5]), W, displacement2, rotation2, normal=2
    )
    alike = second_order_mass(
        2.0, np.array([0.3, 0.1, 0.0]), np.diag([1.0, 1.0, 1.5]), W, displacement2, rotation2, normal=2
    )
    assert plane is not None
    assert alike is not None
    assert len(plane.F) == 3
    assert np.allclose(plane.N, alike.N)
    along = np.zeros((3, N_MODES, N_MODES))
    along[2] = displacement2[2]
    assert second_order_mass(2.0, np.zeros(3), np.eye(3), W, along, np.zeros((3, 0, 0)), normal=2) is None
