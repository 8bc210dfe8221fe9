"""Places of a mechanism's coordinates: slow joints, slow modes, fast joints, fast modes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import IntArray
from fmd.dynamics.links import Link


class Layout(NamedTuple):
    """Where the coordinates are: slow joints, slow modes, fast joints, fast modes."""

    rate: IntArray  # first rate of each joint
    position: IntArray  # first position of each joint
    mode: IntArray  # (n_bodies, most modes): rate of each modal coordinate
    n_slow: int
    n: int
    n_positions: int


def layout_of(links: Sequence[Link], fast_joints: Sequence[str], slow_modes: Sequence[int]) -> Layout:
    """Number the coordinates; rotations in space are slow, so every rate after them has the same shift to its position.

    Parameters
    ----------
    fast_joints : sequence of str
        Links whose joint coordinate is fast.
    slow_modes : sequence of int
        How many of each link's modes, the lowest, are slow.
    """
    rate, position = np.zeros(len(links), dtype=np.int64), np.zeros(len(links), dtype=np.int64)
    mode = np.zeros((len(links), max(len(link.omega) for link in links)), dtype=np.int64)
    at = at_position = n_slow = 0
    for fast in (False, True):
        for k, link in enumerate(links):
            if (link.name in fast_joints) is fast:
                rate[k], position[k] = at, at_position
                at += link.n_rates
                at_position += link.n_positions
        for k, link in enumerate(links):
            first, last = (slow_modes[k], len(link.omega)) if fast else (0, slow_modes[k])
            mode[k, first:last] = np.arange(at, at + last - first)
            at += last - first
            at_position += last - first
        n_slow = n_slow if fast else at
    return Layout(rate, position, mode, n_slow, at, at_position)
