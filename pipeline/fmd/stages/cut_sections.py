"""Cuts of a part in pieces, weighted by the tractions of the part's own static deflections.

A piece that is loaded at a cut by the nodal forces that the whole transmits there deforms as it does in the whole, and
the motion on which these forces do work is common to both sides of the cut. So a chain of pieces with six coordinates a
cut has the flexibility of the whole under loads at its ends: the section warps in torsion and shear as it wants to,
which uniform tractions (RBE3) allow only in part. Between, tractions differ from these by what dies away from the loads
(Saint-Venant), and enter the energy with the square of the difference.

In a thin-walled part it dies away slowly: its sections warp and change their shape as they vibrate. Six coordinates
more, the motions on which the tractions of the part's lowest modes do work, hold pieces together in that. They are
those of a second marker, whose mean motion has them added, so that a second weld of the cut makes them common.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from fmd.core.arrays import Array, IntArray
from fmd.core.cache import stage_key
from fmd.core.limits.mesh import NEW_TRACTION, SAME_WEIGHT, TRACTION_MODES
from fmd.core.limits.round_off import SOLVED
from fmd.core.rotations import move_loads, rigid_motions
from fmd.fem.assembly import assemble
from fmd.fem.markers import Marker, traction_marker
from fmd.fem.mesh import SolidMesh
from fmd.fem.partition import facet_areas, interior_facets
from fmd.fem.space import Discretisation
from fmd.scene.bodies import Solid
from fmd.stages.piece_mesh import Cut, CutPart, round_to_grid

if TYPE_CHECKING:
    from fmd.reduction.eigen import FreeBodySolver
    from fmd.stages.part import FlexiblePart

_SOURCES = ("fmd/fem", "fmd/reduction", "fmd/stages/cut_sections.py", "fmd/stages/pieces.py")


def weigh_cuts(part: FlexiblePart, cut: CutPart, loaded: Collection[str]) -> tuple[tuple[Marker, ...], ...]:
    """Return for each cut the markers on the whole part's nodes, weighted by tractions there, a weld for each.

    They are that of static deflections by loads at the markers ``loaded``, and that of modes if they are wanted; none
    for a cut whose nodes are also on a rigid face, or whose forces have dependent resultants.
    """
    assert isinstance(part.shape, Solid)
    inputs = {
        "part": part.key("body"),
        "pieces": [(piece.digest, piece.offset.tolist()) for piece in cut.pieces],
        "cuts": repr(cut.cuts),
        "loaded": sorted(loaded),
        "sections": part.shape.sections,
    }
    key = stage_key("sections", inputs, _SOURCES, ("numpy", "scipy", "scikit-fem"))
    kind = "tuple[tuple[Marker, ...], ...]"
    return part.store.read_or_compute("sections", key, lambda: _compute(part, cut, sorted(loaded)), kind=kind)


def _compute(part: FlexiblePart, cut: CutPart, loaded: Sequence[str]) -> tuple[tuple[Marker, ...], ...]:
    responses = _Responses(part, cut, loaded)
    found = [responses.section(each) for each in cut.cuts]
    known: list[Marker] = []
    middle_first = sorted(range(len(found)), key=lambda k: abs(2 * k - len(found) + 1))
    for k in middle_first:  # loads are far from there
        own = found[k]
        if own is not None:
            found[k] = like = _like_a_known(own, known, part.plain_space.x)
            known += [like] if like is own else []
    pairs = zip(cut.cuts, found, strict=True)
    if part.shape.sections == "tractions":  # type: ignore[union-attr]
        return tuple(() if own is None else (own,) for _, own in pairs)
    return tuple(() if own is None else (own, *responses.warping(each, own)) for each, own in pairs)


class _Responses:
    """Static deflections of a whole part by loads on both sides of its cuts."""

    def __init__(self, part: FlexiblePart, cut: CutPart, loaded: Sequence[str]) -> None:
        self._part, self._cut = part, cut
        self._labels = np.empty(len(part.plain_space.element_nodes), dtype=np.int64)
        for k, piece in enumerate(cut.pieces):
            self._labels[piece.cells] = k
        self._facets = interior_facets(part.plain_space)
        floating = {part.joint.marker} if part.joint.floating else set()
        self._ports = {name: cut.holds(name) for name in loaded if name not in floating}
        self._origin = part.fe.m.sum(axis=0) @ part.fe.x / part.fe.mass
        self._solver: FreeBodySolver = replace(part.model).solver  # a copy: what it factorises is let go with it
        self._solved: dict[tuple[tuple[str, ...], ...], tuple[Array, Array]] = {}

    def section(self, cut: Cut) -> Marker | None:
        """Return the marker of a cut; ``None`` where there is none."""
        space, labels = self._part.plain_space, self._labels
        at = np.unique(self._facets[0][cut.facets])
        first, second = (space.element_nodes[at[labels[at] == number]] for number in (cut.first, cut.second))
        nodes = np.intersect1d(first, second)
        touching = np.isin(space.element_nodes, nodes).any(axis=1)
        if any(marker.rigid and np.isin(marker.nodes, nodes).any() for marker in self._part.markers.values()):
            return None
        u, f = self._deflect(cut, nodes)
        forces = self._nodal_forces(np.flatnonzero(touching & (labels == cut.second)), nodes, u) - f[nodes]
        forces *= self._share(cut, nodes)[:, None, None]
        centre = self._middle(cut)
        forces = forces.transpose(2, 0, 1)
        # A force at the origin has a moment about the middle of the section; without it resultants differ less in size.
        forces[:3] -= np.einsum("km,mib->kib", np.cross(self._origin - centre, np.eye(3)), forces[3:])
        try:
            return traction_marker(centre, nodes, space.x[nodes], forces)
        except ValueError:
            return None

    def warping(self, cut: Cut, section: Marker) -> list[Marker]:
        """Return the marker with the motions on which tractions of the lowest modes do work; none if they depend."""
        space, nodes = self._part.plain_space, section.nodes
        touching = np.isin(space.element_nodes, nodes).any(axis=1)
        forces = self._nodal_forces(np.flatnonzero(touching & (self._labels == cut.second)), nodes, self._modes)
        forces = (forces * self._share(cut, nodes)[:, None, None]).transpose(2, 0, 1)
        moments = np.cross(space.x[nodes] - section.position, forces).sum(axis=1)
        unit = np.concatenate([section.translation_weights, section.rotation_weights])
        forces -= np.tensordot(np.concatenate([forces.sum(axis=1), moments], axis=1), unit, axes=1)
        largest = np.linalg.norm(forces.reshape(len(forces), -1), axis=1).max()
        found: list[Array] = []
        for force in forces.reshape(len(forces), -1) / largest:
            left = force
            for _ in range(2):  # Gram and Schmidt twice: once leaves round-off
                left = left - sum(((own @ left) * own for own in found), start=np.zeros_like(left))
            if (size := float(np.linalg.norm(left))) > NEW_TRACTION and len(found) < len(unit):
                found.append(left / size)
        if len(found) < len(unit):
            return []
        more = np.reshape(found, unit.shape) * np.linalg.norm(unit, axis=(1, 2))[:, None, None]
        return [Marker(section.position, nodes, (unit + more)[:3], (unit + more)[3:])]

    @cached_property
    def _modes(self) -> Array:
        """Shapes of the part's lowest modes, more than a cut takes, since some load it alike."""
        return self._solver.modes(min(TRACTION_MODES, self._solver.most_modes())).shapes

    def _share(self, cut: Cut, nodes: IntArray) -> Array:
        """Share of a cut in the forces on its second piece at nodes (n,): less than 1 where that has cuts to others."""
        areas = {each: self._areas_at_nodes(each)[nodes] for each in self._cut.cuts if cut.second in each.pieces}
        return np.asarray(areas[cut] / np.sum(list(areas.values()), axis=0))

    def _areas_at_nodes(self, cut: Cut) -> Array:
        """Sum of the areas of a cut's facets around each node of the part [m²], shape (n_nodes,)."""
        space, (elements, local) = self._part.plain_space, self._facets
        pairs = space.element_nodes[elements[cut.facets]]
        shared = (pairs[:, 0, :, None] == pairs[:, 1, None]).any(axis=2)
        areas = facet_areas(space, elements[cut.facets, 0], local[cut.facets, 0])
        found = np.bincount(pairs[:, 0][shared], (areas[:, None] * shared)[shared], minlength=len(space.x))
        return np.asarray(found, dtype=float)

    def _middle(self, cut: Cut) -> Array:
        """Middle of a cut's facets [m], shape (3,)."""
        space, (elements, local) = self._part.plain_space, self._facets
        elements, local = elements[cut.facets, 0], local[cut.facets, 0]
        areas = facet_areas(space, elements, local)
        corners = space.kind.facet_corners
        middles = [
            space.x[space.element_nodes[e, corners[k]]].mean(axis=0) for e, k in zip(elements, local, strict=True)
        ]
        return np.asarray(areas @ np.array(middles) / areas.sum())

    def _deflect(self, cut: Cut, nodes: IntArray) -> tuple[Array, Array]:
        """Return deflections (n_nodes, 3, 6) by six loads through a cut, and the loads beyond the cut."""
        ports: list[tuple[str, ...]] = [(), ()]
        beyond = _reached(cut, self._cut.cuts, len(self._cut.pieces))
        if cut.first in beyond:  # a ring: forces may go round the other way, too
            sides = {cut.second}, {cut.first}
        else:
            sides = beyond, set(range(len(self._cut.pieces))) - beyond
            ports = [tuple(name for name, at in self._ports.items() if at in side) for side in sides]
        known = tuple(ports)
        if all(ports) and known in self._solved:
            return self._solved[known]
        f, back = (self._unit_loads(side, own, nodes) for side, own in zip(sides, ports, strict=True))
        supported = self._part.shape.support and 0 not in sides[0]
        u = self._solver.static_response(f if supported else f - back)
        if all(ports):
            self._solved = {known: (u, f)}
        return u, f

    def _unit_loads(self, side: set[int], ports: tuple[str, ...], nodes: IntArray) -> Array:
        """Return nodal loads of unit forces and torques about the origin on one side of a cut, (n_nodes, 3, 6)."""
        fe = self._part.fe
        if not ports:  # inertia in six motions
            inside = np.zeros(len(fe.x))
            inside[self._part.plain_space.element_nodes[np.isin(self._labels, list(side))]] = 1.0
            inside[nodes] = 0.0
            R = rigid_motions(fe.x - self._origin)
            f = inside[:, None, None] * (fe.m @ (R * inside[:, None, None]).reshape(len(R), -1)).reshape(R.shape)
            return np.asarray(f @ np.linalg.inv(np.einsum("iak,ial->kl", R, f)))
        f = np.zeros((len(fe.x), 3, 6))
        for name in ports:
            marker = self._part.markers[name]
            f += marker.columns(len(fe.x), np.eye(3)) @ move_loads(self._origin - marker.position) / len(ports)
        return f

    def _nodal_forces(self, elements: IntArray, nodes: IntArray, u: Array) -> Array:
        """Return the nodal forces that deform elements, at some of their nodes, shape (n, 3, k)."""
        part, mesh = self._part, self._part.plain_mesh
        used, cells = np.unique(mesh.cells[elements], return_inverse=True)
        midsurface = mesh.midsurface and mesh.midsurface.of_points(used)
        own = SolidMesh(
            mesh.points[used], cells.reshape(-1, mesh.cells.shape[1]), mesh.cell_type, {}, {}, midsurface=midsurface
        )
        fe = assemble(own, part.order, part.material.of_elements(elements), part.formulation)
        place = cKDTree(part.plain_space.x).query(fe.discretisation.x)[1]
        n = 3 * len(place)
        forces = (fe.K[:n, :n] @ u[place].reshape(n, -1)).reshape(len(place), 3, -1)
        order = np.argsort(place)
        return np.asarray(forces[order[np.searchsorted(place[order], nodes)]])


