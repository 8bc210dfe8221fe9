"""NASA's rotor 37 that rubs on an oval casing, beside whole elements and NLstep, written to contact_rotor.csv.

Run from the project's root: ``python benchmarks/contact_rotor.py NLSTEP``, with a copy of the repository of NLstep
(github.com/maltekrack/NLstep), whose example 03 has the mesh, 6,732 wedges of 15 nodes, and CalculiX, which writes
the matrices that the example is run with. Numbers are the example's: the root is clamped, the blade stands, and the
casing turns about it at 1,344 rad/s, 0.356 mm wider than the tip but for two lobes that reach as far into it (Piollet,
Nyssen & Batailly, J Sound Vib 460, 2019), friction 0.15; damping is in proportion to the mass, 0.5 % of the first mode.
The casing follows the tip's radius along the axis, and points are the middles of the sides of the tip's triangles.

Whole elements march all 61,098 unknowns by Hilber, Hughes and Taylor with CalculiX's matrices; conditions of contact
hold at the end of each step. NLstep has its example's kind of model, MacNeal's with massless points, of the same
matrices and points.
"""

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from contact_oblique import CLASS, History
from contact_rub import FRICTION, OUTPUTS, STEPS, WIDTH, Blade, Casing, our_march, whole_march, write_table
from scipy.io import loadmat, savemat
from scipy.sparse.linalg import LinearOperator, eigsh
from table_format import HERE

from fmd.fem.formats.abaqus import read_abaqus
from fmd.reduction.factor.factor import factorise

TABLE = HERE / "contact_rotor.csv"
RATIO = 0.005  # of critical damping, of the first mode
TIP = 0.62  # triangles outside of this radius are the tip's [m]


