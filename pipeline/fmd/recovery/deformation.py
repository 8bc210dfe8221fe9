"""Rotation and strain of a body's elastic field, and the error of a model that is linear in them.

In its floating frame a body's displacement is linear in the modal coordinates. Squares are left out: a beam whose
sections turn by θ against its root is shorter along its axis by ``½ ∫ θ² ds``, and all other results are off by parts
of the order θ² and of the order of the strain (Shabana, Dynamics of Multibody Systems, section 6; the elastica).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits import recovery as limits
from fmd.core.limits.memory import DEFORMED_AT_ONCE, STRAINED_AT_ONCE
from fmd.core.limits.round_off import SOLVED

if TYPE_CHECKING:
    from fmd.fem.joined import AnySpace
    from fmd.fem.space import Discretisation
    from fmd.reduction.body import FlexibleBody


@dataclass(frozen=True)
class DeformationShapes:
    """Rotation and strain of each modal coordinate at some points of a body."""

    # (n_points, 3, n): half the second-order rotation of the displacement, against the body's frame [rad per unit of
    # the coordinate]
    rotation: Array
    strain: Array  # (n_points, 6, n): xx, yy, zz and √2 times yz, xz, xy, so that its length is that of the tensor
    # (n_points, 3, n): for each marker but the joint's the rotation across the straight line from the joint to it,
    # evenly along that line, against the section at the joint
    lines: Mapping[str, Array]


@dataclass(frozen=True)
class Deformation:
    """Largest rotation and strain of a body's elastic field over a motion."""

    rotation: float  # largest rotation against the body's frame [rad]
    strain: float  # largest length of the strain tensor
    # (n_times,): by marker, how much nearer it is to the joint than the linear field has it [m]
    shortening: Mapping[str, Array]

    @property
    def second_order_error(self) -> float:
        """Estimated relative error of sizes, stress, energies and joints by the squares that are left out."""
        return limits.OF_SQUARED_ROTATION * self.rotation**2 + limits.OF_LARGEST_STRAIN * self.strain


def deformation_shapes(space: AnySpace, body: FlexibleBody, supported: bool) -> DeformationShapes:
    """Evaluate rotation and strain of a body's shapes where each of them is largest, and evenly over the body.

    If supports hold the body in its frame, no section at the joint turns against it.
    """
    rotation, strain = (
        np.concatenate(each)
        for each in zip(*(_fields(own.space, own.of_shapes(body.shapes)) for own in space.members), strict=True)
    )
    largest = [
        np.argsort(-np.linalg.norm(field, axis=1), axis=0)[: limits.TOP_POINTS].ravel() for field in (rotation, strain)
    ]
    even = np.linspace(0, len(rotation) - 1, min(limits.EVEN_POINTS, len(rotation))).astype(int)
    chosen = np.unique(np.concatenate([*largest, even]))
    rotation, strain = rotation[chosen], strain[chosen]
    return DeformationShapes(rotation, strain, _rotation_on_lines(space, body, supported))


def _fields(space: Discretisation, shapes: Array) -> tuple[Array, Array]:
    """Return rotation (n, 3, n_modes) and strain (n, 6, n_modes) of shapes at corners of elements of one kind."""
    X = space.kind.corners.T
    n_elements = len(space.element_nodes)
    looked_at = np.linspace(0, n_elements - 1, min(limits.MOST_PLACES, n_elements)).astype(int)
    parts = [
        _rotation_and_strain(space, shapes, X, looked_at[start : start + STRAINED_AT_ONCE])
        for start in range(0, len(looked_at), STRAINED_AT_ONCE)
    ]
    rotation, strain = (
        np.concatenate(field).reshape(-1, field[0].shape[2], shapes.shape[2]) for field in zip(*parts, strict=True)
    )
    return rotation, strain


def node_deformation_shapes(body: FlexibleBody, supported: bool, of_matter: bool) -> DeformationShapes:
    """Estimate rotation and strain of a body's shapes from its nodes and markers alone, for bodies without elements.

    The straight line from a node to one of its nearest turns and stretches with the material between them. Along the
    line from the joint to a marker a cubic curve has the displacement and the rotation of both ends, as a beam has that
    is loaded at its ends. A single marker has neither: strain isn't known then, and left out. If supports hold the body
    in its frame, no section at the joint turns against it. Nodes that may be masses which carry inertia alone don't
    move as matter does; markers are taken in their place.
    """
    of_markers = list(body.markers.values())
    points = body.x if of_matter else np.array([marker.position for marker in of_markers])
    shapes = body.shapes if of_matter else np.array([marker.translation for marker in of_markers])
    between, moved = _near_pairs(points, shapes)
    square = (between**2).sum(axis=1)[:, None, None]
    turned = np.cross(between[:, None], moved.transpose(0, 2, 1)).transpose(0, 2, 1) / square
    stretched = np.zeros((len(between), 6, moved.shape[2]))
    stretched[:, :1] = np.einsum("pa,pan->pn", between, moved)[:, None] / square
    rotation = np.concatenate([turned, *(marker.rotation[None] for marker in of_markers)])
    joint, lines = body.markers[body.joint], {}
    for name, marker in body.markers.items():
        way = marker.position - joint.position
        if not (length := float(np.linalg.norm(way))) or name == body.joint:
            continue
        carried = np.zeros_like(joint.rotation) if supported else joint.rotation
        across = np.eye(3) - np.outer(way, way) / length**2
        bent = marker.translation - joint.translation - np.cross(carried, way, axisa=0).T
        chord = np.cross(way, bent, axisb=0).T / length**2
        s = ((np.arange(limits.POINTS_ON_LINE) + 0.5) / limits.POINTS_ON_LINE)[:, None, None]
        lines[name] = np.asarray(6 * (s - s**2) * chord + (3 * s**2 - 2 * s) * (across @ (marker.rotation - carried)))
    return DeformationShapes(rotation, stretched, lines)


