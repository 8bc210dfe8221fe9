"""Frequencies of bars and plates that a fixed joint holds by an averaged or a rigid face, written to clamps.csv.

Run from the project's root: ``python benchmarks/clamps.py``. The first three frequencies by each attachment are
compared with those of a mesh of more elements each way whose nodes on the face are all fixed, as rows and columns that
are taken out of its stiffness and mass. Bodies reach 1 m from the face on; ``extent`` is twice the largest distance of
the face from its middle over that of the body, by which the default is chosen.
"""

import tempfile
from pathlib import Path

import numpy as np
from scipy.sparse.linalg import eigsh
from table_format import write_rows

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.core.cache import Cache

TABLE = Path(__file__).parent / "clamps.csv"
# Depth and width [m], elements along, across the depth and the width, and how many times as many the reference has.
BODIES = {
    "bar 1:10": (0.1, 0.1, (20, 2, 2), 2),
    "bar 1:10, deep": (0.2, 0.1, (20, 2, 2), 2),
    "bar 1:30": (0.033, 0.033, (30, 1, 1), 3),
    "bar 1:100": (0.01, 0.01, (50, 1, 1), 3),
    "stub 4:1": (0.25, 0.25, (12, 3, 3), 2),
    "stub 2:1": (0.5, 0.5, (8, 4, 4), 2),
    "stub 1:1": (1.0, 1.0, (5, 5, 5), 2),
    "strip 3:1": (0.01, 1 / 3, (18, 1, 6), 2),
    "square plate": (0.01, 1.0, (12, 1, 12), 2),
    "wide plate 1:3": (0.01, 3.0, (8, 1, 24), 2),
}
MODES = 3
SCENE = """
title = "clamped"
[body.bar]
shape = "bar"
length = "1 m"
depth = "{depth} m"
width = "{width} m"
E = "70 GPa"
nu = 0.33
rho = "2700 kg/m^3"
mesh = {{ order = 2, divisions = {divisions} }}
modes = {{ count = {modes}, boundary = "joint" }}
marker = {{ root = {{ face = "x-", attachment = "{attachment}" }}, tip = {{ face = "x+" }} }}
[joint.hub]
type = "fixed"
parent = "ground"
child = "bar.root"
[simulation]
duration = "1 ms"
output_step = "1 ms"
tip = "bar.tip"
run = [{{ integrator = "auto" }}]
"""


def clamped(folder: Path, depth: float, width: float, divisions: list[int], attachment: str) -> Pipeline:
    """Return the scene of a body of 1 m on a fixed joint."""
    file = folder / "clamped.toml"
    file.write_text(SCENE.format(depth=depth, width=width, divisions=divisions, attachment=attachment, modes=MODES))
    return Pipeline(load_scene(file), Cache(None))


def fixed_frequencies(run: Pipeline) -> Array:
    """Return the first angular frequencies of a body whose nodes on the face are all fixed [rad/s]."""
    fe = run.part.fe
    kept = np.flatnonzero(np.repeat(fe.x[:, 0] > 1e-9, 3))
    K, M = (A.tocsr()[kept][:, kept].tocsc() for A in (fe.K, fe.M))
    omega2 = eigsh(K, MODES, M, sigma=0.0, return_eigenvectors=False)
    return np.asarray(np.sqrt(np.sort(omega2)))


def main() -> None:
    """Measure all bodies and write the table."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, (depth, width, divisions, times) in BODIES.items():
            finer = [times * n for n in divisions]
            exact = fixed_frequencies(clamped(Path(folder), depth, width, finer, "averaged"))
            row = {"body": name, "extent": np.hypot(depth, width) / np.hypot(1.0, np.hypot(depth, width) / 2)}
            for attachment in ("averaged", "rigid"):
                omega = clamped(Path(folder), depth, width, list(divisions), attachment).part.modes.omega
                row |= {f"{attachment} {k + 1}": omega[k] / exact[k] - 1 for k in range(MODES)}
            rows.append(row)
            print(row, flush=True)
    write_rows(TABLE, rows)


if __name__ == "__main__":
    main()
