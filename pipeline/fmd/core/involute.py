"""Involute teeth of spur gears by closed forms: one tooth's profile, and two gears in mesh.

A place on an involute is given by its roll angle ``ε = tan α_y = √(r² − r_b²)/r_b``. The tooth's axis is x; its profile
here is that with y > 0. The fillet is the trochoid that the rounded corner of a basic rack cuts (ISO 53, ISO 6336-3).
"""

import math

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.contact import ROLL_PASSES, ROUNDED_ROLL
from fmd.core.newton import Tolerance, solve


@dataclass(frozen=True)
class Tooth:
    """A tooth of a spur gear as a basic rack cuts it."""

    module: float  # pitch circle's diameter over the number of teeth [m]
    teeth: int  # number of teeth
    alpha: float  # pressure angle of the rack [rad]
    shift: float  # profile shift over the module
    addendum: float  # height of the rack above its reference line, over the module
    dedendum: float  # depth of the rack below its reference line, over the module
    rounding: float  # radius of the rack's corners, over the module

    @property
    def pitch_radius(self) -> float:
        """Radius [m]."""
        return 0.5 * self.module * self.teeth

    @property
    def base_radius(self) -> float:
        """Radius [m]."""
        return self.pitch_radius * math.cos(self.alpha)

    @property
    def tip_radius(self) -> float:
        """Radius [m]."""
        return self.pitch_radius + self.module * (self.addendum + self.shift)

    @property
    def root_radius(self) -> float:
        """Radius [m]."""
        return self.pitch_radius - self.module * (self.dedendum - self.shift)

    @property
    def base_pitch(self) -> float:
        """Distance of two flanks along the line of action [m]."""
        return math.pi * self.module * math.cos(self.alpha)

    @property
    def tip_roll(self) -> float:
        """Roll angle ε at the tip [rad]."""
        return math.sqrt((self.tip_radius / self.base_radius) ** 2 - 1.0)

    @property
    def form_roll(self) -> float:
        """Roll angle ε where the fillet ends and the involute begins [rad]; below 0 the rack undercuts the tooth."""
        end = self.module * (self.shift - self.dedendum + self.rounding * (1.0 - math.sin(self.alpha)))
        return math.tan(self.alpha) + end / (self.base_radius * math.sin(self.alpha))

    @property
    def land(self) -> float:
        """Half of the straight part of the rack's tip over the module; below 0 its two roundings don't fit."""
        flank = (self.dedendum - self.rounding) * math.tan(self.alpha) + self.rounding / math.cos(self.alpha)
        return 0.25 * math.pi - flank

    @property
    def base_angle(self) -> float:
        """Half of the tooth's angle on its base circle [rad]."""
        return (0.5 * math.pi + 2.0 * self.shift * math.tan(self.alpha)) / self.teeth + involute(math.tan(self.alpha))

    def half_angle(self, radius: float) -> float:
        """Half of the tooth's angle at a radius from the base circle on [rad]; below 0 it is pointed before."""
        return self.base_angle - involute(math.sqrt((radius / self.base_radius) ** 2 - 1.0))

    @property
    def polar_moment(self) -> float:
        """Second moment of the tooth's area about the gear's axis [m⁴]; fillets go on at the base circle's angle."""
        radii = np.linspace(self.root_radius, self.tip_radius, 100)
        angles = np.array([2.0 * self.half_angle(float(r)) for r in np.maximum(radii, self.base_radius)])
        return float(np.trapezoid(angles * radii**3, radii))

    def flank(self, roll: Array | float) -> Array:
        """Return points of the involute at roll angles (n,), shape (n, 2), or at one, shape (2,) [m]."""
        angle = self.base_angle - (roll - np.arctan(roll))
        return _polar(self.base_radius * np.hypot(1.0, roll), angle)

    def normal(self, roll: Array | float) -> Array:
        """Return outward unit normals of the involute, which are tangents of the base circle, shaped as points."""
        return _polar(np.ones_like(roll, dtype=float), self.base_angle - roll + 0.5 * math.pi)

    def fillet(self, beta: Array | float) -> Array:
        """Return points of the fillet, shape (n, 2), or one, shape (2,) [m].

        ``beta`` is the angle between the fillet's normal and the rack's reference line as the point is cut: the
        pressure angle where the involute begins, a right angle at the root circle.
        """
        depth = self.module * (self.dedendum - self.rounding - self.shift)
        along = depth / np.tan(beta)
        corner = along + self.module * self.rounding * np.cos(beta)
        below = -depth - self.module * self.rounding * np.sin(beta)
        r = self.pitch_radius
        from_gap = np.arctan2(corner, r + below) - (along - self.land * self.module) / r
        return _polar(np.hypot(corner, r + below), math.pi / self.teeth - from_gap)


