"""Sections of beams: how they are drawn, and their stiffness in torsion and shear.

A section is drawn by quadrilaterals about its centroid, in its principal axes. Area and moments of inertia are those of
the drawing; a circle is drawn as a polygon of its area, and its moments are put right.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.files import ISOTROPIC
from fmd.core.limits.mesh import FULLEST_TUBE, ROUND_CORNERS, STIFF_IN_SHEAR

NUMBERS_ALONE = "has sections by numbers without points, C to F of PBAR, so no stress; give these, or a PBARL"
_GAUSS = 0.5 + np.sqrt(0.15) * np.arange(-1, 2), np.array([5.0, 8.0, 5.0]) / 18
_CORNERS = np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])


@dataclass(frozen=True)
class Section:
    """A section of a beam."""

    points: Array  # (n_points, 2): y and z of its drawing about the centroid [m]
    quads: IntArray  # (n_quads, 4): points around each quadrilateral, counter-clockwise seen against x
    torsion: float  # Saint-Venant's torsion constant J [m⁴]

    line_mass = 0.0  # mass beside the material's [kg/m]

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

    def closest(self) -> float:
        """Return the smallest distance between two points [m]."""
        apart = np.linalg.norm(self.points[:, None] - self.points, axis=2)
        return float(apart[apart > 0].min())

    def places(self, yz: Array) -> Array:
        """Return where strain at places (…, 2) of the drawing is that of: there."""
        return yz

    def forced(self) -> Section | Changed:
        """Return the section whose strain of shear gives its force, here itself."""
        return self

    def stressed(self) -> Section | Changed | None:
        """Return the section whose strain gives its stress, here itself; ``None`` if it is drawn otherwise."""
        return self

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
class Changed:
    """A section with something of its own in place of another's."""

    of: Section | Changed

    def __getattr__(self, name: str) -> Any:
        return getattr(self.of, name)


class EvenStrains:
    """Strains of shear and twist that are even over a section, with the energies that it has."""

    def shear_shapes(self: Any, yz: Array, nu: float) -> Array:
        """Return shear strain along y and z at places (…, 2) over the mean."""
        return np.broadcast_to(np.sqrt(self.shear_areas(nu)), yz.shape)

    def twisting(self: Any, yz: Array) -> Array:
        """Return factors (…, 1), at places (…, 2), of the strain of a twist without warping."""
        return np.full((*yz.shape[:-1], 1), np.sqrt(self.torsion / self._drawn()[1:].sum()))


@dataclass(frozen=True)
class EvenSection(EvenStrains, Changed):
    """A section whose strains of shear and twist are even over it: interpolation keeps those."""


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


@dataclass(frozen=True)
class NumberedSection(EvenStrains, Section):
    """A section by its numbers: rectangular tubes within one another, of its area and its moments of inertia.

    Their corners aren't those of the section, whose stress is that at points of its own. Strains of shear and twist
    are even.
    """

    shares: Array  # (2,): of the area that resist shear along y and z
    line_mass: float = 0.0  # mass beside the material's, without rotary inertia [kg/m]
    seen: Array | None = None  # (4, 2): y and z of the points whose stress is wanted [m]

    def shear_areas(self, nu: float) -> Array:
        """Return the shares as they are given."""
        return self.shares

    def forced(self) -> ForcedSection:
        """Return the section with the strain of shear that gives its force, not its energy."""
        return ForcedSection(self)

    def stressed(self) -> SeenSection | None:
        """Return the section with the strain of its points at the corners of its drawing."""
        return None if self.seen is None else SeenSection(self)


@dataclass(frozen=True)
class ForcedSection(Changed):
    """A section by its numbers whose stress by shear is force over area."""

    def shear_shapes(self, yz: Array, nu: float) -> Array:
        """Return shear strain along y and z at places (…, 2) over the mean."""
        return np.broadcast_to(self.shear_areas(nu), yz.shape)


@dataclass(frozen=True)
class SeenSection(ForcedSection):
    """A section by its numbers whose drawn corners have the strain of its points."""

    def places(self, yz: Array) -> Array:
        """Return where strain at places (…, 2) of the drawing is that of."""
        y, z = np.moveaxis(yz / np.abs(self.points).max(axis=0), -1, 0)
        N = np.stack([(1 + a * y) * (1 + b * z) for a, b in _CORNERS], axis=-1) / 4
        return np.asarray(N @ self.seen)


def numbered_section(
    area: float,
    moments: tuple[float, float],
    torsion: float,
    shares: tuple[float, float],
    line_mass: float = 0.0,
    seen: Array | None = None,
) -> NumberedSection:
    """Return a section by area [m²], ∫ z² dA and ∫ y² dA, J [m⁴], shares of shear along y and z, and mass [kg/m].

    Of n rectangular tubes around the centroid, all with the section's radii of inertia, each has the share
    ``(1 − m²) / (1 + m²)`` of the area ``12 i_y i_z`` of a rectangle, m being its bore over its outside. A rectangle's
    numbers give a rectangle. A share of 0 leaves the beam stiff in shear. Stress is that at points (4, 2), if any, each
    at the drawing's corner that comes as it does around the centroid.
    """
    inertia = np.sqrt(np.array(moments[::-1]) / area)  # radii along y and z
    full = area / (12 * inertia.prod())
    if seen is not None:
        seen = seen[np.argsort(np.arctan2(seen[:, 1], seen[:, 0]) % (2 * np.pi), kind="stable")]
    stiff = np.array([share or STIFF_IN_SHEAR for share in shares])
    if abs(full - 1) <= ISOTROPIC:
        whole = rectangular_section(*(np.sqrt(12) * inertia))
        return NumberedSection(whole.points, whole.quads, torsion, stiff, line_mass, seen)
    n = int(np.ceil(full / FULLEST_TUBE))
    # apart from one another, so that they have no point in common
    bored = full / n * (1 + (0.2 * (np.arange(n) - 0.5 * (n - 1)) / n))
    points, quads = list[Array](), list[IntArray]()
    k = np.arange(4)
    after = (k + 1) % 4
    for share in bored:
        m = np.sqrt((1 - share) / (1 + share))
        corners = np.sqrt(3 / (1 + m**2)) * inertia * _CORNERS
        quads.append(np.stack([k, after, 4 + after, 4 + k], axis=1) + 8 * len(quads))
        points += [corners, m * corners]
    return NumberedSection(np.concatenate(points), np.concatenate(quads), torsion, stiff, line_mass, seen)


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
