"""Bodies of superelements that other programs have made: matrices of boundary nodes and modal coordinates.

Rigid motions and free vibration follow from stiffness and mass alone, whatever the coordinates are (Craig & Bampton
1968, Guyan 1965). Of the products ``∫ f g dm`` of 1, x and the free modes ψ a reduced mass tells all that equations of
motion take in first order: mass, centre, inertia tensor, ``∫ ψ = 0``, ``∫ x × ψ = 0`` and ``∫ ψ_j · ψ_k = δ_jk``. What
it doesn't tell, ``∫ x_(a ψ_b)`` and how ``∫ ψ_ja ψ_kb`` divides among directions, comes from points of known motion.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.linalg import eigh, eigvalsh, null_space
from scipy.optimize import nnls

from fmd.core.arrays import EPSILON, Array
from fmd.core.errors import AccuracyError, InputError
from fmd.core.limits import files as limits
from fmd.core.limits.files import EVEN_MASS, FITTED_MODES, LEAST_STRAIN, SEEN_MASS
from fmd.core.limits.modes import MASSLESS, NO_FREQUENCY
from fmd.core.rotations import RIGID_MOTIONS, rigid_motions
from fmd.reduction.body import MarkerShapes
from fmd.reduction.given_superelement import GivenSuperelement, Recovery
from fmd.reduction.inertia import InertiaIntegrals
from fmd.reduction.modal_data import ModalData


def affine_products(K: Array, M: Array, V: Array, U: Array, r: Array, second: Array) -> Array:
    """Return ``∫ r_a ψ_b = ∫ r_b ψ_a`` of free modes, (3, 3, n), through the mass matrix and evenly strained points.

    The field ``r_a e_b`` is nearly that of the unknowns y by which the points move so, and which strain the body least;
    then ``∫ ψ · (r_a e_b) dm`` is ``ψᵀ M y``: to all digits where a bar is stretched. Of two directions, in principal
    axes, r is taken along the one in which the body is thinner, where the field is smaller.

    Of the free modes V (n_unknowns, n) and points U (n_points, 3, n_unknowns), the latter are at r (n_points, 3) from
    the centre of mass [m], about which ``second`` (3, 3) are the body's second moments [kg m²].
    """
    Q = np.linalg.eigh(second)[1]
    pairs = np.array([(a, b) for a in range(3) for b in range(a, 3)])  # moments ascend
    flat = U.reshape(-1, len(K))
    fields = np.einsum("ip,cp->icp", (r @ Q)[:, pairs[:, 0]], Q[:, pairs[:, 1]]).reshape(len(flat), -1)
    pull = flat.T @ flat
    y = np.linalg.lstsq(pull + LEAST_STRAIN * np.trace(pull) / np.trace(K) * K, flat.T @ fields, rcond=None)[0]
    H = np.zeros((3, 3, V.shape[1]))
    H[pairs[:, 0], pairs[:, 1]] = H[pairs[:, 1], pairs[:, 0]] = (V.T @ (M @ y)).T
    return np.asarray(np.einsum("ac,bd,cdj->abj", Q, Q, H))


def directional_mass(
    points: Sequence[tuple[Array, Array]], omega2: Array, mass: float, centre: Array, second: Array
) -> tuple[Array, str]:
    """Return ``∫ ψ_ja ψ_kb`` of free modes, shape (3, 3, n, n), as points of known motion tell it, and how well.

    Masses of the points are fitted to what is known: mass [kg], centre of mass (3,) [m] and second moments about it (3,
    3) [kg m²]. Of the lowest modes, as many as they have masses of, shapes are combined so that all modal masses are
    exact. The others have their points' directions, and no coupling. Points have a place (3,) and displacements (3, n)
    by each mode, of unit modal mass and ascending ω² (n,).
    """
    n = len(omega2)
    x, shapes = (np.array(column) for column in zip(*points, strict=True))
    r, few = x - centre, min(n, FITTED_MODES)
    lower = np.sqrt(omega2[0] / omega2[:few])  # the lower a mode, the more it counts
    pair, upper = np.triu_indices(few), np.triu_indices(3)
    products = np.einsum("iaj,iak->jki", shapes[:, :, :few] * lower, shapes[:, :, :few] * lower)[pair]
    moments, spread = np.einsum("ia,ib->abi", r, r)[upper], float(np.trace(second))
    rows = np.concatenate([np.ones((1, len(r))) / mass, r.T / np.sqrt(mass * spread), moments / spread, products])
    wanted = np.concatenate([[1.0], np.zeros(3), second[upper] / spread, np.diag(lower**2)[pair]])
    w = nnls(rows, wanted)[0]
    exact = np.diag([mass, 0.0, 0.0, 0.0])
    exact[1:, 1:] = second + 1e-9 * spread * np.eye(3)
    functions = np.concatenate([np.ones((len(r), 1)), r], axis=1)
    w = w / max(1.0, float(eigh((functions.T * w) @ functions, exact, eigvals_only=True)[-1]))  # no more than there is
    R, each = rigid_motions(r).reshape(-1, 6), np.sqrt(np.repeat(w, 3))[:, None]
    flat = shapes.reshape(len(R), n)
    flat = flat - R @ np.linalg.lstsq(each * R, each * flat, rcond=None)[0]
    T, shapes = (flat * each).T @ (flat * each), flat.reshape(shapes.shape)
    k = next((k for k in range(n, 0, -1) if np.linalg.eigvalsh(T[:k, :k])[0] > SEEN_MASS), 0)
    own = np.einsum("i,iaj,ibj->jab", w, shapes, shapes)
    own[~own.any(axis=(1, 2))] = np.eye(3)
    C = np.zeros((3, 3, n, n))
    C[:, :, np.arange(n), np.arange(n)] = (own / np.einsum("jaa->j", own)[:, None, None]).transpose(1, 2, 0)
    shown, axes = np.linalg.eigh(T[:k, :k])
    low = shapes[:, :, :k] @ ((axes / np.sqrt(shown)) @ axes.T)
    C[:, :, :k, :k] = np.einsum("i,iaj,ibk->abjk", w, low, low)
    C = (1.0 - EVEN_MASS) * C + EVEN_MASS / 3 * np.einsum("ab,jk->abjk", np.eye(3), np.eye(n))
    error = float(np.abs(T.diagonal()[:k] - 1.0).max(initial=0.0))
    return C, f"of {k} of {n} shapes from {len(r)} points, which have their masses to {error:.1e}"


def within_schwarz(H: Array, C: Array, second: Array) -> Array:
    """Return ``∫ r_(a ψ_b)`` no larger than second moments and modal masses allow, in the body's principal axes."""
    moments, Q = np.linalg.eigh(second)
    turned = np.einsum("ac,bd,abj->cdj", Q, Q, H)
    masses = np.einsum("ac,bc,abjj->cj", Q, Q, C)
    most = np.sqrt(np.maximum(moments, 0.0)[:, None, None] * masses[None])
    most = np.minimum(most, most.swapaxes(0, 1))
    return np.asarray(np.einsum("ac,bd,cdj->abj", Q, Q, np.clip(turned, -most, most)))


