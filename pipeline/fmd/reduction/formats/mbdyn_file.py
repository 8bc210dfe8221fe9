"""Modal data for MBDyn's ``modal`` joint: ``.fem`` files, text in numbered record groups.

MBDyn computes the inertia invariants of the deforming body from point masses (record group 11). A mesh's consistent
mass is no set of points; but 2 r points that stand about the mean of positions and shapes as far as these vary, r the
rank of their products, have all of a body's first and second integrals exactly. They follow the markers in the list of
nodes, and bear no joints.

Format: MBDyn's input manual, appendix "Modal Element Data".
"""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from fmd.core.arrays import EPSILON, Array
from fmd.core.errors import InputError
from fmd.core.files import read_text, write_text
from fmd.core.fortran import read_real
from fmd.core.limits.files import MOST_NUMBERS, SAME_MASS
from fmd.core.limits.rank import INDEPENDENT_FUNCTIONS
from fmd.reduction.body import MarkerShapes
from fmd.reduction.formats.body_format import BodyFormat
from fmd.reduction.inertia import InertiaIntegrals
from fmd.reduction.modal_data import ModalData, function_products, without_stiffening

_GROUP = re.compile(r"\*\*\s*RECORD GROUP\s*(\d+)")
_NAMES = {
    3: "INITIAL MODAL DISPLACEMENTS", 4: "INITIAL MODAL VELOCITIES", 5: "NODAL X COORDINATES", 6: "NODAL Y COORDINATES",
    7: "NODAL Z COORDINATES", 9: "MODAL MASS MATRIX", 10: "MODAL STIFFNESS MATRIX",
    11: "DIAGONAL OF LUMPED MASS MATRIX", 12: "GLOBAL INERTIA PROPERTIES", 13: "MODAL DAMPING MATRIX",
}  # fmt: skip

_Line = tuple[int, list[str]]  # number and items of a line of text


def write_mbdyn(path: Path, data: ModalData) -> None:
    """Write a body's modal data; the file appears whole or not at all."""
    write_text(path, "\n".join(_lines(data)) + "\n")


def inertia_points(data: ModalData) -> tuple[float, Array, Array]:
    """Point masses with all first and second integrals of a body's positions and shapes.

    Returns the mass of each point, their positions (n_points, 3) and shapes (n_points, 3, n).
    """
    products = function_products(data)
    mass = products[0, 0]
    mean = products[0, 1:] / mass
    size = np.sqrt(np.maximum(products.diagonal()[1:] / mass, np.finfo(float).tiny))
    covariance = (products[1:, 1:] / mass - np.outer(mean, mean)) / np.outer(size, size)
    values, vectors = np.linalg.eigh(covariance)
    kept = values > INDEPENDENT_FUNCTIONS * values[-1]
    spread = (vectors[:, kept] * np.sqrt(values[kept] * kept.sum())).T * size
    points = np.concatenate([mean + spread, mean - spread])
    n = data.n
    return mass / len(points), points[:, :3], points[:, 3:].reshape(-1, n, 3).transpose(0, 2, 1)


