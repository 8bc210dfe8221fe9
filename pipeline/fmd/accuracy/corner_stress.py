"""Largest stress at a re-entrant edge, which has no limit: it grows with each finer mesh as in the theory of wedges.

About an edge where more than 180° are material, linear elastic stress grows as a power of the distance below zero
(Williams, J Appl Mech 19, 1952), and so does that of elements about it by their size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fmd.accuracy.coarse_mesh import Pair
from fmd.core.arrays import Array, BoolArray
from fmd.core.limits.errors import EDGE_RINGS, OF_WEDGE
from fmd.core.rotations import rigid_motions
from fmd.fem.surface import SurfaceTopology, reentrant_angles
from fmd.recovery.stress import von_mises
from fmd.scene.variants import compare_element_sizes
from fmd.stages.division import part_of

if TYPE_CHECKING:
    from fmd.stages.part import FlexiblePart


@dataclass(frozen=True)
class CornerStress:
    """Largest stress of a body at a re-entrant edge, where it grows with each finer mesh.

    Attributes
    ----------
    body : str
        Name of the body, or of the piece of one.
    angle : float
        Largest angle of material at the edge [rad].
    place : tuple of float
        In the part's own coordinates [m].
    stress : tuple of float
        Largest von Mises stress along re-entrant edges at one deformation, on a coarser mesh and on the run's [Pa].
    ratio : float
        Size of the coarser mesh's elements over the run's.
    """

    body: str
    angle: float
    place: tuple[float, float, float]
    stress: tuple[float, float]
    ratio: float

    @property
    def growth(self) -> float:
        """Exponent by which the stress grows with smaller elements."""
        return math.log(self.stress[1] / self.stress[0]) / math.log(self.ratio)

    @property
    def text(self) -> str:
        """Text about a largest stress that grows with each finer mesh."""
        return f"stress has no limit at the re-entrant edge of {np.degrees(self.angle):.0f} degrees where it is largest"

    @property
    def warning(self) -> str:
        """Warning with the growth that was measured, and a remedy."""
        part, (coarse, own) = part_of(self.body) or self.body, self.stress
        at = ", ".join(f"{1e3 * x:.4g}" for x in self.place)
        return (
            f"{part}: {self.text}, ({at}) mm: {1e-6 * own:.3g} MPa along it, and {1e-6 * coarse:.3g} MPa by elements "
            f"of {self.ratio:.2g} times the size, which goes on; a fillet with two elements or more around gives it a "
            f"limit, and stress a set distance away has one: [body.{part}.element.NAME] at = ..."
        )


def find_corner_stress(pair: Pair) -> list[CornerStress]:
    """Return the bodies whose largest stress is at a re-entrant edge and grows from the coarser mesh to the run's."""
    run, found = pair.run, list[CornerStress]()
    for name, part in run.parts.items():
        angles = reentrant_angles(part.space.x, part.surface)
        time, place, _ = run.stress_of(name).worst()
        if not (angles.any() and _near(angles > 0.0, part.surface)[place] and pair.divides(name)):
            continue
        other = pair.coarse.parts[name]
        q = run.motion.modal(name)[int(np.abs(run.motion.times - time).argmin())]
        u = part.body.shapes[: len(part.space.x)] @ q
        own = float(von_mises(part.surface_stress[angles > 0.0] @ q).max())
        coarse = _stress_along_edges(other, part.space.x, u)
        ratio = compare_element_sizes(part.shape, len(part.mesh.cells), len(other.mesh.cells))
        if not (coarse > 0.0 and ratio > 1.0):
            continue
        x = tuple(float(each) for each in part.space.x[part.surface.nodes[place]])
        corner = CornerStress(name, float(angles.max()), (x[0], x[1], x[2]), (coarse, own), ratio)
        if corner.growth > OF_WEDGE * wedge_exponent(corner.angle):
            found.append(corner)
    return found


def wedge_exponent(angle: float) -> float:
    """Return the exponent by which stress grows towards the edge of a wedge of material, above 180° [rad].

    It is 1 − λ with the smallest root of ``sin λω + λ sin ω = 0`` (Williams 1952, both faces free).
    """
    from scipy.optimize import brentq

    return 1.0 - float(brentq(lambda x: math.sin(x * angle) + x * math.sin(angle), 0.5, 1.0 - 1e-12))


def _near(on_edge: BoolArray, surface: SurfaceTopology) -> BoolArray:
    """Return which of a surface's nodes are within some rings of triangles about an edge's, shape (n_surface,)."""
    for _ in range(EDGE_RINGS):
        touched = surface.triangles[on_edge[surface.triangles].any(axis=1)]
        on_edge = on_edge.copy()
        on_edge[touched] = True
    return on_edge


def _stress_along_edges(part: FlexiblePart, places: Array, u: Array) -> float:
    """Return the largest von Mises stress along the re-entrant edges of another mesh under the same deformation [Pa].

    The deformation is the combination of the part's shapes, beside a rigid motion, that is nearest to it.

    Parameters
    ----------
    places, u : ndarray, shape (n, 3)
        Nodes of the run's mesh, and their displacements [m].
    """
    from scipy.spatial import cKDTree

    x, shapes = part.space.x, part.body.shapes[: len(part.space.x)]
    seen = u[cKDTree(places).query(x)[1]]
    basis = np.concatenate([shapes, rigid_motions(x)], axis=2).reshape(3 * len(x), -1)
    q = np.linalg.lstsq(basis, seen.ravel(), rcond=None)[0][: shapes.shape[2]]
    on_edges = reentrant_angles(x, part.surface) > 0.0
    return float(von_mises(part.surface_stress[on_edges] @ q).max(initial=0.0))