def _near_pairs(x: Array, shapes: Array) -> tuple[Array, Array]:
    """Return the ways between near points x (n_pairs, 3) and how much each shape changes them (n_pairs, 3, n)."""
    from scipy.spatial import cKDTree

    chosen = np.linspace(0, len(x) - 1, min(limits.MOST_PLACES, len(x))).astype(int)
    near = cKDTree(x).query(x[chosen], min(limits.NEAREST_NODES, len(x)))[1].reshape(len(chosen), -1)
    first, second = np.repeat(chosen, near.shape[1]), near.ravel()
    apart = np.linalg.norm(x[second] - x[first], axis=1)
    used = apart > SOLVED * float(np.ptp(x, axis=0).max())
    first, second = first[used], second[used]
    return x[second] - x[first], shapes[second] - shapes[first]


def measure_deformation(shapes: DeformationShapes, body: FlexibleBody, q: Array) -> Deformation:
    """Find the largest rotation and strain over a motion q (n_times, n), and the shortening towards each marker."""
    shortening = {}
    for name, line in shapes.lines.items():
        square = ((q @ np.einsum("pai,paj->ij", line, line)) * q).sum(axis=1)
        length = float(np.linalg.norm(body.markers[name].position - body.markers[body.joint].position))
        shortening[name] = 0.5 * length * square / len(line)
    return Deformation(_largest(shapes.rotation, q), _largest(shapes.strain, q), shortening)


def _largest(field: Array, q: Array) -> float:
    """Return the largest length of a field's vectors (n_points, k, n) over a motion.

    Times come in the order of a bound, the sum of the modes' largest parts, until the bound is below what was reached;
    of the points those count whose own bound over some of the times isn't.
    """
    if not (q.size and field.size):
        return 0.0
    sizes, lengths = np.abs(q), np.linalg.norm(field, axis=1)
    bound = sizes @ lengths.max(axis=0)
    order, largest = np.argsort(-bound), 0.0
    for start in range(0, len(order), DEFORMED_AT_ONCE):
        frames = order[start : start + DEFORMED_AT_ONCE]
        if bound[frames[0]] <= largest:
            break
        near = field[lengths @ sizes[frames].max(axis=0) > largest]
        values = (near.reshape(-1, near.shape[2]) @ q[frames].T).reshape(*near.shape[:2], len(frames))
        largest = max(largest, float(np.sqrt((values**2).sum(axis=1).max(initial=0.0))))
    return largest


def _rotation_on_lines(space: AnySpace, body: FlexibleBody, supported: bool) -> dict[str, Array]:
    """Return the rotation of the shapes across the line from the joint to each marker, at the nearest elements."""
    from scipy.spatial import cKDTree

    centres = np.concatenate([own.space.x[own.space.element_nodes].mean(axis=1) for own in space.members])
    tree, joint = cKDTree(centres), body.markers[body.joint]
    lines = {}
    for name, marker in body.markers.items():
        way = marker.position - joint.position
        if not (length := float(np.linalg.norm(way))) or name == body.joint:
            continue
        places = joint.position + np.outer((np.arange(limits.POINTS_ON_LINE) + 0.5) / limits.POINTS_ON_LINE, way)
        elements = tree.query(places)[1]
        needed, back = np.unique(elements, return_inverse=True)
        rotation = np.empty((len(needed), 3, len(body.omega)))
        for own in space.members:
            if not len(mine := own.own(needed)):
                continue
            middle, shapes = own.space.kind.corners.mean(axis=0)[:, None], own.of_shapes(body.shapes)
            rotation[mine] = _rotation_and_strain(own.space, shapes, middle, needed[mine] - own.first_element)[0][:, 0]
        rotation = rotation[back]
        if not supported:
            rotation = rotation - joint.rotation
        along = way / length
        lines[name] = np.asarray(rotation - along[:, None] * (along @ rotation)[:, None])
    return lines


def _rotation_and_strain(space: Discretisation, shapes: Array, X: Array, elements: IntArray) -> tuple[Array, Array]:
    """Return rotations (n_elements, n_q, 3, n) and strains (n_elements, n_q, 6, n) at reference points X (3, n_q)."""
    local = space.element_nodes[elements]
    g, _ = space.gradients(X, elements)
    u = shapes[local].reshape(len(elements), 1, local.shape[1], -1)
    du = (g.swapaxes(2, 3) @ u).reshape(len(elements), X.shape[1], 3, 3, -1)  # du[e, q, j, i] = ∂u_i/∂x_j
    pairs = ((1, 2), (2, 0), (0, 1))
    rotation = [0.5 * (du[:, :, a, b] - du[:, :, b, a]) for a, b in pairs]
    shear = [(du[:, :, a, b] + du[:, :, b, a]) / np.sqrt(2) for a, b in pairs]
    stretch = [du[:, :, a, a] for a in range(3)]
    return np.stack(rotation, axis=2), np.stack([*stretch, *shear], axis=2)
