"""A mechanism as pictures and films show it: bodies, marks of joints and lines, at the instants of the frames."""

from dataclasses import field

import numpy as np

from fmd.core.arrays import Array, IntArray, require_shape
from fmd.core.data_classes import dataclass
from fmd.render.surface import Surface

_EVERY = 50  # of the points inside count for the bounds of a motion, beside the outermost ones
_FLAT = 1e-6  # of a body's extent: what is thinner has no hull


@dataclass(frozen=True, slots=True)
class MovingBody:
    """A flexible body's motion at the instants of the frames, from which each is computed when it is drawn."""

    surface: Surface  # the undeformed body, in its frame
    shapes: Array  # (n_points, 3, n_modes): displacement of the points for a unit of each modal coordinate [kg^-1/2]
    coordinates: Array  # (n_frames, n_modes): modal coordinates [kg^1/2 m]
    origin: Array  # (n_frames, 3): place of the body's frame in space [m]
    rotation: Array  # (n_frames, 3, 3): axes of the body's frame in space
    scale: float = 1.0  # factor on the deformation
    stress: Array | None = None  # (n_frames, n_points): what colours it [Pa]; without, it has one colour
    name: str = ""

    def __post_init__(self) -> None:
        n_points, n_frames = len(self.surface.points), len(self.origin)
        require_shape("shapes", self.shapes, (n_points, 3, None))
        require_shape("coordinates", self.coordinates, (n_frames, self.shapes.shape[2]))
        require_shape("rotation", self.rotation, (n_frames, 3, 3))
        if self.stress is not None:
            require_shape("stress", self.stress, (n_frames, n_points))

    def points(self, frame: int) -> Array:
        """Return the surface's points in space, deformed, shape (n_points, 3) [m]."""
        return self._place(self.surface.points, self.shapes, frame)

    def around(self) -> Array:
        """Return points around the body in all frames, shape (n, 3) [m]."""
        chosen = _outer_points(self.surface.points)
        points, shapes = self.surface.points[chosen], self.shapes[chosen]
        return np.concatenate([self._place(points, shapes, k) for k in range(len(self.origin))])

    def _place(self, points: Array, shapes: Array, frame: int) -> Array:
        deformed = points + self.scale * (shapes @ self.coordinates[frame])
        return np.asarray(self.origin[frame] + deformed @ self.rotation[frame].T)


@dataclass(frozen=True, slots=True)
class MovingShape:
    """A rigid shape in one colour: a rigid body, the mark of a joint, a piece of the ground."""

    surface: Surface
    colour: str
    origin: Array  # (n_frames, 3): place of the frame in space [m]
    rotation: Array  # (n_frames, 3, 3): axes of the frame in space
    name: str = ""

    def points(self, frame: int) -> Array:
        """Return the surface's points in space, shape (n_points, 3) [m]."""
        return np.asarray(self.origin[frame] + self.surface.points @ self.rotation[frame].T)

    def around(self) -> Array:
        """Return points around the shape in all frames, shape (n, 3) [m]."""
        points = self.surface.points[_outer_points(self.surface.points)]
        return np.asarray((self.origin[:, None] + points @ self.rotation.swapaxes(1, 2)).reshape(-1, 3))


@dataclass(frozen=True, slots=True)
class MovingLine:
    """A line through points that move: a spring, a rail, a distance that is kept."""

    points: Array  # (n_frames, n_points, 3) [m]
    colour: str
    width: float = 1.6  # [pixels]


@dataclass(frozen=True, slots=True)
class MovingMechanism:
    """All that a picture or a film of a mechanism shows."""

    times: Array  # (n_frames,) [s]
    bodies: tuple[MovingBody, ...] = ()
    shapes: tuple[MovingShape, ...] = ()  # rigid bodies, marks and ground
    lines: tuple[MovingLine, ...] = ()
    notes: tuple[str, ...] = ()  # text beside the time of each frame, e.g. ``4000 rpm``; none, or one for each
    # (3,): direction that is up in the picture; by default that follows from the extents
    up: Array | None = field(default=None)

    def around(self) -> Array:
        """Return points around everything in all frames, shape (n, 3) [m]."""
        parts = [body.around() for body in self.bodies] + [shape.around() for shape in self.shapes]
        return np.concatenate(parts + [line.points.reshape(-1, 3) for line in self.lines])

    def clock(self, frame: int) -> str:
        """Return a frame's note and time, in a unit and with digits that tell the frames apart."""
        span, steps = float(np.ptp(self.times)), max(len(self.times) - 1, 1)
        factor, unit = (1e3, "ms") if max(span, float(self.times[-1])) < 1.0 else (1.0, "s")
        nearest = float(np.diff(self.times)[max(frame - 1, 0) : frame + 1].min(initial=np.inf))
        step = factor * (nearest if nearest < 0.5 * span / steps else span / steps)  # of one between those of a film
        digits = int(np.clip(np.ceil(-np.log10(step)), 0, 6)) if step > 0 else 1
        note = self.notes[frame] if self.notes else ""
        return f"{note}   t = {factor * self.times[frame]:.{digits}f} {unit}".strip()


def _outer_points(points: Array) -> IntArray:
    """Return the numbers of the points on the convex hull, and of a few inside; of all, if the hull is flat."""
    from scipy.spatial import ConvexHull

    extents = np.ptp(points, axis=0)
    if len(points) < 4 * _EVERY or extents.min() < _FLAT * extents.max():
        return np.arange(len(points))
    return np.asarray(np.union1d(ConvexHull(points).vertices, np.arange(0, len(points), _EVERY)))