def superelement_data(
    path: Path, given: GivenSuperelement, mass: float | None = None, recovery: Recovery | None = None
) -> ModalData:
    """Return the data of a superelement's body: its free modes as shapes, all that its coordinates have.

    All is in SI units. Messages name its file; a mass is what its matrix is to have [kg], a recovery has points within
    the body.

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
        if not (apart := float(np.abs(A - A.T).max() / np.abs(A).max())) < limits.SYMMETRIC:
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
    size = _body_size(path, given.M, given.rigid_motions(x.mean(axis=0), 1.0), x)
    scale = np.where(given.turns, 1.0 / size, 1.0)  # unknowns of one unit
    K, M = (scale[:, None] * (A + A.T) / 2 * scale for A in (given.K, given.M))
    R = given.rigid_motions(x.mean(axis=0), size)
    total, centre, second = _rigid_inertia(path, M, R, size, mass)
    omega2, V = _free_modes(path, K, M, R)
    _require_matter(path, K, M, R, total, size, omega2[0])
    centre = x.mean(axis=0) + centre
    V = V * scale[:, None]  # of given unknowns
    nodes, U = given.node_shapes(V), np.array([given.displacements(node) for node in places])
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
    if not max(apart, float(np.abs(across).max() / total)) < limits.RIGID_INERTIA:
        given = ", ".join(f"{m:.6g}" for m in masses)
        raise AccuracyError(
            f"{path}: moved along x, y and z the body has {given} kg, and its moments are none of a body's; unknowns "
            "of nodes are missing, or are in axes of their own"
        )
    if wanted is not None and not abs(total / wanted - 1.0) < limits.RIGID_INERTIA:
        raise AccuracyError(
            f"{path}: the mass matrix has {total:.6g} kg, and body.mass is {wanted:.6g} kg; check mass_unit, and that "
            "the superelement has all masses"
        )
    second = 0.5 * np.trace(J) * np.eye(3) - J
    moments, axes = np.linalg.eigh(second)
    about = eigvalsh(J)
    if not (moments[0] > -limits.RIGID_INERTIA * moments[2] and about[0] > limits.LEAST_MOMENT * about[2]):
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
    if not (defect.max() < limits.RIGID_FORCE and support < limits.SUPPORT_STIFFNESS):
        raise AccuracyError(
            f"{path}: the body isn't free: {RIGID_MOTIONS[int(defect.argmax())]} as a whole it answers with "
            f"{defect.max():.1e} of its forces (at most {limits.RIGID_FORCE:.0e}), with {100 * support:.2g} % of the "
            f"stiffness of its first mode (at most {100 * limits.SUPPORT_STIFFNESS:g} %); reduce it without supports, "
            "check unit of body, write all digits"
        )
    if mass / size**3 > limits.DENSEST or size * np.sqrt(omega2) / np.pi > limits.FASTEST_WAVE:
        raise AccuracyError(
            f"{path}: {mass:.3g} kg within {1e3 * size:.3g} mm and a first frequency of "
            f"{np.sqrt(omega2) / (2 * np.pi):.3g} Hz are of no matter; check unit, stiffness_unit and mass_unit of body"
        )
