"""Displacement of second order as fields that have its momenta: affine ones are known exactly, of others the least."""

from dataclasses import replace

import numpy as np

from fmd.core.arrays import EPSILON, Array
from fmd.reduction.inertia import InertiaIntegrals, inertia_integrals

N_MODES = 4


def random_body(affine: bool, normal: int = -1) -> tuple[Array, Array, Array, Array, InertiaIntegrals]:
    """Return places, masses, shapes and displacements of second order of points, and what a body knows of them."""
    rng = np.random.default_rng(3)
    x, m, Phi = rng.normal(size=(9, 3)), rng.uniform(0.1, 0.4, 9), rng.normal(size=(9, 3, N_MODES))
    Gamma = rng.normal(size=(9, 3, N_MODES, N_MODES))
    if affine:
        Gamma = np.einsum("ic,acjk->iajk", np.c_[np.ones(9), x], rng.normal(size=(3, 4, N_MODES, N_MODES)))
    Gamma = Gamma + Gamma.swapaxes(2, 3)
    if normal >= 0:
        Phi[:, normal] = Gamma[:, normal] = 0.0
    integrals = inertia_integrals(x, np.diag(m), Phi, normal)
    first = np.einsum("i,ia,ibjk->abjk", m, x, Gamma)
    stiffening = -0.5 * (first + first.swapaxes(0, 1))
    if normal >= 0:  # known as the sum across the normal alone, half of it along each axis
        across = np.eye(3) - np.diag(np.eye(3)[normal])
        stiffening = 0.5 * across[:, :, None, None] * np.tensordot(across, stiffening, 2)
    G = integrals.G.copy()
    G[:, :, 1:, 1:] -= stiffening
    displacement2, rotation2 = np.einsum("i,iajk->ajk", m, Gamma), np.einsum("abc,bcjk->ajk", EPSILON, first)
    return (
        x,
        m,
        Phi,
        Gamma,
        replace(integrals, G=G, stiffening=stiffening, displacement2=displacement2, rotation2=rotation2, whole=True),
    )


def test_the_mass_matrix_is_that_of_points_that_affine_fields_move() -> None:
    x, m, Phi, Gamma, integrals = random_body(affine=True)
    q = np.random.default_rng(1).normal(size=N_MODES)
    y = x + Phi @ q + 0.5 * Gamma @ q @ q
    turning = -np.einsum("abc,ib->iac", EPSILON, y).swapaxes(1, 2)
    J = np.concatenate([np.broadcast_to(np.eye(3), (9, 3, 3)), turning.swapaxes(1, 2), Phi + Gamma @ q], axis=2)
    M = integrals.mass_matrix(np.r_[1.0, q])
    np.testing.assert_allclose(M, np.einsum("i,iaj,iak->jk", m, J, J), atol=1e-10 * np.abs(M).max())


def test_of_any_displacement_the_momenta_stay_and_no_more_mass_moves_than_there_is() -> None:
    """Momenta are the terms of first order of the coupling; Schwarz's inequality bounds the modal mass."""
    _, m, _, Gamma, integrals = random_body(affine=False)
    partial, bound = replace(integrals, whole=False), np.einsum("i,iajk,ialn->jkln", m, Gamma, Gamma)
    q = np.random.default_rng(1).normal(size=N_MODES)
    h = 1e-5  # of central differences, which leave nothing of even orders
    slopes = [
        body.mass_matrix(np.r_[1.0, h * q]) - body.mass_matrix(np.r_[1.0, -h * q]) for body in (integrals, partial)
    ]
    np.testing.assert_allclose(slopes[0][:6], slopes[1][:6], atol=1e-8 * np.abs(slopes[1]).max())
    assert integrals.fields is not None
    f = integrals.fields.F @ q
    left = np.einsum("jkln,k,n->jl", bound, q, q) - f.T @ f
    assert np.linalg.eigvalsh(left)[0] > -1e-12 * np.abs(left).max()
    for size in (0.1, 1.0, 10.0):
        assert np.linalg.eigvalsh(integrals.mass_matrix(np.r_[1.0, size * q]))[0] > 0
    assert np.linalg.eigvalsh(partial.mass_matrix(np.r_[1.0, 10.0 * q]))[0] < 0


def test_a_body_in_a_plane_has_what_is_known_across_its_normal() -> None:
    """Two displacements, one rotation and one growth of its plane: four momenta, and as many fields."""
    _, _, _, _, integrals = random_body(affine=False, normal=2)
    assert integrals.fields is not None
    assert len(integrals.fields.F) == 4
    n = 1 + N_MODES
    np.testing.assert_allclose(np.einsum("aakl->kl", integrals.fields.G)[n:, n:], np.eye(4), atol=1e-12)
    assert replace(integrals, whole=False).fields is None
    empty = np.zeros((3, 0, 0))
    assert replace(integrals, stiffening=np.zeros((3, 3, 0, 0)), displacement2=empty, rotation2=empty).fields is None
