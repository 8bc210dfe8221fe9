"""Laminates of plies at any angle, bent in a cylinder: first-order theory beside three-dimensional elasticity."""

import numpy as np
import pytest
from scipy.linalg import expm

from fmd.core.arrays import Array
from fmd.fem.laminate import Laminate, Ply
from fmd.recovery.plies import places_of_plies
from tests.fem.test_laminate import CARBON, stack

K = np.pi  # of a half sine over a unit length [1/m]
PAIRS = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]


def elastic(ply: Ply) -> Array:
    """Return stiffness (6, 6) by xx, yy, zz, yz, xz, xy of a ply that is alike across its fibres but for its shear."""
    own, S = ply.lamina, np.zeros((6, 6))
    S[:3, :3] = -0.25 / own.E2
    S[0, :3] = S[:3, 0] = -own.nu12 / own.E1
    S[np.arange(6), np.arange(6)] = 1 / np.array([own.E1, own.E2, own.E2, own.G23, own.G13, own.G12])
    C, whole, R = np.linalg.inv(S), np.zeros((3, 3, 3, 3)), ply.turn.T
    for row, (i, j) in enumerate(PAIRS):
        for column, (k, m) in enumerate(PAIRS):
            whole[i, j, k, m] = whole[j, i, k, m] = whole[i, j, m, k] = whole[j, i, m, k] = C[row, column]
    turned = np.einsum("ip,jq,kr,ms,pqrs->ijkm", R, R, R, R, whole)
    return np.array([[turned[i, j, k, m] for k, m in PAIRS] for i, j in PAIRS])


def in_ply(ply: Ply, xx: float, yy: float, xy: float, xz: float, yz: float) -> Array:
    """Return stress 11, 22, 12, 13, 23."""
    own = ply.turn @ np.array([(xx, xy, xz), (xy, yy, yz), (xz, yz, 0.0)]) @ ply.turn.T
    return own[[0, 1, 0, 0, 1], [0, 1, 1, 2, 2]]


def elasticity(laminate: Laminate) -> tuple[float, Array]:
    """Return w in the middle plane and stress (n_plies, 2, 5), under sin Kx on the upper face (Pagano 1970).

    u, v and τxz, τyz go with cos Kx, w and the other stress with sin Kx, and nothing changes along y.
    """

    def growth(C: Array) -> tuple[Array, Array]:
        """Slopes over z of u, v, w, σzz, τxz, τyz, and stretches xx, zz and shear xy, by them."""
        M, strain = np.zeros((6, 6)), np.zeros((3, 6))
        strain[0, 0] = strain[2, 1] = -K
        strain[1] = np.array([K * C[0, 2], K * C[5, 2], 0, 1, 0, 0]) / C[2, 2]
        M[:2, 4:], M[0, 2], M[2], M[3, 4] = np.linalg.inv(C[np.ix_([4, 3], [4, 3])]), -K, strain[1], K
        M[4:] = -K * C[np.ix_([0, 5], [0, 2, 5])] @ strain
        return M, strain

    plies = [(each, elastic(each), *growth(elastic(each))) for each in laminate.plies]
    P = np.eye(6)
    for each, _, M, _ in plies:
        P = expm(M * each.thickness) @ P
    state, stress, middle = np.append(np.linalg.solve(P[3:, :3], [1.0, 0.0, 0.0]), np.zeros(3)), [], 0.0
    for number, (each, C, M, strain) in enumerate(plies):
        if 2 * number == len(plies):
            middle = state[2]
        for _ in range(2):
            stress.append(in_ply(each, *C[np.ix_([0, 1, 5], [0, 2, 5])] @ strain @ state, *state[4:]))
            state = expm(M * each.thickness) @ state
        state = expm(-M * each.thickness) @ state
    return middle, np.reshape(stress, (-1, 2, 5))


def first_order(laminate: Laminate, warped: bool) -> tuple[float, Array]:
    """Return the same by A, B, D and the shear stiffness of a laminate, with the warping of sections or without."""
    (A, B, D), S, bend = laminate.plane, laminate.shear, np.ix_([0, 2], [0, 2])
    whole = np.zeros((5, 5))  # u, v in the middle, turns of the section along x and y, w
    whole[:4, :4] = K**2 * np.block([[A[bend], B[bend]], [B[bend], D[bend]]])
    whole[2:, 2:] += (slope := np.array([(1, 0), (0, 1), (K, 0)])) @ S @ slope.T
    u = np.linalg.solve(whole, [0, 0, 0, 0, 1.0])
    shear, places, stress = slope.T @ u[2:], places_of_plies(laminate), []
    z = laminate.thickness * (places - 0.5)
    strain = -K * (np.insert(u[:2], 1, 0.0) + z[:, None] * np.insert(u[2:4], 1, 0.0))
    if warped:
        strain += laminate.warping_strain(places)[:, :, :2] @ (-K * shear)
    for ply, own, across in zip(laminate.ply_at(places), strain, laminate.shear_strain(places) @ shear, strict=True):
        xx, yy, yz, xz, xy = laminate.stiffnesses[ply] @ np.array([*own[:2], across[1], across[0], own[2]])
        stress.append(in_ply(laminate.plies[ply], xx, yy, xy, xz, yz))
    return u[4], np.reshape(stress, (-1, 2, 5))


@pytest.mark.parametrize(
    ("degrees", "ratio", "deflection", "plain", "warped", "shear"),
    [  # how far each is off: w, then 11, 22, 12 of plane sections and with warping, 13 and 23, over its largest
        ((45, -45), 10, 0.003, 0.026, 0.027, 0.38),
        ((45, -45, -45, 45), 4, 0.041, 0.36, 0.12, 0.14),
        ((45, -45, -45, 45), 10, 0.013, 0.081, 0.033, 0.09),
        ((30, -30, 30, -30), 10, 0.002, 0.19, 0.061, 0.05),
        ((45, -45) * 4, 10, 0.005, 0.095, 0.044, 0.17),
        ((0, 45, -45, 90, 90, -45, 45, 0), 10, 0.010, 0.18, 0.11, 0.09),
        ((0, 45, -45, 90, 90, -45, 45, 0), 50, 0.001, 0.009, 0.0055, 0.11),
    ],
)
def test_plies_at_angles_are_those_of_elasticity_to_what_the_page_says(
    degrees: tuple[int, ...], ratio: int, deflection: float, plain: float, warped: float, shear: float
) -> None:
    """Of 13 and 23 the shape across the laminate is off however thin it is."""
    laminate = stack(CARBON, 1 / ratio, *degrees)
    middle, exact = elasticity(laminate)
    size = np.abs(exact).max(axis=(0, 1))
    for of, within in ((False, plain), (True, warped)):
        w, found = first_order(laminate, of)
        off = np.abs(found - exact).max(axis=(0, 1)) / size
        assert abs(w / middle - 1) < deflection
        assert 0.8 * within < off[:3].max() < within, off
        assert off[3:].max() < shear, off


def test_random_stacks_of_thin_plies_bend_as_in_elasticity() -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        laminate = stack(CARBON, 1 / 50, *rng.uniform(-90, 90, 2 * rng.integers(1, 4)))
        assert first_order(laminate, False)[0] == pytest.approx(elasticity(laminate)[0], rel=3e-3)
