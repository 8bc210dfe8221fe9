"""The Princeton beam by CalculiX' linear bricks on the mesh of the published figures, 4 × 12 × 500.

Run from the project's root: ``python benchmarks/princeton_locking.py``; it needs CalculiX (``ccx``) and ``pip install
exudyn==1.13.6``, and takes ten minutes. It writes ``princeton_locking.csv``: how far the end is from the rod's solution
and from the published one [%], by fully integrated bricks (C3D8), which lock in bending, and with incompatible modes
(C3D8I), which don't; by rods whose stiffness about the weak axis is raised; and by Exudyn's geometrically exact beams.
"""

from __future__ import annotations

import csv
import os
import subprocess
import tempfile
import warnings
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from exudyn_march import import_exudyn
from large_deflection import (
    DEPTH,
    LENGTH,
    LOAD,
    MODULUS,
    POISSON,
    PUBLISHED,
    WIDTH,
    bend_princeton_rod,
    princeton_stiffness,
)

HERE = Path(__file__).parent
MESH = (500, 12, 4)
CASES = (("C3D8", 45), ("C3D8", 90), ("C3D8I", 45))
RAISED = 1.027  # fitted to all published figures


def march_bricks(kind: str, degrees: int, folder: Path) -> Any:
    """Return the mean displacement of the end (3,) [m] by bricks of one of CalculiX' kinds, with NLGEOM."""
    sizes, shape = (LENGTH, DEPTH, WIDTH), tuple(n + 1 for n in MESH)
    number = np.arange(np.prod(shape)).reshape(shape)
    lines = ["*NODE,NSET=ALL"]
    for place in np.ndindex(*shape):
        x = [size * (k / n - 0.5) for size, k, n in zip(sizes, place, MESH, strict=True)]
        lines.append(",".join((str(number[place] + 1), *(f"{c:.12g}" for c in x))))
    lines.append(f"*ELEMENT,TYPE={kind},ELSET=E")
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    for k, cell in enumerate(np.ndindex(*MESH), 1):
        lines.append(",".join(map(str, (k, *(number[tuple(np.add(cell, c))] + 1 for c in corners)))))
    lines += ["*MATERIAL,NAME=M", "*ELASTIC", f"{MODULUS},{POISSON}", "*SOLID SECTION,ELSET=E,MATERIAL=M"]
    for name, nodes in (("ROOT", number[0]), ("TIP", number[-1])):
        lines += [f"*NSET,NSET={name}", *(str(node + 1) for node in nodes.ravel())]
    lines += ["*STEP,NLGEOM,INC=1000", "*STATIC", "0.25,1.", "*BOUNDARY", "ROOT,1,3", "*CLOAD"]
    share = [np.r_[0.5, np.ones(n - 1), 0.5] / n for n in MESH[1:]]
    weights = np.outer(*share).ravel()
    for node, weight in zip(number[-1].ravel(), weights, strict=True):
        for axis, part in ((2, np.cos(np.radians(degrees))), (3, np.sin(np.radians(degrees)))):
            lines.append(f"{node + 1},{axis},{weight * LOAD * part:.12g}")
    lines += ["*NODE PRINT,NSET=TIP,FREQUENCY=999", "U", "*END STEP"]
    (folder / "part.inp").write_text("\n".join(lines) + "\n")
    subprocess.run(["ccx", "-i", "part"], cwd=folder, env=os.environ | {"OMP_NUM_THREADS": "1"}, check=True, stdout=-3)
    found = [line.split() for line in (folder / "part.dat").read_text().split("displacements")[-1].splitlines()]
    moved = {int(row[0]) - 1: np.array(row[1:], float) for row in found if len(row) == 4}
    return sum(w * moved[node] for node, w in zip(number[-1].ravel().tolist(), weights, strict=True))


def bend_exudyn(degrees: int, n: int) -> Any:
    """Return the displacement of the end (3,) [m] by n of Exudyn's geometrically exact beams."""
    exu = import_exudyn()
    ii, container = exu.itemInterface, exu.SystemContainer()
    mbs, section = container.AddSystem(), exu.BeamSection()
    bending, stretching = princeton_stiffness()
    section.stiffnessMatrix, section.inertia, section.massPerLength = np.diag([*stretching, *bending]), np.eye(3), 1.0
    places = np.linspace(0.0, LENGTH, n + 1)
    nodes = [mbs.AddNode(ii.NodeRigidBodyRotVecLG(referenceCoordinates=[x, 0, 0, 0, 0, 0])) for x in places]
    for pair in pairwise(nodes):
        mbs.AddObject(ii.ObjectBeamGeometricallyExact(nodeNumbers=list(pair), length=LENGTH / n, sectionData=section))
    ground = mbs.AddMarker(ii.MarkerNodeCoordinate(nodeNumber=mbs.AddNode(ii.NodePointGround()), coordinate=0))
    for k in range(6):
        held = mbs.AddMarker(ii.MarkerNodeCoordinate(nodeNumber=nodes[0], coordinate=k))
        mbs.AddObject(ii.CoordinateConstraint(markerNumbers=[ground, held]))
    force = [0.0, LOAD * np.cos(np.radians(degrees)), LOAD * np.sin(np.radians(degrees))]
    mbs.AddLoad(ii.Force(markerNumber=mbs.AddMarker(ii.MarkerNodePosition(nodeNumber=nodes[-1])), loadVector=force))
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.staticSolver.numberOfLoadSteps, settings.staticSolver.verboseMode = 20, 0
    settings.staticSolver.newton.absoluteTolerance = 1e-7
    mbs.SolveStatic(settings)
    return mbs.GetNodeOutput(nodes[-1], exu.OutputVariableType.Displacement)


def main() -> None:
    """Compare, and write the table."""
    warnings.simplefilter("ignore", DeprecationWarning)
    rows = []

    def add(what: str, degrees: int, moved: Any) -> None:
        rod = bend_princeton_rod(degrees)
        published = 1e-3 * np.array(PUBLISHED[degrees])
        from_rod = np.linalg.norm(moved - rod) / np.linalg.norm(rod)
        from_published = np.linalg.norm(moved[1:] - published) / np.linalg.norm(published)
        rows.append((what, degrees, f"{100 * from_rod:.2g}", f"{100 * from_published:.2g}"))
        print(rows[-1], flush=True)

    for degrees in PUBLISHED:
        add("rod", degrees, bend_princeton_rod(degrees))
    for degrees in PUBLISHED:
        add("rod, weak axis 2.7 % stiffer", degrees, bend_princeton_rod(degrees, RAISED))
    for n in (16, 64):
        add(f"Exudyn, {n} geometrically exact beams", 45, bend_exudyn(45, n))
    with tempfile.TemporaryDirectory() as folder:
        for kind, degrees in CASES:
            add(f"CalculiX {kind}", degrees, march_bricks(kind, degrees, Path(folder)))
    with (HERE / "princeton_locking.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("what", "degrees", "from_rod_percent", "from_published_percent"))
        writer.writerows(rows)


if __name__ == "__main__":
    main()
