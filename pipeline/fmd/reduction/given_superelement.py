"""Bodies of superelements that other programs have made: matrices of boundary nodes and modal coordinates.

Rigid motions and free vibration follow from stiffness and mass alone, whatever the coordinates are (Craig & Bampton
1968, Guyan 1965). Of the products ``∫ f g dm`` of 1, x and the free modes ψ a reduced mass tells all that equations of
motion take in first order: mass, centre, inertia tensor, ``∫ ψ = 0``, ``∫ x × ψ = 0`` and ``∫ ψ_j · ψ_k = δ_jk``. What
it doesn't tell, ``∫ x_(a ψ_b)`` and how ``∫ ψ_ja ψ_kb`` divides among directions, comes from points of known motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh, eigvalsh, null_space

from fmd.core.arrays import EPSILON, Array
from fmd.core.errors import AccuracyError, InputError
from fmd.core.limits.files import (
    DENSEST,
    FASTEST_WAVE,
    LEAST_MOMENT,
    RIGID_FORCE,
    RIGID_INERTIA,
    SUPPORT_STIFFNESS,
    SYMMETRIC,
)
from fmd.core.limits.modes import MASSLESS, NO_FREQUENCY
from fmd.core.rotations import RIGID_MOTIONS, rigid_motions
from fmd.reduction.body import MarkerShapes
from fmd.reduction.inertia import InertiaIntegrals
from fmd.reduction.known_motion import affine_products, directional_mass, within_schwarz
from fmd.reduction.modal_data import ModalData


class Recovery(NamedTuple):
    """Motion of points within a superelement.

    Attributes
    ----------
    labels : sequence of int
        Node numbers.
    x : ndarray, shape (n_points, 3)
        Positions [m].
    matrix : ndarray, shape (n_points, 3, n)
        Displacements for a unit of each unknown, of displacement [m] or rotation [rad].
    """

    labels: Sequence[int]
    x: Array
    matrix: Array


@dataclass(frozen=True)
class GivenSuperelement:
    """A superelement as a file holds it, in the file's units until `in_si`.

    Attributes
    ----------
    unknowns : tuple of (int, int)
        Node number and component of each coordinate: 1 to 3 displacements, 4 to 6 rotations; modal coordinates are
        those of nodes without a place.
    K, M, D : ndarray, shape (n, n)
        Stiffness, mass and damping.
    nodes : mapping of int to ndarray, shape (3,)
        Places of the boundary nodes.
    axes : mapping of int to ndarray, shape (3, 3)
        Directions, as columns, of the unknowns of nodes that have axes of their own.
    """

    unknowns: tuple[tuple[int, int], ...]
    K: Array
    M: Array
    D: Array
    nodes: Mapping[int, Array] = field(default_factory=dict)
    axes: Mapping[int, Array] = field(default_factory=dict)

    @property
    def turns(self) -> Array:
        """True for rotations, shape (n,)."""
        return np.array([node in self.nodes and component > 3 for node, component in self.unknowns])

    def in_si(self, length: float, stiffness: float, mass: float) -> GivenSuperelement:
        """Return it in SI units and in the part's axes, by units of length [m], stiffness [N/m] and mass [kg]."""
        turn = self.to_file(length)
        K, M, D = (u * turn.T @ A @ turn for u, A in ((stiffness, self.K), (mass, self.M), (stiffness, self.D)))
        return GivenSuperelement(self.unknowns, K, M, D, {k: length * np.asarray(x) for k, x in self.nodes.items()})

    def to_file(self, length: float) -> Array:
        """Return the file's unknowns by those in the part's axes and in m, (n, n), up to a factor of all.

        Raises
        ------
        ValueError
            A node has a component that is no displacement or rotation, or axes of its own and one or two displacements
            or rotations alone.
        """
        for node, component in self.unknowns:
            if node in self.nodes and not 1 <= component <= 6:
                raise ValueError(f"node {node} has component {component}; 1 to 3 are displacements, 4 to 6 rotations")
        turn = np.diag(np.where(self.turns, length, 1.0))
        place = {unknown: k for k, unknown in enumerate(self.unknowns)}
        for node, Q in self.axes.items():
            for first in (1, 4):
                own = [place[node, c] for c in range(first, first + 3) if (node, c) in place]
                if len(own) not in (0, 3):
                    raise ValueError(f"node {node} has axes of its own and {len(own)} of three unknowns in them")
                if own:
                    turn[np.ix_(own, own)] = turn[own[0], own[0]] * Q.T
        return turn


