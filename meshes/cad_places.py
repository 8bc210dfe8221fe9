"""Names of a CAD part's faces by their places: flat ends such as ``xmin``, bores ``hole-1``, pins ``pin-1``."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

ROUND = {"Cylinder", "Surface of Revolution"}  # the latter is what IGES has for cylinders
_WIDEST_GAP = np.deg2rad(40.0)  # between such points, around a whole cylinder
_OFF = 1e-4  # of a cylinder: normals along its axis, radii that differ


class WholeCylinder(NamedTuple):
    """A face that is a whole cylinder."""

    what: str  # ``"pin"`` with material within, ``"hole"`` without
    middle: NDArray[np.float64]  # (3,): middle of its axis [m]
    axis: NDArray[np.float64]  # (3,): unit vector along its axis
    radius: float  # [m]
    length: float  # [m]


def name_faces_by_place(gmsh: Any, whole: Mapping[int, int]) -> dict[int, str]:
    """Return the names of surfaces of the current model, in metres, by their tags, as far as their places have one.

    All flat surfaces at an end of the part have one name; bores and pins, whole cylinders without and with material
    within, are numbered along x, then y, then z. ``whole`` has the face of each surface: the halves of a bore are
    surfaces of one face.
    """
    outer = {tag for tag in whole if len(gmsh.model.getAdjacencies(2, tag)[0]) < 2}
    low, high = _box(gmsh)
    names: dict[int, str] = {}
    groups: dict[int, list[int]] = {}
    for tag in sorted(outer):
        kind = gmsh.model.getType(2, tag)
        if kind == "Plane" and (name := _end(gmsh, tag, low, high)):
            names[tag] = name
        elif kind in ROUND:
            groups.setdefault(whole[tag], []).append(tag)
    found: dict[str, list[tuple[tuple[float, ...], list[int]]]] = {"hole": [], "pin": []}
    extent = float((high - low).max())
    for tags in groups.values():
        if (seen := look_at_cylinder(gmsh, tags)) is not None:
            found[seen.what].append((tuple(np.round(seen.middle / extent, 6)), tags))
    for what, cylinders in found.items():
        for number, (_, tags) in enumerate(sorted(cylinders), start=1):
            names |= dict.fromkeys(tags, f"{what}-{number}")
    return names


def find_centre(gmsh: Any, tags: list[int]) -> tuple[float, float, float, float]:
    """Return the area [m²] and the centre [m] of the face that some surfaces make up.

    Of a whole cylinder it is the middle of its axis, of another face its centroid.
    """
    areas = np.array([gmsh.model.occ.getMass(2, tag) for tag in tags])
    kinds = {gmsh.model.getType(2, tag) for tag in tags}
    cylinder = look_at_cylinder(gmsh, tags) if kinds <= ROUND else None
    if cylinder is not None:
        return float(areas.sum()), *_triple(cylinder.middle)
    centres = np.array([gmsh.model.occ.getCenterOfMass(2, tag) for tag in tags])
    return float(areas.sum()), *_triple(areas @ centres / areas.sum())


def describe_part(gmsh: Any, whole: Mapping[int, int], names: Mapping[tuple[int, int], list[str]]) -> dict[str, Any]:
    """Describe the current model with its faces, each under the first of its names.

    ``whole`` has the face of each surface, ``names`` those of each entity, by its dimension and tag, the best first.
    The result has the number of ``solids``, ``volume`` [m³], corners ``low`` and ``high`` of the box around them [m],
    and ``faces`` in the file's order, each with ``name``, ``kind`` of surface, ``area`` [m²] and ``centre`` [m].
    """
    surfaces: dict[str, list[int]] = {}
    for tag in whole:
        surfaces.setdefault(name_of_face(tag, whole, names), []).append(tag)
    faces = []
    for name, tags in surfaces.items():
        area, *centre = find_centre(gmsh, tags)
        kind = gmsh.model.getType(2, tags[0]).lower()
        kind = kind if kind in ("plane", "cylinder", "cone", "sphere", "torus") else "free-form"
        faces.append({"name": name, "kind": kind, "area": area, "centre": centre})
    solids = gmsh.model.getEntities(3)
    volume = float(sum(gmsh.model.occ.getMass(3, tag) for _, tag in solids))
    low, high = _box(gmsh)
    return {"solids": len(solids), "volume": volume, "low": _triple(low), "high": _triple(high), "faces": faces}


def name_of_face(tag: int, whole: Mapping[int, int], names: Mapping[tuple[int, int], list[str]]) -> str:
    """Return the first name of a surface that is no colour, else that by the number of its face."""
    own = (name for name in names.get((2, tag), []) if not name.startswith("#"))
    return next(own, f"face-{whole[tag]}")


def _triple(x: NDArray[np.float64]) -> tuple[float, float, float]:
    return float(x[0]), float(x[1]), float(x[2])


def _box(gmsh: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Corners of the box around the part [m]."""
    box = np.array([gmsh.model.getBoundingBox(3, tag) for _, tag in gmsh.model.getEntities(3)])
    return box[:, :3].min(axis=0), box[:, 3:].max(axis=0)


