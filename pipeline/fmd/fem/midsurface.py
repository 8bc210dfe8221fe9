"""The midsurface of a shell: its nodes, and the points at both faces that hang on them."""

from __future__ import annotations

from dataclasses import dataclass

from fmd.core.arrays import Array, IntArray, read_only, require_finite, require_shape


@dataclass(frozen=True)
class Midsurface:
    """Nodes of a shell, each with the points of the mesh that turn with it.

    Parameters
    ----------
    nodes : ndarray, shape (n_nodes, 3)
        Positions of the nodes [m].
    owner : ndarray, shape (n_points,)
        The node of each point of the mesh. A node has two points on a director through the thickness, and more where
        the shell has a fold, a branch or a jump of thickness.
    """

    nodes: Array
    owner: IntArray

    def __post_init__(self) -> None:
        require_shape("nodes", self.nodes, (None, 3))
        require_finite("nodes", self.nodes)
        read_only(self.nodes)
        read_only(self.owner)
