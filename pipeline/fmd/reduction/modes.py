"""Modes of a body as data: eigenpairs, those chosen among them for its basis, and what round-off mixes of them."""

from __future__ import annotations

from dataclasses import field, replace

import numpy as np

from fmd.core.arrays import Array, short_repr
from fmd.core.data_classes import dataclass
from fmd.core.html import table
from fmd.core.limits.modes import ROUNDED_PAIR
from fmd.reduction.factor.figures import FactorFigures


class TooManyModesError(ValueError):
    """More modes are wanted than a mesh has, or than can be computed of it; the message gives their number."""


@dataclass(frozen=True)
class EigenPairs:
    """Eigenpairs of ``K φ = ω² M φ``, ascending, ``Φᵀ M Φ = 1``; the rigid-body modes are counted and left out."""

    omega: Array  # (n,): angular frequencies [rad/s]
    shapes: Array  # (n_nodes, 3, n): mode shapes [kg^-1/2]
    n_rigid: int
    residual: float  # largest defect of ``K φ = ω² M φ`` in the energy norm, relative to the mode's own
    # Solver, size and memory of the factorisation behind them.
    factor: FactorFigures | None = field(default=None, kw_only=True)

    __repr__ = short_repr

    def with_others(self, others: EigenPairs) -> EigenPairs:
        """Return these and other pairs of the same body, which are in few cases between them."""
        omega = np.concatenate([self.omega, others.omega])
        order = np.argsort(omega, kind="stable")
        shapes = np.concatenate([self.shapes, others.shapes], axis=2)[:, :, order]
        return replace(self, omega=omega[order], shapes=shapes, residual=max(self.residual, others.residual))


@dataclass(frozen=True)
class Modes(EigenPairs):
    """Modes that are chosen among the elastic ones of a body, with their places among them."""

    numbers: tuple[int, ...]  # place of each among all elastic modes of the body, from 1
    # Modes beyond the wanted number that complete the group of equal frequency of the highest.
    n_completing: int = field(default=0, kw_only=True)

    __repr__ = short_repr

    @property
    def frequencies_hz(self) -> Array:
        """Frequencies [Hz], shape (n,)."""
        return np.asarray(self.omega / (2 * np.pi))

    @property
    def dofs(self) -> int:
        """Number of unknowns of the finite element model."""
        return 3 * len(self.shapes)

    def _repr_html_(self) -> str:
        rows = [(number, f"{hertz:.2f}") for number, hertz in zip(self.numbers, self.frequencies_hz, strict=True)]
        return table(("mode", "Hz"), rows, f"{self.dofs} unknowns, {self.n_rigid} rigid-body modes")


def separate_modes(K: Array, M: Array) -> tuple[Array, Array]:
    """Return ω² (n,) and the turn (n, n) of modes, by their stiffness and mass K and M (n, n), to ones without others.

    These are nearly diag(ω²) and one. Round-off of a stiffness matrix mixes modes and moves ω², of slender bodies by
    1e-9 to 1e-7; forces by strain show by how much, which is so little that its first order does. Modes of one
    frequency stay as they are.
    """
    one = np.eye(len(K))
    normed = 1.5 * one - 0.5 * M
    K = normed.T @ K @ normed
    squares = np.diag(K)
    apart = squares[None] - squares[:, None]
    mixed = np.abs(apart) > ROUNDED_PAIR * squares
    mixing = np.where(mixed, 0.5 * (K + K.T) / np.where(mixed, apart, 1.0), 0.0)
    return squares, np.asarray(normed @ (one + mixing))
