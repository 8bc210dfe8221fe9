"""Displacement of second order as fields of a body's points, so that its kinetic energy is that of a motion.

Of the displacement of second order Γ(q) a stiffened body knows momenta: integrals of its products with translations,
rotations and strains of the whole body (``displacement2``, ``rotation2`` and ``stiffening``). Among all fields with
these momenta the one of least mass is affine in the place x:

    Γ = Σ_k s_k B_k (1, x)        s_k = ½ qᵀ F_k q

So s are further modal coordinates, which follow from q, and their inertia integrals follow from those that are known.
The kinetic energy of points that move by ``Φ q + Γ`` is never negative, which is not so if a part of it is left out. By
Schwarz's inequality it takes no more of Γ's own than there is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmd.core.arrays import EPSILON, Array
from fmd.core.limits.rank import DEPENDENT_FIELD, FIELD_ROUND_OFF


@dataclass(frozen=True)
class SecondOrderFields:
    """Affine fields of unit mass, orthogonal to each other, by which a body's points move in second order.

    Attributes
    ----------
    F : ndarray, shape (k, n, n)
        Coordinates ``½ qᵀ F_k q``.
    W : ndarray, shape (k, n)
        Modal mass between fields and modes.
    G, S : ndarray, shapes (3, 3, 1 + n + k, 1 + n + k) and (3, 1 + n + k)
        Inertia integrals as `InertiaIntegrals` has them, with the fields behind the modes.
    """

    F: Array
    W: Array
    G: Array
    S: Array


def second_order_fields(
    G: Array, S: Array, mass: float, stiffening: Array, displacement2: Array, rotation2: Array, normal: int = -1
) -> SecondOrderFields | None:
    """Return the fields of a body whose inertia integrals are those of an `InertiaIntegrals`; ``None`` if it has none.

    Momenta that are empty aren't known, others are what they are, and zero if they are zero.
    """
    across = [a for a in range(3) if a != normal]
    turns = range(3) if normal < 0 else [normal]
    tests = [_affine(np.eye(3)[a], np.zeros((3, 3))) for a in across] if displacement2.size else []
    momenta = [displacement2[a] for a in across] if displacement2.size else []
    pure = G.copy()
    if stiffening.size:
        pure[:, :, 1:, 1:] += stiffening
        ways = _stiffening_ways(stiffening)
        tests += [_affine(np.zeros(3), way) for way in ways]
        momenta += [-np.tensordot(way, stiffening, 2) for way in ways]
    if rotation2.size:
        tests += [_affine(np.zeros(3), -EPSILON[a]) for a in turns]
        momenta += [rotation2[a] for a in turns]
    if not tests:
        return None
    T = np.block([[np.array([[mass]]), S[None, :, 0]], [S[:, :1], pure[:, :, 0, 0]]])
    B, F = _orthogonal(tests, momenta, T)
    sizes = np.abs(F).max(axis=(1, 2), initial=0.0)
    kept = sizes > FIELD_ROUND_OFF * sizes.max(initial=0.0)
    if not kept.any():
        return None
    B = B[kept]
    places = np.concatenate([S[None], pure[:, :, 0]])  # (1, x) with positions and shapes
    mixed = np.einsum("kac,cbi->abki", B, places)
    own = np.einsum("kac,cd,lbd->abkl", B, T, B)
    more = np.block([[pure, mixed.transpose(1, 0, 3, 2)], [mixed, own]])
    return SecondOrderFields(
        F[kept], np.einsum("aaki->ki", mixed)[:, 1:], more, np.concatenate([S, np.einsum("kac,c->ak", B, T[0])], axis=1)
    )


def _affine(shift: Array, slope: Array) -> Array:
    """Return the field ``shift + slope x``, shape (3, 4)."""
    return np.concatenate([shift[:, None], slope], axis=1)


def _stiffening_ways(stiffening: Array) -> Array:
    """Return the symmetric pairs of axes for which momenta are known, shape (k, 3, 3).

    Of a motion in a plane it is the sum across its normal alone, of which each axis has half; otherwise all six.
    """
    ways, sizes, _ = np.linalg.svd(stiffening.reshape(9, -1), full_matrices=False)
    way = ways[:, 0].reshape(3, 3) * np.sign(ways[0, 0] + ways[4, 0] + ways[8, 0]) * np.sqrt(2.0)
    if not (sizes[1:] > FIELD_ROUND_OFF * sizes[0]).any() and np.allclose(way @ way, way):
        return np.asarray(way[None])
    units = np.eye(9).reshape(9, 3, 3)[[0, 4, 8, 1, 2, 5]]
    return np.asarray(units + units.swapaxes(1, 2))


def _orthogonal(tests: list[Array], momenta: list[Array], T: Array) -> tuple[Array, Array]:
    """Return fields of unit mass that span test fields, (k, 3, 4), and their momenta, by Gram and Schmidt, twice."""
    fields, forms = list[Array](), list[Array]()
    for test, form in zip(tests, momenta, strict=True):
        rest, left = test, form
        for _ in range(2):
            for B, F in zip(fields, forms, strict=True):
                share = float(np.sum((rest @ T) * B))
                rest, left = rest - share * B, left - share * F
        square = float(np.sum((rest @ T) * rest))
        if square > DEPENDENT_FIELD * float(np.sum((test @ T) * test)):
            fields.append(rest / np.sqrt(square))
            forms.append(left / np.sqrt(square))
    return np.array(fields), np.array(forms)
