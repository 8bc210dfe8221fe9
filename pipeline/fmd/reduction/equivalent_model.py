"""A small model of nodes and mass that has the inertia integrals of a body from a file, and moves as it does.

All that a multibody file tells of a body's inertia are products ``∫ f g dm`` of the functions 1, x_a and φ_ja. A model
of as many nodes as there are functions, with a mass matrix for which the functions' values at the nodes have these
products, has exactly the same integrals in every frame: what refers a mesh to its joint refers it, too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import EPSILON, Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError
from fmd.core.limits.modes import MASSLESS, NO_FREQUENCY, OWN_FRAME
from fmd.core.rotations import rigid_motions
from fmd.fem.formats.matrix_model import MatrixModel
from fmd.fem.markers import Marker
from fmd.fem.surface import SurfaceTopology
from fmd.reduction.body import FlexibleBody, MarkerShapes
from fmd.reduction.modal_data import ModalData, function_products
from fmd.reduction.modes import Modes


@dataclass(frozen=True)
class EquivalentModel(MatrixModel):
    """A model with the inertia integrals of a body from a file; it has no stiffness of its own, K is empty."""

    data: ModalData  # the body as its file holds it
    values: Array  # (n_nodes, 4 + 3 n): the functions 1, x, y, z and φ_ja, mode by mode, at the nodes

    @property
    def shapes(self) -> Array:
        """The file's shapes at the nodes, shape (n_nodes, 3, n)."""
        return self.values[:, 4:].reshape(len(self.values), -1, 3).transpose(0, 2, 1)

    @property
    def surface(self) -> SurfaceTopology | None:
        """The file's surface; ``None`` if it has none with stress."""
        return self.data.surface if self.data.stress is not None else None

    def stress_of(self, shapes: Array) -> Array:
        """Return the stress (n_surface, 6, n) of displacements of the file's nodes, which its shapes combine to."""
        assert self.data.stress is not None
        nodes = list(self.data.nodes.values())
        x = np.array([node.position for node in nodes])
        own = np.array([node.translation for node in nodes])
        return np.asarray(self.data.stress @ _combination(own, rigid_motions(x), shapes)[0])


def equivalent_model(data: ModalData) -> EquivalentModel:
    """Make a model of 4 + 3 n nodes with the inertia integrals of a body, without its geometric stiffening."""
    integrals, products = data.integrals, function_products(data)
    scale = np.sqrt(np.maximum(products.diagonal() / integrals.mass, 0.0))
    scale[scale == 0.0] = 1.0
    values = np.diag(scale)
    values[:, 0] = 1.0
    inverse = np.diag(1.0 / scale)
    inverse[1:, 0] = -1.0 / scale[1:]
    inverse[0, 0] = 1.0
    m = sp.csr_array(inverse.T @ products @ inverse)
    K = sp.csr_array((3 * len(values), 3 * len(values)))
    labels: IntArray = np.arange(len(values))
    return EquivalentModel(None, None, K, m, values[:, 1:4], labels, data, values)  # type: ignore[arg-type]


def equivalent_marker(model: EquivalentModel, nodes: Sequence[MarkerShapes]) -> Marker:
    """Attach a marker to a node of the file, or to several in the mean.

    Raises
    ------
    ValueError
        One or two nodes alone, whose rotation the file doesn't tell, or nodes in a line.
    """
    position = np.mean([node.position for node in nodes], axis=0)
    translation = np.mean([node.translation for node in nodes], axis=0)
    rotation = _rotation(nodes, position, translation)
    inverse = np.linalg.inv(model.values)
    weights = np.concatenate([[1.0], position, translation.T.ravel()]) @ inverse
    n = translation.shape[1]
    turning = np.zeros((3, 3, len(model.values)))  # of functionals: rotation about a, displacements along b
    turning[:, :, 1:4] = 0.5 * EPSILON.transpose(0, 2, 1)
    for b in range(3):
        turning[:, b, 4 + b :: 3] = rotation / 3
    assert turning[:, 0, 4::3].shape == (3, n)
    return Marker(position, np.arange(len(model.values)), weights, (turning @ inverse).transpose(0, 2, 1))


def _rotation(nodes: Sequence[MarkerShapes], centre: Array, translation: Array) -> Array:
    """Rotation of a node, or the mean one of several by least squares, for each mode, shape (3, n)."""
    if len(nodes) == 1:
        if not np.isfinite(nodes[0].rotation).all():
            raise ValueError("the file doesn't tell the node's rotation: take three nodes that don't lie in a line")
        return nodes[0].rotation
    r = np.array([node.position for node in nodes]) - centre
    u = np.array([node.translation for node in nodes]) - translation
    inertia = np.eye(3) * (r**2).sum() - r.T @ r
    if np.linalg.eigvalsh(inertia)[0] <= 1e-6 * np.trace(inertia):
        raise ValueError("a marker of several nodes takes three at least that don't lie in a line")
    return np.asarray(np.linalg.solve(inertia, np.cross(r[:, None], u.transpose(0, 2, 1)).sum(axis=0).T))


