"""Division of a mesh into connected pieces, along its longest path or by METIS where it branches.

Along the path the elements are ordered by the lowest eigenvector of diffusion in the body (Fiedler, Czechoslovak
Mathematical Journal 23, 1973; Pothen, Simon & Liou, SIAM J Matrix Anal 11, 1990). Its level sets cross slender parts
squarely, however these are bent.
"""

from collections.abc import Sequence
from importlib.util import find_spec

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import eigsh

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.mesh import CUT_WINDOW, DIFFUSION_SHIFT, DIVISIONS, FINEST_WEIGHT, FRAGMENT, UNBALANCED, WIDE_GAP
from fmd.fem.mesh import three_corners
from fmd.fem.space import Discretisation


class PartitionError(ValueError):
    """A mesh can't be divided into the wanted pieces; the message says why."""


def interior_facets(space: Discretisation) -> tuple[IntArray, IntArray]:
    """Return both elements of each facet that two share, and the facet's number in each, (n_facets, 2) both."""
    facets, nodes = space.kind.facet_corners, joined_nodes(space)
    keys = np.concatenate([three_corners(nodes[:, corners]) for corners in facets])
    order = np.lexsort(keys.T)
    equal = np.flatnonzero((np.diff(keys[order], axis=0) == 0).all(axis=1))
    pairs = np.stack([order[equal], order[equal + 1]], axis=1)
    local, elements = np.divmod(pairs, len(space.element_nodes))
    between = elements[:, 0] != elements[:, 1]  # the two sides of a shell hang on the same nodes
    return elements[between], local[between]


def joined_nodes(space: Discretisation) -> IntArray:
    """Return the nodes of each element (n_elements, n_local), of a shell those that its points hang on."""
    midsurface = space.mesh.midsurface
    return space.element_nodes if midsurface is None else np.asarray(midsurface.owner[space.element_nodes])


def facet_areas(space: Discretisation, elements: IntArray, local: IntArray) -> Array:
    """Return the areas of facets, flat between their corners, shape (n_facets,) [m²]."""
    areas = np.empty(len(elements))
    for k, corners in enumerate(space.kind.facet_corners):
        mine = local == k
        x = space.x[space.element_nodes[elements[mine]][:, corners]]
        across = np.cross(x[:, 2] - x[:, 0], x[:, -1] - x[:, 1]) if len(corners) == 4 else np.cross(*_sides(x))
        areas[mine] = 0.5 * np.linalg.norm(across, axis=1)
    return areas


def divide_mesh(space: Discretisation, count: int, together: Sequence[IntArray] = ()) -> IntArray:
    """Divide a mesh into connected pieces of about equal volume, and return each element's, (n_elements,), from 0.

    Pieces follow one another along a part that doesn't branch. METIS puts each set of elements ``together`` into one.

    Raises
    ------
    PartitionError
        The mesh is too coarse for so many pieces, or METIS isn't installed and the part branches.
    """
    n = len(space.element_nodes)
    if count > n:
        raise PartitionError(f"the mesh has {n} elements; it can't be divided into {count} pieces")
    if count == 1:
        return np.zeros(n, dtype=np.int64)
    elements, local = interior_facets(space)
    areas = facet_areas(space, elements[:, 0], local[:, 0])
    labels = _divide_along_path(space, elements, areas, count)
    if labels is not None and not count_bare_nodes(space.element_nodes, labels, elements):
        return labels
    try:
        found = _divide_by_metis(space, elements, areas, count, together)
    except PartitionError:
        if labels is None:
            raise
        return labels
    if labels is None:
        return found
    bare = [count_bare_nodes(space.element_nodes, each, elements) for each in (labels, found)]
    return found if bare[1] < bare[0] else labels


def count_bare_nodes(element_nodes: IntArray, labels: IntArray, elements: IntArray) -> int:
    """Count nodes common to pieces that have no facet in common; forces across these nodes are lost in a cut part.

    Elements have nodes (n_elements, n_local) and pieces (n_elements,), interior facets elements (n_facets, 2).
    """
    n, count = int(element_nodes.max()) + 1, int(labels.max()) + 1
    pairs = np.unique(np.stack([element_nodes.ravel(), np.repeat(labels, element_nodes.shape[1])]), axis=1)
    touches = sp.csr_array((np.ones(pairs.shape[1]), pairs), shape=(n, count))
    shared = (touches.T @ touches).toarray()
    shared[labels[elements[:, 0]], labels[elements[:, 1]]] = 0.0
    shared[labels[elements[:, 1]], labels[elements[:, 0]]] = 0.0
    np.fill_diagonal(shared, 0.0)
    return int(shared.sum()) // 2


def _sides(x: Array) -> tuple[Array, Array]:
    return x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]


def _divide_along_path(space: Discretisation, elements: IntArray, areas: Array, count: int) -> IntArray | None:
    """Divide a mesh between levels of its slowest diffusion; ``None`` if pieces aren't connected, as of a branching."""
    volumes = space.volumes
    order = path_coordinates(space, elements, areas).argsort(kind="stable")
    level = path_coordinates(space, elements, areas)[order]
    share = np.cumsum(volumes[order]) / volumes.sum()  # volume up to and with each element
    gaps = np.diff(level)
    layers = gaps > WIDE_GAP * np.partition(gaps, -min(len(gaps), count))[-min(len(gaps), count)]
    cuts: list[int] = []
    for k in range(1, count):
        off = np.abs(share[:-1] - k / count) * count
        near = np.flatnonzero(off <= CUT_WINDOW)
        near = near[near > (cuts[-1] if cuts else -1)]
        if not len(near):
            return None
        between = near[layers[near]]
        chosen = between if len(between) else near
        cuts.append(int(chosen[off[chosen].argmin()]))
    labels = np.empty(len(order), dtype=np.int64)
    labels[order] = np.searchsorted(np.array(cuts), np.arange(len(order)), side="left")
    return join_fragments(labels, elements, volumes, count)