def _lines(data: ModalData) -> Iterator[str]:
    mass, x, shapes = inertia_points(data)
    nodes = list(data.nodes.values())
    n, n_nodes = data.n, len(nodes) + len(x)
    labels = [re.sub(r"\s+", "-", name) for name in data.nodes] + [f"mass-{k}" for k in range(1, len(x) + 1)]
    yield "** MBDyn MODAL DATA FILE; SI units"
    yield f"** nodes: {len(nodes)} markers, then {len(x)} point masses that carry the inertia alone"
    yield "** RECORD GROUP 1, HEADER"
    yield "**   REVISION,  NODE,  NORMAL, ATTACHMENT, CONSTRAINT, REJECTED MODES."
    yield f"      REV0  {n_nodes}  {n}  0  0  0"
    yield "**"
    yield "** RECORD GROUP 2, FINITE ELEMENT NODE LIST"
    yield from (" ".join(labels[k : k + 6]) for k in range(0, len(labels), 6))
    yield "**"
    places = np.concatenate([np.reshape([node.position for node in nodes], (-1, 3)), x])
    moves = np.concatenate([np.reshape([node.translation for node in nodes], (-1, 3, n)), shapes])
    turns = np.concatenate([np.reshape([node.rotation for node in nodes], (-1, 3, n)), np.zeros_like(shapes)])
    zeros = np.zeros((1, n))
    for group, rows in ((3, zeros), (4, zeros), *((5 + a, places[:, a : a + 1]) for a in range(3))):
        yield from _group(group, rows)
    yield "** RECORD GROUP 8, MODE SHAPES"
    for k in range(n):
        yield f"**    NORMAL MODE SHAPE #  {k + 1}"
        yield from map(_row, np.concatenate([moves[:, :, k], turns[:, :, k]], axis=1))
    yield "**"
    yield from _group(9, data.M)
    yield from _group(10, data.K)
    lumped = np.zeros((n_nodes, 6))
    lumped[len(nodes) :, :3] = mass
    yield from _group(11, lumped)
    c = data.integrals.S[:, 0] / data.integrals.mass
    P = data.integrals.G[:, :, 0, 0] - data.integrals.mass * np.outer(c, c)
    yield "** RECORD GROUP 12, GLOBAL INERTIA PROPERTIES"
    yield f" {data.integrals.mass:.16e}"
    yield from map(_row, [c, *(np.trace(P) * np.eye(3) - P)])
    yield "**"
    if data.D.any():
        yield from _group(13, data.D)
    yield "** END OF FILE"


def _group(number: int, rows: Array) -> Iterator[str]:
    yield f"** RECORD GROUP {number}, {_NAMES[number]}"
    yield from map(_row, rows)
    yield "**"


def _row(values: Array) -> str:
    return " ".join(f"{value: .16e}" for value in values)


def read_mbdyn(path: Path) -> ModalData:
    """Read a body's modal data.

    Raises
    ------
    InputError
        The file can't be read, is cut off or damaged; the message names the record group and its line.
    """
    return _Records(str(path), read_text(path)).data()


