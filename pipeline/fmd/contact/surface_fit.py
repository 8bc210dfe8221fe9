"""Smooth surface through the nodes of a face, a plane or a quadric: spheres, cylinders, cones and ellipsoids are."""

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.contact import FIT_ROUNDS, OFF_SURFACE, ONE_QUADRIC


@dataclass(frozen=True)
class Quadric:
    """Surface ``F(x) = xᵀ A x + bᵀ x + c = 0``."""

    A: Array  # (3, 3): symmetric [1/m²]
    b: Array  # (3,) [1/m]
    c: float

    def values(self, x: Array) -> Array:
        """Return F at points x, shape (n, 3)."""
        return np.asarray(np.einsum("na,ab,nb->n", x, self.A, x) + x @ self.b + self.c)

    def gradients(self, x: Array) -> Array:
        """Return ``∇F`` at points x, shape (n, 3)."""
        return np.asarray(2.0 * x @ self.A + self.b)

    def lowest_place(self, x: Array, normal: Array) -> Array:
        """Return the place of the surface that is lowest along a normal, shape (3,), from a place x near it.

        Where a line is, as on a cylinder, the place on it nearest to x.
        """
        across = np.linalg.svd(normal[None])[2][1:]
        for _ in range(FIT_ROUNDS):
            gradient = self.gradients(x[None])[0]
            rows = np.vstack([gradient, 2.0 * across @ self.A])
            left = np.concatenate([self.values(x[None]), across @ gradient])
            x = x - np.linalg.lstsq(rows, left, rcond=ONE_QUADRIC)[0]
        return x

    def heights(self, x: Array, normal: Array) -> Array:
        """Return how far along a normal the surface is from points x, (n,); NaN where it is nowhere."""
        a, b = float(normal @ self.A @ normal), self.gradients(x) @ normal
        root = np.sqrt(np.where((d := b**2 - 4.0 * a * self.values(x)) < 0.0, np.nan, d))
        return np.asarray(-2.0 * self.values(x) / (b + np.copysign(root, b)))


def is_flat(x: Array) -> bool:
    """Return true if points (n, 3) are all but in a plane."""
    apart = x - x.mean(axis=0)
    across = np.linalg.svd(apart, full_matrices=False)[2][-1]
    return bool(np.abs(apart @ across).max() < OFF_SURFACE * float(np.ptp(x, axis=0).max()))


def fit_quadric(x: Array) -> Quadric | None:
    """Return the one quadric through points (n, 3), a sphere if there is one; ``None`` without one.

    Planes are none: many quadrics have them.
    """
    middle, size = x.mean(axis=0), float(np.ptp(x, axis=0).max())
    u = (x - middle) / size
    squares = np.stack([u[:, a] * u[:, b] for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))], axis=1)
    one = np.ones((len(u), 1))
    for columns in (np.hstack([squares[:, :3].sum(axis=1, keepdims=True), u, one]), np.hstack([squares, u, one])):
        if len(u) < columns.shape[1]:
            return None
        _, parts, rows = np.linalg.svd(columns, full_matrices=False)
        if parts[-2] < ONE_QUADRIC * parts[0]:
            return None
        v = rows[-1]
        s = np.concatenate([v[:1].repeat(3), np.zeros(3)]) if len(v) == 5 else v[:6]
        A = np.array([[s[0], s[3] / 2, s[5] / 2], [s[3] / 2, s[1], s[4] / 2], [s[5] / 2, s[4] / 2, s[2]]]) / size**2
        b = v[-4:-1] / size - 2.0 * A @ middle
        found = Quadric(A, b, float(v[-1] - v[-4:-1] @ middle / size + middle @ A @ middle))
        slopes = np.linalg.norm(found.gradients(x), axis=1)
        if slopes.min() > 0.0 and (np.abs(found.values(x)) / slopes).max() < OFF_SURFACE * size:
            return found
    return None
