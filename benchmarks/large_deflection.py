"""Measure parts in pieces: statics against the elastica, a circle, rods, Bathe's bend and CalculiX; costs by pieces.

Run from the project's root: ``python benchmarks/large_deflection.py``. CalculiX (``ccx``) is timed if it is installed.
Writes ``large_deflection.csv``: case, pieces, stiffening, coordinates, seconds of a warm statics, error [%], note.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
sys.path.append(str(HERE.parent))
from benchmarks.table_format import write_rows  # noqa: E402
from fmd import Pipeline  # noqa: E402
from fmd.stages.mechanism import find_start  # noqa: E402
from tests.verification.bathe_bend import END, OTHER_BEAMS, SONNEVILLE, bend  # noqa: E402
from tests.verification.rods import bend_rod, torsion_of_rectangle  # noqa: E402
from tests.verification.test_large_deflection import FORCE, MOMENT, elastica, end_of, strip  # noqa: E402

DEPTH, WIDTH, MODULUS, POISSON, LENGTH, LOAD = 12.3777e-3, 3.2024e-3, 71.7e9, 0.31, 0.508, 8.896
PRINCETON = {"LENGTH": LENGTH, "DEPTH": DEPTH, "WIDTH": WIDTH, "MODULUS": MODULUS, "POISSON": POISSON}
PUBLISHED = {  # solids of ANSYS, by Obrezkov et al., as in Exudyn's test of its ANCF beam: across and down [mm]
    0: (10.69753, 0.0),
    15: (10.57180, 41.01166),
    30: (9.93828, 76.96749),
    45: (8.68679, 105.97631),
    60: (6.50001, 127.25130),
    75: (3.48200, 139.59474),
    90: (0.0, 143.84865),
}
CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]


def measure(folder: Path) -> list[dict[str, Any]]:
    """Measure all cases."""
    rows: list[dict[str, Any]] = []

    def add(case: str, run: Pipeline, pieces: int, stiffening: str, error: float, note: str = "") -> None:
        figures = {"seconds": f"{static_seconds(run):.3g}"}
        row = {"case": case, "pieces": pieces, "stiffening": stiffening, "coordinates": run.system.n}
        rows.append(row | figures | {"error_percent": f"{100 * error:.3g}", "note": note})
        print(rows[-1], flush=True)

    for load in (1, 2, 5, 10):
        exact = elastica(load)
        for stiffening in ("off", "auto"):
            for pieces in (4, 8, 16):
                run = strip(folder, PIECES=pieces, ALONG=48, LOAD=f"{load} N", **FORCE | {"STIFFENING": stiffening})
                apart = np.linalg.norm(end_of(run)[[0, 2]] - exact) / np.linalg.norm(exact - [1, 0])
                add(f"elastica, P L²/EI = {load}", run, pieces, stiffening, apart)
    for pieces in (8, 16):
        run = strip(folder, PIECES=pieces, ALONG=48, LOAD=f"{2 * np.pi!r} N m", **MOMENT)
        add("closed circle", run, pieces, "auto", float(np.linalg.norm(end_of(run))))
    for pieces, along in ((4, 32), (8, 32), (16, 64)):
        run = bend(folder, pieces, along)
        moved = end_of(run) - END
        apart = np.abs(moved / SONNEVILLE - 1)
        other = 100 * np.abs(moved / OTHER_BEAMS - 1).max()
        note = f"({', '.join(f'{x:.3f}' for x in moved)}) in; {other:.2g} % from the other published beams"
        add("Bathe's 45° bend, largest of three components", run, pieces, "auto", float(apart.max()), note)
    for degrees, published in PUBLISHED.items():
        force = LOAD * np.array([0.0, np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
        run = strip(folder, PIECES=8, LOAD=f"{LOAD} N", ALONG=64, **PRINCETON, **FORCE | {"DIRECTION": force.tolist()})
        moved, of_rod = end_of(run) - [LENGTH, 0, 0], bend_princeton_rod(degrees)
        size = float(np.linalg.norm(of_rod))
        beside = np.linalg.norm(1e3 * moved[1:] - published) / np.linalg.norm(published)
        note = f"{100 * beside:.2g} % from the published solids"
        add(f"Princeton beam, {degrees}°", run, 8, "auto", float(np.linalg.norm(moved - of_rod)) / size, note)
    if shutil.which("ccx"):
        for degrees in (45, 90):
            force = LOAD * np.array([0.0, np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
            values = {**PRINCETON, **FORCE, "DIRECTION": force.tolist(), "ALONG": 64, "1, 1]": "2, 2]"}
            values['root = { face = "x-" }'] = 'root = { face = "x-", attachment = "rigid" }'
            run = strip(folder, PIECES=8, LOAD=f"{LOAD} N", **values)
            theirs, seconds = march_calculix(run, force, folder)
            ours = end_of(run) - [LENGTH, 0, 0]
            apart = float(np.linalg.norm(ours - theirs) / np.linalg.norm(theirs))
            ratio = seconds / static_seconds(run)
            note = f"CalculiX with NLGEOM on the same mesh: {seconds:.2g} s, {ratio:.0f} times as long"
            add(f"CalculiX, {degrees}°", run, 8, "auto", apart, note)
    return rows


def bend_princeton_rod(degrees: float) -> Any:
    """Return the displacement (3,) [m] of the end of the Princeton beam as a rod, with shear factors of 5/6."""
    G, area = MODULUS / (2 * (1 + POISSON)), DEPTH * WIDTH
    weak, strong = MODULUS * DEPTH * WIDTH**3 / 12, MODULUS * WIDTH * DEPTH**3 / 12
    bending = (G * torsion_of_rectangle(DEPTH, WIDTH), weak, strong)
    force = LOAD * np.array([0.0, np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    return bend_rod(LENGTH, bending, (MODULUS * area, G * area * 5 / 6, G * area * 5 / 6), force) - [LENGTH, 0, 0]


def static_seconds(run: Pipeline) -> float:
    """Time of finding the rest, compiled and with all bodies reduced [s]: the best of five."""
    times = []
    for _ in range(5):
        tick = time.perf_counter()
        find_start(run.divided_scene, run.system)
        times.append(time.perf_counter() - tick)
    return min(times)


def march_calculix(run: Pipeline, force: Any, folder: Path) -> tuple[Any, float]:
    """Solve the whole part's mesh by CalculiX with NLGEOM; return the mean displacement of the tip [m] and the time."""
    part = run.wholes["strip"]
    space, tip, local = part.space, part.markers["tip"], part.space.kind.element.doflocs
    places = [np.array(place, float) for place in CORNERS]
    places += [(places[i] + places[j]) / 2 for i, j in EDGES]
    if np.linalg.det(space.jacobians(np.full((3, 1), 0.5))[0, 0]) < 0:
        places = [place * [-1, 1, 1] + [1, 0, 0] for place in places]
    order = [int(np.linalg.norm(local - place, axis=1).argmin()) for place in places]
    lines = ["*NODE", *(f"{k + 1},{x:.12g},{y:.12g},{z:.12g}" for k, (x, y, z) in enumerate(space.x))]
    lines += ["*ELEMENT,TYPE=C3D20,ELSET=E"]
    for k, nodes in enumerate(space.element_nodes[:, order] + 1):
        lines += [",".join(map(str, (k + 1, *nodes[:10]))) + ",", ",".join(map(str, nodes[10:]))]
    lines += ["*MATERIAL,NAME=M", "*ELASTIC", f"{MODULUS},{POISSON}", "*SOLID SECTION,ELSET=E,MATERIAL=M"]
    for name, marker in (("ROOT", part.markers["root"]), ("TIP", tip)):
        lines += [f"*NSET,NSET={name}", *(str(node + 1) for node in marker.nodes)]
    lines += ["*STEP,NLGEOM,INC=1000", "*STATIC", "0.25,1.", "*BOUNDARY", "ROOT,1,3", "*CLOAD"]
    for node, weight in zip(tip.nodes, tip.translation_weights, strict=True):
        lines += [f"{node + 1},{axis + 1},{weight * force[axis]:.12g}" for axis in range(3) if force[axis]]
    lines += ["*NODE PRINT,NSET=TIP,FREQUENCY=999", "U", "*END STEP"]
    (folder / "part.inp").write_text("\n".join(lines) + "\n")
    tick = time.perf_counter()
    subprocess.run(["ccx", "-i", "part"], cwd=folder, env=os.environ | {"OMP_NUM_THREADS": "1"}, check=True, stdout=-3)
    seconds = time.perf_counter() - tick
    rows = [line.split() for line in (folder / "part.dat").read_text().split("displacements")[-1].splitlines()]
    moved = {int(row[0]) - 1: np.array(row[1:], float) for row in rows if len(row) == 4}
    return sum(w * moved[node] for node, w in zip(tip.nodes, tip.translation_weights, strict=True)), seconds


def main() -> None:
    """Measure, and write the table."""
    with tempfile.TemporaryDirectory() as folder:
        rows = measure(Path(folder))
    write_rows(HERE / "large_deflection.csv", rows)


if __name__ == "__main__":
    main()
