"""Modes that neither the loads nor the motion can excite: left out of the integration, they stay at rest exactly.

Modes and their couplings are a graph. A mode is excited where a force reaches it in the undeformed state (by its part
in the inertia shape integrals's products with the rigid body, by a load or another body at a place that it moves, by
its own start) or where a mode that is excited acts on it; all others have nothing to move them. A blade's out-of-plane
modes under an in-plane motion stay at rest, and all but the evenly turned ones of a cyclic body in a steady drive.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fmd.core.arrays import EPSILON, Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.round_off import SOLVED
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.transmitted_loads import loaded_places
from fmd.reduction.inertia import InertiaIntegrals


@dataclass(frozen=True)
class Excited:
    """A mechanism without the modes that stay at rest."""

    mechanism: Mechanism  # with the other modes alone
    positions: IntArray  # numbers of its positions in the whole mechanism
    rates: IntArray  # numbers of its rates in the whole mechanism
    left_out: Mapping[str, tuple[int, ...]]  # numbers of the modes of each body that are left out, from 0


def excited_part(mechanism: Mechanism, q0: Array, tolerance: float) -> Excited | None:
    """Leave out the modes that stay at rest; ``None`` if there are none, or if nothing else would move.

    The motion starts at positions q0 (n_positions,). No force is one below ``tolerance`` of the largest static response
    to its kind, no coupling one below that of the modal mass.
    """
    if mechanism.contacts or not any(len(link.omega) for link in mechanism.links):  # contact excites all modes
        return None
    excited = []
    for b, link in enumerate(mechanism.links):
        forces, couplings = _acting(mechanism, b) if len(link.omega) else ([], [])
        start = q0[mechanism.modal_positions_of(b)]
        excited.append(reached(link.omega, [*forces, start], couplings, tolerance))
    left_out = {
        link.name: tuple(np.flatnonzero(~own).tolist()) for link, own in zip(mechanism.links, excited, strict=True)
    }
    if not any(left_out.values()):
        return None
    kept = [np.flatnonzero(own) for own in excited]
    part = mechanism.with_modes({link.name: own for link, own in zip(mechanism.links, kept, strict=True)})
    if not part.n:  # nothing moves but what is prescribed: there would be no march
        return None
    positions, rates = find_places(mechanism, part, kept)
    return Excited(part, positions, rates, {name: numbers for name, numbers in left_out.items() if numbers})


def reached(omega: Array, forces: Sequence[Array], couplings: Sequence[Array], tolerance: float) -> NDArray[np.bool_]:
    """Mark the modes that a force acts on, and those that a marked mode acts on in turn.

    Of the angular frequencies (n,) [rad/s] they are given by forces (n,), an array for each kind, 1 being a large
    force, and by couplings (n, n), 1 being the modal mass.
    """
    marked = np.zeros(len(omega), dtype=bool)
    linked = np.zeros((len(omega), len(omega)), dtype=bool)
    for force in forces:
        if np.abs(force).max(initial=0.0) > SOLVED:
            response = np.abs(force) * (omega.min() / omega) ** 2
            marked |= response > tolerance * response.max()
    for coupling in couplings:
        linked |= (np.abs(coupling) > tolerance) | (np.abs(coupling.T) > tolerance)
    for _ in omega:
        marked |= linked[:, marked].any(axis=1)
    return marked


def _acting(mechanism: Mechanism, b: int) -> tuple[list[Array], list[Array]]:
    """Forces on body b's modes by the rigid motion, its joint, its loads and its children; couplings of modes."""
    link, n, integrals = mechanism.links[b], len(mechanism.links[b].omega), mechanism.links[b].integrals
    products = _inertia_products(integrals, _common_axis(mechanism, b))
    inertia = float(np.sqrt(max(np.einsum("aa", integrals.G[:, :, 0, 0]), 1e-300)))
    size = float(np.sqrt(integrals.mass))
    forces = [product[0, 1:] / inertia for product in products]
    couplings = [product[1:, 1:] for product in products]
    accelerated = link.parent >= 0 or bool(link.joint.slides) or bool(np.any(mechanism.gravity))
    if accelerated:
        forces += list(integrals.S[:, 1:] / size)
        couplings += list(integrals.displacement2)
    couplings += [*integrals.rotation2, link.joint_displacement2]
    if link.motion is None and len(link.joint_rotation):
        forces.append(link.joint_rotation * inertia)
    loaded = loaded_places(mechanism, b)
    for load in loaded.loads:
        at = load.marker
        forces += list((at.rotation * inertia) if load.torque else (at.translation * size))
        couplings += list(at.displacement2)
    for at in [*loaded.markers[: len(loaded.carried)], *(at for *_, at in loaded.joined)]:
        forces += [*(at.translation * size), *(at.rotation * inertia)]
        couplings += list(at.displacement2)
    return [force for force in forces if len(force) == n], [pairs for pairs in couplings if len(pairs) == n]


