"""Statics of a Cosserat rod by a boundary value problem: the reference for solids that bend and twist far."""

from typing import Any

import numpy as np
from scipy.integrate import solve_bvp

from fmd.core.arrays import Array


def bend_rod(length: float, bending: Any, stretching: Any, force: Any, curvature: float = 0.0) -> Array:
    """Return the place (3,) of the end of a clamped rod along x under a dead force (3,) there.

    Simo, Comp Meth Appl Mech Eng 49 (1985). Orientations are quaternions w, x, y, z; ``curvature`` bends the unloaded
    rod about z; ``bending`` are G J, E I_y, E I_z, ``stretching`` E A and twice G A.
    """
    K, S = np.array(bending)[:, None], np.array(stretching)[:, None]
    along, own = np.array([[1.0], [0.0], [0.0]]), np.array([[0.0], [0.0], [curvature]])
    s = np.linspace(0.0, length, 41)
    angle = curvature * s
    y = np.zeros((10, len(s)))
    y[0] = np.sin(angle) / curvature if curvature else s
    y[1] = (1 - np.cos(angle)) / curvature if curvature else 0.0
    y[3], y[6] = np.cos(angle / 2), np.sin(angle / 2)

    for part in (0.25, 0.5, 0.75, 1.0):
        n = part * np.array(force)[:, None]

        def slopes(_: Array, y: Array, n: Array = n) -> Array:
            q, m = y[3:7] / np.linalg.norm(y[3:7], axis=0), y[7:]
            whole = np.broadcast_to(n, m.shape)
            tangent = turn(q, along + turn_back(q, whole) / S)
            k = own + turn_back(q, m) / K
            dq = 0.5 * np.concatenate([-(q[1:] * k).sum(axis=0)[None], q[0] * k + np.cross(q[1:].T, k.T).T])
            return np.concatenate([tangent, dq, -np.cross(tangent.T, whole.T).T])

        def ends(a: Array, b: Array) -> Array:
            return np.concatenate([a[:3], a[3:7] - [1, 0, 0, 0], b[7:]])

        found = solve_bvp(slopes, ends, s, y, tol=1e-8, max_nodes=5000)
        assert found.success, found.message
        s, y = found.x, found.y
    return np.asarray(y[:3, -1])


def turn(q: Array, v: Array) -> Array:
    """Turn vectors (3, n) by unit quaternions (4, n)."""
    twice = 2 * np.cross(q[1:].T, v.T).T
    return np.asarray(v + q[0] * twice + np.cross(q[1:].T, twice.T).T)


def turn_back(q: Array, v: Array) -> Array:
    """Turn vectors (3, n) by the inverse of unit quaternions (4, n)."""
    return turn(np.concatenate([q[:1], -q[1:]]), v)


def torsion_of_rectangle(a: float, b: float) -> float:
    """Return the torsion constant of a rectangle of sides a ≥ b (Saint-Venant; Timoshenko & Goodier, section 109)."""
    k = np.arange(1, 60, 2)
    return float(a * b**3 / 3 * (1 - 192 * b / (np.pi**5 * a) * (np.tanh(k * np.pi * a / (2 * b)) / k**5).sum()))
