"""Constant stiffness and damping of all forces of a mechanism in its reference state, force elements included."""

from __future__ import annotations

import numpy as np

from fmd.dynamics.elements import Element, Matrices
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


def _element_matrices(motion: Kinematics, element: Element) -> Matrices:
    """Return stiffness and damping of an element, and those that its end stops add, by unit rates of one state.

    Parameters
    ----------
    motion : Kinematics
        One state with each rate at 1 in turn, and last with all at 0.
    """
    values, rates, swings = motion.strain(element)
    J, swing = ((part[:-1] - part[-1]).T for part in (rates, swings))
    return element.linearise(J, swing, values[-1])
