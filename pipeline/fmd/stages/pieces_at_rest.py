"""Pieces of a part together at rest, and how far their vibrations and deflections are from those of the part itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array
from fmd.core.cache import stage_key
from fmd.core.data_classes import dataclass
from fmd.core.limits.mesh import COMPARED_FREQUENCIES, FAMILIES
from fmd.core.limits.round_off import SOLVED
from fmd.core.rotations import move_loads
from fmd.stages.part import FlexiblePart
from fmd.stages.piece_mesh import CutPart

if TYPE_CHECKING:
    from fmd.reduction.body import FlexibleBody

_SOURCES = ("fmd/fem", "fmd/reduction", "fmd/stages/pieces_at_rest.py")


@dataclass(frozen=True)
class PiecesAtRest:
    """Mass and stiffness of pieces that are welded together, undeformed.

    Coordinates are those of all pieces, then velocity and spin of the first one's frame unless supports fix it.
    """

    M: Array  # (n, n): mass
    K: Array  # (n, n): stiffness
    closing: Array  # (k, n): rows that the cuts which close rings keep at 0
    motions: Mapping[str, Array]  # (6, n): translation and rotation of the part's markers by their names
    n_rigid: int  # number of rigid motions, which are the last coordinates

    @cached_property
    def _free(self) -> Array:
        """Motions that keep rings closed, shape (n, n - k)."""
        from scipy.linalg import null_space

        return null_space(self.closing) if len(self.closing) else np.eye(len(self.M))

    @cached_property
    def frequencies_hz(self) -> Array:
        """Elastic frequencies, ascending [Hz]."""
        from scipy.linalg import eigh

        free = self._free
        squares = eigh(free.T @ self.K @ free, free.T @ self.M @ free, eigvals_only=True)
        return np.asarray(np.sqrt(squares[self.n_rigid :]) / (2 * np.pi))

    def compliance(self, f: Array) -> Array:
        """Return the work (k, k) of loads f (n, k) in equilibrium on the deflections by each other."""
        loads = self._free.T @ f
        return np.asarray(loads.T @ np.linalg.pinv(self._free.T @ self.K @ self._free, hermitian=True) @ loads)


def put_together(bodies: Sequence[FlexibleBody], cut: CutPart, supported: bool) -> PiecesAtRest:
    """Weld the reduced bodies of pieces, free or with supports that hold the first one's frame."""
    ends = np.cumsum([0, *(len(body.omega) for body in bodies)])
    n_rigid = 0 if supported else 6
    n = int(ends[-1]) + n_rigid
    own = [slice(int(first), int(last)) for first, last in pairwise(ends)]
    frames = [np.eye(6, n, int(ends[-1])) * (n_rigid > 0)]  # velocity and spin of each piece's frame

    def move(piece: int, marker: str) -> Array:
        at, motion = bodies[piece].markers[marker], frames[piece].copy()
        motion[:3] -= np.cross(at.position[:, None], motion[3:], axis=0)
        motion[:3, own[piece]] += at.translation
        motion[3:, own[piece]] += at.rotation
        return motion

    M, K = np.zeros((n, n)), np.zeros((n, n))
    for k, body in enumerate(bodies):
        if k:
            weld = next(each for each in cut.cuts if each.second == k and not each.closes)
            frames.append(move(weld.first, weld.of_first))
        J = np.concatenate([frames[k], np.eye(n)[own[k]]])
        M += J.T @ body.integrals.mass_matrix(np.eye(1, 1 + len(body.omega))[0]) @ J
        K[own[k], own[k]] = np.diag(body.omega**2)
    rings = (each for each in cut.cuts if each.closes)
    residuals = (move(each.first, each.of_first) - move(each.second, each.of_second) for each in rings)
    motions = {name: move(k, name) for k, piece in enumerate(cut.pieces) for name in piece.own_markers}
    return PiecesAtRest(M, K, np.concatenate([np.zeros((0, n)), *residuals]), motions, n_rigid)