def superelement_data(
    path: Path, given: GivenSuperelement, mass: float | None = None, recovery: Recovery | None = None
) -> ModalData:
    """Return the data of a superelement's body: its free modes as shapes, all that its coordinates have.

    Parameters
    ----------
    path : Path
        Its file, for messages.
    given : GivenSuperelement
        In SI units.
    mass : float, optional
        Mass of the whole body, which the matrix is to have [kg].
    recovery : Recovery, optional
        Points within the body.

    Raises
    ------
    InputError
        No node has a place.
    AccuracyError
        A matrix is zero or isn't symmetric, a rigid motion isn't free or has an inertia that no body has, or another
        mass than the body; a motion without mass has no stiffness; with the figure.
    """
    for what, A in (("stiffness", given.K), ("mass", given.M)):
        if not A.any():
            raise AccuracyError(f"{path}: all entries of the {what} matrix are zero")
        if not (apart := float(np.abs(A - A.T).max() / np.abs(A).max())) < SYMMETRIC:
            raise AccuracyError(f"{path}: the {what} isn't symmetric, entries differ by {apart:.1e} of the largest")
    used = np.flatnonzero(given.K.any(axis=1) | given.M.any(axis=1))  # rotations of solids' nodes have neither
    unknowns, used_of = tuple(given.unknowns[k] for k in used), np.ix_(used, used)
    given = replace(given, unknowns=unknowns, K=given.K[used_of], M=given.M[used_of], D=given.D[used_of])
    recovery = recovery and recovery._replace(matrix=recovery.matrix[:, :, used])
    places = {node: x for node, x in given.nodes.items() if any(node == own for own, _ in given.unknowns)}
    if not places:
        raise InputError(
            str(path), "", None, "no unknown is of a node with a place; name a file of nodes by body.nodes"
        )
    x = np.array([*places.values()])
    size = _body_size(path, given.M, _rigid_motions(given, x.mean(axis=0), 1.0), x)
    scale = np.where(given.turns, 1.0 / size, 1.0)  # unknowns of one unit
    K, M = (scale[:, None] * (A + A.T) / 2 * scale for A in (given.K, given.M))
    R = _rigid_motions(given, x.mean(axis=0), size)
    total, centre, second = _rigid_inertia(path, M, R, size, mass)
    omega2, V = _free_modes(path, K, M, R)
    _require_matter(path, K, M, R, total, size, omega2[0])
    centre = x.mean(axis=0) + centre
    V = V * scale[:, None]  # of given unknowns
    nodes, U = _node_shapes(given, places, V), np.array([_rows(given, node) for node in places])
    H = affine_products(K, M, V / scale[:, None], U * scale, x - centre, second)
    points = list(zip(x, U @ V, strict=True))
    if recovery is not None:
        unknown, moved = np.full((3, V.shape[1]), np.nan), recovery.matrix @ V
        points += list(zip(recovery.x, moved, strict=True))
        within = zip(map(str, recovery.labels), recovery.x, moved, strict=True)
        nodes = {label: MarkerShapes(at, shapes, unknown) for label, at, shapes in within} | nodes
    C, text = directional_mass(points, omega2, total, centre, second)
    note = f"how its deformation's inertia divides among directions isn't in a superelement; it is taken {text}"
    n = len(omega2)
    G, S = np.zeros((3, 3, 1 + n, 1 + n)), np.zeros((3, 1 + n))
    G[:, :, 0, 0] = second + total * np.outer(centre, centre)
    H = within_schwarz(H, C, second)
    G[:, :, 0, 1:] = H
    G[:, :, 1:, 0] = H.transpose(1, 0, 2)
    G[:, :, 1:, 1:] = C
    S[:, 0] = total * centre
    damping = V.T @ ((given.D + given.D.T) / 2) @ V
    return ModalData(InertiaIntegrals(G, S, total), np.diag(omega2), damping, nodes, (note,))


