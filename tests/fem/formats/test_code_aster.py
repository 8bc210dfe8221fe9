"""Matrices printed by Code_Aster, written here by the formats of its own source (matimp.F90, 2025)."""

import re
from pathlib import Path

import numpy as np
import pytest

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import InputError
from fmd.fem.formats.matrix_readers import read_matrix
from tests.fem.formats.test_six_unknowns import frame

COMPONENTS = ("DX", "DY", "DZ", "DRX", "DRY", "DRZ")


def printed(A: Array, nodes: IntArray, symmetric: bool = True, old: bool = False, **flags: str) -> str:
    """Print a matrix of unknowns of nodes in their order: upper entries alone, or each with its mirror image."""
    n, k = len(A), len(A) // len(nodes)
    head = {"MATRICE A COEEFICIENTS REELS": "T", "MATRICE SYMETRIQUE": "T" if symmetric else "F"}
    head |= {"MATRICE DISTRIBUEE": "F", "MATRICE HPC": "F"} | {
        key.replace("_", " "): each for key, each in flags.items()
    }
    rows = ["", " % " + 90 * "-", f" DIMENSION DE LA MATRICE : {n:11d}"]
    rows += [
        f" NOMBRE DE TERMES NON NULS (MATRICE SYMETRIQUE) :{np.count_nonzero(np.triu(A)):12d}",
        *(f" {key} : {v}" for key, v in head.items()),
    ]
    rows += [" ", f"{'ILIGL':>12}{'JCOLL':>12} {'VALEUR':>14}"]
    for j in range(n):
        for i in range(j + 1):
            if A[i, j]:
                rows.append(f"{i + 1:12d}{j + 1:12d} {A[i, j]:23.15E}")
                if not symmetric and i != j:
                    rows.append(f"{j + 1:12d}{i + 1:12d} {A[j, i]:23.15E}")
    rows += [" ", " DESCRIPTION DES EQUATIONS :", " ", "    NUM_EQUA NOEUD    CMP"]
    for row in range(n):
        name = ("N" if old else "") + str(nodes[row // k])
        rows.append(f"{row + 1:12d} {name:<8} {COMPONENTS[row % k]:<8}" + ("" if old else 10 * " "))
    return "\n".join([*rows, " % " + 90 * "-", ""])


@pytest.fixture
def given() -> tuple[Array, IntArray, IntArray]:
    """Stiffness of a frame of beams, numbers of its nodes, and the order in which they are printed."""
    return frame(n=6)[1], np.array([3, 17, 4, 90, 8, 11]), np.random.default_rng(1).permutation(6)


@pytest.mark.parametrize(("symmetric", "old"), [(True, False), (False, True)])
def test_a_printed_matrix_is_read_by_nodes_and_components(
    given: tuple[Array, IntArray, IntArray], symmetric: bool, old: bool, tmp_path: Path
) -> None:
    K, labels, order = given
    own = (6 * order[:, None] + np.arange(6)).ravel()
    path = tmp_path / "fort.81"
    text = printed(K[np.ix_(own, own)], labels[order], symmetric, old)
    tiny = re.sub(r"E-\d\d$", "-103", text, flags=re.MULTILINE)  # as Fortran writes 1e-103
    path.write_text(tiny)
    assert read_matrix(path, labels, 6, "stiffness").toarray() == pytest.approx(K, rel=1e-14, abs=1e-14 * abs(K).max())


def test_what_is_not_a_free_bodys_matrix_is_refused_by_name(
    given: tuple[Array, IntArray, IntArray], tmp_path: Path
) -> None:
    K, labels, _ = given
    text, path = printed(K, labels), tmp_path / "fort.81"
    last = f"{36:12d} 11       DRZ     "
    first, terms = re.search(r"\n +1 +1 .*", text)[0], np.count_nonzero(np.triu(K))  # type: ignore[index]
    assert last in text
    for changed, unknowns, message in (
        (text, 3, r"node 3 has DRX; DX, DY, DZ are read; with rotations say matrices\.unknowns = 6"),
        (text.replace(last, f"{36:12d} 11       DRZ      LAGR1 BLOCAGE"), 6, "1 of its rows are Lagrange multipliers"),
        (text.replace(last, last.replace("DRZ ", "TEMP")), 6, "node 11 has TEMP; DX, DY, DZ, DRX, DRY, DRZ are read"),
        (text.replace(last, last.replace("11", "12")), 6, "it names node 12, which isn't among the nodes"),
        (text.replace(last, last.replace("11 ", "TIP")), 6, "it names node TIP, which isn't among the nodes by number"),
        (text.replace(last, last.replace("DRZ", "DRX")), 6, "two equations of one node and component"),
        (text.replace(first, ""), 6, rf"it isn't whole: {terms - 1} of the {terms} entries of its half are there"),
        (text.replace(last, ""), 6, "its size is 36, and 35 equations are described"),
        (printed(K[6:, 6:], labels[1:]), 6, "it has no equation of node 3; leave out of the nodes"),
        (text.partition("DESCRIPTION")[0], 6, "it isn't whole"),
        (printed(K, labels, MATRICE_A_COEEFICIENTS_REELS="F"), 6, "its entries are complex"),
        (printed(K, labels, MATRICE_HPC="T"), 6, "it is distributed over processes"),
        (text.replace(f"{36:12d}{36:12d}", f"{36:12d}{37:12d}"), 6, "its entries aren't row, column and value of 36"),
    ):
        path.write_text(changed)
        with pytest.raises(InputError, match=message):
            read_matrix(path, labels, unknowns, "stiffness")