@dataclass(frozen=True)
class PartAtRest:
    """Frequencies and compliances of a part in one piece at rest."""

    frequencies_hz: Array  # lowest frequencies, free but for the supports [Hz]
    # (6, 6): work of unit forces and torques at markers on the deflections by each other, balanced at the first marker
    # unless supports fix the part
    compliances: Mapping[str, Array]


def measure_part(part: FlexiblePart, ports: Sequence[str]) -> PartAtRest:
    """Measure a part in one piece, with loads at markers; kept under the part's key."""
    inputs = {"part": part.key("body"), "ports": [*ports]}
    key = stage_key("at rest", inputs, _SOURCES, ("numpy", "scipy", "scikit-fem"))
    return part.store.read_or_compute("at rest", key, lambda: _measure(part, ports), kind="PartAtRest")


def _measure(part: FlexiblePart, ports: Sequence[str]) -> PartAtRest:
    from fmd.reduction.mode_families import lowest_modes

    solver = replace(part.model).solver  # a copy: its factor is let go with it
    count = COMPARED_FREQUENCIES * (1 if part.shape.modes.family == "any" else FAMILIES)
    found = {}
    columns = {name: part.markers[name].columns(len(part.fe.x), np.eye(3)) for name in ports}
    for name, f in balance(part, ports, columns).items():
        u = solver.static_response(f)
        found[name] = np.asarray(np.tensordot(f, u, axes=([0, 1], [0, 1])))
    return PartAtRest(lowest_modes(solver, min(count, solver.most_modes())).frequencies_hz, found)


def balance(part: FlexiblePart, ports: Sequence[str], loads: Mapping[str, Array]) -> dict[str, Array]:
    """Balance unit loads (…, 6) at each marker by those at the first one, unless supports fix the part."""
    if part.shape.support:
        return dict(loads)
    found = {}
    for name in ports[1:]:
        arm = part.markers[name].position - part.markers[ports[0]].position
        found[name] = loads[name] - loads[ports[0]] @ move_loads(arm)
    return found


def frequency_error(together: PiecesAtRest, part: FlexiblePart, whole: PartAtRest) -> float:
    """Return the largest relative error of the lowest frequencies of pieces together.

    Modes of one family have fewer frequencies than the part; each of these counts against the nearest one.
    """
    ours, true = together.frequencies_hz[:COMPARED_FREQUENCIES], whole.frequencies_hz
    if part.shape.modes.family == "any":
        n = min(len(ours), len(true), COMPARED_FREQUENCIES)
        return float(np.abs(ours[:n] / true[:n] - 1.0).max(initial=0.0))
    ours = ours[ours < true.max(initial=0.0)]
    return float(np.abs(ours[:, None] / true - 1.0).min(axis=1).max(initial=0.0))


def deflection_error(together: PiecesAtRest, part: FlexiblePart, whole: PartAtRest, ports: Sequence[str]) -> float:
    """Return the largest relative error of the deflection of pieces together under a load at one of some markers.

    Modes of one family take some loads alone, and have no such error here.
    """
    if part.shape.modes.family != "any":
        return 0.0
    loads = balance(part, ports, {name: together.motions[name].T for name in ports})
    return max((_relative(together.compliance(f), whole.compliances[name]) for name, f in loads.items()), default=0.0)


def _relative(ours: Array, true: Array) -> float:
    """Return the largest relative error of a quadratic form (k, k), where the true one isn't round-off."""
    size = np.sqrt(np.diag(true))
    used = size > 0.0  # a single point takes no torque
    scale = np.outer(size[used], size[used])
    values, vectors = np.linalg.eigh(true[np.ix_(used, used)] / scale)
    kept = vectors[:, values > SOLVED] / np.sqrt(values[values > SOLVED])
    return float(np.abs(np.linalg.eigvalsh(kept.T @ (ours[np.ix_(used, used)] / scale) @ kept) - 1.0).max(initial=0.0))
