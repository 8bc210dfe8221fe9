"""Constant stiffness and damping of a mechanism's modes, springs, dampers and force elements in its reference state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.compiler.efforts import effort_tangents
from fmd.dynamics.elements import Element, Matrices
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.links import Link
from fmd.dynamics.mechanism import Layout, Mechanism


class LinearForces(NamedTuple):
    """Stiffness and damping in the order of rates."""

    own: Array  # (n,): stiffness of each mode and each spring by itself
    K: Array  # (n, n): stiffness, with springs that grip a section which turns with its body's modes
    C: Array  # (n, n): damping, with dampers that grip such a section, and the slope of friction at rest
    stop_K: Array  # (n, n): stiffness that end stops add where all of them touch
    stop_C: Array  # (n, n): damping that they add then

    def __add__(self, other: object) -> LinearForces:
        """Return the sum with the forces of others."""
        assert isinstance(other, LinearForces)
        return LinearForces(*(a + b for a, b in zip(self, other, strict=True)))


def gather_linear_forces(links: Sequence[Link], layout: Layout) -> LinearForces:
    """Gather the stiffness and the damping of all links."""
    n = layout.n
    own = np.zeros(n)
    K, C, stop_K, stop_C = np.zeros((4, n, n))
    for k, link in enumerate(links):
        modes = layout.mode[k, : len(link.omega)]
        own[modes] = link.omega**2
        K[modes, modes] += link.omega**2
        if len(link.damping):
            C[modes, modes] += 2.0 * link.damping * link.omega
        if link.n_rates == 1:
            i = layout.rate[k]
            own[i] = link.spring
            grip = np.zeros(n)  # what stretches the spring: the joint, and the section's turning with the modes
            grip[i] = 1.0
            if link.grips_section:
                grip[modes] = link.joint_rotation
            K += link.spring * np.outer(grip, grip)
            C += link.damper * np.outer(grip, grip)
        for j, law in enumerate(link.laws):
            grip = np.zeros(n)
            grip[layout.rate[k] + j] = 1.0
            if link.grips_section:
                grip[modes] = link.joint_rotation
            along, slope = np.outer(grip, grip), max(law.curve.tangent(0.0)[1], 0.0)
            own[layout.rate[k] + j] += slope
            K += slope * along
            C += law.resting_damping * along
            stop_K += law.stop_stiffness * along
            stop_C += law.stop_damping * along
    return LinearForces(own, K, C, stop_K, stop_C)


def linearise_forces(mechanism: Mechanism) -> LinearForces:
    """Gather the stiffness and the damping of modes, joints and force elements in the order of rates.

    An element has ``Jᵀ K J`` and ``Jᵀ C J`` with the rates J of its strain for unit rates; a spring in tension has
    what that adds across its line, too. Of loads by the state the symmetric, positive part counts.
    """
    forces = gather_linear_forces(mechanism.links, mechanism.layout)
    if mechanism.efforts:
        forces = forces + _effort_forces(mechanism)
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

    The motion has this state with each rate at 1 in turn, and last with all at 0.
    """
    values, rates, swings = motion.strain(element)
    J, swing = ((part[:-1] - part[-1]).T for part in (rates, swings))
    return element.linearise(J, swing, values[-1])


def _effort_forces(mechanism: Mechanism) -> LinearForces:
    """Return what loads by the mechanism's own state add, with all else at rest."""
    K, C = (_positive_part(A) for A in effort_tangents(mechanism))
    nothing = np.zeros((2, *K.shape))
    return LinearForces(K.diagonal(), K, C, *nothing)


def _positive_part(A: Array) -> Array:
    """Return the symmetric part of a matrix, without negative eigenvalues."""
    values, vectors = np.linalg.eigh(0.5 * (A + A.T))
    return np.asarray(vectors * np.maximum(values, 0.0) @ vectors.T)
