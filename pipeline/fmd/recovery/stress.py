"""Stress of modal bases, and of motions as combinations of them.

Stress is linear in the modal coordinates: ``σ(t) = Σ_j q_j(t) σ_j``. Each mode's stress is evaluated at the points
where the element's strains are most accurate (Barlow, Int J Num Meth Eng 10, 1976), extrapolated to the element's
nodes and averaged over the elements that share a node. Von Mises and principal values are formed from the summed
tensor, never summed themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array, BoolArray, IntArray, require_shape, short_repr
from fmd.core.data_classes import dataclass
from fmd.core.limits.memory import CACHED_NUMBERS, HIGHEST_NODES, STRAINED_AT_ONCE, STRESSED_FRAMES
from fmd.core.limits.recovery import IN_A_ROW
from fmd.core.limits.round_off import SOLVED

if TYPE_CHECKING:
    from fmd.fem.joined import AnySpace
    from fmd.fem.material import AnyMaterial
    from fmd.fem.space import Discretisation, Member

STRESS_TENSOR = ("xx", "yy", "zz", "yz", "xz", "xy")
STRESS_COMPONENTS = ("von Mises", *STRESS_TENSOR, "principal 1", "principal 2", "principal 3")


def modal_stress(space: AnySpace, material: AnyMaterial, shapes: Array, nodes: IntArray) -> Array:
    """Stress (n_chosen, 6, n) of each shape (n_nodes, 3, n) at chosen nodes, averaged over the elements around them.

    Components are xx, yy, zz, yz, xz, xy [Pa per unit of the shape]. Only elements that touch the nodes are evaluated;
    points of links, behind the nodes, have no stress.

    Raises
    ------
    ValueError
        Shapes don't belong to the space, or a node is named twice.
    """
    from fmd.fem.strain import stresses

    found = np.zeros((len(nodes), 6, shapes.shape[2]))
    for own in space.members:
        mine = np.flatnonzero((nodes >= own.first) & (nodes < own.first + len(own.space.x)))
        evaluate = partial(stresses, own.space.stressed, own.material(material))
        found[mine] = average_at_nodes(own.space, own.of_shapes(shapes), nodes[mine] - own.first, evaluate)
    return found


def average_at_nodes(
    space: Discretisation,
    shapes: Array,
    nodes: IntArray,
    evaluate: Callable[[Array, Array, IntArray], Array],
    among: IntArray | slice = slice(None),
) -> Array:
    """Average a quantity at nodes over the elements around them, by its function of shapes, points and elements.

    Elements ``among`` these count; nodes of none have 0.
    """
    shapes = shapes[: len(space.x)]
    require_shape("shapes", shapes, (len(space.x), 3, None))
    if len(np.unique(nodes)) < len(nodes):
        raise ValueError("nodes names a node twice")
    X, to_nodes = space.kind.stress_points, space.kind.stress_to_nodes
    chosen = np.full(len(space.x), -1)
    chosen[nodes] = np.arange(len(nodes))
    everything = np.arange(len(space.element_nodes))[among]
    elements = everything[(chosen[space.element_nodes[everything]] >= 0).any(axis=1)]
    total = np.zeros((len(nodes) + 1, 6, shapes.shape[2]))  # the last row gathers all other nodes
    count = np.zeros(len(nodes) + 1)
    for start in range(0, len(elements), STRAINED_AT_ONCE):
        part = elements[start : start + STRAINED_AT_ONCE]
        at_points = evaluate(shapes, X, part)
        stress = np.einsum("aq,eqsn->easn", to_nodes, at_points, optimize=True)
        local = chosen[space.element_nodes[part]]
        np.add.at(total, local, stress)
        np.add.at(count, local, 1.0)
    return np.asarray(total[:-1] / np.maximum(count[:-1, None, None], 1.0))


def element_stress(
    space: AnySpace, material: AnyMaterial, shapes: Array, elements: IntArray, upper: Sequence[bool] = ()
) -> Array:
    """Stress of each shape in the middle of chosen elements, shape (n_chosen, 6, n) [Pa per unit of the shape].

    Of solids it is carried there from the elements' most accurate points: where the moment changes along a bar, the
    middle of a long quadratic element itself has a shear stress by its bending, which these don't have. The middle of a
    shell has no stress by bending: it is that on the upper or the lower face of each element.
    """
    found = np.zeros((len(elements), 6, shapes.shape[2]))
    for own in space.members:
        if not len(mine := own.own(elements)):
            continue
        is_shell = own.space.mesh.midsurface is not None and len(upper) > 0
        sides = np.asarray(upper, dtype=int)[mine] if is_shell else np.zeros(0, dtype=int)
        numbers = elements[mine] - own.first_element
        found[mine] = _middle_stress(own.space.stressed, own.material(material), own.of_shapes(shapes), numbers, sides)
    return found


def _middle_stress(
    space: Discretisation, material: AnyMaterial, shapes: Array, elements: IntArray, upper: IntArray
) -> Array:
    from fmd.fem.strain import stresses

    middle = space.kind.corners.mean(axis=0)[:, None]
    if not len(upper):
        at_points = stresses(space, material, shapes, space.kind.stress_points, elements)
        return np.asarray(np.einsum("q,eqsn->esn", space.kind.stress_weights(middle)[0], at_points))
    lower, higher = (np.vstack([middle[:2], [[end]]]) for end in (0.0, 1.0))
    both = stresses(space, material, shapes, np.concatenate([lower, higher], axis=1), elements)
    return np.asarray(both[np.arange(len(elements)), upper])


def excess_in_middle(space: AnySpace, material: AnyMaterial, shapes: Array, element: int) -> Array:
    """Stress by which that in the middle of a solid element is beyond the true one, shape (6, n) [Pa per unit].

    The middle has the mean of the element's length, as nodes are hardly displaced wrongly along a bar. The mean of a
    parabola is beyond its value in the middle by a 24th of the second difference of three means. These are taken along
    each row of three elements, which are found behind opposite faces; elsewhere nothing is known.
    """
    member = next(own for own in space.members if len(own.own(np.array([element]))))
    space, material, shapes = member.space, member.material(material), member.of_shapes(shapes)
    element -= member.first_element
    if space.kind.strain_matrix is not None:  # shells and beams have their strain along them
        return np.zeros((6, shapes.shape[2]))
    corners = space.element_nodes[:, : len(space.kind.corners)]
    n_shared = np.isin(corners, corners[element]).sum(axis=1)
    around = np.flatnonzero(n_shared == len(space.kind.facet_corners[0]))
    apart = space.x[corners[around]].mean(axis=1) - space.x[corners[element]].mean(axis=0)
    way = apart / np.linalg.norm(apart, axis=1)[:, None]
    one, other = np.nonzero(np.triu(way @ way.T < -IN_A_ROW))
    stress = element_stress(space, material, shapes, np.concatenate([[element], around]))
    return np.asarray((stress[1 + one] + stress[1 + other] - 2 * stress[:1]).sum(axis=0) / 24)


def point_stress(space: AnySpace, material: AnyMaterial, shapes: Array, points: Array) -> Array:
    """Stress of each shape in the elements at points (n, 3) [m], shape (n, 6, n_shapes) [Pa per unit of the shape].

    Of solids it is carried there from the elements' most accurate points; shells and beams say how it varies across.
    """
    from fmd.fem.selection import locate_points
    from fmd.fem.strain import stresses

    found = np.zeros((len(points), 6, shapes.shape[2]))
    for own, mine in nearest_members(space, points):
        elements, X = locate_points(own.space, points[mine])
        evaluate = partial(stresses, own.space.stressed, own.material(material), own.of_shapes(shapes))
        if own.space.kind.strain_matrix is not None:
            each = zip(elements, X, strict=True)
            found[mine] = np.stack([evaluate(x[:, None], np.array([e]))[0, 0] for e, x in each])
            continue
        at_points = evaluate(own.space.kind.stress_points, elements)
        found[mine] = np.einsum("eq,eqsn->esn", own.space.kind.stress_weights(np.transpose(X)), at_points)
    return found


def smooth_stress(space: AnySpace, material: AnyMaterial, shapes: Array, points: Array) -> Array:
    """Stress of each shape at points (n, 3) [m] between the averages at nodes, shape (n, 6, n_shapes) [Pa per unit]."""
    from fmd.fem.selection import interpolate_points

    found = np.zeros((len(points), 6, shapes.shape[2]))
    for own, mine in nearest_members(space, points):
        for k, nodes, weights in zip(mine, *interpolate_points(own.space, points[mine]), strict=True):
            found[k] = np.tensordot(weights, modal_stress(space, material, shapes, own.first + nodes), 1)
    return found


def nearest_members(space: AnySpace, points: Array) -> list[tuple[Member, IntArray]]:
    """Return the elements of each kind with the places of the points (n, 3) [m] that are nearest to them."""
    from fmd.fem.selection import interpolate_points

    if len(space.members) == 1:
        return [(space.members[0], np.arange(len(points)))]
    away = []
    for own in space.members:
        nodes, weights = interpolate_points(own.space, points)
        away.append(np.linalg.norm(np.einsum("pn,pna->pa", weights, own.space.x[nodes]) - points, axis=1))
    extent = float(np.ptp(space.x, axis=0).max())
    nearest = np.argmin(np.round(np.array(away) / (SOLVED * extent)), axis=0)
    return [(own, mine) for k, own in enumerate(space.members) if len(mine := np.flatnonzero(nearest == k))]


def von_mises(stress: Array) -> Array:
    """Von Mises stress (n, …) of tensors (n, 6, …) in the order xx, yy, zz, yz, xz, xy."""
    xx, yy, zz, yz, xz, xy = np.moveaxis(stress, 1, 0)
    return np.asarray(np.sqrt(0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3.0 * (yz**2 + xz**2 + xy**2)))


def choose_frames(n_times: int, count: int) -> IntArray:
    """Choose at most ``count`` of ``n_times`` output times, evenly, with the first and the last; their numbers."""
    return np.unique(np.linspace(0, n_times - 1, count).round().astype(int))


def stress_measure(component: str) -> Callable[[Array], Array]:
    """Return the function that takes stress tensors (n, 6, …) to one measure (n, …).

    That is ``von Mises``, a component, e.g. ``xx``, or ``principal 1`` to ``principal 3``, the first being the largest.
    """
    if component == "von Mises":
        return von_mises
    if component in STRESS_TENSOR:
        row = STRESS_TENSOR.index(component)
        return lambda stress: stress[:, row]
    place = int(component.removeprefix("principal "))

    def principal(stress: Array) -> Array:
        full = np.moveaxis(stress[:, [[0, 5, 4], [5, 1, 3], [4, 3, 2]]], (1, 2), (-2, -1))
        return np.asarray(np.linalg.eigvalsh(full)[..., 3 - place])

    return principal


@dataclass(frozen=True)
class StressHistory:
    """Stress at some nodes of a body over a motion, combined from its modes when it is read."""

    nodes: IntArray  # (n_nodes,): node numbers
    modal: Array  # (n_nodes, 6, n): stress of each modal coordinate [Pa]
    times: Array  # (n_times,): output times of the motion [s]
    q: Array  # (n_times, n): modal coordinates
    # (n_nodes,): nodes whose stress grows with each refinement, which are no place of the largest
    limitless: BoolArray | None = None

    __repr__ = short_repr

    def tensor(self, t: float) -> Array:
        """Stress tensors (n_nodes, 6) [Pa] at time t [s], linear between output times."""
        if not self.times[0] <= t <= self.times[-1]:
            raise ValueError(f"t = {t} s is outside the motion, {self.times[0]} … {self.times[-1]} s")
        q = np.array([np.interp(t, self.times, column) for column in self.q.T])
        return np.asarray(self.modal @ q)

    def von_mises(self, t: float) -> Array:
        """Von Mises stress (n_nodes,) [Pa] at time t [s]."""
        return von_mises(self.tensor(t))

    def measure_at(self, frames: IntArray, measure: Callable[[Array], Array] | None = None) -> Array:
        """Von Mises stress, or another measure, at chosen output times, shape (n_frames, n_nodes) [Pa].

        Tensors are formed for a few nodes at a time, so that they stay in the processor's cache.
        """
        measure = measure or von_mises
        q = np.ascontiguousarray(self.q[frames].T)
        values = np.empty((len(frames), len(self.nodes)))
        block = max(1, CACHED_NUMBERS // (6 * len(frames)))
        for start in range(0, len(self.nodes), block):
            rows = self.modal[start : start + block]
            tensors = (rows.reshape(-1, rows.shape[2]) @ q).reshape(len(rows), 6, -1)
            values[:, start : start + block] = measure(tensors).T
        return values

    def limited_von_mises(self, frames: IntArray) -> Array:
        """Von Mises stress at chosen output times (n_frames, n_nodes) [Pa], -1 where it has no limit."""
        values = self.measure_at(frames)
        if self.limitless is not None:
            values[:, self.limitless] = -1.0
        return values

    def worst(self) -> tuple[float, int, float]:
        """Time [s], place in ``nodes`` and value [Pa] of the largest von Mises stress at any output time.

        The stress of a sum is no larger than the sum of stresses: so most nodes and times can't have the largest.
        """
        sizes, q = von_mises(self.modal), np.abs(self.q)
        if self.limitless is not None:
            sizes[self.limitless] = 0.0
        of_nodes, of_times = sizes @ q.max(axis=0), q @ sizes.max(axis=0)
        _, _, least = self._worst_of(np.arange(len(q)), np.sort(np.argsort(of_nodes)[-HIGHEST_NODES:]))
        frames, places = (np.flatnonzero(~(some < least - SOLVED * abs(least))) for some in (of_times, of_nodes))
        return self._worst_of(frames, places)

    def _worst_of(self, frames: IntArray, places: IntArray) -> tuple[float, int, float]:
        """Return `worst` of some output times and nodes."""
        peak, limitless = (0.0, 0, -1.0), None if self.limitless is None else self.limitless[places]
        nodes = replace(self, nodes=self.nodes[places], modal=self.modal[places], limitless=limitless)
        for start in range(0, len(frames), STRESSED_FRAMES):
            some = frames[start : start + STRESSED_FRAMES]
            value = nodes.limited_von_mises(some)
            k, node = np.unravel_index(value.argmax(), value.shape)
            if value[k, node] > peak[2]:
                peak = float(self.times[some[k]]), int(places[node]), float(value[k, node])
        return peak