def _rigid_motions(given: GivenSuperelement, centre: Array, size: float) -> Array:
    """Return rigid motions about a centre in unknowns of one unit, turned by 1 / size, shape (n, 6)."""
    R = np.zeros((len(given.unknowns), 6))
    for row, (node, component) in zip(R, given.unknowns, strict=True):
        if node in given.nodes and component <= 3:
            row[:] = rigid_motions((given.nodes[node][None] - centre) / size)[0, component - 1]
        elif node in given.nodes:
            row[component - 1] = 1.0
    return R


def _body_size(path: Path, M: Array, R: Array, x: Array) -> float:
    """Return the nodes' extent, or if it is longer the diagonal of an even box of the body's second moments [m]."""
    H = R.T @ M @ R
    total, _, J = _moments(H)
    if not total > 0.0:
        raise AccuracyError(f"{path}: no mass matrix: moved as a whole the body has {total:.3g} kg")
    radius2 = max(0.5 * float(np.trace(J)) / total, 0.0)
    size = max(float(np.linalg.norm(np.ptp(x, axis=0))), float(np.sqrt(12.0 * radius2)))
    if not size > 0.0:
        raise AccuracyError(f"{path}: {len(x)} nodes at one place tell no rotation of the body; retain more of them")
    return size


def _moments(H: Array) -> tuple[float, Array, Array]:
    """Return mass, centre of mass (3,) and inertia tensor about it (3, 3) of the inertia (6, 6) of rigid motions."""
    total = float(np.trace(H[:3, :3]) / 3)
    centre = 0.5 * np.einsum("abc,bc->a", EPSILON, H[:3, 3:]) / (total or 1.0)
    square = float(centre @ centre) * np.eye(3) - np.outer(centre, centre)
    return total, centre, 0.5 * (H[3:, 3:] + H[3:, 3:].T) - total * square


def _rigid_inertia(path: Path, M: Array, R: Array, size: float, wanted: float | None) -> tuple[float, Array, Array]:
    """Return mass [kg], centre of mass from the nodes' mean [m] and second moments about it (3, 3) [kg m²]."""
    H = R.T @ M @ R
    total, centre, J = _moments(H)  # of lengths in parts of the size
    masses = H[:3, :3].diagonal()
    apart = float(np.abs(H[:3, :3] - total * np.eye(3)).max() / total)
    across = 0.5 * (H[:3, 3:] + H[:3, 3:].T)
    if not max(apart, float(np.abs(across).max() / total)) < RIGID_INERTIA:
        given = ", ".join(f"{m:.6g}" for m in masses)
        raise AccuracyError(
            f"{path}: moved along x, y and z the body has {given} kg, and its moments are none of a body's; unknowns "
            "of nodes are missing, or are in axes of their own"
        )
    if wanted is not None and not abs(total / wanted - 1.0) < RIGID_INERTIA:
        raise AccuracyError(
            f"{path}: the mass matrix has {total:.6g} kg, and body.mass is {wanted:.6g} kg; check mass_unit, and that "
            "the superelement has all masses"
        )
    second = 0.5 * np.trace(J) * np.eye(3) - J
    moments, axes = np.linalg.eigh(second)
    about = eigvalsh(J)
    if not (moments[0] > -RIGID_INERTIA * moments[2] and about[0] > LEAST_MOMENT * about[2]):
        raise AccuracyError(
            f"{path}: no body has moments of inertia of {', '.join(f'{j:.3g}' for j in size**2 * about)} kg m² about "
            "its centre of mass: its nodes, on one line perhaps, don't tell how it turns; retain more of them, or "
            "their rotations"
        )
    return total, size * centre, size**2 * (axes * np.maximum(moments, 0.0)) @ axes.T


