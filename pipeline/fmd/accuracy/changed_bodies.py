"""Bodies of other frequencies or fewer shapes, in coordinates of their own, for computations beside a run's."""

from dataclasses import replace
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.errors import HARDLY_MIXED, MOST_OF_EIGENVALUE
from fmd.core.limits.rank import NEW_RESPONSE
from fmd.reduction.body import FlexibleBody


def soften_body(body: FlexibleBody, excess: Array) -> tuple[FlexibleBody, Array]:
    """Return a body whose stiffness has lost its excess, and the matrix (n, n) to coordinates with the same forces.

    Stress balances forces: a stiffness that is too large makes displacements too small but leaves it right. So the
    stress of the softened body is that of the given one under the same modal forces. The excess (n, n) is of products
    of two shapes' stiffness, over both frequencies; at most three quarters of the stiffness of a combination are taken
    off. The body comes in coordinates of its own, each most like the given one of its number.
    """
    from scipy.optimize import linear_sum_assignment  # many runs soften nothing

    parts, directions = np.linalg.eigh(np.eye(len(excess)) - 0.5 * (excess + excess.T))
    kept = (directions * np.clip(parts, 1 - MOST_OF_EIGENVALUE, 1 + MOST_OF_EIGENVALUE)) @ directions.T
    omega2, turn = np.linalg.eigh(body.omega[:, None] * kept * body.omega)
    # In the given order and without round-off equations have the structure of the given body's, and their machine code.
    order = linear_sum_assignment(turn**2, maximize=True)[1]
    omega2, turn = omega2[order], turn[:, order]
    turn[np.abs(turn) < HARDLY_MIXED] = 0.0
    return _combined(body, turn, np.sqrt(omega2)), turn * omega2 / body.omega[:, None] ** 2


def retune_body(body: FlexibleBody, omega: Array) -> tuple[FlexibleBody, Array]:
    """Return a body of other frequencies omega (n,) [rad/s] and the same stiffness, whose modal masses are changed.

    It rings at these frequencies and still yields to static loads as before. Its coordinates have unit modal mass; the
    matrix (n, n) from them to the given body's is returned, too.
    """
    scale = np.diag(omega / body.omega)
    return _combined(body, scale, omega), scale


def keep_lowest(body: FlexibleBody, own: Array, n: int) -> tuple[FlexibleBody, Array]:
    """Return a body with the shapes of a poorer basis and its own n lowest ones alone.

    The lowest alone lack static responses that the poorer basis has, and so would differ from it by more than by what
    it leaves out. A body of no more shapes than both are is returned as it is. The poorer basis' shapes ``own``
    (n_nodes, 3, k) combine the body's; those of the result, k + n at most, have unit modal mass and diagonal stiffness
    (Rayleigh–Ritz). With it comes the matrix (n_modes, k + n) from its coordinates to the given body's.
    """
    if len(body.omega) <= own.shape[-1] + n:
        return body, np.eye(len(body.omega))
    nodal = body.shapes.reshape(-1, len(body.omega))
    combined = np.linalg.lstsq(nodal, own.reshape(len(nodal), -1))[0]
    both = np.c_[combined / np.linalg.norm(combined, axis=0), np.eye(len(body.omega))[:, :n]]
    directions, sizes, _ = np.linalg.svd(both, full_matrices=False)
    directions = directions[:, sizes > NEW_RESPONSE * sizes[0]]
    omega2, turn = np.linalg.eigh((directions.T * body.omega**2) @ directions)
    weights = directions @ turn
    return _combined(body, weights, np.sqrt(omega2)), weights


def _combined(body: FlexibleBody, weights: Array, omega: Array) -> FlexibleBody:
    """Return a body whose shapes are combinations (n, k) of another's, of unit modal mass, with these frequencies."""
    full = np.zeros((len(weights) + 1, len(omega) + 1))
    full[0, 0], full[1:, 1:] = 1.0, weights
    integrals = body.integrals
    second_order = ("stiffening", "displacement2", "rotation2")
    forms: dict[str, Any] = {name: _in_new(getattr(integrals, name), weights) for name in second_order}
    integrals = replace(integrals, G=full.T @ integrals.G @ full, S=integrals.S @ full, **forms)
    markers = {
        name: replace(
            marker,
            translation=marker.translation @ weights,
            rotation=marker.rotation @ weights,
            displacement2=_in_new(marker.displacement2, weights),
        )
        for name, marker in body.markers.items()
    }
    return replace(body, omega=omega, shapes=body.shapes @ weights, markers=markers, integrals=integrals)


def _in_new(forms: Array, weights: Array) -> Array:
    return np.asarray(weights.T @ forms @ weights) if forms.size else forms
