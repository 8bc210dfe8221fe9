"""Writer of a body's full matrices and nodes, in the formats that `fmd.fem.formats.matrices` reads."""

from pathlib import Path

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array, IntArray
from fmd.core.files import whole_file
from fmd.fem.model import FEModel

SUFFIXES = (".mtx", ".npz", ".txt")
"""Suffixes of the matrices: Matrix Market, SciPy's, and rows of row, column, value as Abaqus writes them."""


def write_matrices(path: Path, fe: FEModel, labels: IntArray) -> list[Path]:
    """Write stiffness [N/m], mass [kg] and nodes [m] of a body, and return the files.

    The stiffness has the path itself, whose suffix, one of `SUFFIXES`, is the format of both matrices; the others'
    names end by theirs. Unknown ``3 i + a`` is node i along axis a; labels (n_nodes,) are the nodes' numbers.
    """
    mass = path.with_name(f"{path.stem}-mass{path.suffix}")
    for place, A in ((path, fe.K), (mass, fe.M)):
        with whole_file(place) as part:
            _write(part, sp.coo_array(A))
    nodes = path.with_name(f"{path.stem}-nodes.csv")
    with whole_file(nodes) as part:
        rows = np.column_stack([labels, fe.x])
        np.savetxt(part, rows, fmt="%d,%.17g,%.17g,%.17g", header="node,x,y,z", comments="")
    return [path, mass, nodes]


def write_modes(path: Path, labels: IntArray, frequencies_hz: Array, shapes: Array) -> None:
    """Write modes as NumPy's ``.npz``: ``nodes`` (n_nodes,), ``frequencies_hz`` (n,), ``shapes`` (n_nodes, 3, n)."""
    with whole_file(path) as part, part.open("wb") as stream:
        np.savez(stream, nodes=labels, frequencies_hz=frequencies_hz, shapes=shapes)


def _write(part: Path, A: sp.coo_array) -> None:
    if part.suffix == ".npz":
        sp.save_npz(part, sp.csr_array(A))
        return
    if part.suffix == ".mtx":
        from scipy.io import mmwrite

        with part.open("wb") as stream:
            mmwrite(stream, A, comment="SI units", precision=17, symmetry="symmetric")
        return
    lower = A.coords[0] >= A.coords[1]
    rows = np.empty(np.count_nonzero(lower), dtype=[("row", int), ("column", int), ("value", float)])
    rows["row"], rows["column"], rows["value"] = A.coords[0][lower] + 1, A.coords[1][lower] + 1, A.data[lower]
    np.savetxt(part, rows, fmt="%d, %d, %.16e")
