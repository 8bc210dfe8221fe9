"""The inertia shape integrals: all inertia integrals of a floating frame, exact in the finite element space."""

from dataclasses import field, replace
from functools import cached_property
from typing import Any

import numpy as np

from fmd.core.arrays import Array, read_only, require_shape
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError
from fmd.reduction.second_order import SecondOrderFields, SecondOrderMass, second_order_fields, second_order_mass


@dataclass(frozen=True)
class InertiaIntegrals:
    """Inertia integrals of a body whose points move as ``U_a p`` with ``U_a = [x_a, Φ_a]`` and ``p = (1, q)``."""

    G: Array  # (3, 3, 1 + n, 1 + n): ``G[a, b] = U_aᵀ m U_b``: second moments, moment–mode and mode–mode integrals
    S: Array  # (3, 1 + n): ``S[a] = 1ᵀ m U_a``: first moments
    mass: float  # ``1ᵀ m 1`` [kg]
    # (3, 3, n, n): geometric stiffness that was taken off the modal blocks of G, in which it counts as inertia; empty
    # without
    stiffening: Array = field(default_factory=lambda: np.zeros((3, 3, 0, 0)))
    # (3, n, n): second-order first moments: ``c_a = S_a p + ½ qᵀ displacement2_a q``; empty if they are left out
    displacement2: Array = field(default_factory=lambda: np.zeros((3, 0, 0)))
    # (3, n, n): second-order angular momentum of the deforming, ``qᵀ rotation2_a q̇``; empty if it is left out
    rotation2: Array = field(default_factory=lambda: np.zeros((3, 0, 0)))
    # Number of the only axis that the body turns about: that motion needs only the blocks of G across it, those along
    # it are left out (zero). -1 if G is whole.
    normal: int = -1
    # True if displacements of second order count with all of their kinetic energy, as `second_order_fields` has it.
    whole: bool = False

    def second_moment(self, p: Array) -> Array:
        """``P_ab = ∫ρ r_a r_b`` about the frame's origin, shape (3, 3) [kg m²], at ``p = (1, q)``."""
        return np.asarray(np.einsum("abij,i,j->ab", self.G, p, p))

    def inertia(self, p: Array) -> Array:
        """Inertia tensor about the frame's origin, shape (3, 3) [kg m²]; with a normal, right about that alone."""
        P = self.second_moment(p)
        return np.asarray(np.trace(P) * np.eye(3) - P)

    def mass_matrix(self, p: Array) -> Array:
        """Mass matrix of translation, rotation and modes in body axes, shape (6 + n, 6 + n), at ``p = (1, q)``.

        Raises
        ------
        ValueError
            G lacks its blocks along an axis.
        """
        if self.normal >= 0:
            mend = "FlexiblePart.for_any_motion adds the rest"
            raise ValueError(f"there is no more of the inertia than turning about {'xyz'[self.normal]} takes; {mend}")
        n = len(p) - 1
        if self.fields is not None:
            f = self.fields.F @ p[1:]
            D = np.concatenate([np.eye(6 + n), np.concatenate([np.zeros((len(f), 6)), f], axis=1)])
            extended = InertiaIntegrals(self.fields.G, self.fields.S, self.mass)
            return np.asarray(D.T @ extended.mass_matrix(np.concatenate([p, 0.5 * f @ p[1:]])) @ D)
        S = self.S.copy()
        c = S @ p
        if self.displacement2.size:
            displacement2 = self.displacement2 @ p[1:]
            S[:, 1:] += displacement2
            c = c + 0.5 * displacement2 @ p[1:]
        tilde = np.array([[0, -c[2], c[1]], [c[2], 0, -c[0]], [-c[1], c[0], 0]])
        pG = np.einsum("i,bcij->bcj", p, self.G)
        H = np.stack([pG[1, 2] - pG[2, 1], pG[2, 0] - pG[0, 2], pG[0, 1] - pG[1, 0]])[:, 1:]
        if self.rotation2.size:
            H = H + self.rotation2 @ p[1:]
        M = np.zeros((6 + n, 6 + n))
        M[:3, :3] = self.mass * np.eye(3)
        M[:3, 3:6], M[3:6, :3] = -tilde, tilde
        M[3:6, 3:6] = self.inertia(p)
        M[:3, 6:], M[6:, :3] = S[:, 1:], S[:, 1:].T
        M[3:6, 6:], M[6:, 3:6] = H, H.T
        M[6:, 6:] = np.einsum("aaij->ij", self.G)[1:, 1:]
        if self.stiffening.size:
            M[6:, 6:] += np.einsum("aaij->ij", self.stiffening)
        if self.second_order is not None:
            M[6:, 6:] += self.second_order.matrix(p[1:])
        return M

    @cached_property
    def fields(self) -> SecondOrderFields | None:
        """Displacement of second order as fields, whose kinetic energy counts as a whole; ``None`` if it doesn't."""
        if not self.whole:
            return None
        return second_order_fields(
            self.G, self.S, self.mass, self.stiffening, self.displacement2, self.rotation2, self.normal
        )

    @cached_property
    def second_order(self) -> SecondOrderMass | None:
        """Modal mass of displacements of second order; ``None`` where they have no momenta, or are left out."""
        if not (self.displacement2.size or self.rotation2.size):
            return None
        G = self.G
        H = [G[b, c, 0, 1:] - G[c, b, 0, 1:] for b, c in ((1, 2), (2, 0), (0, 1))]
        W, J = np.concatenate([self.S[:, 1:], H]), self.inertia(np.eye(G.shape[-1])[0])
        return second_order_mass(self.mass, self.S[:, 0], J, W, self.displacement2, self.rotation2, self.normal)


