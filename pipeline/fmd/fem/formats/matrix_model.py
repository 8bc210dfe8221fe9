"""A finite element model without elements, of another program's matrices."""

from dataclasses import field

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError
from fmd.core.limits.files import UNMATCHED_FIELD
from fmd.core.rotations import rigid_motions
from fmd.fem.geometric_stiffness import energies, reduced_geometric_stiffness
from fmd.fem.markers import Marker
from fmd.fem.model import FEModel
from fmd.fem.surface import SurfaceTopology

_EXPORT = "write load cases anew (fmd export --to load-cases), for what the scene has now, and run them"


@dataclass(frozen=True)
class StressFields:
    """Displacements of a body with the stress that another program has computed for each."""

    file: str
    nodes: IntArray  # (n,): nodes of the model
    displacement: Array  # (n, 3, k) [m]
    stress: Array  # (n, 6, k): xx, yy, zz, yz, xz, xy [Pa]
    surface: SurfaceTopology  # surface whose nodes are among those; without triangles if its facets aren't known
    not_drawn: str = ""  # why it has no triangles


@dataclass(frozen=True)
class StressedStiffness:
    """Geometric stiffness under some loads, as another program has computed it."""

    files: str
    # By the unknowns of the model [N/m], or (n_nodes, n_nodes) for all three components of a displacement alike.
    matrices: tuple[sp.csr_array, ...]
    loads: Array  # (3 n_points, k): forces on points under which each is [N]


@dataclass(frozen=True)
class MatrixModel(FEModel):
    """A finite element model without elements: discretisation and material are ``None``."""

    positions: Array  # (n_nodes, 3): node positions [m]
    labels: IntArray  # (n_nodes,): node numbers in the other program
    fields: StressFields | None = field(default=None, kw_only=True)  # stress of some displacements
    stressed: StressedStiffness | None = field(default=None, kw_only=True)  # geometric stiffness under some loads

    strained = False

    def name_point(self, k: int) -> str:
        """Return what a message calls point k: the number of its node."""
        return f"node {self.labels[k]}"

    @property
    def local_pairs(self) -> int:
        """Entries that a stress has beside its sums: none, without elements."""
        return 1

    @property
    def surface(self) -> SurfaceTopology | None:
        """Surface at whose nodes the stress is known; ``None`` without stress."""
        return None if self.fields is None else self.fields.surface

    def stress_of(self, shapes: Array) -> Array:
        """Return the stress (n_surface, 6, n) at the surface's nodes for displacements (n_points, 3, n) of all points.

        Components are xx, yy, zz, yz, xz, xy [Pa per unit of the displacement].

        Raises
        ------
        AccuracyError
            A displacement is no combination of those with known stress, rigid motions aside, with what is missing; or
            the known ones can't be told apart at the nodes that they are known at.
        """
        fields = self.fields
        assert fields is not None
        R = np.linalg.qr(rigid_motions(self.x[fields.nodes]).reshape(-1, 6))[0]
        known, wanted = (
            u - R @ (R.T @ u)
            for u in (field.reshape(len(R), -1) for field in (fields.displacement, shapes[fields.nodes]))
        )
        _require_apart(fields, known, len(self.x))
        share = _combine(known, wanted, f"{fields.file}: mode {{}} isn't a combination of its {{}} displacements")
        place = np.searchsorted(fields.nodes, fields.surface.nodes)
        return np.asarray(fields.stress[place] @ share)

    @property
    def x(self) -> Array:
        """Node positions, shape (n_nodes, 3) [m]."""
        return self.positions

    def unknowns(self, shapes: Array) -> Array:
        """Return the given matrices' unknowns by displacements (n_points, 3, n): these themselves, (3 n_points, n)."""
        return shapes.reshape(-1, shapes.shape[2])

    def rigid_by_node(self) -> Array:
        """Return rigid motions by the unknowns that files have, node by node, (3 n_nodes, 6), or (6 n_nodes, 6)."""
        return self.rigid_modes

    def loads_of_nodes(self, forces: Array, length: float) -> Array:
        """Return loads of nodes by forces on points (n_points, 3), shape (n_nodes, 3), or (n_nodes, 6) with moments.

        Arms of moments have the unit ``length`` [m].
        """
        return forces

    def turning_marker(self, node: int) -> Marker | None:
        """Return the marker at a node that has rotations, by its place among the nodes; ``None`` if it has none."""
        return None

    def frequency_changes(self, shapes: Array) -> Array:
        """Return relative changes (n,) of the frequencies of modes (n_nodes, 3, n) by lumping of masses."""
        return np.zeros(shapes.shape[2])


@reduced_geometric_stiffness.register
def _(fe: MatrixModel, u: Array, shapes: Array) -> Array:
    """Combine the geometric stiffness under given loads to that under the loads ``K u``."""
    assert fe.stressed is not None
    known = fe.stressed.loads
    message = f"{fe.stressed.files}: load {{}} isn't a combination of those of its {{}} matrices"
    share = _combine(known, fe.K @ u.reshape(len(known), -1), message)
    return np.asarray(np.einsum("mk,mij->kij", share, energies(fe.stressed.matrices, fe.unknowns(shapes))))


def _require_apart(fields: StressFields, known: Array, n_nodes: int) -> None:
    """Raise ``AccuracyError`` if displacements (3 n, k) without rigid motions don't tell the stress that is of them.

    As many cases as n nodes have deformations combine to any shape, and cases that together move none of the nodes must
    have no stress together.
    """
    n, k = len(fields.nodes), known.shape[1]
    sizes = _sizes(known)
    _, values, rows = np.linalg.svd(np.linalg.qr(known / sizes, mode="r"))
    stress = (fields.stress / sizes).reshape(-1, k)
    unseen = rows[np.count_nonzero(values > UNMATCHED_FIELD**2 * values[0]) :]
    hidden = np.linalg.norm(stress @ unseen.T) > UNMATCHED_FIELD * np.linalg.norm(stress)
    if hidden or (n < n_nodes and k >= 3 * n - 6):
        raise AccuracyError(
            f"{fields.file}, matrices.stress: displacements of {k} cases at {n} of {n_nodes} nodes don't tell the "
            "stress of a shape; stress at more nodes is needed"
        )


def _combine(known: Array, wanted: Array, message: str) -> Array:
    """Express columns by others; shape (n_known, n_wanted). Raises ``AccuracyError`` if one is none of theirs."""
    sizes = _sizes(known)
    share = np.linalg.lstsq(known / sizes, wanted, rcond=UNMATCHED_FIELD**2)[0] / sizes[:, None]
    missing = np.linalg.norm(wanted - known @ share, axis=0)
    parts = missing / np.maximum(np.linalg.norm(wanted, axis=0), np.finfo(float).tiny)
    worst = int(parts.argmax())
    if parts[worst] > UNMATCHED_FIELD:
        text = message.format(worst + 1, known.shape[1])
        raise AccuracyError(f"{text}: {100 * parts[worst]:.3g} % of it are missing; {_EXPORT}")
    return np.asarray(share)


def _sizes(columns: Array) -> Array:
    """Return the norms of columns, 1 of those that are zero."""
    sizes = np.linalg.norm(columns, axis=0)
    return np.where(sizes == 0.0, 1.0, sizes)
