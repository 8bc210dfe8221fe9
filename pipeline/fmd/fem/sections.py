"""Sections of beams: how they are drawn, and their stiffness in torsion and shear.

A section is drawn by quadrilaterals about its centroid, in its principal axes. Area and moments of inertia are those of
the drawing; a circle is drawn as a polygon of its area, and its moments are put right.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.mesh import ROUND_CORNERS

_GAUSS = 0.5 + np.sqrt(0.15) * np.arange(-1, 2), np.array([5.0, 8.0, 5.0]) / 18


@dataclass(frozen=True)
class Section:
    """A section of a beam."""

    points: Array  # (n_points, 2): y and z of its drawing about the centroid [m]
    quads: IntArray  # (n_quads, 4): points around each quadrilateral, counter-clockwise seen against x
    torsion: float  # Saint-Venant's torsion constant J [m⁴]

    @property
    def area(self) -> float:
        """Area [m²]."""
        return float(self._drawn()[0])

    @property
    def moments(self) -> Array:
        """Moments of inertia ∫ z² dA, of bending about y, and ∫ y² dA, shape (2,) [m⁴]."""
        return np.asarray(self._drawn()[1:])

    @property
    def bending(self) -> Array:
        """Factors of the curvatures about y and z that make up for the drawing, shape (2,)."""
        return np.ones(2)

    def twisting(self, yz: Array) -> Array:
        """Return factors (…, 1), at places (…, 2), of the strain of a twist without warping.

        They fall with the square of the radius, so that its moment and its energy are those of the torsion constant.
        """
        points, weight = self._places
        square = (points**2).sum(axis=0)
        weight = weight * square / (weight @ square)
        share, mean = self.torsion / self._drawn()[1:].sum(), weight @ square
        if share >= 1.0:  # a circle, drawn as a polygon
            return np.full((*yz.shape[:-1], 1), np.sqrt(share))
        steep = np.sqrt((1 / share - 1) / (weight @ square**2 - mean**2))
        return np.asarray(share * (1 + steep * (mean - (yz**2).sum(axis=-1, keepdims=True))))

    def shear_areas(self, nu: float) -> Array:
        """Return the shares of the area that resist shear along y and z, shape (2,)."""
        raise NotImplementedError

    def shear_shapes(self, yz: Array, nu: float) -> Array:
        """Return shear strain along y and z at places (…, 2) over the mean.

        They are parabolas whose resultant and whose energy are those of `shear_areas`; in a rectangle Reissner's.
        """
        share, square = self.shear_areas(nu), self._drawn()[:0:-1] / self.area
        spread = self._fourth / self.area - square**2
        return np.asarray(share * (1 + np.sqrt((1 / share - 1) / spread) * (square - yz**2)))

    def _drawn(self) -> Array:
        """Return area, ∫ z² and ∫ y² of the drawing, shape (3,)."""
        (y, z), weight = self._places
        return np.asarray(np.stack([weight, weight * z**2, weight * y**2]).sum(axis=1))

    @property
    def _fourth(self) -> Array:
        """∫ y⁴ and ∫ z⁴ of the drawing, shape (2,) [m⁶]."""
        yz, weight = self._places
        return np.asarray(yz**4 @ weight)

    @cached_property
    def _places(self) -> tuple[Array, Array]:
        """Points (2, n) and weights (n,) of Gauss's rule, three each way in the quadrilaterals, exact to y⁴."""
        x, found, weights = self.points[self.quads], [], []
        for s, ws in zip(*_GAUSS, strict=True):
            for t, wt in zip(*_GAUSS, strict=True):
                N = np.array([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t])
                by_s = np.array([t - 1, 1 - t, t, -t]) @ x
                by_t = np.array([s - 1, -s, s, 1 - s]) @ x
                weights.append(ws * wt * (by_s[:, 0] * by_t[:, 1] - by_s[:, 1] * by_t[:, 0]))
                found.append((N @ x).T)
        return np.concatenate(found, axis=1), np.concatenate(weights)


@dataclass(frozen=True)
class EvenSection:
    """A section whose strains of shear and twist are even over it, with its own energies: interpolation keeps those."""

    of: Section | EvenSection

    def __getattr__(self, name: str) -> Any:
        return getattr(self.of, name)

    def shear_shapes(self, yz: Array, nu: float) -> Array:
        """Return shear strain along y and z at places (…, 2) over the mean."""
        return np.broadcast_to(np.sqrt(self.of.shear_areas(nu)), yz.shape)

    def twisting(self, yz: Array) -> Array:
        """Return factors (…, 1), at places (…, 2), of the strain of a twist without warping."""
        return np.full((*yz.shape[:-1], 1), np.sqrt(self.torsion / self._drawn()[1:].sum()))


@dataclass(frozen=True)
class RoundSection(Section):
    """A circle, or a ring."""

    diameter: float  # [m]
    bore: float  # [m]

    @property
    def bending(self) -> Array:
        """Roots of the circle's moments over the polygon's."""
        exact = np.pi / 64 * (self.diameter**4 - self.bore**4)
        return np.asarray(np.sqrt(exact / self.moments))

    def shear_areas(self, nu: float) -> Array:
        """Return Cowper's coefficients (J Appl Mech 33, 1966)."""
        m = (self.bore / self.diameter) ** 2
        whole = (7 + 6 * nu) * (1 + m) ** 2 + (20 + 12 * nu) * m
        return np.full(2, 6 * (1 + nu) * (1 + m) ** 2 / whole)


@dataclass(frozen=True)
class RectangularSection(Section):
    """A rectangle, in which shear is a parabola over the depth, 5/6 of the area."""

    width: float  # extent along y [m]
    height: float  # extent along z [m]

    def shear_areas(self, nu: float) -> Array:
        """Return 5/6 for both."""
        return np.full(2, 5 / 6)