def _free_modes(path: Path, K: Array, M: Array, R: Array) -> tuple[Array, Array]:
    """Return squared frequencies (n,) and mass-orthonormal shapes of the free body, without rigid motions."""
    weight, axes = np.linalg.eigh(M)
    light = weight < MASSLESS * weight[-1]
    if weight[0] < -MASSLESS * 1e3 * weight[-1]:
        raise AccuracyError(f"{path}: the mass isn't positive: a combination of unknowns has {weight[0]:.2e} kg")
    Z, N = axes[:, ~light], axes[:, light]
    if light.any():  # massless motions follow the others
        rest = N.T @ K @ N
        stiff = eigvalsh(rest)
        if not stiff[0] > NO_FREQUENCY * np.abs(K).max():
            raise AccuracyError(
                f"{path}: {np.count_nonzero(light)} motions have no mass, and one has no stiffness either"
            )
        Z = Z - N @ np.linalg.solve(rest, N.T @ K @ Z)
    B = Z @ null_space(R.T @ M @ Z)
    omega2, turn = eigh(B.T @ K @ B, B.T @ M @ B)
    if not omega2[0] > NO_FREQUENCY * omega2[-1]:
        raise AccuracyError(
            f"{path}: a motion that isn't rigid has no stiffness: ω² = {omega2[0]:.1e} rad²/s² beside {omega2[-1]:.1e}"
        )
    return omega2, B @ turn


def _require_matter(path: Path, K: Array, M: Array, R: Array, mass: float, size: float, omega2: float) -> None:
    """Raise ``AccuracyError`` if rigid motions have forces, or no matter is so dense or so stiff."""
    terms, inertia = ((np.abs(A) @ np.abs(R)).max(axis=0) for A in (K, M))
    defect = np.abs(K @ R).max(axis=0) / np.maximum(terms, omega2 * inertia)  # a node alone has terms of round-off
    support = np.abs(eigh(R.T @ K @ R, R.T @ M @ R, eigvals_only=True)).max() / omega2
    if not (defect.max() < RIGID_FORCE and support < SUPPORT_STIFFNESS):
        raise AccuracyError(
            f"{path}: the body isn't free: {RIGID_MOTIONS[int(defect.argmax())]} as a whole it answers with "
            f"{defect.max():.1e} of its forces (at most {RIGID_FORCE:.0e}), with {100 * support:.2g} % of the "
            f"stiffness of its first mode (at most {100 * SUPPORT_STIFFNESS:g} %); reduce it without supports, "
            "check unit of body, write all digits"
        )
    if mass / size**3 > DENSEST or size * np.sqrt(omega2) / np.pi > FASTEST_WAVE:
        raise AccuracyError(
            f"{path}: {mass:.3g} kg within {1e3 * size:.3g} mm and a first frequency of "
            f"{np.sqrt(omega2) / (2 * np.pi):.3g} Hz are of no matter; check unit, stiffness_unit and mass_unit of body"
        )


def _rows(given: GivenSuperelement, node: int) -> Array:
    """Return the displacements of a boundary node by the unknowns, shape (3, n)."""
    rows = np.zeros((3, len(given.unknowns)))
    for k, (own, component) in enumerate(given.unknowns):
        if own == node and component <= 3:
            rows[component - 1, k] = 1.0
    return rows


def _node_shapes(given: GivenSuperelement, places: Mapping[int, Array], V: Array) -> dict[str, MarkerShapes]:
    """Return the boundary nodes with all three displacements, by label; rotations are NaN without unknowns."""
    place = {unknown: k for k, unknown in enumerate(given.unknowns)}
    found, none = dict[str, MarkerShapes](), np.full((3, V.shape[1]), np.nan)
    for node, x in places.items():
        rows = [place.get((node, component), -1) for component in range(1, 7)]
        if min(rows[:3]) >= 0:
            found[str(node)] = MarkerShapes(x, V[rows[:3]], V[rows[3:]] if min(rows[3:]) >= 0 else none)
    return found
