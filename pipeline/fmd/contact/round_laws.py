"""Force of round rigid surfaces by how deep one is in the other, of elastic half-spaces.

A ball's is Hertz's. A pin's on a plane or in a bore follows from the flexibility of a half-space under strips as long
as the pin: for each width of the contact, pressures that lift the strips out of the other surface vanish at its edges.
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipe, ellipkm1

from fmd.contact.half_space import half_space_flexibility
from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits import contact as limits

DEPTH, LOAD, POWER, STORED, SIZE, GROWTH, PEAK = range(7)
"""Columns of a law from a depth on: force, its exponent, energy beside that of the power, area, its exponent, largest
over mean pressure."""
Row = tuple[float, ...]


@dataclass(frozen=True)
class RoundLaw:
    """Force over depth, by pieces that are powers, and what is lost in a shock."""

    rows: tuple[Row, ...]  # columns `DEPTH` [m], `LOAD` [N], `POWER`, `STORED` [J], `SIZE` [m²], `GROWTH` and `PEAK`
    restitution: float = 1.0  # speed after a shock of two free bodies over that before
    ends: float = np.inf  # depth up to which it is known [m]

    @property
    def loss(self) -> float:
        """The number c of a force ``F (1 + c δ̇/v)`` at a rate δ̇, after an approach at v, that the restitution takes.

        A free shock between two bodies obeys ``∫ u du/(1 + c u/v)`` over its speeds u alike before and after, whatever
        F is, so that ``c (1 + e) = ln((1 + c)/(1 − c e))``. Hunt & Crossley 1975 have the form of the force,
        Lankarani & Nikravesh 1990 ``c = 3 (1 − e²)/4``, which is that for e near 1.
        """
        e = self.restitution
        if e == 1.0:
            return 0.0

        def fault(c: float) -> float:
            return float(c * (1.0 + e) - np.log1p(c) + np.log1p(-c * e))

        return float(brentq(fault, 0.5 * (1.0 - e), (1.0 - 1e-15) / e))

    def _row_at(self, column: int, value: float) -> Row:
        rows = np.array(self.rows)
        rows[:, STORED] += rows[:, LOAD] * rows[:, DEPTH] / (rows[:, POWER] + 1.0)
        return self.rows[max(0, int(np.searchsorted(rows[:, column], value, side="right")) - 1)]

    def depth_under(self, force: float, energy: float) -> float:
        """Return how deep a force at rest [N] presses, or a shock of an energy [J] if that is more [m]."""
        row = self._row_at(LOAD, force)
        by_force = row[DEPTH] * (force / row[LOAD]) ** (1.0 / row[POWER])
        row = self._row_at(STORED, energy)
        per = row[LOAD] * row[DEPTH] / (row[POWER] + 1.0)
        by_energy = row[DEPTH] * max(0.0, (energy - row[STORED]) / per) ** (1.0 / (row[POWER] + 1.0))
        return float(max(by_force, by_energy))

    def stiffness(self, depth: float) -> float:
        """Return the slope of the force at a depth [N/m]."""
        row = self._row_at(DEPTH, depth)
        return float(row[POWER] * row[LOAD] / row[DEPTH] * (depth / row[DEPTH]) ** (row[POWER] - 1.0))


def joint_modulus(*materials: tuple[float, float]) -> float:
    """Return E* of surfaces of Young's moduli [Pa] and Poisson's ratios, ``1/E* = Σ (1 − ν²)/E``."""
    return float(1.0 / sum((1.0 - nu**2) / E for E, nu in materials))


def shear_ratio(*materials: tuple[float, float]) -> float:
    """Return how far a ball slips aside by a force over how deep the same one presses it, ``E*/(6 G*)``.

    Mindlin's stiffness is ``8 a G*`` with ``1/G* = Σ (2 − ν)/G``, and Hertz's force over depth ``4/3 a E*``.
    """
    softness = sum((2.0 - nu) * 2.0 * (1.0 + nu) / E for E, nu in materials)
    return float(joint_modulus(*materials) * softness / 6.0)


def ball_law(curvatures: tuple[float, float], modulus: float) -> tuple[Row, ...]:
    """Return Hertz's law ``F = 4/3 E* √R (δ/f)^1.5`` for two relative curvatures [1/m].

    Of unlike curvatures the contact is an ellipse, whose axes a and b follow from complete elliptic integrals (Johnson,
    Contact Mechanics, equations 4.26): ``δ = p0 b K/E*``, ``κ1 + κ2 = 2 p0 b E/(E* b²)`` and ``F = 2/3 π a b p0``.
    """
    less, more = sorted(curvatures)

    def fault(log_square: float) -> float:
        square = np.exp(log_square)
        K, E = ellipkm1(square), ellipe(1.0 - square)
        return float((K - E) / (E / square - K) - less / more)

    square = 1.0  # of the short axis b over the long one a
    if less < (1.0 - limits.ROUND_ENOUGH) * more:
        square = float(np.exp(brentq(fault, np.log(limits.FLATTEST), np.log(1.0 - 0.1 * limits.ROUND_ENOUGH))))
    K, E = ellipkm1(square), ellipe(1.0 - square)
    push = modulus / K  # p0 b, by the depth
    size = 2.0 * push * E / (square * modulus * (less + more))  # a², by the depth
    force = 2.0 / 3.0 * np.pi * np.sqrt(size) * push
    return ((1.0, float(force), 1.5, 0.0, float(np.pi * size * np.sqrt(square)), 1.0, 1.5),)


def pin_law(radius: float, bore: float, length: float, modulus: float) -> tuple[tuple[Row, ...], float]:
    """Return the rows of the law of a pin on a plane or in a bore, and the depth that makes it wider than allowed [m].

    Radius, bore, infinite of a plane, and length are in m. Wider contacts than that are no half-space's.
    """
    found = []
    for angle in np.geomspace(limits.LEAST_ANGLE, limits.WIDEST_ANGLE, limits.LAW_ROWS):
        theta = (np.arange(limits.LAW_STRIPS) + 0.5) / limits.LAW_STRIPS * 2.0 * angle - angle
        across, wide = radius * theta, 2.0 * radius * angle / limits.LAW_STRIPS
        places = np.stack([across, np.zeros(limits.LAW_STRIPS)], axis=1)
        C = half_space_flexibility(places, (wide, length), 1.0, 0.0)[:, 0, :, 0] / modulus
        # A pin that is d deep along θ = 0 leaves c (1 − cos θ) − d cos θ, c the difference of the radii.
        fall = 1.0 - np.cos(theta)
        gap, along = (
            (radius * fall, np.ones(limits.LAW_STRIPS)) if np.isinf(bore) else ((bore - radius) * fall, np.cos(theta))
        )
        lifted, held = np.linalg.solve(C, np.stack([along, gap], axis=1)).T
        depth = float((held / lifted).max())
        force = depth * lifted - held
        load = float(force @ along)
        area = 2.0 * radius * theta[-1] * length  # the pressure of the last strip is 0
        found.append((depth, load, area, float(force.max() / (wide * length) / (load / area))))
    return _joined(found), found[-1][0]


def _joined(found: Sequence[tuple[float, float, float, float]]) -> tuple[Row, ...]:
    """Return a law through depths, forces, areas and peaks, of powers between them."""
    rows, stored = list[Row](), 0.0
    for k, (depth, load, area, peak) in enumerate(found):
        low = min(k, len(found) - 2)
        steps = np.log(np.array(found[low + 1][:3]) / np.array(found[low][:3]))
        power, growth = steps[1] / steps[0], steps[2] / steps[0]
        own = load * depth / (power + 1.0)
        beside = stored - own if k else 0.0
        rows.append((depth, load, float(power), float(beside), area, float(growth), peak))
        if k + 1 < len(found):
            stored = beside + own * (found[k + 1][0] / depth) ** (power + 1.0)
    return tuple(rows)


def law_table(laws: Sequence[RoundLaw | None]) -> Array:
    """Return all laws for kernels, (n, most rows, 7); rows that a law lacks are at an infinite depth."""
    most = max([1, *(len(law.rows) for law in laws if law)])
    found = np.full((len(laws), most, 7), np.inf)
    for own, law in zip(found, laws, strict=True):
        if law:
            own[: len(law.rows)] = law.rows
    return found
