"""The finite element model of solids, shells and beams that are one body, by one map from its independent unknowns."""

from collections.abc import Sequence
from functools import reduce

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.mesh import ON_A_LINE, OUTSIDE, RIGID_RESIDUAL, SEAM_PLACES
from fmd.core.rotations import rigid_motions
from fmd.fem.arms import Arms, join_arms
from fmd.fem.constraints import Constraints, rows_of
from fmd.fem.joined import JoinedSpace, Seam
from fmd.fem.markers import facets_on_face, weighted_marker
from fmd.fem.model import FEModel
from fmd.fem.node_turns import node_turns
from fmd.fem.selection import interpolate_points
from fmd.fem.shell_model import ShellModel
from fmd.fem.space import Member, member_of


class SeamError(ValueError):
    """Shells or beams don't follow the solids as they are told to."""


def join_models(space: JoinedSpace, models: Sequence[FEModel]) -> ShellModel:
    """Return the model of a body by those of its members, each of which moves freely.

    Points of beams' masses come behind the rows of the space.

    Raises
    ------
    SeamError
        A seam isn't on its face.
    """
    firsts = space.mesh.firsts
    sizes = np.diff(firsts)
    starts = np.cumsum([0, *(len(model.x) for model in models)])
    number = np.arange(starts[-1])
    own = [number[a : a + n] for a, n in zip(starts, sizes, strict=False)]
    behind = [number[a + n : b] for a, n, b in zip(starts, sizes, starts[1:], strict=False)]
    order = np.concatenate([*own, *behind])
    place = np.empty_like(order)
    place[order] = number
    rows = rows_of(order)
    T = sp.csr_array(sp.block_diag([model.point_map for model in models], format="csr")[rows])
    x = np.concatenate([model.x for model in models])[order]
    arms = [_placed(model.arms, start, place) for model, start in zip(models, starts, strict=False)]
    directors = reduce(
        join_arms, [_placed(own.directors, start, place) for own, start in zip(models, starts, strict=False)]
    )
    constraints = Constraints(T.shape[1], 0)
    for seam in space.mesh.seams:
        _sew(seam, space, T, constraints)
    shared = _Shared(space, T, directors)
    for first, second in space.mesh.shared.tolist():
        shared.lead(first, second, constraints)
    J, _ = constraints.transformation()
    return ShellModel(
        space,
        models[0].material,
        _permuted([model.K for model in models], rows),
        _permuted([model.m for model in models], order),
        x,
        T=sp.csr_array(T @ J),
        arms=reduce(join_arms, arms),
        directors=directors,
    )


def _permuted(blocks: Sequence[sp.csr_array], order: IntArray) -> sp.csr_array:
    """Return the matrix of blocks on the diagonal with rows and columns in another order."""
    return sp.csr_array(sp.csr_array(sp.block_diag(blocks, format="csr"))[order][:, order])


