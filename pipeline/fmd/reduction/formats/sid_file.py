"""Files of standard input data, ``.SID_FEM``: text of nested blocks, written in one dialect and read in both.

The dialect of Simpack's and Modelica's files opens its nodes by ``frame``, numbers first orders (row, mode, column) and
begins with a line of counts. The other opens them by ``new frame``, has no such line, and numbers them (row, column,
mode). Numbers have 17 digits, so a body comes back to the last bit.
"""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from fmd.core.arrays import EPSILON, Array
from fmd.core.errors import InputError, as_input_error
from fmd.core.files import read_text, write_text
from fmd.core.fortran import read_real
from fmd.core.limits.files import MOST_ENTRIES
from fmd.reduction.body import MarkerShapes
from fmd.reduction.formats.body_format import BodyFormat
from fmd.reduction.formats.sid_terms import PARTS, Taylor, modal_data_of, sid_terms
from fmd.reduction.modal_data import ModalData

_ENTRY = re.compile(r"m([01])\s*\(\s*(\d+)\s*,\s*(\d+)\s*(?:,\s*(\d+)\s*)?\)$")
_OF_NODES = ("origin", "phi", "psi", "AP", "sigma")
_ZERO, _DIAGONAL, _SYMMETRIC, _FULL, _UNIT = range(5)


def write_sid(path: Path, data: ModalData) -> None:
    """Write a body's standard input data; the file appears whole or not at all.

    Nodes are numbered from 1 in their order; their labels stand in the first line's text.
    """
    write_text(path, "\n".join(_lines(data)) + "\n")


def _lines(data: ModalData) -> Iterator[str]:
    labels = ", ".join(f"{k} {name}" for k, name in enumerate(data.nodes, start=1))
    yield f"{len(data.nodes):5d}{data.n:5d}    :No. nodes, No. modes; SI units; nodes: {labels}"
    yield "part"
    yield "  new modal ="
    yield "    refmod"
    yield f"      mass = {_number(data.integrals.mass)}"
    yield f"      nelastq = {data.n}"
    hertz = np.sqrt(np.sort(np.abs(np.linalg.eigvals(np.linalg.solve(data.M, data.K)).real))) / (2 * np.pi)
    for k, frequency in enumerate(hertz, start=1):
        yield f"      ielastq ({k:4d}) = Eigen Mode {k:4d} : {frequency:12.3f} Hz"
    yield "    end refmod"
    yield "    frame"
    for number, node in enumerate(data.nodes.values(), start=1):
        yield f"      new node = {number}"
        yield "        rframe = body ref"
        for name, term in _node_terms(node).items():
            yield from _term_lines(name, term, data.n, "        ")
        yield "      end node"
    yield "    end frame"
    for name, term in sid_terms(data).items():
        vector = Taylor(_as_vector(term.M0), _as_vector(term.M1)) if name == "J" else term
        yield from _term_lines(name, vector, data.n, "    ")
    yield "  end modal"
    yield "end part"


def _as_vector(J: Array) -> Array:
    """Components xx, yy, zz, xy, xz, yz of a tensor along its first and last axis, as rows."""
    return np.stack([J[a, ..., b] for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))])[..., None]


def _node_terms(node: MarkerShapes) -> dict[str, Taylor]:
    """Terms of a node: place, shapes, rotations, and the axes that turn with them."""
    displacement2 = node.displacement2 if node.displacement2.size else np.zeros((6, 0, 0))
    turned = np.einsum("acb,ck->akb", EPSILON, -node.rotation)  # the matrix of a rotation's cross product
    return {
        "origin": Taylor(node.position[:, None], node.translation[:, :, None]),
        "phi": Taylor(node.translation, displacement2[:3].transpose(0, 2, 1)),
        "psi": Taylor(node.rotation, displacement2[3:].transpose(0, 2, 1)),
        "AP": Taylor(np.eye(3), turned),
    }


def _term_lines(name: str, term: Taylor, n: int, indent: str) -> Iterator[str]:
    rows, columns = term.M0.shape
    yield f"{indent}{name}"
    head = (term.order, rows, columns, n, 0, _FULL if term.M0.any() or term.M1.any() else _ZERO)
    for key, value in zip(("order", "nrow", "ncol", "nq", "nqn", "structure"), head, strict=True):
        yield f"{indent}  {key} = {value}"
    for i, j in np.argwhere(term.M0):
        yield f"{indent}  m0({i + 1:4d},{j + 1:4d}) = {_number(term.M0[i, j])}"
    if term.order:
        for i, k, j in np.argwhere(term.M1):
            yield f"{indent}  m1({i + 1:4d},{k + 1:4d},{j + 1:4d}) = {_number(term.M1[i, k, j])}"
    yield f"{indent}end {name}"