@dataclass(frozen=True)
class GearPair:
    """Two external spur gears in mesh.

    A contact's place on the line of action is its distance s from where that touches the pinion's base circle.
    """

    pinion: Tooth  # the first gear's tooth
    wheel: Tooth  # the second gear's, of the same module and pressure angle
    distance: float  # of their axes [m]

    @property
    def alpha(self) -> float:
        """Working pressure angle [rad]."""
        return math.acos((self.pinion.base_radius + self.wheel.base_radius) / self.distance)

    @property
    def path(self) -> tuple[float, float]:
        """Where on the line of action contact begins, at the wheel's tip, and ends, at the pinion's [m]."""
        begin = self.distance * math.sin(self.alpha) - self.wheel.base_radius * self.wheel.tip_roll
        return begin, self.pinion.base_radius * self.pinion.tip_roll

    @property
    def contact_ratio(self) -> float:
        """Transverse contact ratio ε_α: how many pairs of teeth touch, on the average."""
        begin, end = self.path
        return (end - begin) / self.pinion.base_pitch

    def rolls(self, s: float) -> tuple[float, float]:
        """Return the roll angles on pinion and wheel of a contact at s."""
        whole = self.distance * math.sin(self.alpha)
        return s / self.pinion.base_radius, (whole - s) / self.wheel.base_radius

    def place(self, angle: float) -> float:
        """Return where on the line of action a flank touches, beyond the path too [m].

        The angle is from the line of the axes to the axis of the pinion's tooth, in the sense in which that flank
        drives [rad].
        """
        return self.pinion.base_radius * (angle + self.pinion.base_angle + self.alpha)

    def gap(self, s: Array) -> Array:
        """Return how far flanks are apart that would touch at places (n,) of the line of action, along it [m].

        On the path they touch. Before it and beyond it the tip of one tooth is what comes nearest to the other's flank.
        """
        whole = self.distance * math.sin(self.alpha)
        before, after = self._tip_gap(self.wheel, self.pinion, whole - s), self._tip_gap(self.pinion, self.wheel, s)
        begin, end = self.path
        return np.where(s > end, after, np.where(s < begin, before, 0.0))

    def _tip_gap(self, tipped: Tooth, other: Tooth, s: Array) -> Array:
        """Return the gap of a tooth's tip to the other's flank, by places from where the line leaves its base circle.

        Tip and flank of equal radius about the other's axis are compared by their angles about it.
        """
        angle = s / tipped.base_radius - self.alpha - involute(tipped.tip_roll)
        x, y = self.distance - tipped.tip_radius * np.cos(angle), tipped.tip_radius * np.sin(angle)
        roll = np.sqrt(np.maximum((x**2 + y**2) / other.base_radius**2 - 1.0, 0.0))
        met = (self.distance * math.sin(self.alpha) - s) / other.base_radius
        return np.asarray(other.base_radius * (self.alpha - met + roll - np.arctan(roll) - np.arctan2(y, x)))

    @property
    def backlash(self) -> float:
        """Gap between the flanks that don't touch, on the working pitch circles [m]; below 0 the teeth jam."""
        ratio = self.distance / (self.pinion.teeth + self.wheel.teeth)
        thickness = [2.0 * r * gear.half_angle(r) for gear in (self.pinion, self.wheel) for r in (gear.teeth * ratio,)]
        return 2.0 * math.pi * ratio - sum(thickness)


def tight_distance(pinion: Tooth, wheel: Tooth) -> float | None:
    """Return the distance of the axes at which two gears mesh without backlash [m]; none if they have it at all."""
    teeth, alpha = pinion.teeth + wheel.teeth, pinion.alpha
    wanted = involute(math.tan(alpha)) + 2.0 * (pinion.shift + wheel.shift) * math.tan(alpha) / teeth
    if wanted <= 0.0:
        return None
    found = solve(
        math.tan(alpha),
        lambda roll: np.array([involute(roll) - wanted]),
        lambda roll, left: -left * (1.0 + roll**2) / roll**2,
        lambda roll, change: roll + float(change[0]),
        Tolerance(ROLL_PASSES, relative=ROUNDED_ROLL),
    )
    return (pinion.base_radius + wheel.base_radius) * math.hypot(1.0, found.state)


def involute(roll: float) -> float:
    """Return the involute function ``inv α = tan α − α`` of a roll angle ``tan α``."""
    return roll - math.atan(roll)


def _polar(radius: Array | float, angle: Array | float) -> Array:
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