@dataclass(frozen=True)
class WalledSection(Section):
    """A section of thin walls along y and z, which take the shear along them."""

    along_y: float  # areas of the walls [m²]
    along_z: float  # areas of the walls [m²]

    def shear_areas(self, nu: float) -> Array:
        """Return the shares of the walls' areas."""
        return np.array([self.along_y, self.along_z]) / self.area


def round_section(diameter: float, bore: float = 0.0) -> RoundSection:
    """Return a circle, with a bore or without."""
    angle = 2 * np.pi * (np.arange(ROUND_CORNERS) + 0.5) / ROUND_CORNERS
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    to_area = np.sqrt(2 * np.pi / ROUND_CORNERS / np.sin(2 * np.pi / ROUND_CORNERS))
    outer = 0.5 * diameter * to_area * circle
    k = np.arange(ROUND_CORNERS)
    after = (k + 1) % ROUND_CORNERS
    torsion = float(np.pi / 32 * (diameter**4 - bore**4))
    if bore:
        points = np.concatenate([outer, 0.5 * bore * to_area * circle])
        quads = np.stack([k, after, ROUND_CORNERS + after, ROUND_CORNERS + k], axis=1)
        return RoundSection(points, quads, torsion, diameter, bore)
    n = ROUND_CORNERS // 4
    # a square in the middle whose sides are curved a little, so that its corners aren't flat
    side = np.linspace(-1.0, 1.0, n + 1)
    Y, Z = np.meshgrid(side, side, indexing="ij")
    bulge = 1.0 + 0.15 * (2.0 - Y**2 - Z**2)
    inner = 0.2 * diameter * np.column_stack([(Y * bulge).ravel(), (Z * bulge).ravel()])
    number = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    cells = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=2).reshape(-1, 4)
    edge = np.concatenate([number[:-1, 0], number[-1, :-1], number[:0:-1, -1], number[0, :0:-1]])
    # around from the corner at -y, -z, as the circle's points go around from the one nearest to it
    start = 5 * np.pi / 4
    order = np.argsort(np.mod(np.arctan2(inner[edge, 1], inner[edge, 0]) - start + 1e-9, 2 * np.pi))
    edge = edge[order]
    turned = start + 2 * np.pi * k / ROUND_CORNERS
    outer = 0.5 * diameter * to_area * np.column_stack([np.cos(turned), np.sin(turned)])
    first = len(inner)
    ring = np.stack([edge, first + k, first + after, np.roll(edge, -1)], axis=1)
    return RoundSection(np.concatenate([inner, outer]), np.concatenate([cells, ring]), torsion, diameter, 0.0)


def rectangular_section(width: float, height: float) -> RectangularSection:
    """Return a rectangle of extents along y and z; J by Roark's formula, within 0.4 %."""
    points, quads = _rectangles([(-width / 2, width / 2, -height / 2, height / 2)], 2)
    a, b = max(width, height), min(width, height)
    torsion = a * b**3 * (1 / 3 - 0.21 * b / a * (1 - b**4 / (12 * a**4)))
    return RectangularSection(points, quads, torsion, width, height)


def box_section(width: float, height: float, wall: float) -> WalledSection:
    """Return a rectangular tube of outer extents along y and z; J by Bredt's formula."""
    y, z, t = width / 2, height / 2, wall
    walls = [(-y, y, -z, t - z), (-y, y, z - t, z), (-y, t - y, t - z, z - t), (y - t, y, t - z, z - t)]
    points, quads = _rectangles(walls, 1, y - t)
    middle = (width - wall) * (height - wall)
    torsion = 2 * wall * middle**2 / ((width - wall) + (height - wall))
    return WalledSection(points, quads, torsion, 2 * wall * (width - wall), 2 * wall * (height - wall))


def i_section(width: float, height: float, web: float, flange: float) -> WalledSection:
    """Return an I of extents along y and z, its web along z; J of open walls, Σ b t³ / 3."""
    y, z, w = width / 2, height / 2, web / 2
    walls = [(-y, y, -z, flange - z), (-y, y, z - flange, z), (-w, w, flange - z, z - flange)]
    points, quads = _rectangles(walls, 1, w)
    torsion = (2 * width * flange**3 + (height - flange) * web**3) / 3
    return WalledSection(points, quads, torsion, 2 * width * flange * 5 / 6, web * (height - flange))


def _rectangles(
    walls: list[tuple[float, float, float, float]], split: int, cut: float = np.inf
) -> tuple[Array, IntArray]:
    """Return points and quadrilaterals of rectangles y0 … y1, z0 … z1 that meet side by side.

    They are cut across y at a distance from the middle, so that pieces share their points, and each piece has ``split``
    quadrilaterals each way.
    """
    points, quads = list[Array](), list[IntArray]()
    for y0, y1, z0, z1 in walls:
        cuts = [y for y in (-cut, cut) if y0 < y < y1]
        for a, b in zip([y0, *cuts], [*cuts, y1], strict=True):
            Y, Z = np.meshgrid(np.linspace(a, b, split + 1), np.linspace(z0, z1, split + 1), indexing="ij")
            number = sum(len(each) for each in points) + np.arange((split + 1) ** 2).reshape(split + 1, split + 1)
            points.append(np.column_stack([Y.ravel(), Z.ravel()]))
            cells = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=2)
            quads.append(cells.reshape(-1, 4))
    x = np.concatenate(points)
    _, first, same = np.unique(np.round(x / np.abs(x).max(), 9), axis=0, return_index=True, return_inverse=True)
    return x[first], same.ravel()[np.concatenate(quads)]
