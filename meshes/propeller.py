"""Propellers: a sleeve and blades that grow out of it through joints, in one mesh of hexahedra.

The axis of rotation is z. Gmsh divides the straightened propeller, whose blades are sectors of a ring; each of its
points (r, θ, z) then moves to where the blade's section at the radius r has it. With u and w from −1 to 1 across the
thickness and along the chord, a section lies on the cylinder of radius r, unrolled, as::

    (y, z) = ½ c w (cos β, sin β) + (½ t u (1 − (1 − e) w²) − k c (1 − w²)) (sin β, −cos β)

with chord c, thickness t, thickness of the edges e·t, camber k·c and pitch β against the plane of rotation. On the
sleeve c is its length, t the width of the seat, e = 1, k = 0, β = 90°, and the section is the seat itself; along the
joint all of them pass smoothly to those of the blade.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.spatial import cKDTree

from fmd.meshes.gmsh_session import MeshArrays, gmsh_model, read_out
from fmd.meshes.ring import add_mid_edge_nodes, split_into_tetrahedra

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PropellerShape:
    """Dimensions of a propeller, its sleeve, joints and blades."""

    blades: int  # number of blades, at least 2
    bore: float  # radii [m]: inner and outer of the sleeve, outer of the joints, outer of the blades
    hub: float
    root: float
    tip: float
    length: float  # extent of the sleeve along z [m]
    # this and the next 2: of the blade [m, m, rad], at equal distances from its root to its tip
    chord: tuple[float, ...]
    thickness: tuple[float, ...]
    pitch: tuple[float, ...]
    camber: float  # largest rise of a section's middle over its chord; thickness of its edges over that of its middle
    edge: float
    seat: float | None = None  # angle of each joint on the sleeve [rad]; by default its share of the cells around


@dataclass(frozen=True)
class PropellerCounts:
    """Numbers of cells along the edges of a propeller's sleeve, joints and blades."""

    around: int  # of the sleeve
    axial: int  # of the sleeve
    sleeve_radial: int  # of the sleeve
    seat: int  # around under each blade, fewer than ``around / blades``, and through the blade's thickness
    joint_radial: int  # along each joint and each blade
    blade_radial: int
    growth: float  # ratio of the cells at a blade's tip to those at its root, along the span


def mesh(table: Any) -> MeshArrays:
    """Mesh the propeller of a scene's table ``Propeller``, whose lengths across are diameters."""
    shape = PropellerShape(
        table.blades,
        bore=table.bore / 2,
        hub=table.hub / 2,
        root=table.root / 2,
        tip=table.diameter / 2,
        length=table.length,
        chord=table.chord,
        thickness=table.thickness,
        pitch=table.pitch,
        camber=table.camber,
        edge=table.edge,
        seat=table.seat,
    )
    (around, axial, radial), (_, seat, joint_radial) = table.mesh.sleeve, table.mesh.joint
    counts = PropellerCounts(around, axial, radial, seat, joint_radial, table.mesh.blade[2], table.mesh.growth)
    return propeller(shape, counts, table.mesh.element, table.mesh.order)


def propeller(
    shape: PropellerShape,
    counts: PropellerCounts,
    element: Literal["hexahedron", "tetrahedron"] = "hexahedron",
    order: int = 1,
) -> MeshArrays:
    """Mesh a propeller with hexahedra or tetrahedra of first or second order.

    Parameters
    ----------
    element : str
        ``hexahedron``, or ``tetrahedron`` for six in place of each.
    order : int
        1, or 2 for curved edges.

    Returns
    -------
    MeshArrays
        Parts ``sleeve``, ``joints``, ``blades``; faces ``bore``, ``back`` and ``front`` (the sleeve's ends, where z is
        least and greatest), and ``tip-1``, ``pressure-1``, ``suction-1`` and so on of each blade, the first on the x
        axis, the others following in the sense of rotation about z.
    """
    half = counts.seat * np.pi / counts.around if shape.seat is None else shape.seat / 2
    with gmsh_model("propeller") as gmsh:
        faces = _build_straight(gmsh, shape, counts, half)
        gmsh.model.mesh.generate(3)
        mesh = read_out(gmsh, faces)
    mesh = split_into_tetrahedra(mesh) if element == "tetrahedron" else mesh
    mesh = add_mid_edge_nodes(mesh) if order == 2 else mesh
    points = _bend(mesh.points, shape, half)
    return _by_sectors(mesh, shape.blades)._replace(points=_make_cyclic(points, shape.blades))