def _number(value: float) -> str:
    return f"{value: .16E}".replace("E", "D")


def read_sid(path: Path) -> ModalData:
    """Read a body's standard input data, in either dialect.

    Raises
    ------
    InputError
        The file can't be read, is cut off or damaged, or its terms contradict one another; the message names the line.
    """
    reader = _Reader(str(path), read_text(path))
    mass, terms, nodes = reader.read_part()
    n = terms["Ke"].M0.shape[0]
    for name, term in terms.items():
        reader.require_shape(name, term, n)
    with as_input_error(str(path)):
        return modal_data_of(mass, terms, nodes)


class _Reader:
    """The lines of a file that hold something, taken one after another."""

    def __init__(self, file: str, text: str) -> None:
        self._file = file
        lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), start=1)]
        self._lines = [(number, line) for number, line in lines if line]
        self._next, self._by_columns = 0, False

    def fault(self, mend: str) -> InputError:
        """Return the error of the line that was read last."""
        number = self._lines[min(self._next, len(self._lines)) - 1][0] if self._lines else 1
        return InputError(self._file, f"line {number}", None, mend)

    def read_part(self) -> tuple[float, dict[str, Taylor], dict[str, MarkerShapes]]:
        """Read the whole file: mass, terms of the body, nodes."""
        if not self._lines or not any(line.split("=")[0].strip() == "new modal" for _, line in self._lines[:5]):
            raise self.fault("no standard input data (SID): 'part' and 'new modal' should stand in its first lines")
        while self._take()[0] != "new modal":
            pass
        mass, terms, nodes = np.nan, {}, {}
        while (item := self._take())[0] != "end modal":
            name = item[0]
            if name == "refmod":
                mass = self._read_reference()
            elif name in ("frame", "new frame"):
                self._by_columns = name == "new frame"
                nodes = self._read_nodes()
            elif name in PARTS:
                terms[name] = self._read_term(name)
            else:
                raise self.fault(f"'{name}' is no term of SID; these are {', '.join(PARTS)}")
        missing = [name for name in PARTS if name not in terms]
        if missing == ["ksigma"]:
            terms["ksigma"] = Taylor(np.zeros((terms["Ke"].M0.shape[0], 1)))
        elif missing:
            raise self.fault(f"the body has no {' and no '.join(missing)}")
        if not mass > 0:
            raise self.fault("the body has no mass; 'mass = …' belongs between 'refmod' and 'end refmod'")
        return float(mass), terms, nodes

    def _read_reference(self) -> float:
        mass = np.nan
        while (item := self._take())[0] != "end refmod":
            if item[0] == "mass":
                mass = self._real(item[1])
        return float(mass)

    def _read_nodes(self) -> dict[str, MarkerShapes]:
        nodes: dict[str, MarkerShapes] = {}
        while (item := self._take())[0] not in ("end frame", "end new frame"):
            if item[0] != "new node":
                raise self.fault(f"'new node = …' or 'end frame' expected, not '{item[0]}'")
            label, own = item[1], {}
            while (item := self._take())[0] != "end node":
                if item[0] == "rframe":
                    if item[1] not in ("body ref", "ref", ""):
                        raise self.fault(f"nodes are read relative to 'body ref', not to '{item[1]}'")
                elif item[0] in _OF_NODES:
                    own[item[0]] = self._read_term(item[0])
                else:
                    raise self.fault(f"'{item[0]}' is nothing of a node; these are {', '.join(_OF_NODES)}")
            if label in nodes:
                raise self.fault(f"there are two nodes {label}")
            nodes[label] = self._node(label, own)
        return nodes

    def _node(self, label: str, own: Mapping[str, Taylor]) -> MarkerShapes:
        for name in ("origin", "phi"):
            if name not in own:
                raise self.fault(f"node {label} has no {name}")
        phi, n = own["phi"], own["phi"].M0.shape[1]
        psi = own.get("psi", Taylor(np.full((3, n), np.nan)))
        for name, shape in (("origin", (3, 1)), ("phi", (3, n)), ("psi", (3, n))):
            if name in own and own[name].M0.shape != shape:
                raise self.fault(f"node {label}: {name} has {own[name].M0.shape}, expected {shape} rows and columns")
        displacement2 = np.zeros((6, 0, 0))
        if phi.M1.any() or psi.M1.any():
            nothing = np.zeros((3, n, n))
            displacement2 = np.concatenate(
                [term.M1.transpose(0, 2, 1) if term.order else nothing for term in (phi, psi)]
            )
        return MarkerShapes(own["origin"].M0[:, 0], phi.M0, psi.M0, displacement2)

    def _read_term(self, name: str) -> Taylor:
        size: dict[str, int] = {}
        keys = ("order", "nrow", "ncol", "nq", "nqn", "structure")
        while len(size) < len(keys):
            key, value = self._take()
            if key not in keys:
                lacking = [key for key in keys if key not in size]
                raise self.fault(f"{name} lacks {lacking[0]}: '{key}' comes instead")
            size[key] = self._whole(value)
        order, rows, columns, n, structure = (size[key] for key in ("order", "nrow", "ncol", "nq", "structure"))
        if order > 1 or size["nqn"]:
            raise self.fault(f"{name} is of order {order}; terms to first order are read")
        if structure > _UNIT or rows * columns * max(n, 1) > MOST_ENTRIES:
            raise self.fault(f"{name} has structure {structure} and {rows} x {n} x {columns} entries")
        M0 = np.eye(rows, columns) if structure == _UNIT else np.zeros((rows, columns))
        M1 = np.zeros((rows, n, columns) if order else (rows, 0, columns))
        while (item := self._take())[0] != f"end {name}":
            found = _ENTRY.match(item[0])
            if found is None:
                raise self.fault(f"'m0(…) = …' or 'end {name}' expected, not '{item[0]}'")
            self._enter(name, M0, M1, [int(group) for group in found.groups() if group], self._real(item[1]))
            if structure == _SYMMETRIC:
                self._enter(name, M0, M1, self._mirrored([int(g) for g in found.groups() if g]), self._real(item[1]))
        return Taylor(M0, M1)

    def _mirrored(self, entry: list[int]) -> list[int]:
        if len(entry) == 3:
            return [entry[0], entry[2], entry[1]]
        order, i, j, k = entry
        return [order, j, i, k] if self._by_columns else [order, k, j, i]

    def _enter(self, name: str, M0: Array, M1: Array, entry: list[int], value: float) -> None:
        order, *place = entry
        if len(place) != 2 + order:
            raise self.fault(f"an entry of order {order} has {2 + order} numbers, not {len(place)}")
        if order and self._by_columns:
            place = [place[0], place[2], place[1]]
        term = M1 if order else M0
        if any(not 1 <= k <= most for k, most in zip(place, term.shape, strict=True)):
            raise self.fault(f"{name} has {' x '.join(map(str, term.shape))} entries of order {order}, none there")
        term[tuple(k - 1 for k in place)] = value

    def require_shape(self, name: str, term: Taylor, n: int) -> None:
        """Raise ``InputError`` unless a term of the body has as many rows and columns as n modes need."""
        shapes = {"mdCM": [(3, 1)], "J": [(3, 3), (6, 1)], "Gr": [(3, 3 * n)], "Ge": [(n, 3 * n)], "Oe": [(n, 6)]}
        shapes |= {"Ct": [(n, 3)], "Cr": [(n, 3)], "ksigma": [(n, 1)]}
        wanted = shapes.get(name, [(n, n)])
        if term.M0.shape not in wanted or (term.order and term.M1.shape[1] != n):
            found = f"{term.M0.shape[0]} x {term.M0.shape[1]} entries for {term.M1.shape[1]} modes"
            mend = f"{name} has {found}; {n} modes need {' or '.join(f'{r} x {c}' for r, c in wanted)}"
            raise InputError(self._file, "", None, mend)

    def _take(self) -> tuple[str, str]:
        """Take the next line: what stands before '=' and after it."""
        if self._next >= len(self._lines):
            raise self.fault("the file ends here, before 'end part'; it is cut off")
        line = self._lines[self._next][1]
        self._next += 1
        name, _, value = line.partition("=")
        return " ".join(name.split()), value.strip()

    def _real(self, text: str) -> float:
        try:
            value = read_real(text)
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise self.fault(f"'{text}' is no finite number")
        return value

    def _whole(self, text: str) -> int:
        if not text.isdigit():
            raise self.fault(f"'{text}' is no whole number")
        return int(text)


FORMAT = BodyFormat(lambda body, path: write_sid(path, body.modal_data(body.stiffened)), read_sid)
