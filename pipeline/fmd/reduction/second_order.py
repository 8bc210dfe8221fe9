"""Displacement of second order as fields of a body's points and as modal mass, with the kinetic energy of a motion.

Of the displacement of second order Γ(q) a stiffened body knows momenta: integrals of its products with translations,
rotations and strains of the whole body (``displacement2``, ``rotation2`` and ``stiffening``). Among all fields with
these momenta the one of least mass is affine in the place x:

    Γ = Σ_k s_k B_k (1, x)        s_k = ½ qᵀ F_k q

So s are further modal coordinates, which follow from q, and their inertia integrals follow from those that are known.
The kinetic energy of points that move by ``Φ q + Γ`` is never negative, which is not so if a part of it is left out. By
Schwarz's inequality it takes no more of Γ's own than there is.

A body whose points move by ``Φ q + Γ(q)``, Γ quadratic in q, has of Γ̇ what is linear in it: its momenta ``F_a q · q̇``,
by which it couples frame and modes. They alone make a kinetic energy that can be negative. The square of Γ̇ and its
product with ``Φ q̇`` are missing. Both are known for the rigid part of Γ̇, the rigid motion ``τ q̇`` that has its momenta,
``M₀ τ = F q``. They add the modal mass

    W₀ᵀ τ + τᵀ W₀ + τᵀ M₀ τ = Σ_a (g_a f_aᵀ + f_a g_aᵀ) + Σ_ab N_ab f_a f_bᵀ      f_a = F_a q, g = M₀⁻¹ W₀, N = M₀⁻¹

with the inertia M₀ of the undeformed frame and its coupling W₀ with the modes. Since ``f_a · q̇`` is the rate of
``½ qᵀ F_a q``, Lagrange's equations have no forces of it but this mass times the accelerations, and
``Σ_a β_a (g_a + Σ_b N_ab f_b)`` with ``β_a = q̇ᵀ F_a q̇``.
"""

import numpy as np

from fmd.core.arrays import EPSILON, Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.mechanism import NO_MASS_LEFT
from fmd.core.limits.rank import DEPENDENT_FIELD, FIELD_ROUND_OFF


@dataclass(frozen=True)
class SecondOrderFields:
    """Affine fields of unit mass, orthogonal to each other, by which a body's points move in second order."""

    F: Array  # (k, n, n): coordinates ``½ qᵀ F_k q``
    W: Array  # (k, n): modal mass between fields and modes
    G: Array  # (3, 3, 1 + n + k, 1 + n + k): integrals as `InertiaIntegrals` has them, the fields behind the modes
    S: Array  # (3, 1 + n + k): integrals as `InertiaIntegrals` has them, likewise


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
        directions = _stiffening_directions(stiffening)
        tests += [_affine(np.zeros(3), direction) for direction in directions]
        momenta += [-np.tensordot(direction, stiffening, 2) for direction in directions]
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


def _stiffening_directions(stiffening: Array) -> Array:
    """Return the symmetric pairs of axes for which momenta are known, shape (k, 3, 3).

    Of a motion in a plane it is the sum across its normal alone, of which each axis has half; otherwise all six.
    """
    directions, sizes, _ = np.linalg.svd(stiffening.reshape(9, -1), full_matrices=False)
    direction = (
        directions[:, 0].reshape(3, 3) * np.sign(directions[0, 0] + directions[4, 0] + directions[8, 0]) * np.sqrt(2.0)
    )
    if not (sizes[1:] > FIELD_ROUND_OFF * sizes[0]).any() and np.allclose(direction @ direction, direction):
        return np.asarray(direction[None])
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


@dataclass(frozen=True)
class SecondOrderMass:
    """Constants of the modal mass that displacements of second order bring, by the momenta that they have."""

    F: Array  # (k, n, n): momenta ``q̇ᵀ F_a q`` of displacements of second order, those that aren't 0
    g: Array  # (k, n): rows of ``M₀⁻¹ W₀``
    N: Array  # (k, k): rows and columns of ``M₀⁻¹``

    def matrix(self, q: Array) -> Array:
        """Return the modal mass at modal coordinates q (n,), shape (n, n)."""
        f = self.F @ q
        return np.asarray(self.g.T @ f + f.T @ self.g + f.T @ self.N @ f)


def second_order_mass(
    mass: float, c: Array, J: Array, W: Array, displacement2: Array, rotation2: Array, normal: int = -1
) -> SecondOrderMass | None:
    """Return a body's modal mass by displacements of second order; ``None`` if they have no momenta.

    Mass, first moment c and inertia tensor J are of the undeformed body; W (6, n) couples its frame, translation and
    rotation, with the modes. Displacements of second order have linear and angular momenta (3, n, n), or (3, 0, 0). The
    normal is the number of the only axis that the body turns about, across which it moves; -1 if it moves anyhow.
    """
    n = W.shape[1]
    F = np.concatenate([forms if forms.size else np.zeros((3, n, n)) for forms in (displacement2, rotation2)])
    moves = np.arange(6) if normal < 0 else np.r_[np.delete(np.arange(3), normal), 3 + normal]
    kept = [int(a) for a in moves if F[a].any()]
    if not kept:
        return None
    across = np.cross(np.eye(3), c)
    M = np.block([[mass * np.eye(3), across.T], [across, J]])[np.ix_(moves, moves)]
    sizes = np.sqrt(M.diagonal())
    sizes[sizes == 0.0] = 1.0
    inverse = np.zeros((6, 6))
    inverse[np.ix_(moves, moves)] = np.linalg.pinv(M / np.outer(sizes, sizes), NO_MASS_LEFT, hermitian=True)
    inverse[np.ix_(moves, moves)] /= np.outer(sizes, sizes)
    return SecondOrderMass(F[kept], inverse[kept] @ W, inverse[np.ix_(kept, kept)])