def _reached(cut: Cut, cuts: Sequence[Cut], count: int) -> set[int]:
    """Return the numbers of the pieces that hang together with a cut's second piece but for this cut."""
    found, new = {cut.second}, [cut.second]
    while new:
        at = new.pop()
        for other in cuts:
            if other is not cut and at in (other.first, other.second):
                beside = other.first + other.second - at
                if beside not in found:
                    found.add(beside)
                    new.append(beside)
    return found


def _like_a_known(marker: Marker, known: Sequence[Marker], x: Array) -> Marker:
    """Return a marker with the weights of a known one if both sections are equal but for a translation.

    So the equal pieces of a bar stay equal to the bit.
    """
    r, extent = x[marker.nodes] - marker.position, float(np.ptp(x, axis=0).max())
    for other in known:
        if len(other.nodes) != len(marker.nodes):
            continue
        away, place = cKDTree(x[other.nodes] - other.position).query(r)
        if away.max() > SOLVED * extent:
            continue
        pairs = [
            (other.translation_weights[:, place], marker.translation_weights),
            (other.rotation_weights[:, place], marker.rotation_weights),
        ]
        if all(np.abs(a - b).max() < SAME_WEIGHT * np.abs(b).max() for a, b in pairs):
            return replace(marker, translation_weights=pairs[0][0], rotation_weights=pairs[1][0])
    return marker