def path_coordinates(space: Discretisation, elements: IntArray, areas: Array) -> Array:
    """Return a number for each element that grows along the longest path through the body, shape (n_elements,).

    Interior facets have elements (n_facets, 2) on both sides, and areas (n_facets,) [m²].
    """
    n, centres = len(space.element_nodes), space.x[space.element_nodes].mean(axis=1)
    first, second = elements.T
    conductance = areas / np.linalg.norm(centres[first] - centres[second], axis=1)
    A = sp.csr_array(sp.coo_array((conductance, (first, second)), shape=(n, n)))
    A = A + A.T
    D = sp.diags_array(A.sum(axis=1))
    V = sp.diags_array(space.volumes)
    extent = float(np.ptp(centres, axis=0).max())
    start = centres @ np.ptp(centres, axis=0)  # a fixed vector that isn't constant
    if n < 3:  # too few for the iteration
        _, vectors = eigh((D - A).toarray(), V.toarray())
    else:
        _, vectors = eigsh(sp.csc_array(D - A), k=2, M=sp.csc_array(V), sigma=-DIFFUSION_SHIFT / extent**2, v0=start)
    field = vectors[:, np.ptp(vectors, axis=0).argmax()]
    field = field if field[centres[:, np.ptp(centres, axis=0).argmax()].argmin()] < 0 else -field
    # the lowest eigenvector of a straight bar is a cosine: its inverse grows evenly along the bar
    return np.asarray(np.arcsin(np.clip(field / np.abs(field).max(), -1.0, 1.0)))


def join_fragments(labels: IntArray, elements: IntArray, volumes: Array, count: int) -> IntArray | None:
    """Give loose elements to the piece beside them; ``None`` if a piece consists of several large parts, or of none.

    Elements have pieces and volumes (n_elements,) [m³]; ``elements`` (n_facets, 2) are beside each interior facet.
    """
    n = len(labels)
    for _ in range(3):
        same = elements[labels[elements[:, 0]] == labels[elements[:, 1]]]
        graph = sp.coo_array((np.ones(len(same)), (same[:, 0], same[:, 1])), shape=(n, n))
        n_found, parts = connected_components(graph, directed=False)
        if len(np.unique(labels)) < count:
            return None
        if n_found == count:
            return labels
        sizes = np.bincount(parts, volumes)
        of_parts = np.zeros(n_found, dtype=np.int64)
        of_parts[parts] = labels
        largest = np.array([np.where(of_parts == k, sizes, 0.0).argmax() for k in range(count)])
        loose = ~np.isin(np.arange(n_found), largest)
        if sizes[loose].max() > FRAGMENT * volumes.sum() / count:
            return None
        labels = labels.copy()
        for part in np.flatnonzero(loose):
            mine = parts == part
            beside = elements[mine[elements[:, 0]] != mine[elements[:, 1]]]
            others = labels[np.where(mine[beside[:, 0]], beside[:, 1], beside[:, 0])]
            labels[mine] = np.bincount(others).argmax()
    return None


def _divide_by_metis(
    space: Discretisation, elements: IntArray, areas: Array, count: int, together: Sequence[IntArray]
) -> IntArray:
    """Divide a mesh by METIS so that the area of all cuts is small: across thin sections, not through thick joints."""
    if find_spec("pymetis") is None:
        raise PartitionError("the part branches, and pymetis, which would divide it, isn't installed")
    import pymetis

    volumes = space.volumes
    n = len(volumes)
    tied = [np.stack([group[:-1], group[1:]]) for group in together]
    ties = np.concatenate([np.zeros((2, 0), dtype=np.int64), *tied], axis=1)
    m, vertex = connected_components(sp.coo_array((np.ones(ties.shape[1]), ties), shape=(n, n)), directed=False)
    apart = vertex[elements]
    between = apart[:, 0] != apart[:, 1]
    pairs = np.concatenate([apart[between], apart[between, ::-1]])
    graph = sp.csr_array(sp.coo_array((np.tile(areas[between], 2), pairs.T), shape=(m, m)))
    adjacency = pymetis.CSRAdjacency(graph.indptr, graph.indices)
    sizes, strengths = _whole_numbers(np.asarray(np.bincount(vertex, volumes), dtype=float)), _whole_numbers(graph.data)
    found: list[tuple[int, int, float, IntArray]] = []
    for seed in range(1, 1 + DIVISIONS):
        options = pymetis.Options(contig=1, seed=seed, ufactor=UNBALANCED)
        parts = pymetis.part_graph(
            count, adjacency, vweights=sizes, eweights=strengths, options=options, recursive=False
        )[1]
        labels = np.asarray(parts, dtype=np.int64)
        joined = join_fragments(labels[vertex], elements, volumes, count)
        if joined is not None:
            torn = sum(len(np.unique(joined[group])) > 1 for group in together)
            across = joined[elements[:, 0]] != joined[elements[:, 1]]
            bare = count_bare_nodes(space.element_nodes, joined, elements)
            found.append((torn, bare, float(areas[across].sum()), joined))
    if not found:
        raise PartitionError(f"METIS finds no {count} connected pieces; take another number, or a finer mesh")
    return min(found, key=lambda each: each[:3])[3]


def _whole_numbers(sizes: Array) -> list[int]:
    """Return sizes in whole multiples of a small part of the largest, at least 1: the weights that METIS takes."""
    whole: list[int] = np.maximum(np.rint(FINEST_WEIGHT * sizes / sizes.max()), 1).astype(int).tolist()
    return whole
