"""Extremes of von Mises and principal stress over blocks of output times, node by node.

With the mean stress p and the von Mises stress σ, principal stresses lie within ``p ± ⅔ σ``: they are computed where
these bounds pass the extremes so far, and nowhere else.
"""

from __future__ import annotations

from fmd.core.arrays import Array, IntArray
from fmd.kernels.kernel import kernel
from fmd.recovery.kernels.principal import principal_stresses


@kernel
def take_extremes(tensors: Array, first: int, squares: Array, means: Array, extremes: Array, frames: IntArray) -> None:
    """Take the output times of a block into extremes.

    Parameters
    ----------
    tensors : ndarray, shape (n_nodes, 6, n_frames)
        xx, yy, zz, yz, xz, xy of the block [Pa].
    first : int
        Number of the block's first output time.
    squares, means : ndarray, shape (n_frames,)
        Room to work in.
    extremes : ndarray, shape (n_nodes, 3)
        Largest square of the von Mises stress, largest and smallest principal stress so far.
    frames : ndarray, shape (n_nodes, 3)
        Numbers of the output times at which they occur first.
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
