"""Modes that neither the loads nor the motion can excite: left out of the integration, they stay at rest exactly.

Modes and their couplings are a graph. A mode is excited where a force reaches it in the undeformed state (by its part
in the Gram tensor's products with the rigid body, by a load or another body at a place that it moves, by its own start)
or where a mode that is excited acts on it; what no path reaches has nothing to move it. A blade's out-of-plane modes
under an in-plane motion are such, and all but the evenly turned ones of a cyclic body in a steady drive.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.core.arrays import Array, IntArray
from pipeline.dynamics.links import FREE, PRISMATIC, Link
from pipeline.dynamics.mechanism import Mechanism
from pipeline.dynamics.rotor.rotor import PlanarRotor
from pipeline.dynamics.system import System
from pipeline.dynamics.tree.arrays import plane_normal
from pipeline.reduction.body import FlexibleBody, MarkerShapes
from pipeline.reduction.inertia import InertiaGram

_ROUND_OFF = 1e-10  # of what it could be: no force at all


@dataclass(frozen=True)
class Excited:
    """A mechanism without the modes that stay at rest.

    Attributes
    ----------
    system : PlanarRotor or Mechanism
        With the other modes alone.
    positions, rates : ndarray
        Which of the whole mechanism's its positions and rates are.
    left_out : mapping of str to tuple of int
        Numbers of the modes of each body that are left out, from 0; a rotor's body has no name.
    """

    system: PlanarRotor | Mechanism
    positions: IntArray
    rates: IntArray
    left_out: Mapping[str, tuple[int, ...]]


def excited_part(system: System, q0: Array, tolerance: float) -> Excited | None:
    """Leave out the modes that stay at rest; ``None`` if there are none, or the mechanism is of another kind.

    Parameters
    ----------
    q0 : ndarray, shape (n_positions,)
        Positions at the start.
    tolerance : float
        What counts as no force and no coupling: a part of the largest static response to a force of its kind, and of
        the modal mass.
    """
    if isinstance(system, PlanarRotor):
        return _of_rotor(system, q0, tolerance)
    return _of_tree(system, q0, tolerance) if isinstance(system, Mechanism) else None


def reached(omega: Array, forces: Sequence[Array], couplings: Sequence[Array], tolerance: float) -> NDArray[np.bool_]:
    """Which modes a force acts on, or a mode that is reached itself.

    Parameters
    ----------
    omega : ndarray, shape (n,)
        Angular frequencies [rad/s].
    forces : sequence of ndarray, shapes (n,)
        What acts on each mode, one array for each kind; 1 is a large force.
    couplings : sequence of ndarray, shapes (n, n)
        What acts between modes; 1 is the modal mass.
    """
    found = np.zeros(len(omega), dtype=bool)
    linked = np.zeros((len(omega), len(omega)), dtype=bool)
    for force in forces:
        if np.abs(force).max(initial=0.0) > _ROUND_OFF:
            response = np.abs(force) * (omega.min() / omega) ** 2
            found |= response > tolerance * response.max()
    for coupling in couplings:
        linked |= (np.abs(coupling) > tolerance) | (np.abs(coupling.T) > tolerance)
    for _ in omega:
        found |= linked[:, found].any(axis=1)
    return found


def _of_rotor(rotor: PlanarRotor, q0: Array, tolerance: float) -> Excited | None:
    p, body = rotor.parameters, rotor.body
    scale = np.sqrt(p.D[0, 0])
    forces = [p.D[0, 1:] / scale, p.A[0, 1:] / scale, p.lever[1:] * scale, q0[1:]]
    kept = np.flatnonzero(reached(body.omega, forces, [p.D[1:, 1:], p.A[1:, 1:]], tolerance))
    if not 0 < len(kept) < len(body.omega):
        return None
    at = np.r_[0, 1 + kept]
    return Excited(replace(rotor, body=_body_with(body, kept)), at, at, {"": _others(kept, len(body.omega))})


def _of_tree(tree: Mechanism, q0: Array, tolerance: float) -> Excited | None:
    kept = []
    for b, link in enumerate(tree.links):
        forces, couplings = _acting(tree, b)
        start = q0[tree.modes_of(b) + tree.n_positions - tree.n]
        kept.append(np.flatnonzero(reached(link.omega, [*forces, start], couplings, tolerance)))
    left_out = {link.name: _others(k, len(link.omega)) for link, k in zip(tree.links, kept, strict=True)}
    if not any(left_out.values()):
        return None
    slow = {name: int((kept[_number(tree, name)] < count).sum()) for name, count in tree.slow_modes.items()}
    loads = [
        replace(load, shapes=_columns(load.shapes, own), rotations=_columns(load.rotations, own))
        for load in tree.loads
        for own in [kept[_number(tree, load.body)]]
    ]
    links = [_link_with(link, kept[b], kept[link.parent]) for b, link in enumerate(tree.links)]
    part = replace(tree, links=links, loads=loads, slow_modes=slow)
    if not part.n:  # nothing moves but what is prescribed: there would be no march
        return None
    positions, rates = np.zeros(part.n_positions, dtype=np.int64), np.zeros(part.n, dtype=np.int64)
    for b, link in enumerate(links):
        at, first = part.layout.rate[b], part.layout.position[b]
        rates[at : at + link.n_rates] = tree.layout.rate[b] + np.arange(link.n_rates)
        positions[first : first + link.n_positions] = tree.layout.position[b] + np.arange(link.n_positions)
        modes, whole = part.modes_of(b), tree.modes_of(b)[kept[b]]
        rates[modes] = whole
        positions[modes + part.n_positions - part.n] = whole + tree.n_positions - tree.n
    return Excited(part, positions, rates, {name: numbers for name, numbers in left_out.items() if numbers})


def _acting(tree: Mechanism, b: int) -> tuple[list[Array], list[Array]]:
    """Forces on body b's modes by the rigid motion, its joint, its loads and what it carries; couplings of modes."""
    link, p, n = tree.links[b], tree.parameters, len(tree.links[b].omega)
    G, A, gram = p.G[b, :, : 1 + n, : 1 + n], p.A[b, :, : 1 + n, : 1 + n], link.gram
    normal = plane_normal(tree.links)
    # Turning about one axis alone has the same product of rates with both squares across it.
    across = [a for a in range(3) if a != normal]
    products = [*G, *A] if normal < 0 else [G[across].sum(axis=0), A[normal]]
    inertia = float(np.sqrt(max(G[:3, 0, 0].sum(), 1e-300)))
    size = float(np.sqrt(gram.mass))
    forces = [product[0, 1:] / inertia for product in products]
    couplings = [product[1:, 1:] for product in products]
    accelerated = link.parent >= 0 or link.joint in (PRISMATIC, FREE) or bool(np.any(tree.gravity))
    if accelerated:
        forces += list(gram.S[:, 1:] / size)
        couplings += list(gram.bow) if gram.bow.size else []
    if link.motion is None and len(link.joint_rotation):
        forces.append(link.joint_rotation * inertia)
    for load in tree.loads:
        if load.body == link.name:
            forces += list((load.rotations * inertia) if load.torque else (load.shapes * size))
    for other in tree.links:
        if other.parent == b:
            forces += [*(other.place_shapes * size), *(other.place_rotations * inertia)]
    return [force for force in forces if len(force) == n], couplings


