"""Reduced equations of a solid of large displacements, exact within the span of their shapes.

A field is ``u = Φ q``. Green's strain is linear in the n coordinates and in their n (n + 1)/2 products, together the
monomials z, so the strain energy is ``½ zᵀ A z`` with one constant matrix. Its gradient is a sum over all monomials of
degrees 1 to 3 (Barbič & James, ACM Trans Graphics 24, 2005). With so few coordinates nothing is left out of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement
from typing import Any, NamedTuple

import numpy as np
from modal_derivatives import orthonormalise, static_derivatives
from nonlinear_solid import PAIRS, NonlinearSolid

from fmd.core.arrays import Array
from fmd.dynamics.jit.compiled import contracted, meaning
from fmd.dynamics.system import accelerations, advance, leapfrog_step, velocities


class PolynomialParameters(NamedTuple):
    """Constants of ``a = p − ∂U/∂q`` for a quartic energy U, and room to work in."""

    p: Array  # (n,) generalised forces
    linear: Array  # (n, n) gradient by coordinates
    quadratic: Array  # (n_2, n) by their products i ≤ j, j fastest
    cubic: Array  # (n_3, n) by the products i ≤ j ≤ k, k fastest


@dataclass(frozen=True)
class ReducedSolid:
    """Reduced equations ``q̈ + ∂U/∂q = p`` of a solid of large displacements.

    Attributes
    ----------
    basis : ndarray, shape (n_nodes, 3, n)
        Shapes Φ, orthonormal by mass, modes of the undeformed solid within what they span.
    omega : ndarray, shape (n,)
        Their angular frequencies [rad/s].
    A : ndarray, shape (n_z, n_z)
        Energy of the monomials of degrees 1 and 2.
    exponents : ndarray of int, shape (n_m, 3)
        Coordinates of each monomial of degrees 1 to 3, padded by n.
    G : ndarray, shape (n, n_m)
        Gradient of the energy by monomials.
    """

    basis: Any
    omega: Any
    A: Any
    exponents: Any
    G: Any

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.omega)

    breakpoints = ()
    shortest_action = np.inf

    @property
    def n_positions(self) -> int:
        """Number of position coordinates, here one for each rate."""
        return self.n

    @cached_property
    def parameters(self) -> PolynomialParameters:
        """Flat arrays for the compiled functions, without loads."""
        n, G = self.n, self.G.T.copy()
        m = n + n * (n + 1) // 2
        return PolynomialParameters(np.zeros(n), G[:n].copy(), G[n:m].copy(), G[m:].copy())

    @property
    def highest_frequency(self) -> float:
        """Highest angular frequency of the undeformed solid within the shapes [rad/s]."""
        return float(self.omega[-1])

    def leapfrog(self) -> Any:
        """Return room for rates."""
        return np.zeros(self.n)

    def energy(self, q: Any) -> float:
        """Return the strain energy [J] at coordinates q (n,)."""
        i, j = np.triu_indices(self.n)
        z = np.concatenate([q, q[i] * q[j]])
        return float(0.5 * z @ self.A @ z)

    def force(self, q: Any) -> Any:
        """Return the gradient of the energy at coordinates q (n,), shape (n,)."""
        return self.G @ np.append(q, 1.0)[self.exponents].prod(axis=1)

    def tangent(self, q: Any) -> Any:
        """Return the second derivatives of the energy at coordinates q (n,), shape (n, n)."""
        i, j = np.triu_indices(self.n)
        z, k = np.concatenate([q, q[i] * q[j]]), np.arange(len(i))
        dz = np.zeros((self.n + len(i), self.n))
        dz[: self.n] = np.eye(self.n)
        np.add.at(dz, (self.n + k, i), q[j])
        np.add.at(dz, (self.n + k, j), q[i])
        second = np.zeros((self.n, self.n))
        f = (self.A @ z)[self.n :]
        np.add.at(second, (i, j), f)
        np.add.at(second, (j, i), f)
        return dz.T @ self.A @ dz + second


def reduce_solid(solid: NonlinearSolid, modes: Any) -> ReducedSolid:
    """Reduce a solid to modes (n_nodes, 3, n) and their static derivatives with its exact energy."""
    return reduce_to_span(solid, np.concatenate([modes, static_derivatives(solid, modes)], axis=2))


def reduce_to_span(solid: NonlinearSolid, shapes: Any) -> ReducedSolid:
    """Reduce a solid to the span of shapes (n_nodes, 3, n) with its exact energy."""
    basis, omega = orthonormalise(solid, shapes)
    A = energy_matrix(solid, basis)
    return ReducedSolid(basis, omega, A, *energy_gradient(A, len(omega)))


def energy_matrix(solid: NonlinearSolid, basis: Any) -> Any:
    """Return the energy of the monomials of degrees 1 and 2 of a basis (n_nodes, 3, n), shape (n_z, n_z)."""
    H = solid.displacement_gradients(basis)
    n = basis.shape[2]
    H = H.reshape(-1, 3, 3, n)
    i, j = np.triu_indices(n)
    Z = np.empty((len(H), 6, n + len(i)))
    for row, (a, b) in enumerate(PAIRS):
        twice = 1.0 if a == b else 2.0
        Z[:, row, :n] = 0.5 * twice * (H[:, a, b] + H[:, b, a])
        products = np.einsum("pki,pkj->pij", H[:, :, a], H[:, :, b])
        Z[:, row, n:] = 0.5 * twice * 0.5 * (products + products.swapaxes(1, 2))[:, i, j]
    Z[:, :, n:] *= np.where(i == j, 1.0, 2.0)
    weighed = (solid.fe.material.stiffness @ Z) * solid.volumes.reshape(-1, 1, 1)
    A = np.asarray(Z.reshape(-1, Z.shape[2]).T @ weighed.reshape(-1, Z.shape[2]))
    return 0.5 * (A + A.T)


def energy_gradient(A: Any, n: int) -> tuple[Any, Any]:
    """Return the gradient of the energy by monomials: their coordinates (n_m, 3) and coefficients (n, n_m)."""
    i, j = np.triu_indices(n)
    factors = np.stack([np.r_[np.arange(n), i], np.r_[np.full(n, n), j]], axis=1)
    a, b = np.triu_indices(len(A))
    whole = np.sort(np.concatenate([factors[a], factors[b]], axis=1), axis=1)  # n stands for 1 and comes last
    terms, place = np.unique(whole, axis=0, return_inverse=True)
    weights = np.bincount(place.ravel(), np.where(a == b, 0.5, 1.0) * A[a, b])
    exponents = np.array(
        [m + (n,) * (3 - len(m)) for k in (1, 2, 3) for m in combinations_with_replacement(range(n), k)]
    )
    code = (n + 1) ** np.arange(3)
    sorted_codes = np.argsort(exponents @ code)
    G = np.zeros((n, len(exponents)))
    for k in range(4):  # the derivative by each factor leaves the other three
        by, left = terms[:, k], np.delete(terms, k, axis=1)
        real = by < n
        at = sorted_codes[np.searchsorted((exponents @ code)[sorted_codes], left[real] @ code)]
        np.add.at(G, (by[real], at), weights[real])
    return exponents, G


def rest_of_reduced(reduced: ReducedSolid, load: Any, steps: int = 4) -> Any:
    """Return the coordinates (n,) at rest under generalised forces (n,), by Newton's method in load steps.

    Raises
    ------
    RuntimeError
        Newton's method doesn't converge.
    """
    q = np.zeros(reduced.n)
    for part in np.arange(1, steps + 1) / steps:
        for _ in range(60):
            change = np.linalg.solve(reduced.tangent(q), part * load - reduced.force(q))
            q = q + change
            if np.abs(change).max() < 1e-11 * np.abs(q).max():
                break
        else:
            raise RuntimeError("the reduced solid's rest was not found")
    return q


@contracted
def _add_row(factor: float, rows: Array, number: int, a: Array) -> None:
    for i in range(a.size):
        a[i] -= factor * rows[number, i]


@meaning(accelerations, PolynomialParameters)
def _accelerations(p: PolynomialParameters, t: float, q: Array, v: Array, a: Array) -> None:
    """Sum the gradient's monomials, products of lower ones reused."""
    pair = triple = 0
    for i in range(a.size):
        a[i] = p.p[i]
    for i in range(a.size):
        _add_row(q[i], p.linear, i, a)
        for j in range(i, a.size):
            product = q[i] * q[j]
            _add_row(product, p.quadratic, pair, a)
            pair += 1
            for k in range(j, a.size):
                _add_row(product * q[k], p.cubic, triple, a)
                triple += 1


@meaning(leapfrog_step, PolynomialParameters)
def _leapfrog_step(p: PolynomialParameters, room: Array, t: float, h: float, q: Array, v: Array, a: Array) -> None:
    accelerations(p, t, q, v, a)
    for i in range(v.size):
        v[i] += h * a[i]
        q[i] += h * v[i]


@meaning(advance, PolynomialParameters)
def _advance(p: PolynomialParameters, q: Array, v: Array, h: float, first: int, last: int) -> None:
    for i in range(first, last):
        q[i] += h * v[i]


@meaning(velocities, PolynomialParameters)
def _velocities(p: PolynomialParameters, q: Array, v: Array, dq: Array) -> None:
    for i in range(v.size):
        dq[i] = v[i]
