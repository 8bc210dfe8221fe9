"""Midsurfaces of thin-walled solids of one thickness, between planes and round faces that are parallel.

A plane half-way between two parallel faces, or a cylinder between two about one axis, cuts the solid in the middle of a
wall, and across all walls that it passes. All these cuts are divided where they meet, and round ones where bends begin.
A piece is of the midsurface where the solid's faces are half a thickness away on both of its sides; so walls end where
the middles of others are, and strips across walls are none.
"""

from collections.abc import Iterator
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

_ALIKE = 1e-3  # of the thickness: distances that are the same
_PARALLEL = 1e-6  # sine of the angle between parallel directions
_NEAR_FACE = 0.03  # of half a thickness: how far from a face a point is inside, or outside
_SAMPLES = 6  # points along each way of a piece that are looked at
_SQUARE = ((-1, -1), (1, -1), (1, 1), (-1, 1))
_MOST_ELSEWHERE = 0.05  # of the volume: what midsurface times thickness may be off


class Wall(NamedTuple):
    """A plane or a cylinder on which faces of the solid lie."""

    axis: NDArray[np.float64]  # (3,): normal of a plane; axis of a cylinder
    origin: NDArray[np.float64]  # (3,): a point on the plane, or on the axis
    radius: float = 0.0  # of a cylinder; 0 of a plane
    # (3,): of a cylinder: unit vectors from the axis to where the face begins, and across it, as it turns on
    bounds: tuple[NDArray[np.float64], ...] = ()
    angle: float = 0.0  # by which it turns

    def foot(self, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the nearest point on the whole plane or cylinder, and the unit vector across it there."""
        between = x - self.origin
        if not self.radius:
            return x - (between @ self.axis) * self.axis, self.axis
        aside = between - (between @ self.axis) * self.axis
        r = float(np.linalg.norm(aside))
        across = aside / r if r else self.bounds[0]
        return x + (self.radius - r) * across, across


def replace_by_midsurface(gmsh: Any, thickness: float) -> tuple[float, list[int]]:
    """Replace the only solid of the current model by its midsurface; return its volume [m³] and tags of lost faces.

    Of those most points aren't within half a thickness of a wall's middle.

    Raises
    ------
    ValueError
        There are several solids, no two faces are a thickness apart, or the midsurface isn't all of the solid; the
        message gives what was measured.
    """
    solids = gmsh.model.getEntities(3)
    if len(solids) > 1:
        raise ValueError(f"it has {len(solids)} solids, and a midsurface is found of one; mesh each as a body")
    occ, solid = gmsh.model.occ, solids[0]
    volume, box = occ.getMass(*solid), np.array(gmsh.model.getBoundingBox(*solid)).reshape(2, 3)
    faces = [face for _, face in gmsh.model.getEntities(2)]
    walls = [wall for face in faces if (wall := _wall(gmsh, face)) is not None]
    reach = float(np.linalg.norm(box[1] - box[0]))
    patches, cutters, middles = list[int](), list[int](), list(_middles(walls, thickness))
    for middle in middles:
        if middle.radius:
            patches.append(_cylinder(occ, middle, box.mean(axis=0), reach))
            cutters += [_radial(occ, middle, turn, thickness, box.mean(axis=0), reach) for turn in (0.0, middle.angle)]
        else:
            patches.append(_plane(occ, middle, box.mean(axis=0), reach))
    if not patches:
        raise ValueError(f"no two of its faces are {1e3 * thickness:g} mm apart; {_distances(walls)}")
    cuts = [occ.intersect([(2, patch)], [solid], removeTool=False)[0] for patch in patches]
    pieces = [piece for cut in cuts for piece in cut]
    into = occ.fragment(pieces, [(2, cutter) for cutter in cutters])[1] if len(pieces + cutters) > 1 else [pieces]
    occ.synchronize()
    of_patches = {piece for own in into[: len(pieces)] for piece in own}
    left = {piece for own in into[len(pieces) :] for piece in own} - of_patches
    wrong = {piece for piece in of_patches if not _is_middle(gmsh, piece[1], solid[1], thickness)}
    area = sum(occ.getMass(*piece) for piece in of_patches - wrong)
    if abs(area * thickness / volume - 1) > _MOST_ELSEWHERE:
        raise ValueError(
            f"midsurface times thickness is {1e9 * area * thickness:.4g} mm³, the solid has {1e9 * volume:.4g} mm³: "
            f"walls of another thickness, ribs, fillets or lumps aren't in it ({_distances(walls)}); export "
            "midsurfaces, or leave shell out"
        )
    lost = [face for face in faces if _is_lost(gmsh, face, middles, solid[1], thickness)]
    occ.remove([solid, *left, *wrong], recursive=True)
    occ.remove([curve for curve in occ.getEntities(1) if curve not in _rims(gmsh, occ)], recursive=True)
    occ.synchronize()
    return float(volume), lost


def _rims(gmsh: Any, occ: Any) -> set[tuple[int, int]]:
    """Return the curves around all surfaces."""
    occ.synchronize()
    return set(gmsh.model.getBoundary(gmsh.model.getEntities(2), combined=False, oriented=False))


def _wall(gmsh: Any, face: int) -> Wall | None:
    """Return the plane or cylinder of a face; ``None`` of another surface."""
    (u0, v0), (u1, _) = gmsh.model.getParametrizationBounds(2, face)
    kind = gmsh.model.getType(2, face)
    at = [u0, v0, u0 + min(u1 - u0, 1.0) / 2, v0, u1, v0]
    x = np.array(gmsh.model.getValue(2, face, at)).reshape(-1, 3)
    n = np.array(gmsh.model.getNormal(face, at)).reshape(-1, 3)
    if kind == "Plane":
        return Wall(n[0], x[0])
    if kind != "Cylinder":
        return None
    turn = np.cross(n[0], n[1])
    axis = turn / np.linalg.norm(turn)
    # Both normals meet on the axis: x0 − r n0 = x1 − r n1, but for the place along it.
    apart, normals = x[1] - x[0], n[1] - n[0]
    r = float(apart @ normals / (normals @ normals))
    sign = np.sign(r)
    return Wall(axis, x[0] - r * n[0], abs(r), (sign * n[0], np.cross(axis, sign * n[0])), float(u1 - u0))


def _points_on(gmsh: Any, face: int) -> Iterator[NDArray[np.float64]]:
    """Iterate over points inside of a face, spread over it."""
    (u0, v0), (u1, v1) = gmsh.model.getParametrizationBounds(2, face)
    share = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    for u in u0 + share * (u1 - u0):
        for v in v0 + share * (v1 - v0):
            if gmsh.model.isInside(2, face, [u, v], parametric=True):
                yield np.array(gmsh.model.getValue(2, face, [u, v]))


def _middles(walls: list[Wall], thickness: float) -> Iterator[Wall]:
    """Iterate over planes and cylinders half-way between two walls, each once."""
    found: list[Wall] = []
    for number, one in enumerate(walls):
        for other in walls[number + 1 :]:
            if abs((apart := _apart(one, other)) - thickness) > _ALIKE * thickness:
                continue
            towards = np.sign((other.origin - one.origin) @ one.axis)
            middle = one._replace(origin=one.origin + towards * apart / 2 * one.axis)
            if one.radius:
                middle = one._replace(radius=(one.radius + other.radius) / 2)
            if not any(_same(middle, known, thickness) for known in found):
                found.append(middle)
    yield from found


def _apart(one: Wall, other: Wall) -> float:
    """Return the distance between two surfaces; infinite if they aren't parallel planes or cylinders about one axis."""
    if bool(one.radius) != bool(other.radius) or np.linalg.norm(np.cross(one.axis, other.axis)) > _PARALLEL:
        return np.inf
    between = one.origin - other.origin
    if not one.radius:
        return abs(float(between @ one.axis))
    aside = between - (between @ one.axis) * one.axis
    gap = abs(one.radius - other.radius)
    return gap if np.linalg.norm(aside) < _ALIKE * gap else np.inf


def _same(one: Wall, other: Wall, thickness: float) -> bool:
    """Return true if two middles are one plane, or one part of a cylinder."""
    turned = float(np.linalg.norm(np.cross(one.axis, other.axis)))
    if abs(one.radius - other.radius) > _ALIKE * thickness or turned > _PARALLEL:
        return False
    between = one.origin - other.origin
    if not one.radius:
        return bool(abs(between @ one.axis) < _ALIKE * thickness)
    aside = between - (between @ one.axis) * one.axis
    near = np.linalg.norm(one.bounds[0] - other.bounds[0]) < _ALIKE and abs(one.angle - other.angle) < _ALIKE
    return bool(np.linalg.norm(aside) < _ALIKE * thickness and near)


def _distances(walls: list[Wall]) -> str:
    """Return a text with the shortest distances between faces that are parallel."""
    apart = (_apart(one, other) for k, one in enumerate(walls) for other in walls[k + 1 :])
    found = sorted({round(1e3 * d, 3) for d in apart if 0 < d < np.inf})
    return f"parallel faces are {', '.join(f'{d:g}' for d in found[:4])} mm apart" if found else "no faces are parallel"


def _plane(occ: Any, wall: Wall, centre: NDArray[np.float64], reach: float) -> int:
    """Add a square of a plane beyond the part, and return its tag."""
    across = np.linalg.svd(wall.axis[None])[2][1:]
    middle = centre - ((centre - wall.origin) @ wall.axis) * wall.axis
    return _quadrilateral(occ, [middle + reach * (a * across[0] + b * across[1]) for a, b in _SQUARE])


def _quadrilateral(occ: Any, corners: list[NDArray[np.float64]]) -> int:
    """Add a flat face with four corners, and return its tag."""
    points = [occ.addPoint(*x) for x in corners]
    lines = [occ.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
    return int(occ.addPlaneSurface([occ.addCurveLoop(lines)]))


def _cylinder(occ: Any, wall: Wall, centre: NDArray[np.float64], reach: float) -> int:
    """Add a part of a cylinder, longer than the part, and return its tag."""
    along = wall.origin + ((centre - wall.origin) @ wall.axis) * wall.axis
    ends = [along + wall.radius * wall.bounds[0] + s * reach * wall.axis for s in (-1, 1)]
    line = occ.addLine(*(occ.addPoint(*x) for x in ends))
    made = occ.revolve([(1, line)], *along, *wall.axis, wall.angle)
    return int(next(tag for dimension, tag in made if dimension == 2))


def _radial(occ: Any, wall: Wall, turn: float, thickness: float, centre: NDArray[np.float64], reach: float) -> int:
    """Add the flat face across a bend where it begins or ends, and return its tag."""
    along = wall.origin + ((centre - wall.origin) @ wall.axis) * wall.axis
    outwards = np.cos(turn) * wall.bounds[0] + np.sin(turn) * wall.bounds[1]
    ends = [(wall.radius + r * thickness / 2, s * reach) for r, s in _SQUARE]
    return _quadrilateral(occ, [along + r * outwards + s * wall.axis for r, s in ends])


def _is_middle(gmsh: Any, piece: int, solid: int, thickness: float) -> bool:
    """Return true if the solid's faces are half a thickness away on both sides of most of a piece."""
    good = [_is_halfway(gmsh, x, _normal(gmsh, piece, x), solid, thickness) for x in _points_on(gmsh, piece)]
    return 2 * sum(good) > len(good)


def _is_lost(gmsh: Any, face: int, middles: list[Wall], solid: int, thickness: float) -> bool:
    """Return true if most points of a solid's face aren't within half a thickness of a wall's middle."""
    found = []
    for x in islice(_points_on(gmsh, face), 0, None, _SAMPLES + 1):  # along a diagonal of the face
        within = _NEAR_FACE * thickness / 2 * _normal(gmsh, face, x)  # or without, where no wall is
        feet = ((y, middle.foot(y)) for y in (x - within, x + within) for middle in middles)
        found.append(
            any(
                np.linalg.norm(y - foot) <= thickness / 2 and _is_halfway(gmsh, foot, across, solid, thickness)
                for y, (foot, across) in feet
            )
        )
    return 2 * sum(found) < len(found)


def _normal(gmsh: Any, face: int, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit normal of a face at a point."""
    return np.array(gmsh.model.getNormal(face, gmsh.model.getParametrization(2, face, x.tolist())))


def _is_halfway(gmsh: Any, x: NDArray[np.float64], n: NDArray[np.float64], solid: int, thickness: float) -> bool:
    """Return true if the solid's faces are half a thickness away from a point along a unit vector, both ways."""
    inside, outside = (
        [bool(gmsh.model.isInside(3, solid, (x + s * share * thickness / 2 * n).tolist())) for s in (-1, 1)]
        for share in (1 - _NEAR_FACE, 1 + _NEAR_FACE)
    )
    return all(inside) and not any(outside)
