"""Whole finite element models in motion: every node of a solid in space, without frame, modes or reduction.

A `NonlinearSolid` (Green's strain, St. Venant and Kirchhoff's material) whose root's nodes move as a rigid face does,
under gravity, forces at markers and springs to the ground, by the generalised-α method (Chung & Hulbert, J Appl Mech
60, 1993) with Newton's method in each step. It shares the mesh with the product, and nothing of its motion.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.sparse.linalg import splu

from fmd.fem.markers import Marker
from tests.fem.nonlinear_solid import NonlinearSolid

RADIUS = 0.9  # spectral radius of the method at infinity
SLOW = 7  # corrections in a step, after which the tangent is made anew
MOST = 40
SOLVED = 1e-9  # a correction's largest acceleration, of the largest so far

Vector = Any
Force = Callable[[float], Vector]


@dataclass(frozen=True)
class Spring:
    """A linear spring and damper between a marker and a place on the ground."""

    marker: Marker
    place: Vector
    stiffness: float
    damper: float
    length: float

    def force(self, x: Vector, v: Vector) -> Vector:
        """Return the force on the marker at a position and velocity [N]."""
        arm = self.place - x
        distance = np.linalg.norm(arm)
        along = arm / distance
        return (self.stiffness * (distance - self.length) - self.damper * (v @ along)) * along


@dataclass
class WholeMotion:
    """Histories at the output times: fields (n_times, n_nodes, 3) [m, m/s, m/s²], and forces on the root [N]."""

    times: Vector
    u: Vector
    v: Vector
    a: Vector
    reaction: Vector


@dataclass(frozen=True)
class WholeElements:
    """A solid whose root's face moves rigidly, and what acts on it.

    Parameters
    ----------
    solid : NonlinearSolid
        Mesh, material and the face that is moved.
    angle : callable
        Angle of the root about z through the origin at a time, with its first and second derivative.
    gravity : ndarray, shape (3,)
    forces : list of (Marker, callable)
        Dead forces at markers over time [N].
    springs : list of Spring
    """

    solid: NonlinearSolid
    angle: Callable[[float], tuple[float, float, float]]
    gravity: Vector
    forces: list[tuple[Marker, Force]] = field(default_factory=list)
    springs: list[Spring] = field(default_factory=list)

    def _loads(self, t: float, u: Vector, v: Vector) -> Vector:
        x = self.solid.fe.x
        loads = (self.solid.fe.m @ np.ones(len(x)))[:, None] * self.gravity
        for marker, force in self.forces:
            loads[marker.nodes] += np.outer(marker.translation_weights, force(t))
        for spring in self.springs:
            w, nodes = spring.marker.translation_weights, spring.marker.nodes
            loads[nodes] += np.outer(w, spring.force(w @ (x + u)[nodes], w @ v[nodes]))
        return loads

    def march(self, times: Vector, substeps: int) -> WholeMotion:
        """March with some steps between each two of evenly spaced output times."""
        x, free = self.solid.fe.x, self.solid.free
        M = self.solid.fe.M
        am, af = (2 * RADIUS - 1) / (RADIUS + 1), RADIUS / (RADIUS + 1)
        gamma, beta = 0.5 - am + af, 0.25 * (1 - am + af) ** 2
        h = (times[1] - times[0]) / substeps
        fixed = np.setdiff1d(np.arange(x.size), free)
        u, v, a = self.turned(0.0)
        a.ravel()[free] = 0.0
        left = (self._loads(0.0, u, v) - self.solid.force(u)).ravel() - M @ a.ravel()
        a.ravel()[free] = splu(M[free][:, free].tocsc()).solve(left[free])
        out = WholeMotion(times, *(np.zeros((len(times), *x.shape)) for _ in range(3)), np.zeros((len(times), 3)))
        factor: Any = None
        largest = np.abs(a).max()
        for k in range((len(times) - 1) * substeps + 1):
            if k % substeps == 0:
                row = k // substeps
                out.u[row], out.v[row], out.a[row] = u, v, a
                left = (M @ a.ravel()).reshape(x.shape) + self.solid.force(u) - self._loads(k * h, u, v)
                out.reaction[row] = left[self.solid.root.nodes].sum(axis=0)
            t = (k + 1) * h
            known = self.turned(t)
            new = a.copy()
            new.ravel()[fixed] = known[2].ravel()[fixed]
            for correction in range(MOST):
                du = h * v + h * h * ((0.5 - beta) * a + beta * new)
                u1, v1 = u + du, v + h * ((1 - gamma) * a + gamma * new)
                u1.ravel()[fixed], v1.ravel()[fixed] = known[0].ravel()[fixed], known[1].ravel()[fixed]
                um, vm = (1 - af) * u1 + af * u, (1 - af) * v1 + af * v
                mean = (1 - am) * new + am * a
                force = self._loads(t - af * h, um, vm) - self.solid.force(um)
                left = (force.ravel() - M @ mean.ravel())[free]
                if factor is None or correction == SLOW:
                    K = self.solid.tangent(um)[free][:, free]
                    factor = splu(((1 - am) * M[free][:, free] + (1 - af) * beta * h * h * K).tocsc())
                change = factor.solve(left)
                new.ravel()[free] += change
                largest = max(largest, np.abs(new).max())
                if np.abs(change).max() < SOLVED * largest:
                    break
            else:
                raise RuntimeError(f"the whole elements' step to t = {t:g} s was not found")
            du = h * v + h * h * ((0.5 - beta) * a + beta * new)
            u, v, a = u + du, v + h * ((1 - gamma) * a + gamma * new), new
            u.ravel()[fixed], v.ravel()[fixed] = known[0].ravel()[fixed], known[1].ravel()[fixed]
        return out

    def turned(self, t: float) -> tuple[Vector, Vector, Vector]:
        """Return displacements, velocities and accelerations of the solid turned as its root, (n_nodes, 3) each."""
        (angle, rate, change), x = self.angle(t), self.solid.fe.x
        c, s = np.cos(angle), np.sin(angle)
        along = x @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        flat = along * [1.0, 1.0, 0.0]
        across = np.stack([-along[:, 1], along[:, 0], np.zeros(len(x))], axis=1)
        return along - x, rate * across, change * across - rate**2 * flat

    def von_mises(self, u: Vector) -> Vector:
        """Return the equivalent stress at the nodes [Pa], from Green's strain at the elements' most accurate points."""
        space = self.solid.fe.discretisation
        g, _ = space.gradients(space.kind.stress_points, slice(None))
        H = (g.swapaxes(2, 3) @ u[space.element_nodes][:, None]).swapaxes(2, 3)
        E = 0.5 * (H + H.swapaxes(2, 3) + H.swapaxes(2, 3) @ H)
        lam, mu = self.solid.fe.material.lame
        S = lam * np.trace(E, axis1=2, axis2=3)[..., None, None] * np.eye(3) + 2 * mu * E
        at_nodes = np.einsum("aq,eqij->eaij", space.kind.stress_to_nodes, S)
        total, count = np.zeros((len(u), 3, 3)), np.zeros(len(u))
        np.add.at(total, space.element_nodes, at_nodes)
        np.add.at(count, space.element_nodes, 1.0)
        mean = total / count[:, None, None]
        deviator = mean - np.trace(mean, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
        return np.sqrt(1.5 * (deviator**2).sum(axis=(1, 2)))
