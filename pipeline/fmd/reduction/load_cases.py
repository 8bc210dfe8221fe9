"""Loads under which another program computes what a body without elements lacks: its stress and its K_G."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.files import LARGEST_CASE
from fmd.core.limits.round_off import SOLVED
from fmd.reduction.loads import PRODUCTS, centrifugal_fields, inertia_of

if TYPE_CHECKING:
    from fmd.fem.markers import Marker
    from fmd.fem.model import FEModel
    from fmd.reduction.eigen import FreeBodySolver

_AXES = "xyz"


def stiffening_cases(fe: FEModel, solver: FreeBodySolver, markers: Mapping[str, Marker]) -> dict[str, Array]:
    """Return the loads whose combinations are all that stiffen a body, by name, each of shape (n_nodes, 3) [N].

    Products of angular rates and unit forces and torques at each marker, balanced by the body's own inertia. Reactions
    of joints and inertia of rigid motions are combinations of these, so no joint and no support counts. Loads without
    stress are left out, as that of a straight shaft's turning about itself.
    """
    names = [f"spin-{_AXES[a]}{_AXES[b]}" for a, b in PRODUCTS]
    names += [f"{name}-{what}{axis}" for name in markers for what in "fm" for axis in _AXES]
    columns = [marker.columns(len(fe.x), np.eye(3)) for marker in markers.values()]
    loads = np.concatenate([inertia_of(fe, centrifugal_fields(fe.x, None)), *columns], axis=2)
    u = solver.static_response(loads)
    strained = np.abs(fe.K @ u.reshape(-1, len(names))).max(axis=0) > SOLVED * np.abs(loads).max(axis=(0, 1))
    return dict(zip(np.array(names)[strained].tolist(), _loads_of(fe, u[:, :, strained]), strict=True))


def shape_cases(fe: FEModel, shapes: Array) -> dict[str, Array]:
    """Return the loads under which a body deforms as its shapes (n_nodes, 3, n), by name, shapes (n_nodes, 3) [N]."""
    return {f"mode-{number}": load for number, load in enumerate(_loads_of(fe, shapes), start=1)}


def _loads_of(fe: FEModel, u: Array) -> list[Array]:
    """Return loads ``K u`` by which the largest displacement is `LARGEST_CASE` of the body's size, rigid ones aside."""
    size = float(np.ptp(fe.x, axis=0).max())
    Q = np.linalg.qr(fe.rigid_modes)[0]
    flat = u.reshape(len(Q), -1)
    deformed = np.abs(flat - Q @ (Q.T @ flat)).max(axis=0)
    scale = LARGEST_CASE * size / np.where(deformed > 0.0, deformed, np.inf)
    return [load.reshape(-1, 3) for load in (fe.K @ (flat * scale)).T]
