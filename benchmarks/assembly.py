"""Assembly of stiffness and mass beside scikit-fem's own form, DOLFINx, FElupe, NGSolve and SfePy, on one thread.

Run from the project's root: ``python benchmarks/assembly.py``; it prints the table and writes it beside itself. Every
package that is installed (DOLFINx may be so in another interpreter: ``--dolfinx /usr/bin/python3``) gets the same block
of Gmsh's tetrahedra or of hexahedra in a process of its own. Processor seconds of space, K and M, the median without
the first time; the difference to ours is that of the energies of polynomial displacements, which don't hang on how a
package numbers its unknowns, and for scikit-fem of all entries. Memory is the peak beyond what the process had before.
With ``--elements tet4 --packages DOLFINx`` only these rows are made anew, and ours beside them.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from table_format import machine, renew_rows

from fmd.fem.mesh import SolidMesh
from fmd.fem.space import Discretisation
from fmd.meshes.bar import hexahedral_bar, tetrahedral_bar

PEERS = Path(__file__).with_name("assembly_peers.py")
BLOCK = (0.12, 0.1, 0.08)
PACKAGES = ("fmd", "scikit-fem", "scikit-fem, our quadrature", "DOLFINx", "FElupe", "NGSolve", "SfePy")
# Edge of the tetrahedra [m], or hexahedra along y, for about 50,000 and 200,000 unknowns.
MESHES = {
    "tet4": (0.00375, 0.00232),
    "tet10": (0.00776, 0.00474),
    "hex8": (25, 40),
    "hex20": (16, 25),
}
TOO_MUCH = ("scikit-fem", "hex20")  # at 200,000 unknowns: 125 points in each element, ten minutes and 15 GB
LONGEST = 460


def block(name: str, size: float) -> SolidMesh:
    """Mesh the block for an element."""
    if name.startswith("tet"):
        return SolidMesh(*tetrahedral_bar(*BLOCK, size))
    return SolidMesh(*hexahedral_bar(*BLOCK, tuple(round(size * edge / BLOCK[1]) for edge in BLOCK)))


def measured(package: str, name: str, path: Path, interpreter: str) -> dict | str:
    """What a package's process found, or why it found nothing."""
    command = [interpreter, str(PEERS), package, name, str(path)]
    alone = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    try:
        done = subprocess.run(
            command, env=os.environ | alone, capture_output=True, text=True, timeout=LONGEST, check=False
        )
    except subprocess.TimeoutExpired:
        return f"stopped after {LONGEST} s"
    lines = done.stdout.strip().splitlines()
    return json.loads(lines[-1]) if not done.returncode and lines else done.stderr.strip().splitlines()[-1]


def main():
    """Measure and write the table."""
    reader = argparse.ArgumentParser()
    reader.add_argument("--dolfinx", default=sys.executable, help="interpreter that has DOLFINx")
    reader.add_argument("--elements", nargs="*", default=list(MESHES))
    reader.add_argument("--packages", nargs="*", default=PACKAGES[1:], choices=PACKAGES[1:], metavar="PACKAGE")
    reader.add_argument("--large", action=argparse.BooleanOptionalAction, default=True, help="200,000 unknowns, too")
    chosen = reader.parse_args()
    rows = []
    for name in chosen.elements:
        for size in MESHES[name][: 1 + chosen.large]:
            mesh = block(name, size)
            unknowns = 3 * len(Discretisation(mesh, 1 if name in ("tet4", "hex8") else 2).x)
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "mesh.npz"
                np.savez(path, points=mesh.points, cells=mesh.cells)
                own = {}
                for package in ("fmd", *chosen.packages):
                    if (package, name) == TOO_MUCH and unknowns > 100_000:
                        continue
                    found = measured(package, name, path, chosen.dolfinx if package == "DOLFINx" else sys.executable)
                    if isinstance(found, str):
                        print(f"{name:6s} {unknowns:7d} {package:33s} {found}", flush=True)
                        continue
                    own = own or found
                    energies = np.array(found["energies"]) / own["energies"] - 1
                    apart = found.get("entries", np.abs(energies).max())
                    ratio = found["seconds"] / own["seconds"]
                    peer, comma, how = package.partition(",")
                    label = package if package == "fmd" else f"{peer} {found['version']}{comma}{how}"
                    figures = {"seconds": found["seconds"], "over fmd": ratio, "peak MB": found["megabytes"]}
                    row = {"element": name, "unknowns": unknowns, "package": label}
                    rows.append(row | figures | {"largest difference": float(apart)})
                    print(
                        f"{name:6s} {unknowns:7d} {label:33s} {found['seconds']:8.3f} s {ratio:7.1f} × "
                        f"{found['megabytes']:7.0f} MB {apart:.1e}",
                        flush=True,
                    )
    place = {name: k for k, name in enumerate(MESHES)}
    renew_rows(
        Path(__file__).with_suffix(".csv"),
        rows,
        ("element", "unknowns", "package"),
        lambda row: (place[row["element"]], int(row["unknowns"]), row["package"] != "fmd"),
        f"{machine()}, one thread",
    )


if __name__ == "__main__":
    main()
