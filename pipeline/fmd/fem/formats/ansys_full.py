"""Reader of the matrices in Ansys' ``.full`` files, by the package ansys-mapdl-reader, which loads when it is used."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import IntArray
from fmd.core.errors import InputError

_PACKAGE = "is read by the package ansys-mapdl-reader: pip install ansys-mapdl-reader"


def read_full(path: Path, labels: IntArray, unknowns: int, what: str) -> sp.coo_array:
    """Read one half of the ``stiffness`` or the ``mass`` of a ``.full`` file, its unknowns in the order of nodes.

    The file is of an analysis that writes masses, too (``ANTYPE, MODAL``), and labels (n_nodes,) are its nodes'
    numbers, of 3 or, with rotations, 6 unknowns each.

    Raises
    ------
    InputError
        The package isn't installed; or supports, equations, other unknowns or other nodes are in the file.
    """
    try:
        from ansys.mapdl.reader import read_binary
        from ansys.mapdl.reader.common import read_table
    except ImportError:
        raise InputError(str(path), "", None, _PACKAGE) from None
    full = read_binary(str(path))
    if not hasattr(full, "load_km"):
        raise ValueError("it is another of Ansys' binary files; K and M are in .full")
    with path.open("rb") as stream:  # the third record lists the unknowns of all nodes, UX 1 to ROTZ 6
        kinds = [read_table(stream) for _ in range(3)][2].tolist()
    if kinds not in ([1, 2, 3], [1, 2, 3, 4, 5, 6]):
        raise ValueError(
            f"its nodes have unknowns {kinds}; UX, UY, UZ (1 to 3), and with them ROTX, ROTY, ROTZ are read"
        )
    unknown, K, M = full.load_km(sort=False)
    if n_equations := int(full._header["ncefull"]):
        raise ValueError(f"{n_equations} constraint equations are in it; write it without CE, CP and CERIG")
    if len(held := np.asarray(full.const)):
        raise ValueError(
            f"{len(held)} unknowns of {len(np.unique(held[:, 0]))} nodes, the first {held[0, 0]}, are held by supports "
            "(D), so that their rows are empty; write it without them"
        )
    if (A := K if what == "stiffness" else M) is None:
        raise ValueError(f"it has no {what} matrix; write it by a modal analysis")
    nodes, directions = np.asarray(unknown).T.astype(np.int64)
    if directions.max() >= unknowns:
        more = "; with rotations say matrices.unknowns = 6" if directions.max() < 6 else ""
        raise ValueError(f"a node has {directions.max() + 1} unknowns{more}")
    _require_same(nodes.tolist(), labels.tolist())
    order = np.argsort(labels)
    place = unknowns * order[np.searchsorted(labels[order], nodes)] + directions
    A = sp.coo_array(A)
    row, column = (place[each] for each in A.coords)
    return sp.coo_array((A.data, (row, column)), shape=2 * (unknowns * len(labels),))


def _require_same(there: Iterable[int], labels: Iterable[int]) -> None:
    """Raise ``ValueError`` if the nodes of a file aren't those that are known by number."""
    of_file, known = set(there), set(labels)
    if missing := sorted(of_file - known):
        raise ValueError(f"it has unknowns of node {missing[0]} and {len(missing) - 1} more, which nodes doesn't have")
    if missing := sorted(known - of_file):
        raise ValueError(f"it has no unknowns of node {missing[0]} and {len(missing) - 1} more of nodes")
