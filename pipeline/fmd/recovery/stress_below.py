"""Stress in an elastic half-space under the pressures of a grid, which elements larger than a contact don't show."""

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.contact import COLUMNS_BELOW, DEEPEST, DEPTHS_BELOW
from fmd.recovery.stress import von_mises


def largest_stress_below(places: Array, cell: tuple[float, float], forces: Array, nu: float) -> tuple[float, float]:
    """Return the largest von Mises stress below a grid's pressed rectangles [Pa], and its depth [m].

    It is looked for below those that are pressed most. Each one's force acts in the middles of its quarters. Rectangles
    have middles (n, 2) and sides [m]; forces (n, 3) are along the inward normal and the axes of the places [N].
    """
    pressed = forces[:, 0] > 0.0
    if not pressed.any():
        return 0.0, 0.0
    places, forces = places[pressed], forces[pressed]
    corners = 0.25 * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)]) * cell
    sources = (places[:, None] + corners).reshape(-1, 2)
    shares = np.repeat(0.25 * forces, len(corners), axis=0)
    high = DEEPEST * (np.ptp(places, axis=0).min() + min(cell))
    low = high / DEPTHS_BELOW
    above = places[np.argsort(-forces[:, 0])[:COLUMNS_BELOW]]
    for _ in range(2):  # at depths below the whole contact, and between the neighbours of the one that is found
        depths = np.linspace(low, high, DEPTHS_BELOW)
        tensors = np.stack([point_force_stress(above, sources, shares, z, nu) for z in depths])
        values = von_mises(tensors.reshape(-1, 6)).reshape(len(depths), -1).max(axis=1)
        most = int(values.argmax())
        low, high = depths[max(most - 1, 0)], depths[min(most + 1, DEPTHS_BELOW - 1)]
    return float(values[most]), float(depths[most])


def point_force_stress(places: Array, sources: Array, forces: Array, z: float, nu: float) -> Array:
    """Return the stress at a depth z in a half-space under forces on points of its surface, shape (n, 6) [Pa].

    Boussinesq's and Cerruti's solutions (Johnson, Contact Mechanics, eqs. 3.19 and 3.75). Components are xx, yy, zz,
    yz, xz, xy with z along the inward normal; compression is negative. No place (n, 2) is below a point (n_sources, 2)
    [m]; forces (n_sources, 3) are along the inward normal, x and y [N].
    """
    x, y = np.moveaxis(places[:, None] - sources[None], 2, 0)
    across, slack = x**2 + y**2, 1.0 - 2.0 * nu
    rho = np.sqrt(across + z**2)
    P, Qx, Qy = forces.T / (2.0 * np.pi)
    bulk, turned = 1.0 / (rho * (rho + z)), z / rho**3
    normal = [
        slack / across * (bulk * (x**2 - y**2) + turned * y**2) - 3.0 * z * x**2 / rho**5,
        slack / across * (bulk * (y**2 - x**2) + turned * x**2) - 3.0 * z * y**2 / rho**5,
        -3.0 * z**3 / rho**5,
        -3.0 * y * z**2 / rho**5,
        -3.0 * x * z**2 / rho**5,
        slack / across * (2.0 * bulk - turned) * x * y - 3.0 * x * y * z / rho**5,
    ]
    along_x = _tangential(x, y, z, rho, slack)
    yy, xx, zz, xz, yz, xy = _tangential(y, x, z, rho, slack)
    along_y = [xx, yy, zz, yz, xz, xy]
    each = ((P, normal), (Qx, along_x), (Qy, along_y))
    return np.asarray(sum(np.stack([term @ size for term in terms], axis=1) for size, terms in each))


def _tangential(x: Array, y: Array, z: float, rho: Array, slack: float) -> list[Array]:
    """Return 2 π times the stress by a unit force along x; of the components xx, yy, zz, yz, xz, xy."""
    one = slack / (rho * (rho + z) ** 2)
    more = slack * (1.0 / (rho**3 * (rho + z) ** 2) + 2.0 / (rho**2 * (rho + z) ** 3))
    square = -3.0 / rho**5
    return [
        x * (square * x**2 + slack / rho**3 - 3.0 * one + more * x**2),
        x * (square * y**2 + slack / rho**3 - one + more * y**2),
        x * square * z**2,
        x * square * y * z,
        x * square * x * z,
        y * (square * x**2 - one + more * x**2),
    ]
