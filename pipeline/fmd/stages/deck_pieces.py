"""Links, masses and springs of a deck on a part in pieces: what hangs together stays in one piece."""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from fmd.core.arrays import Array, IntArray
from fmd.fem.connections import Connections, MassOnPoint, MeanConnection
from fmd.fem.partition import PartitionError, joined_nodes
from fmd.fem.space import Discretisation


def group_connections(deck: Connections, space: Discretisation) -> list[tuple[Connections, IntArray]]:
    """Gather the connections of a deck that share points, with the numbers of the elements at these.

    A mass on a node of its own is with one element there, so that cuts may pass it.

    Raises
    ------
    PartitionError
        Connections alone join parts of the mesh.
    """
    nodes, connections = _members(list(joined_nodes(space))), deck.all
    if connected_components(nodes @ nodes.T, directed=False)[0] > 1:
        raise PartitionError("its deck's links or ties alone join parts of the mesh; leave pieces out")
    facets = [each.facets if isinstance(each, MeanConnection) else () for each in connections]
    points = _members(
        [np.concatenate([each.points, *map(np.ravel, f)]) for each, f in zip(connections, facets, strict=True)]
    )
    n = min(points.shape[1], nodes.shape[1])
    around = sp.csr_array(points[:, :n] @ nodes[:, :n].T)
    count, group = connected_components(points @ points.T, directed=False)
    found = []
    for mine in (np.flatnonzero(group == number) for number in range(count)):
        own = [connections[k] for k in mine]
        near = np.unique(around[mine].indices)
        loose = all(isinstance(each, MassOnPoint) and not (each.offset.any() or each.inertia.any()) for each in own)
        found.append((deck.only(own), near[:1] if loose else near))
    return found


def _members(sets: Sequence[IntArray]) -> sp.csr_array:
    """Return the incidence (n_sets, n_points) of sets of points."""
    columns = np.concatenate(sets)
    rows = np.repeat(np.arange(len(sets)), [len(each) for each in sets])
    return sp.csr_array((np.ones(len(rows)), (rows, columns)), shape=(len(sets), int(columns.max()) + 1))


def connections_on(deck: Connections, nodes: IntArray, n_nodes: int, offset: Array) -> Connections:
    """Return connections on a piece with some of the whole mesh's ``n_nodes`` nodes.

    Nodes (n,) are numbers in the whole mesh, in the piece's order; further points move by the offset (3,) [m].
    """
    beyond = deck.points[deck.points >= n_nodes]
    number = {int(node): k for k, node in enumerate(nodes)} | {int(p): len(nodes) + k for k, p in enumerate(beyond)}
    return deck.named(deck.names).numbered(number, deck.places[beyond - n_nodes] - offset)
