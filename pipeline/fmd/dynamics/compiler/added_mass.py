"""Modal mass that displacements of second order add to a body's, in its graph.

With the rows ``R = (g, f)``, g constant and ``f = F q``, it is ``Rᵀ C R``: of low rank, as what a body carries adds.
See `fmd.reduction.second_order`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.round_off import SUMMED
from fmd.dynamics.compiler.algebra import Matrix, constants, times
from fmd.dynamics.compiler.graph import Graph, Scalar, Terms, Vector
from fmd.reduction.second_order import SecondOrderMass


@dataclass(frozen=True)
class AddedMass:
    """Modal mass of a body's displacements of second order at its state.

    Attributes
    ----------
    g, F : ndarray, shapes (k, n) and (k, n, n)
        As in `SecondOrderMass`, without round-off.
    rows : list of Vector
        R: those of g, then those of f.
    C : Matrix
        Constant.
    """

    g: Array
    F: Array
    rows: list[Vector]
    C: Matrix

    @property
    def shapes(self) -> tuple[Array, Array]:
        """Constant part of R (2 k, n), and the forms by which it changes with the modal coordinates (2 k, n, n)."""
        none = np.zeros_like(self.F)
        return np.concatenate([self.g, np.zeros_like(self.g)]), np.concatenate([none, self.F])

    def times(self, eta: Vector) -> Terms:
        """Return the terms of this mass times modal accelerations."""
        return list(zip(times(self.C, [row.dot(eta) for row in self.rows]), self.rows, strict=True))

    def velocity_forces(self, v: Vector) -> Terms:
        """Return the terms of the forces on the modes that modal rates bring about."""
        zero, k = v.graph.number(0.0), len(self.F)
        changes = [zero] * k + [v.multiplied_by(form).dot(v) for form in self.F]
        return [(-1.0 * factor, row) for factor, row in zip(times(self.C, changes), self.rows, strict=True)]

    def twice_energy(self, v: Vector) -> Scalar:
        """Return twice the kinetic energy of this mass."""
        momenta = [row.dot(v) for row in self.rows]
        pairs = zip(momenta, times(self.C, momenta), strict=True)
        return sum((a * b for a, b in pairs), v.graph.number(0.0))


def trace_added_mass(graph: Graph, mass: SecondOrderMass | None, q: Vector) -> AddedMass | None:
    """Trace a body's added mass for its modal coordinates; ``None`` if there is none."""
    if mass is None:
        return None
    k, scale = len(mass.F), np.sqrt(np.abs(mass.N.diagonal()))
    N = np.where(np.abs(mass.N) <= SUMMED * np.outer(scale, scale), 0.0, mass.N)
    g = np.where(np.abs(mass.g) <= SUMMED * scale[:, None], 0.0, mass.g)  # modal masses are 1
    C = np.block([[np.zeros((k, k)), np.eye(k)], [np.eye(k), N]])
    rows = [graph.array(row) for row in g] + [q.multiplied_by(form) for form in mass.F]
    return AddedMass(g, mass.F, rows, [constants(graph, row) for row in C])