def inertia_integrals(x: Array, m: Any, Phi: Array, normal: int = -1) -> InertiaIntegrals:
    """Integrate a body's inertia terms once, exactly, through its scalar mass matrix m (n_nodes, n_nodes) [kg].

    Undeformed places x (n_nodes, 3) [m] and shapes Φ (n_nodes, 3, n_modes) [kg^-1/2] are in the body frame; ``normal``
    is the number of the only axis that the body turns about, along which G is left out, -1 for all of G. See Zwölfer &
    Gerstmayr, A concise nodal-based derivation of the floating frame of reference formulation for displacement-based
    solid finite elements, Multibody System Dynamics 49 (2020).

    Raises
    ------
    ValueError
        Shapes of the arrays disagree.
    AccuracyError
        ``G[a, b]`` is not the transpose of ``G[b, a]``: m is not symmetric, or something is not finite.
    """
    across = (slice(1, 3), slice(0, 3, 2), slice(0, 2), slice(0, 3))[normal]  # axes; for number -1 all three
    U = _positions(x, Phi, across)
    G = np.zeros((3, 3, U.shape[2], U.shape[2]))
    G[across, across] = _products(U, m, U)
    masses = m @ np.ones(len(x))
    S = np.column_stack([masses @ x, np.reshape(masses @ Phi.reshape(len(x), -1), (3, -1))])
    return InertiaIntegrals(_symmetric(G), read_only(S), float(masses.sum()), normal=normal)


def add_normal_blocks(integrals: InertiaIntegrals, along: Array) -> InertiaIntegrals:
    """Complete integrals that were left out along an axis by the blocks from `normal_blocks`."""
    G, e = integrals.G.copy(), integrals.normal
    G[e] += along
    G[:, e] += along.swapaxes(1, 2)
    G[e, e] -= along[e]
    return replace(integrals, G=_symmetric(G), normal=-1)


def normal_blocks(x: Array, m: Any, Phi: Array, normal: int) -> Array:
    """Integrate ``G[normal]``, shape (3, 1 + n, 1 + n), the blocks that `inertia_integrals` leaves out.

    The arguments are those of `inertia_integrals`.
    """
    e = slice(normal, normal + 1)
    return np.asarray(_products(_positions(x, Phi, e), m, _positions(x, Phi))[0])


def _positions(x: Array, Phi: Array, axes: slice = slice(None)) -> Array:
    """Positions and shapes ``U_a = [x_a, Φ_a]`` along chosen axes, shape (n_nodes, n_axes, 1 + n)."""
    require_shape("x", x, (None, 3))
    require_shape("Phi", Phi, (len(x), 3, None))
    return np.concatenate([x[:, axes, None], Phi[:, axes]], axis=2)


def _products(some: Array, m: Any, others: Array) -> Array:
    """Mass products ``U_aᵀ m U_b``, shape (n_axes, n_axes, 1 + n, 1 + n)."""
    m_some = (m @ some.reshape(len(some), -1)).reshape(some.shape)
    return np.asarray(np.einsum("iaj,ibk->abjk", m_some, others, optimize=True))


def _symmetric(G: Array) -> Array:
    """Return G read-only; raise ``AccuracyError`` if it isn't symmetric or not finite."""
    error = float(np.abs(G - G.transpose(1, 0, 3, 2)).max() / np.abs(G).max())
    if not error < 1e-10:
        raise AccuracyError(f"the inertia shape integrals are not symmetric: relative error {error:.1e}")
    return read_only(G)
