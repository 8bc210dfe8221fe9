"""Reference for mechanisms with loops: rigid bodies in absolute coordinates, joints as constraints, no tree.

Position and orientation of each body are coordinates of their own, and every joint is a set of equations between them.
Derivatives are read off values in the complex plane, by an imaginary step and on a circle (exact for polynomials),
so that no Jacobian is written; accelerations and multipliers solve one augmented system, by least squares where
constraints are redundant.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from fmd.core.arrays import Array

Gap = Callable[[Array, Array], list[complex]]
"""Constraints of positions (n_bodies, 3) and rotations (n_bodies, 3, 3), which may be complex."""
_CIRCLE = np.exp(2j * np.pi * np.arange(8) / 8)
_TINY = 1e-100


@dataclass(frozen=True)
class AbsoluteBodies:
    """Rigid bodies by mass, centre of mass and inertia about it in their frames, and constraints on their frames."""

    masses: Sequence[float]
    centres: Sequence[Array]
    inertias: Sequence[Array]
    gaps: Gap
    gravity: Array

    def march(self, positions: Array, times: Array) -> tuple[Array, Array]:
        """Return positions (n_times, n, 3) and rotations of the frames from rest, all parallel to space."""
        n = len(self.masses)
        turned = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
        start = np.concatenate([positions.ravel(), turned.ravel(), np.zeros(6 * n)])
        found = solve_ivp(self._rates, (0.0, times[-1]), start, "DOP853", times, rtol=1e-9, atol=1e-10)
        assert found.success
        y = found.y.T
        rotations = [[_rotation(one) for one in at.reshape(n, 4)] for at in y[:, 3 * n : 7 * n]]
        return y[:, : 3 * n].reshape(-1, n, 3), np.array(rotations)

    def _rates(self, _: float, y: Array) -> Array:
        n = len(self.masses)
        x, quaternions = y[: 3 * n].reshape(n, 3), y[3 * n : 7 * n].reshape(n, 4)
        u = y[7 * n :].reshape(n, 6)
        R = np.array([_rotation(one) for one in quaternions])
        G = np.array([self._moved(x, R, unit.reshape(n, 6), _TINY * 1j).imag / _TINY for unit in np.eye(6 * n)]).T
        circle = np.array([self._moved(x, R, u, s) for s in _CIRCLE])
        bias = 2.0 * (_CIRCLE**-2.0 @ circle).real / len(_CIRCLE)
        M, Q = np.zeros((6 * n, 6 * n)), np.zeros(6 * n)
        for k in range(n):
            arm, omega = R[k] @ self.centres[k], u[k, 3:]
            inertia = R[k] @ self.inertias[k] @ R[k].T
            to_centre = np.hstack([np.eye(3), -_cross(arm)])
            rows = slice(6 * k, 6 * k + 6)
            M[rows, rows] = self.masses[k] * to_centre.T @ to_centre
            M[6 * k + 3 : 6 * k + 6, 6 * k + 3 : 6 * k + 6] += inertia
            force = self.masses[k] * (self.gravity - np.cross(omega, np.cross(omega, arm)))
            Q[rows] = to_centre.T @ force
            Q[6 * k + 3 : 6 * k + 6] -= np.cross(omega, inertia @ omega)
        whole = np.block([[M, G.T], [G, np.zeros((len(G), len(G)))]])
        a = np.linalg.lstsq(whole, np.concatenate([Q, -bias]), rcond=1e-11)[0][: 6 * n]
        spin = [0.5 * _quaternion_product(np.append(u[k, 3:], 0.0), quaternions[k]) for k in range(n)]
        return np.concatenate([u[:, :3].ravel(), np.concatenate(spin), a])

    def _moved(self, x: Array, R: Array, u: Array, s: complex) -> Array:
        """Return the gaps a time s later by steady velocities and spins, (v, ω) of each body, to second order."""
        tilde = s * np.array([_cross(omega) for omega in u[:, 3:]])
        return np.array(self.gaps(x + s * u[:, :3], R + tilde @ R + 0.5 * tilde @ tilde @ R))


def _cross(a: Array) -> Array:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def _rotation(quaternion: Array) -> Array:
    vector, scalar = quaternion[:3], quaternion[3]
    tilde = _cross(vector)
    return np.eye(3) + 2.0 * (scalar * tilde + tilde @ tilde) / (quaternion @ quaternion)


def _quaternion_product(a: Array, b: Array) -> Array:
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.append(vector, a[3] * b[3] - a[:3] @ b[:3])