class _Records:
    """The record groups of a file: the lines of each that are no comments."""

    def __init__(self, file: str, text: str) -> None:
        self._file = file
        self._lines: dict[int, list[_Line]] = {}
        self._places: dict[int, int] = {}
        group = 0
        for number, line in enumerate(text.splitlines(), start=1):
            if (found := _GROUP.match(line.strip())) is not None:
                group = int(found[1])
                if group in self._places:
                    raise self.fault(number, f"record group {group} stands twice")
                self._lines[group], self._places[group] = [], number
            elif group and line.strip() and not line.lstrip().startswith("**"):
                self._lines[group].append((number, line.split()))
        if 1 not in self._lines:
            raise InputError(file, "", None, "no modal data of MBDyn: it has no '** RECORD GROUP 1'")

    def fault(self, line: int, mend: str) -> InputError:
        """Return the error of a line."""
        return InputError(self._file, f"line {line}", None, mend)

    def numbers(self, group: int, shape: tuple[int, ...]) -> Array:
        """Return a record group's numbers, as many as a shape needs; mode shapes may be headed by text."""
        if group not in self._lines:
            raise InputError(self._file, "", None, f"has no record group {group}")
        values: list[float] = []
        for number, items in self._lines[group]:
            try:
                row = [read_real(item) for item in items]
            except ValueError:
                if group == 8:  # the one comment line before each mode may be any text
                    continue
                raise self.fault(number, f"'{' '.join(items)[:40]}' isn't a row of numbers") from None
            values += row
        wanted = int(np.prod(shape))
        if len(values) != wanted:
            place = self._places[group]
            raise self.fault(place, f"record group {group} has {len(values)} numbers, and {wanted} are expected")
        array = np.array(values)
        if not np.isfinite(array).all():
            raise self.fault(self._places[group], f"record group {group} holds a number that isn't finite")
        return array.reshape(shape)

    def optional(self, group: int, shape: tuple[int, ...]) -> Array:
        """Return a record group's numbers, or zeros if it isn't there."""
        return self.numbers(group, shape) if group in self._lines else np.zeros(shape)

    def data(self) -> ModalData:
        """Return the body that the records describe."""
        head = [item for _, items in self._lines[1] for item in items]
        if len(head) < 6 or not all(item.isdigit() for item in head[-5:]):
            raise self.fault(self._places[1], "record group 1 isn't a revision and five counts, of nodes and of modes")
        n_nodes, normal, attached, constraint, rejected = map(int, head[-5:])
        n = normal + attached + constraint - rejected
        if n <= 0 or n_nodes <= 0 or n_nodes * n > MOST_NUMBERS:
            raise self.fault(self._places[1], f"has {n_nodes} nodes and {n} modes")
        labels = [item for _, items in self._lines.get(2, []) for item in items]
        if len(labels) != n_nodes or len(set(labels)) != n_nodes:
            raise self.fault(self._places.get(2, self._places[1]), f"{n_nodes} labels expected, not {len(set(labels))}")
        x = np.column_stack([self.numbers(group, (n_nodes,)) for group in (5, 6, 7)])
        shapes = self.numbers(8, (n, n_nodes, 6)).transpose(1, 2, 0)
        M, K, D = self.numbers(9, (n, n)), self.numbers(10, (n, n)), self.optional(13, (n, n))
        nodes = {label: MarkerShapes(x[k], shapes[k, :3], shapes[k, 3:]) for k, label in enumerate(labels)}
        integrals, notes = self._integrals(nodes, M)
        return ModalData(integrals, K, D, nodes, notes)

    def _integrals(self, nodes: Mapping[str, MarkerShapes], M: Array) -> tuple[InertiaIntegrals, tuple[str, ...]]:
        """Sum inertia over the nodes, with the rigid body's own where the file gives it."""
        n, notes = len(M), []
        if 11 not in self._lines and 12 not in self._lines:
            mend = "has neither record group 11 nor 12: without inertia the body can't move; write one of them"
            raise InputError(self._file, "", None, mend)
        G, S, mass = _sum_points(list(nodes.values()), self.optional(11, (len(nodes), 6)), n)
        if 12 in self._lines:
            own = self.numbers(12, (13,))
            mass, c, J = float(own[0]), own[1:4], own[4:].reshape(3, 3)
            S[:, 0] = mass * c
            G[:, :, 0, 0] = 0.5 * np.trace(J) * np.eye(3) - J + mass * np.outer(c, c)
        if not mass > 0:
            raise self.fault(self._places.get(12, self._places.get(11, 1)), f"the body's mass is {mass:g} kg")
        loss = M - np.einsum("aaij->ij", G)[1:, 1:]
        if 11 not in self._lines:
            notes.append("no record group 11: the inertia of the deformation isn't coupled with the frame's motion")
        elif np.abs(loss).max() > SAME_MASS * np.abs(M).max():
            apart = np.abs(loss).max() / np.abs(M).max()
            notes.append(f"the lumped masses give another modal mass than record group 9, by {apart:.1e} of it")
        return InertiaIntegrals(G, S, mass, stiffening=np.eye(3)[:, :, None, None] * loss / 3), tuple(notes)


def _sum_points(nodes: list[MarkerShapes], lumped: Array, n: int) -> tuple[Array, Array, float]:
    """Integrals of bodies at the nodes, each with its mass and its moments of inertia."""
    G, S = np.zeros((3, 3, 1 + n, 1 + n)), np.zeros((3, 1 + n))
    for node, inertia in zip(nodes, lumped, strict=True):
        U = np.column_stack([node.position, node.translation])
        S += inertia[0] * U
        G += inertia[0] * np.einsum("ai,bj->abij", U, U)
        spread = 0.5 * inertia[3:].sum() - inertia[3:]  # second moments of the mass about the node
        arms = np.concatenate([np.eye(3)[:, :, None], np.einsum("abc,bj->acj", EPSILON, node.rotation)], axis=2)
        G += np.einsum("aci,c,bcj->abij", arms, spread, arms)
    return G, S, float(lumped[:, 0].sum())


FORMAT = BodyFormat(
    lambda body, path: write_mbdyn(path, without_stiffening(body.modal_data(stiffened=False))),
    read_mbdyn,
    second_order=False,
)
