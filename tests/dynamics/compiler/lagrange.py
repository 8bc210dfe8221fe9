"""Lagrange's equations from the energies of `Kinematics`, by differences: for mechanisms without rotations in space."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import constant

STEP = 5e-3  # of differences of order 4


def without_drives(mechanism: Mechanism) -> Mechanism:
    """Mechanism without loads, dampers and prescribed motions: what is left conserves energy."""
    off = {"load": constant(0.0), "motion": None, "damper": 0.0, "damping": np.zeros(0)}
    return replace(mechanism, links=[replace(link, **off) for link in mechanism.links], loads=())


def accelerations(mechanism: Mechanism, q: Array, v: Array) -> Array:
    """Solve ``M a = ½ ∂(vᵀ M v)/∂q − Ṁ v − ∂V/∂q``."""
    units = np.eye(len(q))
    slopes = np.stack([slope(lambda x: mass_matrix(mechanism, x), q, unit) for unit in units])
    force = [slope(lambda x: potential(mechanism, x), q, unit) for unit in units]
    right = 0.5 * np.einsum("kij,i,j->k", slopes, v, v) - np.einsum("kij,k,j->i", slopes, v, v) - np.array(force)
    return np.linalg.solve(mass_matrix(mechanism, q), right)


def mass_matrix(mechanism: Mechanism, q: Array) -> Array:
    """Half the Hessian of the kinetic energy, which is quadratic, by the rates."""
    units = np.eye(mechanism.n)
    own = kinetic(mechanism, q, units)
    pairs = kinetic(mechanism, q, (units[:, None] + units).reshape(-1, mechanism.n))
    return pairs.reshape(mechanism.n, mechanism.n) - own[:, None] - own


def kinetic(mechanism: Mechanism, q: Array, v: Array) -> Array:
    """Kinetic energy for each row of v."""
    return Kinematics(mechanism, np.zeros(len(v)), np.tile(q, (len(v), 1)), v).energies[0]


def potential(mechanism: Mechanism, q: Array) -> Array:
    return Kinematics(mechanism, np.zeros(1), q[None], np.zeros((1, mechanism.n))).energies[1][0]


def slope(values: Callable[[Array], Array], q: Array, unit: Array) -> Array:
    """Derivative along a unit vector."""
    one, two = (values(q + k * STEP * unit) - values(q - k * STEP * unit) for k in (1, 2))
    return (8 * one - two) / (12 * STEP)
