"""Turns of an MJCF element, given in one of five ways."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from fmd.cli.robot import read_numbers
from fmd.core.arrays import Array


def read_turn(given: Mapping[str, str], unit: float, order: str) -> Rotation:
    """Return an element's turn, by the unit of angles [rad] and the order of Euler's axes; raises ``ValueError``."""
    if "quat" in given:
        w, *xyz = read_numbers(given["quat"], "1 0 0 0")
        return Rotation.from_quat([*xyz, w])
    if "axisangle" in given:
        *axis, angle = read_numbers(given["axisangle"], "0 0 1 0")
        return Rotation.from_rotvec(unit * angle * direction(np.array(axis), "axisangle"))
    if "euler" in given:
        # Capitals in both: small letters are axes that turn there, and fixed ones in SciPy.
        return Rotation.from_euler(order.swapcase(), unit * read_numbers(given["euler"], "0 0 0"))
    if "xyaxes" in given:
        x, y = read_numbers(given["xyaxes"], "1 0 0 0 1 0").reshape(2, 3)
        x = direction(x, "xyaxes")
        y = direction(y - (x @ y) * x, "xyaxes")
        return Rotation.from_matrix(np.stack([x, y, np.cross(x, y)], axis=1))
    return turn_z(read_numbers(given.get("zaxis"), "0 0 1"), "zaxis")


def turn_z(to: Array, what: str) -> Rotation:
    """Return the shortest turn that takes the z axis to a vector (3,); half a turn is about x, as in MuJoCo."""
    x, y, z = direction(to, what)
    across = float(np.hypot(x, y))
    axis = np.array([-y, x, 0.0]) / across if across > 1e-10 else np.array([1.0, 0.0, 0.0])
    return Rotation.from_rotvec(np.arctan2(across, z) * axis)


def direction(vector: Array, what: str) -> Array:
    """Return the unit vector (3,) along a vector; raises ``ValueError`` for one of no length."""
    size = float(np.linalg.norm(vector))
    if not size > 0.0:
        raise ValueError(f"{what} has a vector of no length")
    return vector / size
