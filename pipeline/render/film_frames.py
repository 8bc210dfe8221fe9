"""Positions and stress of a moving part, frame by frame, as a film shows them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.core.arrays import Array

_EVERY = 50  # of the points inside count for the film's bounds, beside the outermost ones


class FilmFrame(NamedTuple):
    """A part's position and stress at an instant of a film.

    Attributes
    ----------
    time : float
        [s]
    points : ndarray, shape (n_points, 3)
        Positions in space [m].
    stress : ndarray, shape (n_points,)
        [Pa]
    note : str
        Text beside the time, e.g. ``4000 rpm``.
    """

    time: float
    points: Array
    stress: Array
    note: str = ""


@dataclass(frozen=True, slots=True)
class FilmedMotion:
    """A flexible part's motion at the instants of a film, from which each frame is computed when it is drawn.

    Attributes
    ----------
    times : ndarray, shape (n_frames,)
        [s]
    points : ndarray, shape (n_points, 3)
        Undeformed points in the part's frame [m].
    shapes : ndarray, shape (n_points, 3, n_modes)
        Displacement of the points for a unit of each modal coordinate [kg^-1/2].
    coordinates : ndarray, shape (n_frames, n_modes)
        Modal coordinates [kg^1/2 m].
    scale : float
        Factor on the deformation.
    origin, rotation : ndarray, shapes (n_frames, 3) and (n_frames, 3, 3)
        Place [m] and axes of the part's frame in space.
    stress : ndarray, shape (n_frames, n_points)
        [Pa]
    notes : tuple of str
        Text of each frame.
    """

    times: Array
    points: Array
    shapes: Array
    coordinates: Array
    scale: float
    origin: Array
    rotation: Array
    stress: Array
    notes: tuple[str, ...]

    def frames(self) -> Iterator[FilmFrame]:
        """Compute the frames one after the other."""
        for k, (time, stress, note) in enumerate(zip(self.times, self.stress, self.notes, strict=True)):
            yield FilmFrame(float(time), self._place(self.points, self.shapes, k), stress, note)

    def around(self) -> Array:
        """Return points around the part in motion, shape (n, 3) [m]."""
        from scipy.spatial import ConvexHull

        inside = np.arange(0, len(self.points), _EVERY)
        outer = np.union1d(ConvexHull(self.points).vertices, inside)
        points, shapes = self.points[outer], self.shapes[outer]
        return np.concatenate([self._place(points, shapes, k) for k in range(len(self.times))])

    def _place(self, points: Array, shapes: Array, k: int) -> Array:
        """Deform points and place them in space as in frame k."""
        deformed = points + self.scale * (shapes @ self.coordinates[k])
        return np.asarray(self.origin[k] + deformed @ self.rotation[k].T)