def mark_pieces(part: FlexiblePart, cut: CutPart, loaded: Collection[str]) -> CutPart:
    """Give pieces those markers that their own meshes don't define; joints and loads act at those ``loaded``."""
    shape, given = part.shape, list[dict[str, Marker]]({} for _ in cut.pieces)
    assert isinstance(shape, Solid)
    for k, piece in enumerate(cut.pieces):
        places = {name: shape.marker[name] for name in piece.own_markers}
        given[k] |= {name: part.markers[name] for name, at in places.items() if not at.is_face and at.link is None}
    if shape.sections in ("tractions", "warping"):
        for each, found in zip(cut.cuts, weigh_cuts(part, cut, loaded), strict=True):
            for again, marker in enumerate(found):
                cut, weld = cut.weld_again(each) if again else (cut, each)
                given[weld.first][weld.of_first] = given[weld.second][weld.of_second] = marker
    tree, extent = cKDTree(part.plain_space.x), float(np.ptp(part.plain_mesh.points, axis=0).max())
    pieces = []
    for piece, markers in zip(cut.pieces, given, strict=True):
        if not markers:
            pieces.append(piece)
            continue
        x = Discretisation(piece.mesh, part.order, part.formulation).x
        whole = np.asarray(tree.query(x + piece.offset)[1])
        own = {name: _moved(marker, whole, piece.offset, extent) for name, marker in markers.items()}
        pieces.append(replace(piece, given=own))
    return replace(cut, pieces=tuple(pieces))


def _moved(marker: Marker, whole: IntArray, offset: Array, extent: float) -> Marker:
    """Return a marker by the numbers of a piece's nodes, of which ``whole`` (n_nodes,) are those in the whole."""
    nodes = np.flatnonzero(np.isin(whole, marker.nodes))
    order = np.argsort(marker.nodes)
    place = order[np.searchsorted(marker.nodes[order], whole[nodes])]
    translation = marker.translation_weights
    return Marker(
        round_to_grid(marker.position - offset, extent),
        nodes,
        translation[place] if translation.ndim == 1 else translation[:, place],
        marker.rotation_weights[:, place],
    )
