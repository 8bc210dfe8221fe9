"""Published shell problems by MITC4 and MITC3+ and by CalculiX's S4 and S8R, written to shells.csv with a chart.

Run from the project's root with CalculiX's ``ccx``: ``python benchmarks/shells.py``. S4 and S8R become solids of
incompatible modes and of twenty nodes with reduced integration; their meshes have as many elements each way, and nodes
of S8R between the corners lie on the surface.
"""

import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1]))
from benchmarks.table_format import group_rows, read_rows, write_rows
from fmd.core.arrays import Array, IntArray
from fmd.render.charts import COLOURS, open_figure, style_axes
from tests.fem.published_shells import CYLINDER, HEMISPHERE, ROOF, PublishedShell, nearest
from tests.fem.sheets import unit_grid

HERE = Path(__file__).parent
CASES = {"Scordelis–Lo roof": ROOF, "pinched cylinder": CYLINDER, "hemisphere with a hole": HEMISPHERE}
SIZES = (4, 8, 16, 32)


def quadratic_grid(n: int) -> tuple[Array, IntArray]:
    """Return parameters of the nodes of quadrilaterals of eight nodes, n each way, and their cells."""
    p, cells = unit_grid(n, n, "quadrilateral")
    middles = (p[cells] + p[np.roll(cells, -1, axis=1)]) / 2
    points, number = np.unique(np.round(np.concatenate([p, middles.reshape(-1, 2)]), 12), axis=0, return_inverse=True)
    number = number.ravel()
    return points, np.concatenate([number[cells], number[len(p) :].reshape(-1, 4)], axis=1)


def whole(case: PublishedShell, p: Array, cells: IntArray) -> tuple[Array, IntArray, IntArray, Array]:
    """Return places, cells, held unknowns (n, 2) by node and axis, and forces (n, 3) of a problem's whole shell.

    CalculiX's shells are far too stiff where rotations are held in planes of symmetry.
    """
    x, f = case.place(p), np.zeros((len(p), 3))
    for corner, axis, force in case.forces:
        f[nearest(p, corner), axis] += force
    held = np.zeros((len(p), 3), dtype=bool)
    for nodes, axes in case.supports(p):
        held[np.ix_(nodes, axes)] = True
    size = np.ptp(x)
    x[np.abs(x) < 1e-9 * size] = 0.0
    for axis in case.mirrors:
        sign = np.where(np.arange(3) == axis, -1.0, 1.0)
        held[x[:, axis] == 0.0, axis] = True
        turned = cells[:, [0, 3, 2, 1, *([7, 6, 5, 4] if cells.shape[1] == 8 else [])]] + len(x)
        both, held = np.concatenate([x, sign * x]), np.concatenate([held, held])
        f, cells = np.concatenate([f, sign * f]), np.concatenate([cells, turned])
        _, first, number = np.unique(np.round(both / size, 9) + 0.0, axis=0, return_index=True, return_inverse=True)
        number = number.ravel()
        total = np.zeros((len(first), 3))
        np.add.at(total, number, f)
        x, held, f, cells = both[first], held[first], total, number[cells]
    return x, cells, np.argwhere(held), f


def deck(case: PublishedShell, p: Array, cells: IntArray, kind: str) -> str:
    """Return CalculiX's deck of a problem, which prints the displacement that is compared."""
    measured, material = case.place(p)[nearest(p, case.corner)], case.material
    x, cells, held, forces = whole(case, p, cells)
    at = int(np.linalg.norm(x - measured, axis=1).argmin()) + 1
    lines = ["*NODE, NSET=ALL", *(f"{k}, {a:.15g}, {b:.15g}, {c:.15g}" for k, (a, b, c) in enumerate(x, start=1))]
    lines += [f"*ELEMENT, TYPE={kind}, ELSET=SHELL"]
    lines += [f"{k}, " + ", ".join(map(str, cell)) for k, cell in enumerate(cells + 1, start=1)]
    lines += ["*MATERIAL, NAME=M", "*ELASTIC", f"{material.E:g}, {material.nu:g}", "*DENSITY", f"{material.rho:g}"]
    lines += ["*SHELL SECTION, ELSET=SHELL, MATERIAL=M", f"{case.thickness:g}", "*BOUNDARY"]
    lines += [f"{node + 1}, {axis + 1}, {axis + 1}" for node, axis in held]
    lines += [f"*NSET, NSET=AT\n{at}", "*STEP", "*STATIC"]
    if case.weight:
        lines += ["*DLOAD", f"SHELL, GRAV, {case.weight / material.rho:g}, 0, 0, -1"]
    else:
        loaded = np.argwhere(forces)
        lines += ["*CLOAD", *(f"{node + 1}, {axis + 1}, {forces[node, axis]:g}" for node, axis in loaded)]
    return "\n".join([*lines, "*NODE PRINT, NSET=AT", "U", "*END STEP", ""])


def by_calculix(case: PublishedShell, n: int, kind: str) -> float:
    """Return CalculiX's deflection over the published one."""
    p, cells = unit_grid(n, n, "quadrilateral") if kind == "S4" else quadratic_grid(n)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "job.inp").write_text(deck(case, p, cells, kind))
        subprocess.run(["ccx", "job"], cwd=folder, check=True, capture_output=True, timeout=300)
        rows = [line.split() for line in (Path(folder) / "job.dat").read_text().splitlines()]
    return next(float(row[1 + case.axis]) for row in rows if len(row) == 4 and row[0].isdigit()) / case.target


WAYS: dict[str, Callable[[PublishedShell, int], float]] = {
    "MITC4": lambda case, n: case.deflection(n, "quadrilateral"),
    "MITC3+": lambda case, n: case.deflection(n, "triangle"),
    "CalculiX S4": lambda case, n: by_calculix(case, n, "S4"),
    "CalculiX S8R": lambda case, n: by_calculix(case, n, "S8R"),
}


def measure() -> None:
    """Solve all problems, and write the table."""
    rows = []
    for name, case in CASES.items():
        for element, solve in WAYS.items():
            sizes = SIZES[:-1] if element.endswith("S8R") else SIZES  # as many nodes
            found = {f"n{n}": solve(case, n) for n in sizes}
            print(name, element, found, flush=True)
            rows.append({"case": name, "element": element, **{f"n{n}": "" for n in SIZES}} | found)
    write_rows(HERE / "shells.csv", rows, digits=4)


def draw() -> None:
    """Draw the chart of the table."""
    with open_figure(HERE / "shells.png", (13, 4.5), 100) as figure:
        for number, (name, rows) in enumerate(group_rows(read_rows("shells"), "case").items()):
            axes = figure.add_subplot(1, 3, number + 1)
            for colour, row in zip(COLOURS, rows, strict=False):
                found = {n: float(row[f"n{n}"]) for n in SIZES if row[f"n{n}"]}
                axes.semilogx([*found], [*found.values()], marker="o", base=2, label=row["element"], color=colour)
            axes.axhline(1.0, color="0.6", linewidth=1)
            style_axes(axes, "elements each way", "deflection over the published one" if not number else "", name)
            axes.xaxis.set_major_formatter("{x:g}")
        axes.legend(frameon=False)


if __name__ == "__main__":
    measure()
    draw()
