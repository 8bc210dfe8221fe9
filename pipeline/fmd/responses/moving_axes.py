"""How a mechanism's positions follow its rates, and axes that turn with free bodies, at one state."""

import numpy as np
from scipy.linalg import block_diag

from fmd.core.arrays import EPSILON, Array
from fmd.core.rotations import matrix_of_quaternion
from fmd.dynamics.mechanism import Mechanism


def position_map(mechanism: Mechanism, q: Array) -> Array:
    """Return how positions change for unit rates, shape (n_positions, n): quaternions by ``½ e ∘ (ω, 0)``."""
    out = np.zeros((mechanism.n_positions, mechanism.n))
    for k, link in enumerate(mechanism.links):
        at, first = int(mechanism.layout.position[k]), int(mechanism.layout.rate[k])
        scalars = link.n_scalars
        out[at + np.arange(scalars), first + np.arange(scalars)] = 1.0
        if link.joint.turns_in_space:
            e = q[at + scalars : at + scalars + 4]
            turn = slice(first + scalars, first + scalars + 3)
            out[at + scalars : at + scalars + 3, turn] = 0.5 * (e[3] * np.eye(3) + _skew(e[:3]))
            out[at + scalars + 3, turn] = -0.5 * e[:3]
        out[mechanism.modal_positions_of(k), mechanism.modes_of(k)] = 1.0
    return out


def with_unit_quaternions(mechanism: Mechanism, q: Array) -> Array:
    """Return positions whose quaternions have the length 1."""
    out = q.copy()
    for k, link in enumerate(mechanism.links):
        if link.joint.turns_in_space:
            at = int(mechanism.layout.position[k]) + link.n_slides
            out[at : at + 4] /= np.linalg.norm(out[at : at + 4])
    return out


def turning_axes(mechanism: Mechanism, q: Array, v: Array) -> tuple[Array, Array, Array]:
    """Return W of ``δη_space = W δη``, Ω of ``δη̇ = δv − Ω δη``, and the part of Ω that acts on accelerations, too."""
    parts, turning, sliding = {}, {}, {}
    for k, link in enumerate(mechanism.links):
        if not link.joint.turns_in_space:
            continue
        at, first, slides = int(mechanism.layout.position[k]), int(mechanism.layout.rate[k]), link.n_slides
        omega = _skew(v[first + slides : first + slides + 3])
        R = matrix_of_quaternion(q[None, at + slides : at + slides + 4])[0]
        parts[first] = block_diag(*([R] if slides else []), np.eye(3))
        turning[first] = block_diag(*([omega] if slides else []), omega)
        sliding[first] = block_diag(*([omega] if slides else []), np.zeros((3, 3)))
    W = np.eye(mechanism.n)
    of_rates, of_accelerations = np.zeros((2, mechanism.n, mechanism.n))
    for first, block in parts.items():
        place = slice(first, first + len(block))
        W[place, place] = block
        of_rates[place, place], of_accelerations[place, place] = turning[first], sliding[first]
    return W, of_rates, of_accelerations


def _skew(a: Array) -> Array:
    """Matrix of the cross product with a vector: ``skew(a) @ b = a × b``."""
    return np.asarray(-np.einsum("abc,c->ab", EPSILON, a))
