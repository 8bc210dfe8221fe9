"""Matrices as Code_Aster prints them: entries by equation, then the node and the component of each equation."""

import re
from io import StringIO

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import IntArray

_HEAD, _EQUATIONS = "DIMENSION DE LA MATRICE", "DESCRIPTION DES EQUATIONS"
_TERMS = r"NOMBRE DE TERMES NON NULS \(MATRICE SYMETRIQUE\)"  # of one half, the diagonal's too
_COMPONENTS = ("DX", "DY", "DZ", "DRX", "DRY", "DRZ")
_NEITHER = {  # what isn't read, by the head's line that is true or false
    r"COEE?FICIENTS REELS\s*:\s*F": "its entries are complex",
    r"MATRICE DISTRIBUEE\s*:\s*T": "it is distributed over processes; print it from one",
    r"MATRICE HPC\s*:\s*T": "it is distributed over processes; print it from one",
}


def is_code_aster(text: str) -> bool:
    """Return true if a text begins as a matrix that Code_Aster prints."""
    return _HEAD in text[:400]


def read_code_aster(text: str, labels: IntArray, unknowns: int) -> sp.coo_array:
    """Read a printed matrix, or the half of a symmetric one, in the order of nodes with 3 or 6 unknowns each.

    Raises
    ------
    ValueError
        It has multipliers, other components or other nodes, or is of another form; the message says which.
    """
    head, _, rest = text.partition("VALEUR\n")
    body, found, tail = rest.partition(_EQUATIONS)
    for pattern, problem in _NEITHER.items():
        if re.search(pattern, head):
            raise ValueError(problem)
    size, terms = (re.search(rf"{of}\s*:\s*(\d+)", head) for of in (_HEAD, _TERMS))
    if not (size and found and body.strip()):
        raise ValueError(f"it isn't whole: its size, its entries and '{_EQUATIONS}' are wanted")
    n, equations = int(size[1]), [line.split() for line in tail.splitlines() if re.match(r"\s*\d+\s", line)]
    if multipliers := sum("LAGR" in line for line in tail.splitlines()):
        mend = "assemble without AFFE_CHAR_MECA's supports and relations, which links of the scene replace"
        raise ValueError(f"{multipliers} of its rows are Lagrange multipliers; {mend}")
    if [row[0] for row in equations] != [str(k) for k in range(1, n + 1)]:
        raise ValueError(f"its size is {n}, and {len(equations)} equations are described")
    own = {int(label): unknowns * k for k, label in enumerate(labels)}
    place = np.empty(n, dtype=np.int64)
    for k, (_, node, component, *_) in enumerate(equations):
        if component not in _COMPONENTS[:unknowns]:
            more = "; with rotations say matrices.unknowns = 6" if component in _COMPONENTS else ""
            raise ValueError(f"node {node} has {component}; {', '.join(_COMPONENTS[:unknowns])} are read{more}")
        number = re.fullmatch(r"N?(\d+)", node)
        if not number or int(number[1]) not in own:
            raise ValueError(f"it names node {node}, which isn't among the nodes by number")
        place[k] = own[int(number[1])] + _COMPONENTS.index(component)
    if len(np.unique(place)) < n:
        raise ValueError("it describes two equations of one node and component")
    if len(bare := np.setdiff1d(np.arange(len(labels)), place // unknowns)):
        more = f" and {len(bare) - 1} more" if len(bare) > 1 else ""
        raise ValueError(f"it has no equation of node {labels[bare[0]]}{more}; leave out of the nodes what isn't in it")
    body = re.sub(r"(?<=\d)([+-]\d{3})\b", r"E\1", body)  # Fortran leaves out the letter of an exponent of three digits
    table = np.loadtxt(StringIO(body), ndmin=2)
    if table.shape[1:] != (3,) or not ((table[:, :2] >= 1) & (table[:, :2] <= n)).all():
        raise ValueError(f"its entries aren't row, column and value of {n} equations")
    half = int(np.count_nonzero(table[:, 0] <= table[:, 1]))
    if terms and half != int(terms[1]):
        raise ValueError(f"it isn't whole: {half} of the {terms[1]} entries of its half are there")
    row, column = place[table[:, :2].T.astype(np.int64) - 1]
    return sp.coo_array((table[:, 2], (row, column)), shape=2 * (unknowns * len(labels),))
