"""Propellers: a sleeve and blades that grow out of it through joints, in one mesh of hexahedra.

The axis of rotation is z. Gmsh divides the straightened propeller, whose blades are sectors of a ring; each of its
points (r, θ, z) then moves to where the blade's section at the radius r has it. With u and w from −1 to 1 across the
thickness and along the chord, a section lies on the cylinder of radius r, unrolled, as::

    (y, z) = ½ c w (cos β, sin β) + (½ t u (1 − (1 − e) w²) − k c (1 − w²)) (sin β, −cos β)

with chord c, thickness t, thickness of the edges e·t, camber k·c and pitch β against the plane of rotation. On the
sleeve c is its length, t the width of the seat, e = 1, k = 0, β = 90°, and the section is the seat itself; along the
joint all of them pass smoothly to those of the blade.
"""

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.spatial import cKDTree

from fmd.meshes.gmsh_session import MeshArrays, gmsh_model, read_out
from fmd.meshes.ring import add_mid_edge_nodes, split_into_tetrahedra

Floats = NDArray[np.float64]


def mesh(table: Any) -> MeshArrays:
    """Mesh the propeller of a scene's table ``Propeller``, whose lengths across are diameters.

    Parts are ``sleeve``, ``joints``, ``blades``; faces ``bore``, ``back`` and ``front`` (the sleeve's ends, where z is
    least and greatest), and ``tip-1``, ``pressure-1``, ``suction-1`` and so on of each blade, the first on the x axis,
    the others following in the sense of rotation about z.
    """
    counts = table.mesh
    half = counts.joint[1] * np.pi / counts.sleeve[0] if table.seat is None else table.seat / 2
    with gmsh_model("propeller") as gmsh:
        faces = _build_straight(gmsh, table, half)
        gmsh.model.mesh.generate(3)
        mesh = read_out(gmsh, faces)
    mesh = split_into_tetrahedra(mesh) if counts.element == "tetrahedron" else mesh
    mesh = add_mid_edge_nodes(mesh) if counts.order == 2 else mesh
    points = _bend(mesh.points, table, half)
    return _by_sectors(mesh, table.blades)._replace(points=_make_cyclic(points, table.blades))


def _build_straight(gmsh: Any, table: Any, half: float) -> dict[str, list[int]]:
    """Build the straightened propeller in the current model and return the surfaces of each named face."""
    geo, counts = gmsh.model.geo, table.mesh
    low = -table.length / 2
    centre = geo.addPoint(0, 0, low)
    sector = 2 * np.pi / table.blades
    radii = [across / 2 for across in (table.bore, table.hub, table.root, table.diameter)]
    ends = [(k * sector - half, k * sector + half) for k in range(table.blades)]
    points = [[[geo.addPoint(r * np.cos(a), r * np.sin(a), low) for a in pair] for r in radii] for pair in ends]
    arcs = [[geo.addCircleArc(row[0], centre, row[1]) for row in blade] for blade in points]
    following = [*points[1:], points[0]]
    gaps = [
        [geo.addCircleArc(here[r][1], centre, there[r][0]) for r in (0, 1)]
        for here, there in zip(points, following, strict=True)
    ]
    spokes = [[[geo.addLine(row[s], outer[s]) for s in (0, 1)] for row, outer in pairwise(blade)] for blade in points]
    _divide_curves(geo.mesh, counts, arcs, gaps, spokes)
    volumes: dict[str, list[int]] = {"sleeve": [], "joints": [], "blades": []}
    faces: dict[str, list[int]] = {"bore": [], "back": [], "front": []}

    def extrude(inner: int, side: int, outer: int, other: int) -> tuple[int, list[int], int, int]:
        """Extrude a patch; return the volume, the surfaces over its curves, the bottom and the top."""
        patch = geo.addPlaneSurface([geo.addCurveLoop([inner, side, -outer, -other])])
        geo.mesh.setTransfiniteSurface(patch)
        geo.mesh.setRecombine(2, patch)
        top, volume, *around = geo.extrude(
            [(2, patch)], 0, 0, table.length, numElements=[counts.sleeve[1]], recombine=True
        )
        return volume[1], [tag for _, tag in around], patch, top[1]

    for k in range(table.blades):
        after = (k + 1) % table.blades
        for level, part in enumerate(volumes):
            volume, over, bottom, top = extrude(
                arcs[k][level], spokes[k][level][1], arcs[k][level + 1], spokes[k][level][0]
            )
            volumes[part].append(volume)
            if part == "sleeve":
                faces["bore"].append(over[0])
                faces["back"].append(bottom)
                faces["front"].append(top)
            elif part == "blades":
                sides = zip(("pressure", "tip", "suction"), over[1:], strict=True)
                faces |= {f"{side}-{k + 1}": [surface] for side, surface in sides}
        volume, over, bottom, top = extrude(gaps[k][0], spokes[after][0][0], gaps[k][1], spokes[k][0][1])
        volumes["sleeve"].append(volume)
        faces["bore"].append(over[0])
        faces["back"].append(bottom)
        faces["front"].append(top)
    geo.synchronize()
    for part, tags in volumes.items():
        gmsh.model.addPhysicalGroup(3, tags, name=part)
    return faces


