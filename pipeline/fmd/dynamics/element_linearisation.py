"""Constant stiffness and damping of all forces of a mechanism in its reference state, force elements included."""

from __future__ import annotations

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.mechanism import NO_LENGTH
from fmd.dynamics.elements import Element, SixAxisSpring
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.linear_forces import LinearForces
from fmd.dynamics.mechanism import Mechanism


def linearise_forces(mechanism: Mechanism) -> LinearForces:
    """Gather the stiffness and the damping of modes, joints and force elements in the order of rates.

    An element has ``Jᵀ K J`` and ``Jᵀ C J`` with the rates J of its strain for unit rates; a spring in tension has
    what that adds across its line, too.
    """
    forces = mechanism.linear_forces
    if not mechanism.elements:
        return forces
    n = mechanism.n
    unit = np.concatenate([np.eye(n), np.zeros((1, n))])
    motion = Kinematics(mechanism, np.zeros(n + 1), np.tile(mechanism.rest_positions, (n + 1, 1)), unit)
    scalar = np.ones(n)
    for link, first in zip(mechanism.links, mechanism.layout.rate, strict=True):
        scalar[first : first + link.n_rates] = link.n_rates == 1  # rotations in space are no oscillators by themselves
    for element in mechanism.elements:
        K, *others = _element_matrices(motion, element)
        forces = forces + LinearForces(scalar * K.diagonal(), K, *others)
    return forces


def _element_matrices(motion: Kinematics, element: Element) -> tuple[Array, Array, Array, Array]:
    """Return stiffness and damping of an element, and those that its end stops add, by unit rates of one state.

    Parameters
    ----------
    motion : Kinematics
        One state with each rate at 1 in turn, and last with all at 0.

    Returns
    -------
    tuple of ndarray, shapes (n, n)
        Of the element as it is, and what its end stops add where they touch.
    """
    values, rates, swings = motion.strain(element)
    J = (rates[:-1] - rates[-1]).T  # (n_strains, n)
    if isinstance(element, SixAxisSpring):
        some, none = slice(len(J)), np.zeros((J.shape[1], J.shape[1]))
        return J.T @ element.K[some, some] @ J, J.T @ element.C[some, some] @ J, none, none
    law, at = element.law, values[-1]
    along = J.T @ J
    K = max(float(law.curve.slopes(at)[0]), 0.0) * along
    tension, length = float(law.curve.values(at)[0]), float(at[0] + element.rest)
    if tension > 0.0 and length > NO_LENGTH:
        swing = (swings[:-1] - swings[-1]).T
        K = K + tension / length * (swing.T @ swing - along)
    return K, law.resting_damping * along, law.stop_stiffness * along, law.stop_damping * along
