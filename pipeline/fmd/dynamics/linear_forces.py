"""Constant stiffness and damping of a mechanism's modes, springs and dampers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.layout import Layout
from fmd.dynamics.links import Link


class LinearForces(NamedTuple):
    """Stiffness and damping in the order of rates.

    Attributes
    ----------
    own : ndarray, shape (n,)
        Stiffness of each mode and each spring by itself.
    K, C : ndarray, shape (n, n)
        Stiffness and damping, with springs and dampers that grip a section which turns with its body's modes, and the
        slope of friction at rest.
    stop_K, stop_C : ndarray, shape (n, n)
        What end stops add where all of them touch.
    """

    own: Array
    K: Array
    C: Array
    stop_K: Array
    stop_C: Array

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
            along, slope = np.outer(grip, grip), max(float(law.curve.slopes(np.zeros(1))[0]), 0.0)
            own[layout.rate[k] + j] += slope
            K += slope * along
            C += law.resting_damping * along
            stop_K += law.stop_stiffness * along
            stop_C += law.stop_damping * along
    return LinearForces(own, K, C, stop_K, stop_C)
