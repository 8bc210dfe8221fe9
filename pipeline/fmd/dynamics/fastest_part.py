"""The part of a mechanism that makes its fastest vibration, or stops a motion fastest, and how fast that is."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.linear_forces import LinearForces, gather_linear_forces, linearise_forces

if TYPE_CHECKING:
    from fmd.dynamics.compiled_system.reference_state import ReferenceState
    from fmd.dynamics.mechanism import Mechanism


@dataclass(frozen=True)
class FastestPart:
    """Stiffness or damper that sets the shortest time in a mechanism's reference state."""

    name: str
    damps: bool  # true if it is a damper that stops a motion, false if it is a stiffness that makes a vibration
    # Angular frequency of that vibration, or one over the time in which the motion falls to 37 % [rad/s or 1/s].
    rate: float


def find_fastest_part(system: ReferenceState) -> FastestPart | None:
    """Find the part with the largest share in the fastest vibration or the fastest decay, with all end stops touched.

    Loops are left open. None stands for a mechanism without stiffness and dampers.
    """
    M, K, C = system.stiffest_matrices
    if not len(M) or not (K.any() or C.any()):
        return None
    (squared, swings), (decay, stops) = _largest(K, M), _largest(C, M)
    omega = float(np.sqrt(max(squared, 0.0)))
    damps = decay > 2.0 * omega
    shape = stops if damps else swings
    shares = {name: abs(float(shape @ (part[1] if damps else part[0]) @ shape)) for name, part in _parts(system)}
    return FastestPart(max(shares, key=lambda name: shares[name]), damps, decay if damps else omega)


def _largest(A: Array, M: Array) -> tuple[float, Array]:
    """Return the largest eigenvalue of ``A x = λ M x`` and its vector."""
    from scipy.linalg import eigh

    values, shapes = eigh(0.5 * (A + A.T), M)
    return float(values[-1]), np.asarray(shapes[:, -1])


def _parts(system: ReferenceState) -> Iterator[tuple[str, tuple[Array, Array]]]:
    """Yield each joint, each body and each force element by its name, with its stiffness and damping (n, n)."""
    mechanism = system.mechanism
    links = list(mechanism.links)
    whole = gather_linear_forces(links, mechanism.layout)
    for k, link in enumerate(links):
        loose = [*links[:k], replace(link, spring=0.0, damper=0.0, laws=()), *links[k + 1 :]]
        without = gather_linear_forces(loose, mechanism.layout)
        yield f"joint '{link.joint_name or link.name}'", _difference(whole, without)
        modes, own = mechanism.modes_of(k), np.zeros((2, mechanism.n, mechanism.n))
        own[0, modes, modes] = link.omega**2
        own[1, modes, modes] = 2.0 * link.damping * link.omega if len(link.damping) else 0.0
        yield f"the modes of body '{link.part or link.name}'", (own[0], own[1])
    yield from _elements(mechanism, whole)


def _elements(mechanism: Mechanism, without: LinearForces) -> Iterator[tuple[str, tuple[Array, Array]]]:
    """Yield each force element by its name, with its stiffness and damping."""
    for element in mechanism.elements:
        yield (
            f"{element.title} '{element.name}'",
            _difference(linearise_forces(replace(mechanism, elements=[element])), without),
        )


def _difference(a: LinearForces, b: LinearForces) -> tuple[Array, Array]:
    """Return by how much stiffness and damping differ, with end stops."""
    return a.K + a.stop_K - b.K - b.stop_K, a.C + a.stop_C - b.C - b.stop_C
