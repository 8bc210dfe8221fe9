"""Families of modes (bending, torsion, axial) by symmetry and kinetic energy, never by place in the list."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import AccuracyError
from fmd.core.limits.modes import CLEAR_PARITY, PAIR, SAME_FREQUENCY
from fmd.reduction.modes import EigenPairs, Modes, TooManyModesError

if TYPE_CHECKING:
    from fmd.fem.model import FEModel
    from fmd.reduction.eigen import FreeBodySolver

# Parity about the plane of motion, parity about the plane through the long axis normal to it.
_FAMILY_OF_PARITY = {
    (1, -1): "in-plane bending",
    (-1, 1): "out-of-plane bending",
    (-1, -1): "torsion",
    (1, 1): "axial",
}
# Direction of most of the kinetic energy: along the bar, across it in the plane, normal to the plane.
_MAIN_DIRECTION = {"axial": 0, "in-plane bending": 1, "out-of-plane bending": 2}


def lowest_modes(solver: FreeBodySolver, count: int, constraints: Array | None = None) -> Modes:
    """Return the lowest elastic modes of any family, the last group of equal frequency complete.

    What completes that group comes on top of ``count``; without columns (n_nodes, 3, k) of constraints the body is
    free.

    Raises
    ------
    TooManyModesError
        The mesh has fewer.
    """
    pairs = complete_pairs(solver, count, constraints)
    n = len(pairs.omega)
    numbers = tuple(range(1, n + 1))
    return Modes(
        pairs.omega, pairs.shapes, pairs.n_rigid, pairs.residual, numbers, n_completing=n - count, factor=pairs.factor
    )


def complete_pairs(solver: FreeBodySolver, count: int, constraints: Array | None = None) -> EigenPairs:
    """Return the lowest eigenpairs, ``count`` of them and those of about the frequency of the highest.

    One of a pair alone is an arbitrary direction in the plane of both: a square bar would bend askew to its load.
    The arguments and errors are those of `lowest_modes`.
    """
    most = solver.most_modes(constraints)
    if count > most:
        raise TooManyModesError(f"at most {most} modes can be computed of this mesh; take fewer, or refine it")
    wanted, pairs = count + 1, None
    while True:
        pairs = solver.modes(min(wanted, most), constraints, pairs)
        n = int(np.count_nonzero(pairs.omega <= pairs.omega[count - 1] * (1 + PAIR)))
        if n < len(pairs.omega) or len(pairs.omega) < wanted:
            return replace(pairs, omega=pairs.omega[:n], shapes=pairs.shapes[:, :, :n])
        wanted += n - count + 1


def modes_of_family(
    solver: FreeBodySolver, fe: FEModel, count: int, family: str, normal: Array, constraints: Array | None = None
) -> Modes:
    """Return the ``count`` lowest modes of one family.

    That is ``in-plane bending``, ``out-of-plane bending``, ``torsion`` or ``axial``, by the plane of motion's normal
    (3,). Columns (n_nodes, 3, k) of constraints are as symmetric as the body is.

    Raises
    ------
    AccuracyError
        The body is not symmetric.
    TooManyModesError
        It has too few modes of the family.
    """
    most = solver.most_modes(constraints)
    if count > most:
        raise TooManyModesError(f"at most {most} modes of all families can be computed of this mesh")
    n_all, pairs = 4 * count + 4, None
    while True:
        pairs = solver.modes(min(n_all, most), constraints, pairs)
        families, shapes = classify_modes(fe, pairs, normal)
        # The twin of the highest may be missing, without which its plane is not known.
        all_there = len(pairs.omega) < n_all
        settled = np.full(len(families), all_there) | (pairs.omega < pairs.omega.max() * (1 - SAME_FREQUENCY))
        chosen = [k for k, name in enumerate(families) if name == family and settled[k]][:count]
        if len(chosen) == count:
            numbers = tuple(k + 1 for k in chosen)
            return Modes(
                pairs.omega[chosen], shapes[:, :, chosen], pairs.n_rigid, pairs.residual, numbers, factor=pairs.factor
            )
        if n_all > 40 * count or all_there:
            mend = f"take at most {len(chosen)}" if chosen else "take another family"
            raise TooManyModesError(
                f"only {len(chosen)} {family} modes are among the {len(pairs.omega)} lowest; {mend}"
            )
        n_all += n_all // 2 if 2 * len(chosen) >= count else n_all


def classify_modes(fe: FEModel, pairs: EigenPairs, normal: Array) -> tuple[list[str], Array]:
    """Name the family of each mode of a body with two planes of symmetry, and return shapes that have one.

    A mode's parity about a plane is ``φᵀ M S φ`` with S the reflection: +1 or -1 for a symmetric body. Bending must
    also carry most of its kinetic energy across the bar, the axial family along it; anything else is ``"other"``. Modes
    of equal frequency are first turned within their subspace until each has a parity. The normal (3,) is of the plane
    of motion, a plane of symmetry.

    Raises
    ------
    AccuracyError
        The body is not symmetric.
    """
    parities, shapes, axes = _find_parities(fe, pairs.omega, pairs.shapes, normal)
    energies = np.array([_energy_along(fe, shapes, axis) for axis in axes])
    return [_family(parity, energy) for parity, energy in zip(parities.T, energies.T, strict=True)], shapes


def classify_by_parity(fe: FEModel, omega: Array, shapes: Array, normal: Array) -> tuple[list[str], Array]:
    """Name the family of shapes by their two parities alone, as of static deflections of a short piece.

    Arguments, results and errors are those of `classify_modes`; ``omega`` (n,) [rad/s] tells which shapes are equal.
    """
    parities, shapes, _ = _find_parities(fe, omega, shapes, normal)
    names = (_FAMILY_OF_PARITY[int(a), int(b)] for a, b in np.sign(parities).T)
    clear = np.abs(parities).min(axis=0) > CLEAR_PARITY
    return [name if sure else "other" for name, sure in zip(names, clear.tolist(), strict=True)], shapes


def _find_parities(
    fe: FEModel, omega: Array, shapes: Array, normal: Array
) -> tuple[Array, Array, tuple[Array, Array, Array]]:
    """Return both parities (2, n) of shapes, these turned where frequencies are equal, and the body's three axes."""
    n = normal / np.linalg.norm(normal)
    centre = fe.m.sum(axis=0) @ fe.x / fe.mass
    x = fe.x - centre
    along = _long_axis(fe, x, n)
    across = np.cross(n, along)
    reflections = [_Reflection(x, axis) for axis in (n, across)]
    shapes = shapes.copy()
    Mshapes = _times_mass(fe, shapes)
    for group in _equal_frequencies(omega):
        if len(group) > 1:
            parity = [np.tensordot(Mshapes[..., group], r(shapes[..., group]), ((0, 1), (0, 1))) for r in reflections]
            mixed = parity[0] + 2 * parity[1]  # the four families have the values ±1 ± 2
            turn = np.linalg.eigh(mixed + mixed.T)[1]
            shapes[..., group], Mshapes[..., group] = shapes[..., group] @ turn, Mshapes[..., group] @ turn
    parities = np.array([np.einsum("iak,iak->k", Mshapes, reflect(shapes)) for reflect in reflections])
    return parities, shapes, (along, across, n)