def _inertia_products(integrals: InertiaIntegrals, axis: Array | None) -> list[Array]:
    """Combinations of the inertia shape integrals that the rigid motion can excite, (1 + n, 1 + n) each.

    Turning about one axis alone has one product of rates with both squares across it, and one antisymmetric product.
    """
    symmetric = 0.5 * (integrals.G + integrals.G.swapaxes(0, 1))
    antisymmetric = np.einsum("abc,bcij->aij", EPSILON, integrals.G)
    if axis is not None:
        across = np.eye(3) - np.outer(axis, axis)
        return [np.einsum("ab,abij->ij", across, symmetric), np.einsum("a,aij->ij", axis, antisymmetric)]
    return [*(symmetric[a, b] for a in range(3) for b in range(a, 3)), *antisymmetric]


def _common_axis(mechanism: Mechanism, body: int) -> Array | None:
    """Unit vector in a body's axes that every rotation of the mechanism is about, or ``None``."""
    axes, turned = list[Array](), list[Array]()  # axes in space, and each body's axes at rest
    for link in mechanism.links:
        if link.joint.turns_in_space:
            return None
        carrier = turned[link.parent] if link.parent >= 0 else np.eye(3)
        turned.append(carrier @ link.place_axes)
        axes += [turned[-1] @ link.direction(step) for step in link.joint.turns]
        axes += list((carrier @ link.place.rotation).T)
    for link, into_space in zip(mechanism.links, turned, strict=True):
        for at in mechanism.closed_places(link.name):
            axes += list((into_space @ at.rotation).T)
    if not axes:
        return None
    largest = axes[int(np.argmax([np.linalg.norm(axis) for axis in axes]))]
    axis = largest / np.linalg.norm(largest)
    across = max(np.linalg.norm(other - axis * (axis @ other)) for other in axes)
    return turned[body].T @ axis if across <= SOLVED * np.linalg.norm(largest) else None


def find_places(
    mechanism: Mechanism, part: Mechanism, kept: Sequence[IntArray] | None = None
) -> tuple[IntArray, IntArray]:
    """Return the places of a part's positions and rates, with the modes of each body that it keeps, in the whole."""
    positions, rates = np.zeros(part.n_positions, dtype=np.int64), np.zeros(part.n, dtype=np.int64)
    for b, link in enumerate(part.links):
        at, first = part.layout.rate[b], part.layout.position[b]
        rates[at : at + link.n_rates] = mechanism.layout.rate[b] + np.arange(link.n_rates)
        positions[first : first + link.n_positions] = mechanism.layout.position[b] + np.arange(link.n_positions)
        modes = slice(None) if kept is None else kept[b]
        rates[part.modes_of(b)] = mechanism.modes_of(b)[modes]
        positions[part.modal_positions_of(b)] = mechanism.modal_positions_of(b)[modes]
    return positions, rates
