"""Displacements and stress that another finite element program has computed at a body's nodes, from its files."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass

CSV_HEADER = ("case", "node", "ux", "uy", "uz", "sxx", "syy", "szz", "syz", "sxz", "sxy")
_FRD_COMPONENTS = {"DISP": ("D1", "D2", "D3"), "STRESS": ("SXX", "SYY", "SZZ", "SYZ", "SZX", "SXY")}


@dataclass(frozen=True)
class ProgramFields:
    """Displacements with their stress, a case each, in the units of their file."""

    labels: IntArray  # (n,): numbers of the nodes, ascending
    displacement: Array  # (n, 3, k): displacement of each case
    stress: Array  # (n, 6, k): xx, yy, zz, yz, xz, xy


def read_frd(text: str) -> ProgramFields:
    """Read displacements and stress of all steps of CalculiX's results, ``.frd`` in text, of its long format.

    Raises
    ------
    ValueError
        A step has stress without displacement or for other nodes, or a line isn't read; with its number.
    """
    u, sigma = list[tuple[IntArray, Array]](), list[tuple[IntArray, Array]]()
    for name, labels, values in _frd_blocks(text):
        if name == "DISP":
            u.append((labels, values))
        else:
            if len(sigma) >= len(u):
                raise ValueError(f"stress number {len(sigma) + 1} has no displacement before it; *NODE FILE with U")
            sigma.append((labels, values))
            u = u[: len(sigma) - 1] + u[-1:]  # of displacements without stress none is kept
    return _gather(u[: len(sigma)], sigma)


def read_csv_fields(text: str) -> ProgramFields:
    """Read rows of case, node, three displacements and six stresses, with a header that names them.

    Raises
    ------
    ValueError
        The header has other names, a row isn't of eleven numbers, a case or a node isn't a whole one, or cases have
        other nodes.
    """
    head, *lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")] or [""]
    if tuple(item.strip().lower() for item in head.split(",")) != CSV_HEADER:
        raise ValueError(f"its header must be {','.join(CSV_HEADER)}")
    try:
        table = np.array([line.split(",") for line in lines], dtype=float).reshape(-1, len(CSV_HEADER))
    except ValueError:
        raise ValueError(f"rows are of {len(CSV_HEADER)} numbers") from None
    if (table[:, :2] % 1 != 0).any():  # of NaN, too
        raise ValueError("numbers of cases and nodes must be whole")
    cases = [table[table[:, 0] == case] for case in dict.fromkeys(table[:, 0].tolist())]
    labels = [rows[:, 1].astype(np.int64) for rows in cases]
    return _gather(
        [(own, rows[:, 2:5]) for own, rows in zip(labels, cases, strict=True)],
        [(own, rows[:, 5:]) for own, rows in zip(labels, cases, strict=True)],
    )


def read_point_stress(text: str) -> list[list[str]]:
    """Read the stress at the points of integration of each step of CalculiX's ``.dat``, as lines of initial stress.

    They are ``element,point,xx,yy,zz,xy,xz,yz`` as `*INITIAL CONDITIONS` takes them.
    """
    steps, time = list[list[str]](), ""
    for line in text.splitlines():
        items = line.split()
        if line.lstrip().startswith("stresses (elem"):
            if items[-1] != time:  # sets of elements follow each other at one time
                steps.append([])
            time = items[-1]
        elif steps and len(items) == 8:
            steps[-1].append(",".join(items))
    return steps


def _gather(u: list[tuple[IntArray, Array]], sigma: list[tuple[IntArray, Array]]) -> ProgramFields:
    """Return fields of all cases at the nodes that the first has stress at."""
    if not sigma:
        raise ValueError("holds no displacements with stress; CalculiX writes them by *NODE FILE, U and *EL FILE, S")
    labels = np.unique(sigma[0][0])
    fields = []
    for number, each in enumerate(zip(u, sigma, strict=True), start=1):
        rows = []
        for own, values in each:
            order = np.argsort(own)
            place = np.searchsorted(own[order], labels)
            found = own[order][np.minimum(place, len(own) - 1)]
            if not np.array_equal(found, labels):
                raise ValueError(f"case {number} isn't for the nodes of the first one")
            if (again := own[order][:-1][np.diff(own[order]) == 0]).size:
                raise ValueError(f"case {number} has node {again[0]} more than once")
            rows.append(values[order][place])
        fields.append(np.concatenate(rows, axis=1))
    both = np.stack(fields, axis=2)
    if not np.isfinite(both).all():
        raise ValueError("some of its displacements or stresses aren't finite numbers")
    return ProgramFields(labels, both[:, :3], both[:, 3:])


def _frd_blocks(text: str) -> Iterator[tuple[str, IntArray, Array]]:
    """Yield name, nodes and values of each block of displacements or stress, its components in the order above."""
    name, components, rows = "", list[str](), list[str]()
    for number, line in enumerate(text.splitlines(), start=1):
        key = line[:3]
        if line.startswith("  100C"):
            if not line.rstrip().endswith("1"):
                raise ValueError(f"line {number}: its format isn't the long one of text, as *NODE FILE writes it")
            name, components, rows = "?", [], []
        elif key == " -4" and name:
            name = line[5:13].strip()
            name = name if name in _FRD_COMPONENTS else ""
        elif key == " -5" and name:
            components.append(line[5:13].strip())
        elif key == " -1" and name:
            rows.append(line)
        elif key == " -3" and name:
            wanted, given = _FRD_COMPONENTS[name], [component for component in components if component != "ALL"]
            if sorted(given) != sorted(wanted) or not rows:
                what = f"{name} at {len(rows)} nodes has {', '.join(given)}"
                raise ValueError(f"line {number}: {what}; {', '.join(wanted)} are read, at one node at least")
            ends = range(13, 14 + 12 * len(given), 12)  # of the node's number, and of each value
            try:
                values = np.array([[float(row[a:b]) for a, b in pairwise(ends)] for row in rows])
                labels = np.array([int(row[3:13]) for row in rows])
            except ValueError:
                raise ValueError(f"the results before line {number} aren't read as numbers") from None
            yield name, labels, values[:, [given.index(component) for component in wanted]]
            name = ""