def _number(tree: Mechanism, name: str) -> int:
    return [link.name for link in tree.links].index(name)


def _others(kept: IntArray, n: int) -> tuple[int, ...]:
    return tuple(int(k) for k in np.setdiff1d(np.arange(n), kept))


def _columns(shapes: Array, kept: IntArray) -> Array:
    return shapes[:, kept] if shapes.size else shapes


def _link_with(link: Link, kept: IntArray, of_parent: IntArray) -> Link:
    return replace(
        link,
        gram=_gram_with(link.gram, kept),
        omega=link.omega[kept],
        damping=link.damping[kept] if len(link.damping) else link.damping,
        joint_rotation=link.joint_rotation[kept] if len(link.joint_rotation) else link.joint_rotation,
        place_shapes=_columns(link.place_shapes, of_parent),
        place_rotations=_columns(link.place_rotations, of_parent),
    )


def _gram_with(gram: InertiaGram, kept: IntArray) -> InertiaGram:
    at, both = np.r_[0, 1 + kept], np.ix_(kept, kept)
    return replace(
        gram,
        G=gram.G[:, :, at[:, None], at],
        S=gram.S[:, at],
        stiffening=gram.stiffening[:, :, both[0], both[1]] if gram.stiffening.size else gram.stiffening,
        bow=gram.bow[:, both[0], both[1]] if gram.bow.size else gram.bow,
    )


def _body_with(body: FlexibleBody, kept: IntArray) -> FlexibleBody:
    markers = {
        name: MarkerShapes(marker.position, marker.translation[:, kept], marker.rotation[:, kept])
        for name, marker in body.markers.items()
    }
    return replace(
        body, shapes=body.shapes[..., kept], omega=body.omega[kept], markers=markers, gram=_gram_with(body.gram, kept)
    )