def _family(parity: Array, energy: Array) -> str:
    """Family of a mode by its two parities and its energies along and across the bar and normal to the plane."""
    if not (np.abs(parity) > 0.5).all():
        return "other"
    family = _FAMILY_OF_PARITY[int(np.sign(parity[0])), int(np.sign(parity[1]))]
    return family if energy.argmax() == _MAIN_DIRECTION.get(family, energy.argmax()) else "other"


class _Reflection:
    """Reflection of nodal fields in a plane through the origin, by the nodes nearest to the mirror images."""

    def __init__(self, x: Array, normal: Array) -> None:
        self._H = np.eye(3) - 2 * np.outer(normal, normal)
        tree = cKDTree(x)
        distance, image = tree.query(x @ self._H)
        self._image: IntArray = np.asarray(image)
        spacing = np.asarray(tree.query(x, k=2)[0])[:, 1].max()
        if np.max(distance) > spacing:
            raise AccuracyError(
                f"the body is not symmetric about the plane with normal {np.round(normal, 6).tolist()} "
                f'({np.max(distance):.2e} m off), so its modes have no families; use family = "any"'
            )

    def __call__(self, u: Array) -> Array:
        return np.asarray(np.einsum("ab,ibk->iak", self._H, u[self._image]))


def _long_axis(fe: FEModel, x: Array, normal: Array) -> Array:
    """Direction of the largest second moment in the plane of motion, shape (3,)."""
    second = x.T @ (fe.m @ x)
    in_plane = np.eye(3) - np.outer(normal, normal)
    return np.asarray(np.linalg.eigh(in_plane @ second @ in_plane)[1][:, -1])


def _times_mass(fe: FEModel, u: Array) -> Array:
    """Product of the mass matrix with fields u (n_nodes, 3, n)."""
    return np.asarray((fe.m @ u.reshape(len(u), -1)).reshape(u.shape))


def _energy_along(fe: FEModel, u: Array, axis: Array) -> Array:
    """Twice the kinetic energy of each field's motion along an axis, shape (n,)."""
    component = np.einsum("iak,a->ik", u, axis)
    return np.asarray(np.einsum("ik,ik->k", component, fe.m @ component))


def _equal_frequencies(omega: Array) -> list[list[int]]:
    """Group the numbers of modes by equal frequency, lowest first."""
    groups: list[list[int]] = []
    for k in np.argsort(omega):
        if groups and omega[k] - omega[groups[-1][-1]] < SAME_FREQUENCY * omega[k]:
            groups[-1].append(k)
        else:
            groups.append([k])
    return groups