class Rotor(Blade):
    """The example's mesh, with the matrices that CalculiX writes."""

    element, density = "C3D15", 9000.0

    def __init__(self, example: Path, folder: Path) -> None:
        for name in ("blade.inp", "blade.msh"):
            (folder / name).write_text((example / "FEmodel" / name).read_text(encoding="utf-8"), encoding="utf-8")
        mesh = read_abaqus((folder / "blade.msh").read_text(encoding="utf-8"))
        self.x, self.cells = 1e-3 * mesh.points, mesh.blocks[0][1]
        subprocess.run(["ccx", "blade"], cwd=folder, capture_output=True, check=True)
        self.K, self.M = (1e3 * _matrix(folder / f"blade.{ending}") for ending in ("sti", "mas"))  # of N, mm and t
        kept = np.array((folder / "blade.dof").read_text(encoding="utf-8").replace(".", " ").split(), int)
        at = np.full((len(self.x), 3), -1)
        at[kept[::2] - 1, kept[1::2] - 1] = np.arange(len(kept) // 2)
        self.clamped = np.flatnonzero(at[:, 0] < 0)
        sides = np.concatenate([self.cells[:, [0, 1, 2, 6, 7, 8]], self.cells[:, [3, 4, 5, 9, 10, 11]]])
        _, first, times = np.unique(np.sort(sides[:, :3], axis=1), axis=0, return_index=True, return_counts=True)
        sides, radius = sides[first[times == 1]], np.hypot(self.x[:, 0], self.x[:, 1])
        sides = sides[(radius[sides] > TIP).all(axis=1)]
        self.tip, self.points = np.unique(sides), np.unique(sides[:, 3:])
        self.B, z = at[self.points].ravel(), self.x[self.tip, 2]
        self.damping = 2 * RATIO * float(np.sqrt(self.lowest(1)[0][0]))
        radii = np.polynomial.Polynomial.fit(z, radius[self.tip], 4)  # within 2 µm
        turns, heights = (0.3 * np.pi, 0.45 * np.pi), (z.min() - 5e-3, z.max() + 5e-3)
        self.place(Casing(0.356e-3, 1344.0, *turns, radii, radii.deriv(), heights, (124, 8)))

    def lowest(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the squares of the lowest modes [1/s²] and the modes."""
        inverse = LinearOperator(self.K.shape, matvec=factorise(self.K.tocsr()).solve, dtype=float)
        return eigsh(self.K, count, self.M, sigma=0, OPinv=inverse)


def _matrix(path: Path) -> Any:
    row, column, value = np.fromfile(path, sep=" ").reshape(-1, 3).T
    half = sp.csc_matrix((value, (row.astype(int) - 1, column.astype(int) - 1)))
    return half + sp.tril(half.T, -1)  # of the upper half


CODE = """
addpath('{source}'); addpath('{folder}'); load('{folder}/in.mat');
m = CMS_ROM; m.M = M; m.K = K; m.D = damping*M; m.n = size(M, 1); m.nb = nb;
for k = 1:nb/3
  hole = @(t) share(k)*(g*(1 - 2*exp(-((mod(speed*t(:).' + start + angle(k), pi)/pi - .5)/wide).^2)) - off(k));
  rate = @(t) share(k)*4*speed*g/(pi*wide)*(mod(speed*t(:).' + start + angle(k), pi)/pi - .5)/wide ...
    .*exp(-((mod(speed*t(:).' + start + angle(k), pi)/pi - .5)/wide).^2);
  fast = @(t) [rate(t); zeros(1, numel(t)); way(k)*ones(1, numel(t))];
  m.nonlinear_elements{{k}} = struct('type', '3D', 'imposedGap', hole, 'imposedGapVelocity', fast, ...
    'frictionCoefficient', mu);
end
S.verbosity = 0; begin_ = cputime;
[Q, U, L] = sim_contact3D(t, zeros(m.n, 1), zeros(m.n, 1), m, S);
seconds = cputime - begin_;
save('-v7', '{folder}/out.mat', 'Q', 'U', 'L', 'seconds');
"""


def nlstep(blade: Rotor, count: int, source: Path, folder: Path) -> History:
    """March NLstep's own kind of model for this example, MacNeal's with massless points."""
    nb, solve, (squares, modes) = len(blade.B), factorise(blade.K.tocsr()).solve, blade.lowest(count)
    axes = sp.block_diag([axes.T for axes in blade.axes]).tocsc()
    picked = sp.csc_matrix((np.ones(nb), (blade.B, np.arange(nb))), shape=(blade.K.shape[0], nb)) @ axes
    static = np.concatenate([picked.T @ solve(picked[:, k : k + 24].toarray()) for k in range(0, nb, 24)], axis=1)
    seen = picked.T @ modes
    rest = np.linalg.inv(static - seen / squares @ seen.T)  # stiffness of what the modes leave out
    K = np.block([[rest, -rest @ seen], [-seen.T @ rest, np.diag(squares) + seen.T @ rest @ seen]])
    given = {"M": np.diag(np.repeat([0.0, 1.0], [nb, count])), "K": K, "damping": blade.damping, "nb": float(nb)}
    given |= {"share": blade.share, "off": blade.off, "way": blade.way, "angle": blade.angle, "mu": FRICTION}
    given |= {"g": blade.casing.gap, "wide": WIDTH, "speed": blade.casing.speed, "start": blade.casing.start}
    given |= {"t": np.linspace(0, blade.casing.span, STEPS + 1)}
    savemat(folder / "in.mat", given)
    (folder / "CMS_ROM.m").write_text(CLASS, encoding="utf-8")
    (folder / "go.m").write_text(CODE.format(source=source / "SRC", folder=folder), encoding="utf-8")
    subprocess.run(["octave-cli", "-q", str(folder / "go.m")], cwd=folder, check=True)
    found = loadmat(folder / "out.mat")
    lam, moved = (np.asarray(found[key])[:nb].reshape(nb // 3, 3, -1) for key in "LQ")
    slips = np.diff(moved[:, 1:], axis=2)
    slips[:, 1] += blade.way[:, None] * blade.casing.span / STEPS
    work = np.cumsum(np.einsum("ikt,ikt->t", lam[:, 1:, 1:], slips))
    force, every = np.einsum("pat,pac->tc", lam, blade.axes), STEPS // OUTPUTS
    return History(force[::every], np.append(0.0, -work)[::every], float(found["seconds"].item()))


def main() -> None:
    """Compare all marches with that of the whole elements, and write their table."""
    source, marches = Path(sys.argv[1]).resolve(), {}
    with tempfile.TemporaryDirectory(prefix="fmd-contact-") as scratch:
        folder = Path(scratch)
        blade = Rotor(source / "EXAMPLES" / "03_bladeCasingRubbing", folder)
        marches["NLstep, 20 modes"] = nlstep(blade, 20, source, folder)
        for count in (5, 20):
            keys = {"integrator": "central-difference"}
            marches[f"fmd, {count} modes, central differences"] = our_march(blade, count, folder, keys)
    write_table(TABLE, whole_march(blade), marches, blade.casing.span)


if __name__ == "__main__":
    main()