def _build_straight(gmsh: Any, shape: PropellerShape, counts: PropellerCounts, half: float) -> dict[str, list[int]]:
    """Build the straightened propeller in the current model and return the surfaces of each named face."""
    geo = gmsh.model.geo
    low = -shape.length / 2
    centre = geo.addPoint(0, 0, low)
    sector = 2 * np.pi / shape.blades
    radii = (shape.bore, shape.hub, shape.root, shape.tip)
    ends = [(k * sector - half, k * sector + half) for k in range(shape.blades)]
    points = [[[geo.addPoint(r * np.cos(a), r * np.sin(a), low) for a in pair] for r in radii] for pair in ends]
    arcs = [[geo.addCircleArc(row[0], centre, row[1]) for row in blade] for blade in points]
    following = [*points[1:], points[0]]
    gaps = [
        [geo.addCircleArc(here[r][1], centre, there[r][0]) for r in (0, 1)]
        for here, there in zip(points, following, strict=True)
    ]
    spokes = [[[geo.addLine(row[s], outer[s]) for s in (0, 1)] for row, outer in pairwise(blade)] for blade in points]
    along = (counts.sleeve_radial, counts.joint_radial, counts.blade_radial)
    growth = counts.growth ** (1 / max(counts.blade_radial - 1, 1))
    for blade in range(shape.blades):
        for arc in arcs[blade]:
            geo.mesh.setTransfiniteCurve(arc, counts.seat + 1)
        for arc in gaps[blade]:
            geo.mesh.setTransfiniteCurve(arc, counts.around // shape.blades - counts.seat + 1)
        for level, pair in enumerate(spokes[blade]):
            for spoke in pair:
                geo.mesh.setTransfiniteCurve(spoke, along[level] + 1, "Progression", growth if level == 2 else 1.0)
    volumes: dict[str, list[int]] = {"sleeve": [], "joints": [], "blades": []}
    faces: dict[str, list[int]] = {"bore": [], "back": [], "front": []}

    def extrude(inner: int, side: int, outer: int, other: int) -> tuple[int, list[int], int, int]:
        """Extrude a patch; return the volume, the surfaces over its curves, the bottom and the top."""
        patch = geo.addPlaneSurface([geo.addCurveLoop([inner, side, -outer, -other])])
        geo.mesh.setTransfiniteSurface(patch)
        geo.mesh.setRecombine(2, patch)
        top, volume, *around = geo.extrude([(2, patch)], 0, 0, shape.length, numElements=[counts.axial], recombine=True)
        return volume[1], [tag for _, tag in around], patch, top[1]

    for k in range(shape.blades):
        after = (k + 1) % shape.blades
        for level, part in enumerate(volumes):
            volume, around, bottom, top = extrude(
                arcs[k][level], spokes[k][level][1], arcs[k][level + 1], spokes[k][level][0]
            )
            volumes[part].append(volume)
            if part == "sleeve":
                faces["bore"].append(around[0])
                faces["back"].append(bottom)
                faces["front"].append(top)
            elif part == "blades":
                sides = zip(("pressure", "tip", "suction"), around[1:], strict=True)
                faces |= {f"{side}-{k + 1}": [surface] for side, surface in sides}
        volume, around, bottom, top = extrude(gaps[k][0], spokes[after][0][0], gaps[k][1], spokes[k][0][1])
        volumes["sleeve"].append(volume)
        faces["bore"].append(around[0])
        faces["back"].append(bottom)
        faces["front"].append(top)
    geo.synchronize()
    for part, tags in volumes.items():
        gmsh.model.addPhysicalGroup(3, tags, name=part)
    return faces


def _bend(points: Floats, shape: PropellerShape, half: float) -> Floats:
    """Move the points of the straightened propeller, with blades of 2 ``half`` [rad], to the real sections."""
    r, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    angle = np.arctan2(points[:, 1], points[:, 0])
    pitch = 2 * np.pi / shape.blades
    middle = np.round(angle / pitch) * pitch
    beyond = r > shape.hub * (1 + 1e-9)
    r, u, w = r[beyond], (angle - middle)[beyond] / half, z[beyond] / (shape.length / 2)
    width = 2 * shape.hub * half
    c = _section_property(shape, r, shape.chord, shape.length, _fillet)
    t = _section_property(shape, r, shape.thickness, width, _fillet)
    beta = _section_property(shape, r, shape.pitch, np.pi / 2, _turn)
    e = _section_property(shape, r, (shape.edge, shape.edge), 1.0, _fillet)
    k = _section_property(shape, r, (shape.camber, shape.camber), 0.0, _turn)
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


def _section_property(shape: PropellerShape, r: Floats, values: tuple[float, ...], seat: float, blend: Any) -> Floats:
    """Return a section's property at the radii r: the blade's, blended with the seat's along the joint."""
    stations = np.linspace(shape.root, shape.tip, len(values))
    if len(values) == 1:
        stations, values = np.array([shape.root, shape.tip]), values * 2
    curve = PchipInterpolator(stations, values)
    root, slope = curve(shape.root), curve(shape.root, 1)
    inner = root + slope * (np.minimum(r, shape.root) - shape.root)
    depth = shape.root - shape.hub
    s = np.clip((r - shape.hub) / depth, 0.0, 1.0)
    return np.asarray(
        np.where(r < shape.root, inner, curve(np.maximum(r, shape.root))) + (seat - root + slope * depth) * blend(s)
    )


def _fillet(s: Floats) -> Floats:
    """Blend from 1 to 0 with a slope at 0 and none at 1."""
    return (1 - s) ** 3


def _turn(s: Floats) -> Floats:
    """Blend from 1 to 0 with no slope at either end."""
    return 1 - s**2 * (3 - 2 * s)
