"""Points of faces that take a pressure, and their flexibility that a body's modes leave out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from fmd.contact.columns import motions_of_all
from fmd.contact.touching_body import ContactPoints
from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits import contact as limits

if TYPE_CHECKING:
    from fmd.fem.markers import Marker
    from fmd.fem.model import FEModel
    from fmd.reduction.body import FlexibleBody
    from fmd.reduction.held_by_joint import StaticSolver


def pressed_nodes(marker: Marker) -> tuple[IntArray, Array]:
    """Return the nodes of a marker's face that a constant pressure pushes at, and the area of each.

    Its nodal forces are ``∫ N dA``: equal ones at the corners of linear facets, and at the middles of the sides of
    quadratic ones. The corners of quadratic triangles take none; those of quadrilaterals are pulled at, and without
    them the middles take a quarter of a facet each.

    Raises
    ------
    ValueError
        The marker is on no face that deforms, or this has both quadratic triangles and quadrilaterals.
    """
    if marker.rigid or marker.areas is None:
        raise ValueError("is no face that can deform; an averaged marker on a face works")
    area = marker.areas.sum()
    share = marker.areas / area
    pressed = share > limits.LEAST_SHARE * share.max()
    push = share[pressed].sum()  # 1 of triangles, 4/3 of quadrilaterals
    if min(abs(push - 1.0), abs(push - 4.0 / 3.0)) > limits.OTHER_FACETS:
        raise ValueError("has quadratic triangles and quadrilaterals, which no forces that push load alike; two work")
    return marker.nodes[pressed], share[pressed] / push * area


def contact_points(
    fe: FEModel,
    solver: StaticSolver,
    body: FlexibleBody,
    faces: Mapping[str, Marker],
    triangles: Mapping[str, IntArray],
    loaded: Mapping[str, Marker],
) -> ContactPoints:
    """Find the points of a body's faces and their residual flexibility ``G = Bᵀ K⁺ B − V (Vᵀ K V)⁻¹ Vᵀ``.

    V are the modes at the points without the rigid motion that a joint-conforming basis has, and ``K⁺`` the static
    response by inertia relief. Faces are averaged markers; all corners of ``triangles`` (n_triangles, 3), of faces that
    may touch other bodies, become points. Forces on ``loaded`` markers move points beside the modes, too.

    Raises
    ------
    ValueError
        A face has no points that take a pressure, or there are too many points; the message begins with the face's
        name.
    AccuracyError
        A static response isn't accurate.
    """
    pressed = dict[str, tuple[IntArray, Array]]()
    for name, marker in faces.items():
        try:
            pressed[name] = pressed_nodes(marker)
        except ValueError as error:
            raise ValueError(f"{name} {error}") from error
    corners = [own.ravel() for own in triangles.values()]
    at: IntArray = np.unique(np.concatenate([*(nodes for nodes, _ in pressed.values()), *corners]))
    if (n := len(at)) > limits.MOST_OF_FACES:
        raise ValueError(
            f"{', '.join(faces)}: {n} points, of which {limits.MOST_OF_FACES} can be followed; a smaller face "
            "or larger elements work"
        )
    numbers = {name: np.searchsorted(at, nodes) for name, (nodes, _) in pressed.items()}
    areas = {name: area for name, (_, area) in pressed.items()}
    V, G, raised = _elastic_shapes(fe, solver, body)[at] / body.omega, np.zeros((0, 3, 0, 3)), 0.0
    soft, held, W = np.zeros(0), np.zeros((0, 0)), np.zeros((0, 3, 0))
    try:
        if n <= limits.MOST_POINTS:
            whole = solver.flexibility(at)
            G, raised = _raised(whole - (V := V.reshape(3 * n, -1)) @ V.T, whole)
            G = G.reshape(n, 3, n, 3)
        else:
            soft, held, W, raised = motions_of_all(at, body.x[at], body.shapes[at], solver.responder(), V)
    except np.linalg.LinAlgError as error:
        raise ValueError(f"{', '.join(faces)}: points move as a rigid part; a face that deforms works") from error
    shapes = np.ascontiguousarray(body.shapes[at])
    surfaces = {name: np.searchsorted(at, own) for name, own in triangles.items()}
    (material, _), *others = fe.material.over(slice(None))
    elastic = None if others else material.isotropic
    x = body.x[at].copy()
    yields = find_yields(fe, solver, body, at, loaded)
    return ContactPoints(
        x,
        areas,
        shapes,
        G,
        numbers,
        raised,
        surfaces,
        elastic=elastic,
        nodes=at,
        yields=yields,
        soft=soft,
        held=held,
        left_to_modes=W,
    )


def find_yields(
    fe: FEModel, solver: StaticSolver, body: FlexibleBody, nodes: IntArray, markers: Mapping[str, Marker]
) -> dict[str, Array]:
    """Return displacements of nodes beside the modes by unit forces and moments on markers, (n, 3, 6) each."""
    V, found = _elastic_shapes(fe, solver, body) if markers else np.zeros(0), {}
    for name, marker in markers.items():
        f = marker.columns(len(fe.x), np.eye(3))
        modal = np.einsum("nam,nak->mk", V[marker.nodes], f[marker.nodes]) / body.omega[:, None] ** 2
        found[name] = solver.remembered_response(f)[nodes] - V[nodes] @ modal
    return found


def _elastic_shapes(fe: FEModel, solver: StaticSolver, body: FlexibleBody) -> Array:
    """Return the modes without rigid motion, (n_nodes, 3, n_modes)."""
    flat, R = body.shapes.reshape(3 * len(fe.x), -1), solver.rigid_modes
    if R.shape[1]:
        MR = fe.M @ R
        flat = flat - R @ np.linalg.solve(R.T @ MR, MR.T @ flat)
    return np.asarray(flat.reshape(len(fe.x), 3, -1))


@dataclass(frozen=True)
class ResidualFields:
    """Displacements of a body that its modes leave out, as combinations of fields."""

    shapes: Array  # (n_nodes, 3, n_fields): fields [m]
    sizes: Array  # (n_times, n_fields): how much of each there is at the output times


def find_residual_fields(
    fe: FEModel, solver: StaticSolver, body: FlexibleBody, nodes: IntArray, forces: Array
) -> ResidualFields:
    """Return the displacements of a body that its modes leave out, under forces [N] on some nodes over time.

    They are ``K⁺ f − V (Vᵀ K V)⁻¹ Vᵀ f`` for forces (n_times, n_loaded, 3) in the body's axes. Forces that are
    combinations of a few have as few fields (singular values).
    """
    parts, sizes, rows = np.linalg.svd(forces.reshape(len(forces), -1), full_matrices=False)
    count = int((sizes > limits.FORCES_RESOLVED * sizes.max(initial=0.0)).sum())
    V, fields = _elastic_shapes(fe, solver, body), np.empty((len(fe.x), 3, count))
    for first in range(0, count, limits.COLUMNS_AT_ONCE):
        some = rows[first : min(first + limits.COLUMNS_AT_ONCE, count)].T.reshape(len(nodes), 3, -1)
        loads = np.zeros((len(fe.x), 3, some.shape[2]))
        loads[nodes] = some
        modal = np.einsum("nam,nak->mk", V[nodes], some) / body.omega[:, None] ** 2
        fields[:, :, first : first + some.shape[2]] = solver.static_response(loads) - V @ modal
    return ResidualFields(fields, parts[:, :count] * sizes[:count])


def _raised(G: Array, whole: Array) -> tuple[Array, float]:
    """Return a flexibility, raised where it is too small a part of the whole one, and the share of such directions.

    Where modes have nearly all of it, they would hit the plane with their mass, at a frequency without bound. Each
    direction of both keeps `LEAST_FLEXIBILITY` of the whole, so frequencies stay bounded and little is added.
    """
    L = np.linalg.cholesky(whole)
    half = np.linalg.solve(L, _symmetric(G))
    parts, V = np.linalg.eigh(_symmetric(np.linalg.solve(L, half.T)))
    low = parts < limits.LEAST_FLEXIBILITY
    if not low.any():
        return _symmetric(G), 0.0
    V = L @ V
    return _symmetric((V * np.maximum(parts, limits.LEAST_FLEXIBILITY)) @ V.T), float(low.mean())


def _symmetric(A: Array) -> Array:
    return np.asarray(0.5 * (A + A.T))
