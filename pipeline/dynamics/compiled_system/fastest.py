"""The part of a mechanism that moves fastest by itself: what makes steps short."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pipeline.core.arrays import Array
from pipeline.dynamics.compiled_system.reference_state import ReferenceState
from pipeline.dynamics.element_linearisation import linearise_forces
from pipeline.dynamics.linear_forces import LinearForces


def describe_fastest(system: ReferenceState) -> str:
    """Name the force of a mechanism that acts fastest in the undeformed state, and how fast."""
    inverse: Array = np.asarray(np.linalg.inv(system.stiffest_matrices[0]), dtype=float)
    names, rates = list[str](), list[tuple[float, float]]()
    for name, K, C in _forces(system):
        names.append(name)
        rates.append((np.sqrt(_largest(inverse, K)), _largest(inverse, C)))
    if not rates or not np.max(rates) > 0.0:
        return "the motion itself"
    worst = int(np.argmax(np.max(rates, axis=1)))
    omega, decay = rates[worst]
    if omega >= decay:
        return f"{names[worst]}, which vibrates at {omega / (2 * np.pi):.2g} Hz"
    return f"the damper of {names[worst]}, which acts within {1 / decay:.2g} s"


def _forces(system: ReferenceState) -> Iterator[tuple[str, Array, Array]]:
    """Go through a mechanism's springs, bushings, joints and modes with the stiffness and the damping of each."""
    mechanism, joined = system.mechanism, system.mechanism.linear_forces
    for element in mechanism.elements:
        both = linearise_forces(replace(mechanism, elements=[element]))
        own = LinearForces(*(a - b for a, b in zip(both, joined, strict=True)))
        yield element.name, own.K + own.stop_K, own.C + own.stop_C
    for k, link in enumerate(mechanism.links):
        first = int(mechanism.layout.rate[k])
        joint = np.arange(first, first + link.n_rates)
        for name, rates in ((f"joint {link.joint_name or link.name}", joint), (link.name, mechanism.modes_of(k))):
            block = np.zeros((mechanism.n, mechanism.n))
            block[np.ix_(rates, rates)] = 1.0
            yield name, (joined.K + joined.stop_K) * block, (joined.C + joined.stop_C) * block


def _largest(inverse: Array, A: Array) -> float:
    """Return the largest eigenvalue of M⁻¹ A."""
    return float(np.abs(np.linalg.eigvals(inverse @ A)).max(initial=0.0))
