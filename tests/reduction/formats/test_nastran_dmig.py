"""Nastran's direct matrix input: the cards field by field, and the matrices and frequencies from them."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh

from fmd.core.arrays import Array
from fmd.fem.markers import face_marker
from fmd.fem.model import FEModel
from fmd.reduction.craig_bampton import Superelement, make_superelement
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.formats.nastran_file import write_dmig


@pytest.fixture(scope="module")
def element(small_bar: FEModel) -> Superelement:
    faces = small_bar.discretisation.mesh.faces
    markers = {name: face_marker(small_bar.discretisation, faces[face]) for name, face in (("a", "x-"), ("Ü", "x+"))}
    return make_superelement(small_bar, FreeBodySolver(small_bar), markers, 3, lambda omega: np.full(len(omega), 0.01))


def fields(line: str) -> list[str]:
    """Return a line's fields: one of eight characters, then of sixteen where a star says so."""
    width = 16 if "*" in line[:8] else 8
    return [line[:8].strip(), *(line[k : k + width].strip() for k in range(8, len(line), width))]


def read_dmig(path: Path) -> tuple[dict[int, list[float]], dict[str, Array]]:
    """Return grid points and symmetric matrices, in the order of the points' numbers."""
    lines = [fields(line) for line in path.read_text().splitlines() if not line.startswith("$")]
    grid, scalars, entries = {}, [], {}
    for k, (card, *rest) in enumerate(lines):
        if card == "GRID*":
            grid[int(rest[0])] = [float(x.replace("D", "E")) for x in (*rest[2:4], lines[k + 1][1])]
        elif card == "SPOINT":
            scalars.append(int(rest[0]))
        elif card == "DMIG":
            assert rest[1:5] == ["0", "6", "2", "0"]  # symmetric, real of double precision
            entries[rest[0]] = []
        elif card == "DMIG*":
            name, column = rest[0], (int(rest[1]), int(rest[2]))
        elif card == "*" and len(rest) == 3:
            entries[name].append((column, (int(rest[0]), int(rest[1])), float(rest[2].replace("D", "E"))))
    unknowns = [(g, c) for g in sorted(grid) for c in range(1, 7)] + [(s, 0) for s in sorted(scalars)]
    place = {unknown: k for k, unknown in enumerate(unknowns)}
    matrices = {}
    for name, terms in entries.items():
        A = matrices[name] = np.zeros((len(unknowns), len(unknowns)))
        for column, row, value in terms:
            assert A[place[row], place[column]] == 0.0  # each pair once
            A[place[row], place[column]] = A[place[column], place[row]] = value
    return grid, matrices


def test_points_and_matrices_come_back_from_the_cards(element: Superelement, tmp_path: Path) -> None:
    write_dmig(tmp_path / "bar.pch", element)
    grid, matrices = read_dmig(tmp_path / "bar.pch")
    assert np.array([*grid.values()]) == pytest.approx(np.array([*element.origins.values()]), rel=1e-9, abs=1e-9)
    for name, own in (("KAAX", element.K), ("MAAX", element.M), ("BAAX", element.D)):
        assert np.abs(matrices[name] - own).max() < 1e-9 * np.abs(own).max()
    omega2 = eigh(matrices["KAAX"], matrices["MAAX"], eigvals_only=True)
    assert np.sqrt(omega2[6:]) / (2 * np.pi) == pytest.approx(element.frequencies_hz[6:], rel=1e-7)


def test_lines_are_ascii_of_at_most_72_characters_and_name_the_markers(element: Superelement, tmp_path: Path) -> None:
    write_dmig(tmp_path / "bar.pch", element)
    text = (tmp_path / "bar.pch").read_bytes().decode("ascii")
    assert max(map(len, text.splitlines())) <= 72
    assert re.findall(r"\$ \d: .*", text) == ["$ 1: a", "$ 2: ?"]
    assert "$ K2GG = KAAX, M2GG = MAAX, B2GG = BAAX" in text


def test_without_damping_there_is_no_damping_matrix(element: Superelement, tmp_path: Path) -> None:
    bare = Superelement(element.K, element.M, 0 * element.D, element.origins, element.omega, element.weight)
    write_dmig(tmp_path / "bar.pch", bare)
    assert set(read_dmig(tmp_path / "bar.pch")[1]) == {"KAAX", "MAAX"}


def test_pynastran_reads_the_same_matrices(element: Superelement, tmp_path: Path) -> None:
    bdf = pytest.importorskip("pyNastran.bdf.bdf", reason="pyNastran isn't installed")
    write_dmig(tmp_path / "bar.pch", element)
    model = bdf.read_bdf(str(tmp_path / "bar.pch"), punch=True, xref=False, debug=False)
    assert (len(model.nodes), len(model.spoints)) == (2, 3)
    for name, own in (("KAAX", element.K), ("MAAX", element.M)):
        matrix, rows, columns = model.dmig[name].get_matrix(is_sparse=False, apply_symmetry=True)
        order = [row for _, row in sorted((unknown, row) for row, unknown in rows.items())]
        across = [column for _, column in sorted((unknown, column) for column, unknown in columns.items())]
        assert np.abs(matrix[np.ix_(order, across)] - own).max() < 1e-9 * np.abs(own).max()
