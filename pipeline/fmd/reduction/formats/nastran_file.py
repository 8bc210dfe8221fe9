"""Superelements of Nastran: a punch file of direct matrix input (DMIG) at grid points.

Each marker of the interface is a grid point, each fixed-interface mode a scalar point. Numbers stand in fields of
sixteen characters, which hold ten digits. Cards: ``DMIG``, ``GRID``, ``SPOINT`` of MSC Nastran's Quick Reference Guide.
"""

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.files import whole_file
from fmd.core.limits.files import MOST_UNKNOWNS
from fmd.fem.formats.nastran_matrices import read_dmig, read_op4
from fmd.fem.formats.nastran_op2 import read_op2
from fmd.fem.formats.node_places import Places, nastran_places, read_matrix_text
from fmd.fem.formats.raw_mesh import MeshFileError
from fmd.reduction.craig_bampton import Superelement
from fmd.reduction.formats.body_format import BodyFormat
from fmd.reduction.given_superelement import GivenSuperelement

_Unknown = tuple[int, int]  # number of the point, and its component: 1 to 6, of a scalar point 0


def write_dmig(path: Path, element: Superelement) -> None:
    """Write grid points, scalar points and the matrices ``KAAX``, ``MAAX`` and, if there is damping, ``BAAX``.

    Grid points are numbered from 1 in the order of the markers, scalar points go on after them.
    """
    with whole_file(path) as part:
        part.write_text("\n".join(_lines(element)) + "\n", encoding="ascii", errors="replace")


def _lines(element: Superelement) -> Iterator[str]:
    k, n = len(element.origins), len(element.omega)
    matrices = {"K": element.K, "M": element.M} | ({"B": element.D} if element.D.any() else {})
    yield "$ Superelement in kg, N and m. In the case control:"
    yield "$ " + ", ".join(f"{letter}2GG = {letter}AAX" for letter in matrices)
    for number, (name, place) in enumerate(element.origins.items(), start=1):
        x, y, z = map(_real, place)
        yield f"$ {number}: {name}"
        yield f"GRID*   {number:16}{'':16}{x}{y}"
        yield f"*       {z}"
    for number in range(k + 1, k + n + 1):
        yield f"SPOINT  {number:8}"
    unknowns = [(point, c) for point in range(1, k + 1) for c in range(1, 7)]
    unknowns += [(point, 0) for point in range(k + 1, k + n + 1)]
    for letter, A in matrices.items():
        yield f"DMIG    {letter + 'AAX':8}{0:8}{6:8}{2:8}{0:8}"
        yield from _columns(f"{letter}AAX", (A + A.T) / 2, unknowns)


def _columns(name: str, A: Array, unknowns: list[_Unknown]) -> Iterator[str]:
    """Yield the lower half of a symmetric matrix column by column, without its zeros."""
    for j, (point, component) in enumerate(unknowns):
        rows = j + np.flatnonzero(A[j:, j])
        if len(rows):
            yield f"DMIG*   {name:16}{point:16}{component:16}"
        for i in rows:
            yield f"*       {unknowns[i][0]:16}{unknowns[i][1]:16}{_real(A[i, j])}"


def _real(value: float) -> str:
    return f"{value:16.9E}".replace("E", "D")


def read_external(path: Path) -> GivenSuperelement:
    """Read an external superelement: stiffness K…, mass M… and, if it is there, viscous damping B….

    They are DMIG cards as ``EXTSEOUT(DMIGPCH)`` writes them, ``KAAX``, ``MAAX`` and ``BAAX``; or ``KAA``, ``MAA`` and
    ``BAA`` of OUTPUT4 or OUTPUT2, whose unknowns, none here, a file of nodes lists by EXTRN. Structural damping,
    ``K4…``, is left out.

    Raises
    ------
    InputError
        A card is damaged, a matrix is missing, or they are larger than dense ones may be.
    """
    try:
        if path.suffix.lower() == ".pch":
            text = read_matrix_text(path)
            unknowns, found = _matrices_of_cards(read_dmig(text))
            given = nastran_places(text)
        else:
            read = read_op4 if path.suffix.lower() == ".op4" else read_op2
            unknowns, found, given = (), read(path), Places({})
        stiffness, mass = _stiffness_and_mass(found)
        shape = found[stiffness].shape
        if shape != found[mass].shape or shape[0] != shape[1]:
            raise ValueError(f"{stiffness} has {shape} rows and columns, and {mass} {found[mass].shape}")
        _require_reduced(stiffness, shape[0])
        K, M = found[stiffness].toarray(), found[mass].toarray()
        damping = [A.toarray() for name, A in found.items() if name.startswith("B") and A.shape == shape]
    except (ValueError, MeshFileError) as error:
        raise InputError(str(path), "", None, f"can't be read as a superelement: {error}") from None
    return GivenSuperelement(unknowns, K, M, damping[0] if damping else 0 * K, given.places, given.axes)


def _stiffness_and_mass(found: Collection[str]) -> list[str]:
    """Return the names of the stiffness and the mass among a file's matrices, or raise ``ValueError``."""
    names = [name for name in found if not name.startswith("K4")]
    of_kind = [_named(names, letter) for letter in "KM"]
    if any(len(own) != 1 for own in of_kind):
        listed = ", ".join(names) or "none"
        raise ValueError(f"one matrix K… and one M… are wanted among its real ones, which are {listed}")
    return [own[0] for own in of_kind]


def _require_reduced(name: str, n: int) -> None:
    """Raise ``ValueError`` if a matrix has more rows than a dense one may have."""
    if n > MOST_UNKNOWNS:
        raise ValueError(
            f"matrix {name} has {n} rows, and a superelement has at most {MOST_UNKNOWNS}; if these are matrices of a "
            "whole model, name them by `matrices =` of the body"
        )


def _named(found: Collection[str], letter: str) -> list[str]:
    """Return the names of matrices of a kind: that of the a-set if it is there, else all that begin with the letter."""
    exact = [name for name in (f"{letter}AA", f"{letter}AAX") if name in found]
    return exact[:1] or [name for name in found if name.startswith(letter)]


def _matrices_of_cards(
    found: Mapping[str, Mapping[tuple[int, int, int, int], float]],
) -> tuple[tuple[_Unknown, ...], dict[str, sp.coo_array]]:
    """Return all unknowns of DMIG, ascending, and the matrices."""
    unknowns = tuple(sorted({key[:2] for entries in found.values() for key in entries}))
    place, n = {unknown: k for k, unknown in enumerate(unknowns)}, len(unknowns)
    matrices = dict[str, sp.coo_array]()
    for name, entries in found.items():
        where = np.array([(place[key[:2]], place[key[2:]]) for key in entries], dtype=int).reshape(-1, 2)
        matrices[name] = sp.coo_array((np.array([*entries.values()], dtype=float), tuple(where.T)), shape=(n, n))
    return unknowns, matrices


FORMAT = BodyFormat(lambda body, path: write_dmig(path, body.superelement()), read_superelement=read_external)
