"""Extremes of von Mises and principal stress over blocks of output times, node by node.

With the mean stress p and the von Mises stress σ, principal stresses lie within ``p ± ⅔ σ``: they are computed where
these bounds pass the extremes so far, and nowhere else.
"""

from __future__ import annotations

import math

from fmd.core.arrays import Array, IntArray
from fmd.kernels.kernel import inner, kernel


@inner
def principal_stresses(xx: float, yy: float, zz: float, yz: float, xz: float, xy: float) -> tuple[float, float, float]:
    """Return the principal stresses of a tensor, the largest first, to round-off also where two of them are equal.

    The cosine formula gives the root that stands apart from the other two; these are the eigenvalues of the tensor
    across its direction, a 2 × 2 problem (Smith, Comm ACM 4, 1961, with the deflation of Scherzinger & Dohrmann, Comput
    Methods Appl Mech Engrg 197, 2008).
    """
    mean = (xx + yy + zz) / 3.0
    a, b, c = xx - mean, yy - mean, zz - mean
    J2 = 0.5 * (a * a + b * b + c * c) + yz * yz + xz * xz + xy * xy
    if not J2 > 0.0:
        return mean, mean, mean
    J3 = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)
    ratio = min(1.0, abs(J3) * 0.5 / (J2 / 3.0) ** 1.5)
    side = 1.0 if J3 >= 0.0 else -1.0
    apart = side * 2.0 * math.sqrt(J2 / 3.0) * math.cos(math.acos(ratio) / 3.0)  # of the deviator
    a, b, c = a - apart, b - apart, c - apart
    # The direction of this root: the longest cross product of two rows.
    ux, uy, uz = xy * yz - xz * b, xz * xy - a * yz, a * b - xy * xy
    vx, vy, vz = xy * c - xz * yz, xz * xz - a * c, a * yz - xy * xz
    wx, wy, wz = b * c - yz * yz, yz * xz - xy * c, xy * yz - b * xz
    u, v, w = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, wx * wx + wy * wy + wz * wz
    if v > u and v >= w:
        ux, uy, uz, u = vx, vy, vz, v
    elif w > u:
        ux, uy, uz, u = wx, wy, wz, w
    if not u > 0.0:  # a hair from isotropic
        return mean + max(apart, -0.5 * apart), mean - 0.5 * apart, mean + min(apart, -0.5 * apart)
    u = 1.0 / math.sqrt(u)
    ux, uy, uz = ux * u, uy * u, uz * u
    # Two unit vectors across it.
    if abs(ux) <= abs(uy) and abs(ux) <= abs(uz):
        px, py, pz = 0.0, uz, -uy
    elif abs(uy) <= abs(uz):
        px, py, pz = -uz, 0.0, ux
    else:
        px, py, pz = uy, -ux, 0.0
    p = 1.0 / math.sqrt(px * px + py * py + pz * pz)
    px, py, pz = px * p, py * p, pz * p
    rx, ry, rz = uy * pz - uz * py, uz * px - ux * pz, ux * py - uy * px
    a, b, c = a + apart, b + apart, c + apart
    sx, sy, sz = a * px + xy * py + xz * pz, xy * px + b * py + yz * pz, xz * px + yz * py + c * pz
    tx, ty, tz = a * rx + xy * ry + xz * rz, xy * rx + b * ry + yz * rz, xz * rx + yz * ry + c * rz
    pp, rr, pr = px * sx + py * sy + pz * sz, rx * tx + ry * ty + rz * tz, rx * sx + ry * sy + rz * sz
    half, span = 0.5 * (pp + rr), math.hypot(0.5 * (pp - rr), pr)
    if side > 0.0:
        return mean + apart, mean + half + span, mean + half - span
    return mean + half + span, mean + half - span, mean + apart


@kernel
def take_extremes(tensors: Array, first: int, squares: Array, means: Array, extremes: Array, frames: IntArray) -> None:
    """Take the output times of a block, from number ``first`` on, into extremes.

    Tensors (n_nodes, 6, n_frames) are the block's xx, yy, zz, yz, xz, xy [Pa]. Extremes so far (n_nodes, 3) are the
    largest square of the von Mises stress, the largest and the smallest principal stress; frames are the numbers of the
    output times at which they occur first. Squares and means (n_frames,) are room to work in.
    """
    n_frames = tensors.shape[2]
    for node in range(tensors.shape[0]):
        xx, yy, zz = tensors[node, 0], tensors[node, 1], tensors[node, 2]
        yz, xz, xy = tensors[node, 3], tensors[node, 4], tensors[node, 5]
        for k in range(n_frames):
            a, b, c = xx[k] - yy[k], yy[k] - zz[k], zz[k] - xx[k]
            shear = yz[k] * yz[k] + xz[k] * xz[k] + xy[k] * xy[k]
            squares[k] = 0.5 * (a * a + b * b + c * c) + 3.0 * shear
            means[k] = (xx[k] + yy[k] + zz[k]) / 3.0
        most, high, low = extremes[node, 0], extremes[node, 1], extremes[node, 2]
        for k in range(n_frames):
            if squares[k] > most:
                most, frames[node, 0] = squares[k], first + k
        for k in range(n_frames):
            up, down = 1.5 * (high - means[k]), 1.5 * (means[k] - low)
            if squares[k] >= up * abs(up) or squares[k] >= down * abs(down):
                largest, _, smallest = principal_stresses(xx[k], yy[k], zz[k], yz[k], xz[k], xy[k])
                if largest > high:
                    high, frames[node, 1] = largest, first + k
                if smallest < low:
                    low, frames[node, 2] = smallest, first + k
        extremes[node, 0], extremes[node, 1], extremes[node, 2] = most, high, low