def modes_of(model: EquivalentModel) -> Modes:
    """Modes of the free body in the space of a file's shapes, whose rigid motions are taken out.

    Raises
    ------
    AccuracyError
        Shapes depend on one another once their rigid motions are taken out, or one of them has no stiffness; or the
        coupling of frame and modes is so large that no body has such inertia.
    """
    from scipy.linalg import eigh

    R = model.rigid_modes.reshape(len(model.x), 3, 6)
    shapes, n = model.shapes, model.data.n
    mR = (model.m @ R.reshape(len(R), -1)).reshape(R.shape)
    coupling = np.linalg.lstsq(np.einsum("iak,ial->kl", R, mR), np.einsum("iak,ian->kn", mR, shapes), rcond=None)[0]
    elastic = shapes - R @ coupling
    M = np.einsum("iaj,iak->jk", elastic, (model.m @ elastic.reshape(len(R), -1)).reshape(elastic.shape))
    if not (M.diagonal() > 0.0).all():
        worst = int(M.diagonal().argmin())
        raise AccuracyError(
            f"the file's inertia can't be a body's: mode {worst + 1} with its frame at rest in space would have the "
            f"modal mass {M[worst, worst]:.3g} beside {model.data.M[worst, worst]:.3g} in the frame; the coupling of "
            "frame and modes is too large for the mass and the modal mass"
        )
    size = np.sqrt(M.diagonal())
    least = float(np.linalg.eigvalsh(M / np.outer(size, size))[0])
    if not least > MASSLESS:
        raise AccuracyError(
            f"the {n} shapes depend on one another as motions of mass: a combination of them keeps {least:.1e} of it"
        )
    omega2, turn = eigh(model.data.K, M)
    if not omega2[0] > NO_FREQUENCY * omega2[-1]:
        raise AccuracyError(
            f"a combination of the {n} shapes has no stiffness: ω² = {omega2[0]:.1e} rad²/s² beside {omega2[-1]:.1e}"
        )
    return Modes(np.sqrt(omega2), elastic @ turn, 6, 0.0, tuple(range(1, n + 1)))


def finish_body(model: EquivalentModel, body: FlexibleBody, markers: Mapping[str, Sequence[str]]) -> FlexibleBody:
    """Give a body that was reduced from an equivalent model what its file holds beside inertia: damping, stiffening.

    Its nodes become those of the file, of which each marker is made of some labels.

    Raises
    ------
    ValueError
        The file's body is stiffened in its own frame, and the joint needs another.
    """
    data, n = model.data, model.data.n
    R = model.rigid_modes.reshape(len(model.x), 3, 6)
    turn, rigid = _combination(model.shapes, R, body.shapes)
    D = turn.T @ data.D @ turn
    nodes = list(data.nodes.values())
    x = np.array([node.position for node in nodes]).reshape(-1, 3)
    spins = np.cross(rigid[3:].T[None], x[:, None]).transpose(0, 2, 1)
    shapes = np.einsum("iaj,jk->iak", np.array([node.translation for node in nodes]).reshape(-1, 3, n), turn)
    body = replace(
        body,
        x=x - body.origin,
        shapes=shapes + rigid[:3] + spins,
        damping=0.5 * D.diagonal() / body.omega,
    )
    if not data.in_own_frame:
        return body
    if np.abs(R @ rigid).max() > OWN_FRAME * np.abs(body.shapes).max():
        raise ValueError(
            "the file holds geometric stiffening in its own frame, which the joint doesn't keep: hang the body on the "
            "node that rests in its frame, or leave stiffening out by simulation.stiffening = 'off'"
        )
    return _stiffened(data, body, turn, markers)


def _combination(shapes: Array, R: Array, wanted: Array) -> tuple[Array, Array]:
    """Express displacements (n_nodes, 3, n) by shapes and rigid motions R: coefficients (n, n) and (6, n)."""
    both = np.concatenate([shapes, R], axis=2).reshape(3 * len(shapes), -1)
    sizes = np.sqrt((both**2).sum(axis=0))
    sizes[sizes == 0.0] = 1.0
    found = np.linalg.lstsq(both / sizes, wanted.reshape(len(both), -1), rcond=None)[0] / sizes[:, None]
    return found[: shapes.shape[2]], found[shapes.shape[2] :]


def _stiffened(data: ModalData, body: FlexibleBody, turn: Array, markers: Mapping[str, Sequence[str]]) -> FlexibleBody:
    """Add the file's terms of second order, about the body's origin and in its coordinates."""
    integrals, n, at = data.integrals, data.n, body.origin

    def turned(forms: Array) -> Array:
        return np.asarray(turn.T @ forms @ turn)

    nothing = np.zeros((3, n, n))
    displacement2 = turned(integrals.displacement2 if integrals.displacement2.size else nothing)
    rotation2 = turned(integrals.rotation2 if integrals.rotation2.size else nothing) - np.einsum(
        "abc,b,cij->aij", EPSILON, at, displacement2
    )
    arm = np.einsum("a,bij->abij", at, displacement2)
    stiffening = turned(integrals.stiffening if integrals.stiffening.size else np.zeros((3, 3, n, n)))
    stiffening = stiffening + 0.5 * (arm + arm.transpose(1, 0, 2, 3))
    G = body.integrals.G.copy()
    G[:, :, 1:, 1:] -= stiffening
    stiffened = {}
    for name, labels in markers.items():
        forms = [data.nodes[label].displacement2 for label in labels]
        known = len(labels) == 1 and forms[0].size
        stiffened[name] = replace(body.markers[name], displacement2=turned(forms[0])) if known else body.markers[name]
    second = {"stiffening": stiffening, "displacement2": displacement2, "rotation2": rotation2}
    return replace(body, integrals=replace(body.integrals, G=G, **second), markers=stiffened)
