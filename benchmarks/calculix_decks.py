"""CalculiX's own test decks: which are read, and their frequencies beside CalculiX's, written to calculix_decks.csv.

Run from the project's root: ``python benchmarks/calculix_decks.py FOLDER``, the folder being that of the decks, as
Debian's package ``calculix-ccx-test`` has them; it takes ``ccx`` (2.20). Of each deck that is read, nodes, elements,
sets, links, masses and supports stay; material and step are the same for all: steel in N, mm and t, and eight
frequencies. Both programs get this deck, with elements that both have: C3D20 for C3D20R, C3D8I for C3D8 and C3D8R.
"""

import csv
import re
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from table_format import HERE

import fmd
from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError, InputError
from fmd.fem.formats.import_mesh import read_mesh

TABLE = HERE / "calculix_decks.csv"
E, NU, RHO = 210e9, 0.3, 7800.0
COUNT, SECONDS = 6, 60
KEPT = (
    "*NODE", "*ELEMENT", "*NSET", "*ELSET", "*SURFACE", "*EQUATION", "*MPC", "*RIGID BODY", "*COUPLING", "*KINEMATIC",
    "*DISTRIBUTING", "*TIE", "*MASS", "*SPRING", "*INCLUDE",
)  # fmt: skip
NOT_KEPT = ("*NODE PRINT", "*NODE FILE", "*NODE OUTPUT", "*SURFACE INTERACTION", "*SURFACE BEHAVIOR")
Section = tuple[str, list[str]]


def main(folder: Path) -> None:
    """Read each deck, compare its frequencies, and write a row of it."""
    decks = sorted(folder.glob("*.inp"))
    rows = []
    with tempfile.TemporaryDirectory(prefix="fmd-decks-") as scratch:
        for deck in decks:
            rows.append((deck.stem, *judge(deck, Path(scratch))))
            print(*rows[-1], flush=True)
    with TABLE.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("deck", "outcome", "difference"))
        writer.writerows(rows)
    print(Counter(row[1] for row in rows))


def judge(deck: Path, scratch: Path) -> tuple[str, str]:
    """Return what became of a deck, and the largest relative difference of a frequency from CalculiX's."""
    try:
        read_mesh(deck, 1e-3, mass_unit=1e3, force_unit=1.0)
    except InputError:
        return "refused", ""
    model, supports = write_model(deck, scratch / "model.inp")
    try:
        found = frequencies(scratch / "model.inp", supports)
    except (InputError, AccuracyError):
        return "model refused", ""
    wanted = frequencies_of_calculix(model, supports, scratch)
    n = min(len(wanted), len(found))
    if not n:
        return "no frequencies of CalculiX", ""
    return "compared", f"{np.abs(found[:n] / wanted[:n] - 1).max():.1e}"


def write_model(deck: Path, path: Path) -> tuple[list[str], list[tuple[str, int, int]]]:
    """Write the deck's model alone, with a node set for each support; return its lines, and sets with axes."""
    lines, supports = list[str](), list[tuple[str, int, int]]()
    for number, (keyword, data) in enumerate(sections(deck.read_text(encoding="utf-8", errors="replace"))):
        if keyword.startswith("*STEP"):
            break
        if keyword.startswith("*BOUNDARY"):
            supports += supports_of(data)
        if not keyword.startswith(KEPT) or keyword.startswith(NOT_KEPT):
            continue
        of_both = re.sub(r"TYPE=\s*C3D8R?\s*(,|$)", r"TYPE=C3D8I\1", keyword.replace("C3D20R", "C3D20"))
        needs_set = of_both.startswith("*ELEMENT") and "ELSET" not in of_both
        lines += [of_both + (f",ELSET=OWN{number}" if needs_set else ""), *data]
    for number, (name, _, _) in enumerate(supports):
        lines += [f"*NSET,NSET=HELD{number}", f"{name},"]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return lines, supports


def sections(text: str) -> list[Section]:
    """Divide a deck into its keyword lines, in capitals, and the data below each."""
    found = list[Section]()
    for line in (line.strip() for line in text.splitlines()):
        if line.startswith("*") and not line.startswith("**"):
            found.append((line.upper(), []))
        elif line and not line.startswith("**") and found:
            found[-1][1].append(line)
    return found


def supports_of(data: list[str]) -> list[tuple[str, int, int]]:
    """Return sets or nodes that a *BOUNDARY holds, each with its first and last axis."""
    rows = [[entry.strip() for entry in line.split(",")] for line in data]
    held = [(row[0], int(row[1]), int(row[2] if len(row) > 2 and row[2] else row[1])) for row in rows if row[0]]
    return [(name, first, min(last, 3)) for name, first, last in held if first <= 3]


def frequencies(model: Path, supports: list[tuple[str, int, int]]) -> Array:
    """Return the natural frequencies of a deck's model [Hz]."""
    mesh = {"file": str(model), "unit": "mm", "force_unit": "N", "mass_unit": "t"}
    body: dict[str, Any] = {"mesh": mesh, "E": E, "nu": NU, "rho": RHO, "modes": {"count": COUNT}}
    if supports:
        held = enumerate(supports)
        body["support"] = [{"face": f"HELD{k}", "fixed": list("xyz"[first - 1 : last])} for k, (_, first, last) in held]
    return np.asarray(fmd.load({"title": "Deck", "body": {"deck": body}}).modes.frequencies_hz)[:COUNT]


def frequencies_of_calculix(model: list[str], supports: list[tuple[str, int, int]], scratch: Path) -> Array:
    """Return CalculiX's frequencies above zero of the same model [Hz]; none if it fails."""
    elements = [re.search(r"ELSET\s*=\s*([^,\s]+)", line) for line in model if line.startswith("*ELEMENT")]
    sets = sorted({found[1] for found in elements if found})
    job = ["*MATERIAL,NAME=STEEL", "*ELASTIC", f"{E / 1e6},{NU}", "*DENSITY", f"{RHO / 1e12}"]
    job += [f"*SOLID SECTION,ELSET={name},MATERIAL=STEEL" for name in sets]
    job += ["*BOUNDARY", *(f"{name},{first},{last}" for name, first, last in supports)] if supports else []
    job += ["*STEP", "*FREQUENCY,SOLVER=ARPACK", "8", "*END STEP"]
    (scratch / "job.inp").write_text("\n".join([*model, *job]) + "\n", encoding="utf-8")
    answer = scratch / "job.dat"
    answer.unlink(missing_ok=True)
    try:
        subprocess.run(["ccx", "job"], cwd=scratch, capture_output=True, timeout=SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return np.zeros(0)
    text = answer.read_text(encoding="utf-8") if answer.exists() else ""
    rows = [line.split() for line in text.partition("P A R T I C")[0].splitlines()]
    found = np.array([float(row[3]) for row in rows if len(row) == 5 and row[0].isdigit()])
    return found[found > 1e-3 * found.max(initial=0.0)]


if __name__ == "__main__":
    main(Path(sys.argv[1]))