def _divide_curves(mesh: Any, counts: Any, arcs: list[Any], gaps: list[Any], spokes: list[Any]) -> None:
    """Set the elements along the arcs of blades, those of the hub between them, and the spokes, of each blade."""
    seat, along = counts.joint[1], (counts.sleeve[2], counts.joint[2], counts.blade[2])
    growth = counts.growth ** (1 / max(along[2] - 1, 1))
    for own_arcs, own_gaps, own_spokes in zip(arcs, gaps, spokes, strict=True):
        for arc in own_arcs:
            mesh.setTransfiniteCurve(arc, seat + 1)
        for arc in own_gaps:
            mesh.setTransfiniteCurve(arc, counts.sleeve[0] // len(arcs) - seat + 1)
        for level, pair in enumerate(own_spokes):
            for spoke in pair:
                mesh.setTransfiniteCurve(spoke, along[level] + 1, "Progression", growth if level == 2 else 1.0)


def _bend(points: Floats, table: Any, half: float) -> Floats:
    """Move the points of the straightened propeller, with blades of 2 ``half`` [rad], to the real sections."""
    r, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    angle = np.arctan2(points[:, 1], points[:, 0])
    pitch = 2 * np.pi / table.blades
    middle = np.round(angle / pitch) * pitch
    beyond = r > table.hub / 2 * (1 + 1e-9)
    r, u, w = r[beyond], (angle - middle)[beyond] / half, z[beyond] / (table.length / 2)
    width = table.hub * half
    c = _section_property(table, r, table.chord, table.length, _fillet)
    t = _section_property(table, r, table.thickness, width, _fillet)
    beta = _section_property(table, r, table.pitch, np.pi / 2, _turn)
    e = _section_property(table, r, (table.edge, table.edge), 1.0, _fillet)
    k = _section_property(table, r, (table.camber, table.camber), 0.0, _turn)
    along = 0.5 * c * w
    across = 0.5 * t * u * (1 - (1 - e) * w**2) - k * c * (1 - w**2)
    y = along * np.cos(beta) + across * np.sin(beta)
    turned = middle[beyond] + y / r
    bent = points.copy()
    bent[beyond] = np.column_stack(
        [r * np.cos(turned), r * np.sin(turned), along * np.sin(beta) - across * np.cos(beta)]
    )
    return bent


def _by_sectors(mesh: MeshArrays, sectors: int) -> MeshArrays:
    """Put cells that come part by part, in each sector by sector, into the order of the sectors."""
    order = np.concatenate([each for k in range(sectors) for each in _of_sector(mesh.parts, sectors, k)])
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    parts = {name: np.sort(place[cells]) for name, cells in mesh.parts.items()}
    return mesh._replace(cells=mesh.cells[order], parts=parts, sectors=sectors)


def _of_sector(parts: Mapping[str, NDArray[np.int64]], sectors: int, k: int) -> list[NDArray[np.int64]]:
    """Return the cells of each part in the k-th sector."""
    return [np.split(cells, sectors)[k] for cells in parts.values()]


def _make_cyclic(points: Floats, sectors: int) -> Floats:
    """Replace points by exact images of those in the first sector, since Gmsh's differ by 1e-10 m."""
    tree = cKDTree(points)
    turns = [_turn_about_z(2 * np.pi * k / sectors) for k in range(sectors)]
    images = np.stack([tree.query(points @ turn.T)[1] for turn in turns])
    first = np.unique(images.min(axis=0))
    exact = points.copy()
    for turn, image in zip(turns, images, strict=True):
        exact[image[first]] = points[first] @ turn.T
    return exact


def _turn_about_z(angle: float) -> Floats:
    """Return the matrix (3, 3) of a rotation about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _section_property(table: Any, r: Floats, values: tuple[float, ...], seat: float, blend: Any) -> Floats:
    """Return a section's property at the radii r: the blade's, blended with the seat's along the joint."""
    hub, root, tip = (across / 2 for across in (table.hub, table.root, table.diameter))
    stations = np.linspace(root, tip, len(values))
    if len(values) == 1:
        stations, values = np.array([root, tip]), values * 2
    curve = PchipInterpolator(stations, values)
    value, slope = curve(root), curve(root, 1)
    inner = value + slope * (np.minimum(r, root) - root)
    depth = root - hub
    s = np.clip((r - hub) / depth, 0.0, 1.0)
    return np.asarray(np.where(r < root, inner, curve(np.maximum(r, root))) + (seat - value + slope * depth) * blend(s))


def _fillet(s: Floats) -> Floats:
    """Blend from 1 to 0 with a slope at 0 and none at 1."""
    return (1 - s) ** 3


def _turn(s: Floats) -> Floats:
    """Blend from 1 to 0 with no slope at either end."""
    return 1 - s**2 * (3 - 2 * s)
