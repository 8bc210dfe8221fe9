"""Flexibility of an elastic half-space's surface under rectangles of constant pressure and shear."""

import numpy as np

from fmd.core.arrays import Array


def half_space_flexibility(places: Array, cell: tuple[float, float], E: float, nu: float) -> Array:
    """Return displacements of the middles of rectangles by unit forces spread over rectangles, (n, 3, n, 3) [m/N].

    They are along the inward normal and the two axes of the places (n, 2) of the middles [m], symmetric; a rectangle
    has the sides ``cell`` [m]. The solutions of Boussinesq and Cerruti for a point's force are integrated over a
    rectangle in closed form (Love, Phil Trans R Soc A 228, 1929; Johnson, Contact Mechanics, chapter 3).
    """
    return rectangle_flexibility(places[:, None] - places[None], cell, E, nu)


def rectangle_flexibility(apart: Array, cell: tuple[float, float], E: float, nu: float) -> Array:
    """Return the same of pairs of rectangles (n, m, 2) apart [m], (n, 3, m, 3) [m/N]."""
    means = np.zeros((6, *apart.shape[:2]))
    for side_x in (0.5, -0.5):
        for side_y in (0.5, -0.5):
            x, y, sign = apart[..., 0] + side_x * cell[0], apart[..., 1] + side_y * cell[1], 4.0 * side_x * side_y
            r = np.hypot(x, y)
            x_log, y_log = x * np.arcsinh(y / np.abs(x)), y * np.arcsinh(x / np.abs(y))
            means[0] += sign * (x_log + y_log)
            means[1] += sign * y_log
            means[2] += sign * x_log
            means[3] -= sign * r
            means[4] += sign * (y * np.log(r) + x * np.arctan(y / x))
            means[5] += sign * (x * np.log(r) + y * np.arctan(x / y))
    return _assemble(means / (cell[0] * cell[1]), shear_modulus(E, nu), nu)


def point_flexibility(r: Array, along: Array, normal: Array, E: float, nu: float) -> Array:
    """Return displacements of a half-space's surface by unit forces on points of it, (..., 3, 3) [m/N].

    The surface moves at distances r (...) from the force [m], along unit vectors (..., 3); its inward normals are
    (..., 3).
    """
    G, r = shear_modulus(E, nu), r[..., None, None]
    across, drawn = along[..., None] * along[..., None, :], normal[..., None] * along[..., None, :]
    even = ((1.0 - nu) * np.eye(3) + nu * across) / (2.0 * np.pi * G)
    return np.asarray((even + (1.0 - 2.0 * nu) / (4.0 * np.pi * G) * (drawn - drawn.swapaxes(-1, -2))) / r)


def shear_modulus(E: float, nu: float) -> float:
    """Return ``E/(2 (1 + ν))`` [Pa]."""
    return E / (2.0 * (1.0 + nu))


def _assemble(means: Array, shear: float, nu: float) -> Array:
    """Return flexibilities of means of 1/r, x²/r³, y²/r³, x y/r³, x/r² and y/r² over the loaded places, (6, n, m)."""
    inverse, along_x, along_y, across, slope_x, slope_y = means
    found = np.empty((inverse.shape[0], 3, inverse.shape[1], 3))
    tangential = 1.0 / (2.0 * np.pi * shear)
    towards = (1.0 - 2.0 * nu) / (4.0 * np.pi * shear)  # a force that pushes in draws the surface to it
    found[:, 0, :, 0] = tangential * (1.0 - nu) * inverse
    found[:, 1, :, 1] = tangential * ((1.0 - nu) * inverse + nu * along_x)
    found[:, 2, :, 2] = tangential * ((1.0 - nu) * inverse + nu * along_y)
    found[:, 1, :, 2] = found[:, 2, :, 1] = tangential * nu * across
    for a, slope in ((1, slope_x), (2, slope_y)):
        found[:, a, :, 0] = -towards * slope
        found[:, 0, :, a] = towards * slope
    return found
