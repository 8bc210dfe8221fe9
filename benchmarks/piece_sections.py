"""Measure how a bar in pieces deflects under loads at its end, against the bar in one piece, by the sections' weights.

Run from the project's root: ``python benchmarks/piece_sections.py``. Writes ``piece_sections.csv``.
"""

from __future__ import annotations

import csv
import sys
import tempfile
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path += [str(HERE), str(HERE.parent)]
from fmd.stages.pieces_at_rest import balance, measure_part  # noqa: E402
from tests.verification.test_large_deflection import FORCE, strip  # noqa: E402

SQUARE = {"DEPTH": 0.02, "WIDTH": 0.02, "POISSON": 0.33, "1, 1]": "4, 4]"}
VALUES = FORCE | SQUARE | {"LOAD": "1 N", "count = 1": "count = 4"}
BARS = {0.08: 16, 0.16: 32}  # length [m]: elements along it
LOADS = {"tension": 0, "shear force": 2, "torsion": 3, "bending": 4}


def measure(folder: Path, length: float, pieces: int, sections: str) -> dict[str, str]:
    """Return a row: errors of the end's motion along each load, and of the lowest frequencies."""
    values = VALUES | {"LENGTH": length, "ALONG": BARS[length]}
    run = strip(folder, PIECES=f'{pieces}\nsections = "{sections}"', **values)
    divided = run.division.divided["strip"]
    (tip,) = divided.ports[1:]
    true = measure_part(divided.whole, divided.ports).compliances[tip]
    loads = balance(divided.whole, divided.ports, {name: divided.at_rest.motions[name].T for name in divided.ports})
    error = np.diag(divided.at_rest.compliance(loads[tip])) / np.diag(true) - 1.0
    errors = {load: f"{100 * error[k]:.2g}" for load, k in LOADS.items()}
    bar = f"{1e3 * length:g} × 20 × 20 mm"
    frequencies = f"{100 * divided.errors['lowest frequencies']:.2g}"
    return {"bar": bar, "pieces": str(pieces), "sections": sections} | errors | {"frequencies": frequencies}


def main() -> None:
    """Measure all bars, and write the table."""
    with tempfile.TemporaryDirectory() as folder:
        rows = [
            measure(Path(folder), length, pieces, sections)
            for length in BARS
            for pieces in (4, 8)
            for sections in ("tractions", "averaged", "rigid")
        ]
    with (HERE / "piece_sections.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, [*rows[0]], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
