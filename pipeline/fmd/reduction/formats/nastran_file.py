"""Superelements of Nastran: a punch file of direct matrix input (DMIG) at grid points.

Each marker of the interface is a grid point, each fixed-interface mode a scalar point. Numbers stand in fields of
sixteen characters, which hold ten digits. Cards: ``DMIG``, ``GRID``, ``SPOINT`` of MSC Nastran's Quick Reference Guide.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.files import read_text, whole_file
from fmd.fem.formats.nastran import grid_places
from fmd.fem.formats.nastran_matrices import read_dmig
from fmd.fem.formats.raw_mesh import MeshFileError
from fmd.reduction.craig_bampton import Superelement
from fmd.reduction.formats.body_format import BodyFormat, ExportedBody
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


def _write(body: ExportedBody, path: Path) -> list[Path]:
    write_dmig(path, body.superelement())
    return [path]


def read_external(path: Path) -> GivenSuperelement:
    """Read an external superelement: stiffness K…, mass M… and, if it is there, viscous damping B… as DMIG.

    ``EXTSEOUT(DMIGPCH)`` and ``PARAM,EXTOUT,DMIGPCH`` write ``KAAX``, ``MAAX`` and ``BAAX`` so. Structural damping,
    ``K4AAX``, is left out. Grid points may stand in the same file.

    Raises
    ------
    InputError
        A card is damaged, or a matrix is missing.
    """
    text = read_text(path)
    try:
        found = {name: A for name, A in read_dmig(text).items() if not name.startswith("K4")}
        of = {letter: [name for name in found if name.startswith(letter)] for letter in "KMB"}
        if not len(of["K"]) == len(of["M"]) == 1:
            given = ", ".join(found) or "none"
            raise ValueError(f"one matrix K… and one M… are wanted among its square real DMIG, which are {given}")
        places = grid_places(text)
    except (ValueError, MeshFileError) as error:
        raise InputError(str(path), "", None, f"can't be read as a superelement: {error}") from None
    names = [*of["K"], *of["M"], *of["B"][:1]]
    unknowns = tuple(sorted({key[:2] for name in names for key in found[name]}))
    place = {unknown: k for k, unknown in enumerate(unknowns)}
    K, M, D = (np.zeros((len(unknowns), len(unknowns))) for _ in range(3))
    for A, name in zip((K, M, D), names, strict=False):
        for key, value in found[name].items():
            A[place[key[:2]], place[key[2:]]] = value
    return GivenSuperelement(unknowns, K, M, D, places)


FORMAT = BodyFormat(_write, read_superelement=read_external)
