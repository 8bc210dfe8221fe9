"""Stiffness of contacts at rest, for bodies that are set down: smaller than differences of positions can see."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.contact.round_laws import DEPTH, LOAD, POWER
from fmd.core.arrays import Array, IntArray
from fmd.core.limits.contact import DEEP_START, SMALL_FORCE, SOFTEST_DENT
from fmd.integrators.protocol import evaluate

if TYPE_CHECKING:
    from fmd.contact.tables import ContactTable
    from fmd.dynamics.compiled_system.touching import TouchingSystem


def pressed_stiffness(system: TouchingSystem, q: Array) -> Array:
    """Return the stiffness ``Jᵀ D⁻¹ J`` of the points that are pressed at positions q at rest, (n, n).

    With friction they are stiff along their plane, too, as if none slipped: corrections are rather too short than too
    long. Where none is pressed, those that are all but on it count.
    """
    K, still, p = np.zeros((system.n, system.n)), np.zeros(system.n), system.parameters
    evaluate(p, 0.0, q, still, np.zeros(system.n))
    c = p.contact
    points = [body.points for body in system.mechanism.contacts]
    size = max(own.extent for own in points)
    J = [system.point_velocities(q, int(link), own.x, own.shapes) for link, own in zip(c.link, points, strict=True)]
    for g in range(len(c.noise)):
        mine = np.arange(c.group[g], c.group[g + 1])
        held = _held(c, mine, size)
        mine, held = mine[held[:, 0]], held[held[:, 0]]
        rows, D = np.zeros((len(mine), 3, system.n)), np.zeros((len(mine), 3, len(mine), 3))
        for body, own in enumerate(points):
            T = _motions(c, mine, body, len(own.x))
            used = np.flatnonzero(T.any(axis=(0, 1, 3)))
            T = T[:, :, used]
            rows += np.einsum("iakb,kbn->ian", T, J[body][used], optimize=True)
            D += np.einsum("iakc,kcld,jbld->iajb", T, own.between(used), T, optimize=True)
        for k, i in enumerate(mine):
            if c.rounded[s := c.surface[i]]:
                rows[k] = _velocity(system, p, q, i, c.slave[s])
                if c.dent[i, 0] > 0.0:  # hardly pressed ones are too soft to tell how far to go
                    D[k, :, k] = np.minimum(_round_flexibility(c, i), SOFTEST_DENT * D[k, :, k])
            if c.primitive[s, 0]:
                rows[k] -= _velocity(system, p, q, i, c.master[s])
        K += rows[held].T @ np.linalg.solve(D[held][:, held], rows[held])
    return K


def rounded_push(system: TouchingSystem, q: Array) -> float:
    """Return what forces on modes at rest are known to: those of points may be large and cancel."""
    p, still = system.parameters, np.zeros(system.n)
    evaluate(p, 0.0, q, still, np.zeros(system.n))
    pressed = p.contact.force[:, 0] > 0.0
    shapes, force = p.contact.shapes[p.contact.node[pressed]], p.contact.own[pressed]
    return SMALL_FORCE * float(np.einsum("iam,ia->m", np.abs(shapes), np.abs(force)).max(initial=0.0))


def _velocity(system: TouchingSystem, p: Any, q: Array, i: int, body: int) -> Array:
    """Return the velocity along a point's axes, by unit rates, of a body where the point touches, (3, n)."""
    c, link = p.contact, int(p.contact.link[body])
    R, at = p.rotations[link], c.place[c.node[i]] - c.radii[c.node[i]] * c.axes[i, 0]
    x = (at - p.origins[link]) @ R
    n_modes = int(c.n_modes[body])
    return np.asarray(c.axes[i] @ R @ system.point_velocities(q, link, x[None], np.zeros((1, 3, n_modes)))[0])


def _round_flexibility(c: ContactTable, i: int) -> Array:
    """Return the flexibility of a round point along its axes at its depth, by the slope of its law, (3, 3)."""
    law, s = c.law[c.surface[i]], c.surface[i]
    depth = c.dent[i, 0]
    row = law[max(0, int(np.searchsorted(law[:, DEPTH], depth, side="right")) - 1)]
    secant = c.shares[i] * row[LOAD] / row[DEPTH] * (depth / row[DEPTH]) ** (row[POWER] - 1.0)
    return np.diag(np.array([1.0 / row[POWER], c.slide[s], c.slide[s]]) / secant)


def _motions(c: ContactTable, mine: IntArray, body: int, n: int) -> Array:
    """Return how points move along their axes by displacements of a body's n nodes, shape (n_points, 3, n, 3)."""
    T, first = np.zeros((len(mine), 3, n, 3)), c.first[body]
    for k, i in enumerate(mine):
        s = c.surface[i]
        if c.slave[s] == body:
            T[k, :, c.node[i] - first] += c.turned[i]
        if c.master[s] == body and not c.primitive[s, 0]:
            for e in range(3):
                T[k, :, c.foot[i, e] - first] -= c.weights[i, e] * c.turned[i] @ c.Q[i]
    return T


def _held(c: ContactTable, mine: IntArray, size: float) -> Array:
    """Return which components of a group's points are held, shape (n, 3)."""
    held = np.zeros((len(mine), 3), dtype=bool)
    held[:, 0] = c.force[mine, 0] > 0.0
    if not held.any():
        held[:, 0] = (c.seen[mine, 0] == 1) & (c.free[mine, 0] < DEEP_START * size)
    held[:, 1:] = (held[:, 0] & (c.friction[c.surface[mine]] > 0.0))[:, None]
    return held
