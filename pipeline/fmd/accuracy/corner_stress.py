"""Largest stress at an edge where it has no limit: it grows with each finer mesh as in the theory of wedges.

About an edge where more than 180° are material, and about that of a rigid face, linear elastic stress grows as a power
of the distance below zero (Williams, J Appl Mech 19, 1952), and so does that of elements about it by their size.
"""

import math

import numpy as np

from fmd.accuracy.coarse_mesh import Pair
from fmd.core.arrays import Array, BoolArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.errors import CLAMPED_EDGE, EDGE_RINGS, OF_WEDGE
from fmd.core.rotations import rigid_motions
from fmd.fem.surface import SurfaceTopology, reentrant_angles
from fmd.recovery.stress import von_mises
from fmd.scene.variants import compare_element_sizes
from fmd.stages.division import part_of
from fmd.stages.part import FlexiblePart


@dataclass(frozen=True)
class CornerStress:
    """Largest stress of a body at an edge where it grows with each finer mesh."""

    body: str  # name of the body, or of the piece of one
    code: str  # code of the warning
    edge: str  # what the edge is, as the warning says it
    remedy: str  # what gives its stress a limit, as the warning says it
    exponent: float  # exponent by which the theory of wedges has stress grow towards the edge
    place: tuple[float, float, float]  # in the part's own coordinates [m]
    # Largest von Mises stress along these edges at one deformation, on a coarser mesh and on the run's [Pa].
    stress: tuple[float, float]
    ratio: float  # size of the coarser mesh's elements over the run's

    @property
    def growth(self) -> float:
        """Exponent by which the stress grows with smaller elements."""
        return math.log(self.stress[1] / self.stress[0]) / math.log(self.ratio)

    @property
    def text(self) -> str:
        """Text about a largest stress that grows with each finer mesh."""
        return f"stress has no limit at the {self.edge} where it is largest"

    @property
    def warning(self) -> str:
        """Warning with the growth that was measured, and a remedy."""
        part, (coarse, own) = part_of(self.body) or self.body, self.stress
        at = ", ".join(f"{1e3 * x:.4g}" for x in self.place)
        return (
            f"{part}: {self.text}, ({at}) mm: {1e-6 * own:.3g} MPa along it, and {1e-6 * coarse:.3g} MPa by elements "
            f"of {self.ratio:.2g} times the size, which goes on; {self.remedy} gives it a "
            f"limit, and stress a set distance away has one: [body.{part}.element.NAME] at = ..."
        )


class ReentrantEdges:
    """Edges of a body about which more than 180° are material."""

    code, remedy = "re-entrant-edge", "a fillet with two elements or more around"
    rings = EDGE_RINGS

    def __init__(self, part: FlexiblePart) -> None:
        angle = float(reentrant_angles(part.space.x, part.surface).max(initial=0.0))
        self.name = f"re-entrant edge of {np.degrees(angle):.0f} degrees"
        self.exponent = wedge_exponent(angle) if angle else 0.0

    def on(self, part: FlexiblePart) -> BoolArray:
        """Return which of a part's surface nodes are on these edges, shape (n_surface,)."""
        return reentrant_angles(part.space.x, part.surface) > 0.0


class RigidFaceEdge:
    """Edge of a face that a marker makes rigid, which keeps it from contracting.

    Large elements have the stress of bending alone, which is largest beside the edge; that settles with finer meshes up
    to where the edge itself has more.
    """

    code, exponent, rings = "rigid-face", CLAMPED_EDGE, 0

    def __init__(self, part: FlexiblePart, marker: str) -> None:
        self.marker = marker
        self.name = f"edge of the rigid face {part_of(part.name) or part.name}.{marker}"
        self.remedy = "attachment = 'averaged', which lets the face warp,"

    def on(self, part: FlexiblePart) -> BoolArray:
        """Return which of a part's surface nodes are on the face and on a triangle that isn't, shape (n_surface,)."""
        face = np.isin(part.surface.nodes, part.markers[self.marker].nodes)
        triangles = part.surface.triangles
        edge = np.zeros(len(face), dtype=bool)
        edge[triangles[~face[triangles].all(axis=1)]] = True
        return edge & face


def find_corner_stress(pair: Pair) -> list[CornerStress]:
    """Return the bodies whose largest stress is at an edge and grows from the coarser mesh to the run's as there."""
    found = []
    for name, part in pair.run.parts.items():
        edges: list[ReentrantEdges | RigidFaceEdge] = [ReentrantEdges(part)]
        edges += [RigidFaceEdge(part, marker) for marker, own in part.markers.items() if own.rigid]
        each = [corner for edge in edges if (corner := _corner_stress(pair, name, edge))]
        found += each[:1]
    return found


def _corner_stress(pair: Pair, name: str, edge: ReentrantEdges | RigidFaceEdge) -> CornerStress | None:
    """Return a body's largest stress if it is at an edge and grows by about its exponent."""
    run, part, other = pair.run, pair.run.parts[name], pair.coarse.parts[name]
    on, (time, place, _) = edge.on(part), run.stress_of(name).worst()
    if not (on.any() and _near(on, part.surface, edge.rings)[place] and pair.divides(name)):
        return None
    q = run.motion.modal(name)[int(np.abs(run.motion.times - time).argmin())]
    u = part.body.shapes[: len(part.space.x)] @ q
    own = float(von_mises(part.surface_stress[on] @ q).max())
    coarse = _stress_along_edge(other, edge.on(other), part.space.x, u)
    ratio = compare_element_sizes(part.shape, part.mesh.n_cells, other.mesh.n_cells)
    if not (coarse > 0.0 and ratio > 1.0):
        return None
    x, y, z = (float(each) for each in part.space.x[part.surface.nodes[place]])
    corner = CornerStress(name, edge.code, edge.name, edge.remedy, edge.exponent, (x, y, z), (coarse, own), ratio)
    return corner if corner.growth > OF_WEDGE * corner.exponent else None


def wedge_exponent(angle: float) -> float:
    """Return the exponent by which stress grows towards the edge of a wedge of material, above 180° [rad].

    It is 1 − λ with the smallest root of ``sin λω + λ sin ω = 0`` (Williams 1952, both faces free).
    """
    from scipy.optimize import brentq

    return 1.0 - float(brentq(lambda x: math.sin(x * angle) + x * math.sin(angle), 0.5, 1.0 - 1e-12))


def _near(on_edge: BoolArray, surface: SurfaceTopology, rings: int) -> BoolArray:
    """Return which of a surface's nodes are within some rings of triangles about an edge's, shape (n_surface,)."""
    for _ in range(rings):
        touched = surface.triangles[on_edge[surface.triangles].any(axis=1)]
        on_edge = on_edge.copy()
        on_edge[touched] = True
    return on_edge


def _stress_along_edge(part: FlexiblePart, on: BoolArray, places: Array, u: Array) -> float:
    """Return the largest von Mises stress along the edges of another mesh under the same deformation [Pa].

    The deformation is the combination of the part's shapes, beside a rigid motion, that is nearest to displacements u
    (n, 3) of the run's nodes at ``places``; ``on`` (n_surface,) marks the part's surface nodes on the edges.
    """
    from scipy.spatial import cKDTree

    x, shapes = part.space.x, part.body.shapes[: len(part.space.x)]
    seen = u[cKDTree(places).query(x)[1]]
    basis = np.concatenate([shapes, rigid_motions(x)], axis=2).reshape(3 * len(x), -1)
    q = np.linalg.lstsq(basis, seen.ravel(), rcond=None)[0][: shapes.shape[2]]
    return float(von_mises(part.surface_stress[on] @ q).max(initial=0.0))
