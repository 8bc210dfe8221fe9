"""MYSTRAN's own test decks: which are read, and their free frequencies beside MYSTRAN's, written to mystran_decks.csv.

Run from the project's root: ``python benchmarks/mystran_decks.py MYSTRAN FOLDER``, its program (17.0) and a folder of
decks, those of its source tree and of its repository MYSTRAN_Benchmark. Bulk data stay but for supports, sets of
reduction and parameters; all materials are one, in SI units. Both programs get this deck.
"""

import csv
import re
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
from table_format import HERE

import fmd
from fmd.core.errors import AccuracyError, InputError

TABLE = HERE / "mystran_decks.csv"
COUNT, SECONDS, RIGID = 6, 60, 1e-3  # modes, of the program [s], frequency of a rigid motion over its highest
LEFT_OUT = ("EIG", "SPC", "SUP", "ASE", "OMI", "PAR", "DEB", "SEQ", "TEM", "FOR", "MOM", "LOA", "GRA", "RFO", "PLO")
MATERIAL = "MAT1,{},7.+10,,.33,2700."


def main(program: Path, folder: Path) -> None:
    """Compare each model once, and write a row of it."""
    rows, seen = list[tuple[str, str, str]](), set[str]()
    with tempfile.TemporaryDirectory(prefix="fmd-decks-") as scratch:
        for deck in sorted(folder.iterdir()):
            model = "\n".join(bulk(deck.read_text(encoding="utf-8", errors="replace")))
            if model not in seen:
                seen.add(model)
                rows.append((deck.stem, *judge(program, model, Path(scratch))))
                print(*rows[-1], flush=True)
    with TABLE.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([("deck", "outcome", "difference"), *rows])
    print(Counter(row[1] for row in rows))


def bulk(text: str) -> list[str]:
    """Return the cards of a deck's model, with continuations."""
    lines, keep = list[str](), False
    for raw in re.split(r"BEGIN +BULK.*", text, maxsplit=1)[-1].splitlines():
        line = raw.partition("$")[0].rstrip().upper()
        if line.startswith("ENDDATA"):
            break
        if line and not line.startswith(("+", "*", " ", ",")):
            keep = not line.startswith(LEFT_OUT)
            if keep and line.startswith("MAT1"):
                lines.append(MATERIAL.format(re.split(r"[,\s]+", line)[1]))
                keep = False
        if keep and line:
            lines.append(line)
    return lines


def judge(program: Path, model: str, scratch: Path) -> tuple[str, str]:
    """Return what became of a model: the refusal, or the largest difference of a frequency from MYSTRAN's."""
    path = scratch / "model.bdf"
    path.write_text(
        "\n".join(["SOL 103", "CEND", "METHOD=1", "BEGIN BULK", f"EIGRL,1,,,{COUNT + 8}", model, "ENDDATA\n"])
    )
    try:
        found = frequencies(path)
    except (InputError, AccuracyError) as error:
        return "refused", str(error).partition("model.bdf: ")[2].partition("\n")[0][:100] or str(error)[:100]
    wanted = frequencies_of_mystran(program, path)
    if not len(wanted):
        return "no frequencies of MYSTRAN", ""
    if wanted[5] > RIGID * wanted[-1]:
        return "rigid motions of MYSTRAN vibrate", f"{wanted[5]:.1e} Hz"
    elastic = wanted[wanted > RIGID * wanted[-1]]
    n = min(len(elastic), len(found))
    return "compared", f"{np.abs(found[:n] / elastic[:n] - 1).max():.1e}"


def frequencies(path: Path) -> np.ndarray:
    """Return the elastic frequencies of the free body [Hz]."""
    kinds = {"shell": "CQUAD|CTRIA", "beam": "CBAR|CBEAM|CROD|CONROD|CBUSH"}
    has = {key: "deck" for key, names in kinds.items() if re.search(f"^({names})", path.read_text(), re.MULTILINE)}
    mesh = {"file": str(path), "unit": "m", "mass_unit": "kg", "force_unit": "N"} | has
    body = {"mesh": mesh, "E": "70 GPa", "nu": 0.33, "rho": "2700 kg/m^3", "modes": {"count": COUNT}}
    return np.asarray(fmd.load({"title": "Deck", "body": {"b": body}}).run.parts["b"].modes.frequencies_hz)


def frequencies_of_mystran(program: Path, path: Path) -> np.ndarray:
    """Return MYSTRAN's frequencies of the same deck, ascending, seven or more or none [Hz]."""
    answer = path.with_suffix(".F06")
    answer.unlink(missing_ok=True)
    subprocess.run([program, path.name], cwd=path.parent, capture_output=True, timeout=SECONDS, check=False)
    text = answer.read_text(encoding="utf-8", errors="replace") if answer.exists() else ""
    rows = re.findall(r"^\s+\d+\s+\d+\s+\S+E\S+\s+\S+\s+(\S+)\s+\S+\s+\S+\s*$", text, re.MULTILINE)
    return np.sort(np.array(rows, dtype=float)) if len(rows) > 6 else np.empty(0)


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), Path(sys.argv[2]))
