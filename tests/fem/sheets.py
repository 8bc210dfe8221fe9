"""Midsurfaces of published shell problems, and their solution with chosen displacements and rotations held."""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla
from scipy.linalg import qr

from fmd.core.arrays import Array, IntArray
from fmd.fem.assembly import assemble
from fmd.fem.material import AnyMaterial
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.fem.thicken import Sheet, thicken
from fmd.meshes.sheets import grid_cells


def unit_grid(n_x: int, n_y: int, element: str) -> tuple[Array, IntArray]:
    """Return parameters (n, 2) between 0 and 1, and cells."""
    X, Y = np.meshgrid(np.linspace(0, 1, n_x + 1), np.linspace(0, 1, n_y + 1), indexing="ij")
    return np.column_stack([X.ravel(), Y.ravel()]), grid_cells(n_x, n_y + 1, n_y, element)


def shell_mesh(x: Array, cells: IntArray, thickness: float, offset: float = 0.0, **faces: IntArray) -> SolidMesh:
    t, off = (np.full(len(cells), each) for each in (thickness, offset))
    return thicken(Sheet(x, cells, t, {}, faces, {}, ("bottom", "top"), off))


class ShellProblem:
    """A shell with held displacements of nodes, and held turns of their directors."""

    def __init__(self, x: Array, cells: IntArray, thickness: float, material: AnyMaterial) -> None:
        self.x = x
        self.fe: FEModel = assemble(shell_mesh(x, cells, thickness), 1, material)
        mesh = self.fe.discretisation.mesh
        assert mesh.midsurface is not None
        self.n_points, self.owner = len(mesh.points), mesh.midsurface.owner
        self._held: list[sp.csr_array] = []

    def hold(self, nodes: IntArray, axes: Sequence[int]) -> None:
        """Hold displacements of nodes along axes."""
        for axis in axes:
            self._held.append(self.fe.T[3 * (self.n_points + nodes) + axis])

    def hold_tips(self, nodes: IntArray, axes: Sequence[int]) -> None:
        """Hold points at both faces in line with their nodes along axes."""
        points = np.flatnonzero(np.isin(self.owner, nodes))
        for axis in axes:
            own = 3 * (self.n_points + self.owner[points]) + axis
            self._held.append(sp.csr_array(self.fe.T[3 * points + axis] - self.fe.T[own]))

    def mirror(self, axis: int) -> None:
        """Make the plane across an axis through the origin a plane of symmetry."""
        nodes = np.flatnonzero(np.abs(self.x[:, axis]) < 1e-9 * np.ptp(self.x))
        self.hold(nodes, (axis,))
        self.hold_tips(nodes, (axis,))

    def solve(self, f: Array) -> Array:
        """Return displacements of nodes (n_nodes, 3) by forces on them and, before them, on all points."""
        return self.solve_all(f)[self.n_points :]

    def solve_all(self, f: Array) -> Array:
        """Return displacements of all points and, behind them, of nodes by forces on these."""
        T, C = self.fe.T, sp.csr_array(sp.vstack(self._held))
        C = C[np.flatnonzero(abs(C).sum(axis=1) > 1e-12)]
        C = C[_independent(C)]
        K = sp.csc_array(T.T @ self.fe.K @ T)
        scale = abs(K.diagonal()).mean()
        system = sp.block_array([[K, scale * C.T], [scale * C, None]], format="csc")
        full = np.concatenate([T.T @ f.ravel(), np.zeros(C.shape[0])])
        y = sla.spsolve(system, full)[: K.shape[0]]
        return np.asarray((T @ y).reshape(-1, 3))

    def load(self) -> Array:
        """Return no forces on all points, shape (n_points, 3)."""
        return np.zeros((len(self.fe.x), 3))


def _independent(C: sp.csr_array) -> IntArray:
    """Return rows of constraints of which none follows from the others."""
    dense = C[:, np.unique(C.indices)].toarray()
    _, R, order = qr(dense.T, mode="economic", pivoting=True)
    size = np.abs(np.diag(R))
    return np.asarray(np.sort(order[: np.count_nonzero(size > 1e-8 * size[0])]))