def _end(gmsh: Any, tag: int, low: NDArray[np.float64], high: NDArray[np.float64]) -> str:
    """Return the name of a flat surface at an end of the part, else an empty text."""
    start, end = gmsh.model.getParametrizationBounds(2, tag)
    normal = np.abs(gmsh.model.getNormal(tag, (np.array(start) + end) / 2))
    axis = int(normal.argmax())
    if normal[axis] < 0.9999:  # cosine between a normal and an axis
        return ""
    place, near = gmsh.model.occ.getCenterOfMass(2, tag)[axis], 1e-4 * (high - low).max()  # of the part's extent
    for side, at in (("min", low[axis]), ("max", high[axis])):
        if abs(place - at) < near:
            return "xyz"[axis] + side
    return ""


def look_at_cylinder(gmsh: Any, tags: list[int], solids: list[int] | None = None) -> WholeCylinder | None:
    """Return the whole cylinder of some surfaces of the model, or of solids alone; ``None`` if it isn't whole."""
    points, normals = [], []
    for tag in tags:
        (u0, v0), (u1, v1) = gmsh.model.getParametrizationBounds(2, tag)
        u, v = (np.ravel(a) for a in np.meshgrid(np.linspace(u0, u1, 24), [v0, v1]))  # points around each cylinder
        uv = np.stack([u, v], axis=1).ravel()
        points.append(np.array(gmsh.model.getValue(2, tag, uv)).reshape(-1, 3))
        normals.append(np.array(gmsh.model.getNormal(tag, uv)).reshape(-1, 3))
    x, n = np.concatenate(points), np.concatenate(normals)
    frame = np.linalg.svd(n)[2]  # its last row is the axis, across all normals
    if np.abs(n @ frame[2]).max() > _OFF:
        return None
    flat = n @ frame[:2].T
    angles = np.sort(np.arctan2(flat[:, 1], flat[:, 0]))
    if np.diff(np.r_[angles, angles[0] + 2 * np.pi]).max() > _WIDEST_GAP:
        return None
    across = x @ frame[:2].T
    A = np.concatenate([2 * across, np.ones((len(x), 1))], axis=1)  # |p|² = 2 c·p + r² − |c|²
    centre = np.linalg.lstsq(A, (across**2).sum(axis=1), rcond=None)[0][:2]
    radii = np.linalg.norm(across - centre, axis=1)
    if np.ptp(radii) > _OFF * radii.max():
        return None
    along = x @ frame[2]
    middle = np.array([*centre, (along.min() + along.max()) / 2]) @ frame
    start, end = gmsh.model.getParametrizationBounds(2, tags[0])
    on = np.array(gmsh.model.getValue(2, tags[0], (np.array(start) + end) / 2))
    to_axis = centre @ frame[:2] + (on @ frame[2]) * frame[2] - on
    within = list(on + 1e-3 * to_axis)  # of the radius
    own = [tag for _, tag in gmsh.model.getEntities(3)] if solids is None else solids
    what = "pin" if any(gmsh.model.isInside(3, tag, within) for tag in own) else "hole"
    return WholeCylinder(what, middle, frame[2], float(radii.mean()), float(np.ptp(along)))