def _placed(arms: Arms | None, start: int, place: IntArray) -> Arms | None:
    """Return the arms of a member, whose points are numbered from ``start`` on before they have their places."""
    if arms is None:
        return None
    turn = sp.coo_array(arms.turn)
    row, column = turn.coords
    columns = 3 * place[start + column // 3] + column % 3
    moved = sp.csr_array((turn.data, (row, columns)), shape=(turn.shape[0], 3 * len(place)))
    return Arms(place[start + arms.points], arms.link, moved, arms.second)


class _Shared:
    """Nodes that two members have in common."""

    def __init__(self, space: JoinedSpace, T: sp.csr_array, directors: Arms | None) -> None:
        self._space, self._T, self._directors = space, T, directors

    def lead(self, first: int, second: int, constraints: Constraints) -> None:
        """Let the second of two nodes move as the first does, and turn as it does if that has rotations."""
        moved, by = (_columns(self._T, np.array([row])) for row in (second, first))
        if not constraints.are_given(moved).any():
            constraints.give(moved, by, np.eye(3))
        if not self._space.turning[first]:
            return
        follower = member_of(self._space.members, second)
        rotations = np.setdiff1d(_columns(self._T, self._points(second, follower)), moved)
        if constraints.are_given(rotations).any():
            return
        x, points = self._space.x, self._points(second, follower)
        arms = sp.csr_array(self._T[rows_of(points)])[:, rotations].toarray()
        whole = rigid_motions(x[points] - x[second])[:, :, 3:].reshape(-1, 3)
        leader = member_of(self._space.members, first)
        assert self._directors is not None
        turn = node_turns(self._T, self._directors, leader, np.array([first - leader.first - len(leader.space.x)]))
        others = np.unique(turn.indices)
        constraints.give(rotations, others, np.linalg.pinv(arms) @ whole @ turn[:, others].toarray())

    def _points(self, node: int, member: Member) -> IntArray:
        """Return the points that turn with a node."""
        midsurface = member.space.mesh.midsurface
        assert midsurface is not None
        local = np.flatnonzero(midsurface.owner == node - member.first - len(member.space.x))
        return np.asarray(member.first + local)


def _sew(seam: Seam, space: JoinedSpace, T: sp.csr_array, constraints: Constraints) -> None:
    """Let nodes move and turn as the solids do in the mean over their thickness, or over their section."""
    solids = space.members[0]
    facets = facets_on_face(solids.space, solids.own_points(seam.onto))
    if solids.space.mesh.midsurface is not None or not len(facets):
        raise SeamError(f"{seam.label}: no facet of the solids' boundary is on the second face")
    extent = float(np.ptp(space.x, axis=0).max())
    for node in seam.nodes.tolist():
        points, places, share = _across(space, node)
        others, weights = interpolate_points(solids.space, places)
        found = np.einsum("pn,pna->pa", weights, solids.space.x[others])
        away = np.linalg.norm(found - places, axis=1)
        thickness = 2 * float(np.linalg.norm(places - share @ places, axis=1).max())
        if away.max() > max(thickness if seam.within is None else seam.within, OUTSIDE * extent):
            at = ", ".join(f"{each:.4g}" for each in space.x[node])
            raise SeamError(
                f"{seam.label}: the node at ({at}) m is {away.max():.3g} m off the face that it is to follow"
            )
        nodes, place = np.unique(others, return_inverse=True)
        place = place.reshape(others.shape)
        if away.max() <= OUTSIDE * extent:
            rows = np.zeros((len(places), len(nodes)))
            np.add.at(rows, (np.arange(len(places))[:, None], place), weights)
            moved = np.kron(rows, np.eye(3))
        else:  # over the rim of the face: as its nodes there in the mean
            mean = weighted_marker(nodes, solids.space.x[nodes], np.ones(len(nodes)))
            shift = np.kron(mean.translation_weights, np.eye(3)).reshape(3, -1)
            rigid = rigid_motions(places - mean.position).reshape(-1, 6)
            moved = rigid @ np.concatenate([shift, mean.rotation_weights.reshape(3, -1)])
        unknowns = _columns(T, np.append(points, node))
        if constraints.are_given(unknowns).any():
            raise SeamError(f"{seam.label}: a node follows two faces")
        # the unknowns' motion as rotation and displacement, and that at the places
        known = rigid_motions(space.x[points] - space.x[node]).reshape(-1, 6)
        motion = np.linalg.pinv(known, rcond=ON_A_LINE) @ sp.csr_array(T[rows_of(points)])[:, unknowns].toarray()
        there = rigid_motions(places - space.x[node]).reshape(-1, 6) @ motion
        root = np.sqrt(np.repeat(share, 3))[:, None]
        matrix = np.linalg.pinv(root * there, rcond=ON_A_LINE) @ (root * moved)
        left = there @ matrix @ rigid_motions(solids.space.x[nodes]).reshape(-1, 6)
        if np.abs(left - rigid_motions(places).reshape(-1, 6)).max() > RIGID_RESIDUAL * max(extent, 1.0):
            raise SeamError(f"{seam.label}: it doesn't follow rigid motions of the face")
        constraints.give(unknowns, rows_of(solids.first + nodes), matrix)


def _across(space: JoinedSpace, node: int) -> tuple[IntArray, Array, Array]:
    """Return the points of a node, and places (n, 3) with weights (n,) across its thickness or its section."""
    member = member_of(space.members, node)
    mesh = member.space.mesh
    assert mesh.midsurface is not None
    points = np.flatnonzero(mesh.midsurface.owner == node - member.first - len(mesh.points))
    s, w = np.polynomial.legendre.leggauss(SEAM_PLACES)
    s, w = 0.5 + 0.5 * s, 0.5 * w
    if mesh.midsurface.has_sections:
        ends = np.isin(mesh.cells, points).reshape(-1, 2, 4)
        corners = mesh.points[mesh.cells.reshape(-1, 2, 4)[ends.all(axis=2)]]  # (n_quads, 4, 3)
        N = np.array([[(1 - a) * (1 - b), a * (1 - b), a * b, (1 - a) * b] for a in s for b in s])
        area = 0.5 * np.linalg.norm(np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]), axis=1)
        places = np.einsum("pn,qna->qpa", N, corners).reshape(-1, 3)
        share = np.outer(area, np.outer(w, w)).ravel()
    else:
        lower, upper = mesh.points[np.split(points, 2)]  # of each director
        places = (lower[:, None] + s[:, None] * (upper - lower)[:, None]).reshape(-1, 3)
        share = np.outer(np.linalg.norm(upper - lower, axis=1), w).ravel()
    return member.first + points, places, share / share.sum()


def _columns(T: sp.csr_array, points: IntArray) -> IntArray:
    """Return the unknowns that move points; of one node its displacements in their order."""
    rows = sp.csr_array(T[rows_of(points)])
    return rows.indices if len(points) == 1 and rows.nnz == 3 else np.unique(rows.indices)
