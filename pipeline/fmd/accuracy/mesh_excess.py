"""Excess of a part's frequencies by its mesh: by recovered stress, by a coarser mesh and by few elements across."""

import numpy as np

from fmd.accuracy.coarse_mesh import Pair
from fmd.core.arrays import Array
from fmd.core.limits.errors import MOST_OF_CHANGE
from fmd.reduction.body import FlexibleBody
from fmd.stages.part import FlexiblePart


def find_excess(part: FlexiblePart, body: FlexibleBody, pair: Pair | str, across: Pair | None) -> tuple[Array, Array]:
    """Return the excess of a body's squared frequencies (n,) and of products of its shapes' stiffness (n', n').

    ``pair`` has the run on a coarser mesh, or says why there is none; ``across`` that with more elements from side to
    side, of whose lack the others know nothing. Where it is finer each way it tells all.
    """
    of_modes, excess = _excess_along(part, body, pair)
    if across is None or not across.divides(part.name):
        return of_modes, excess
    changed, alike = across.excess_of_shapes(part.name)
    along = np.where(alike & across.is_finer_each_way(part.name), 0.0, np.diag(excess))
    required = along + np.where(alike, changed, 0.0)
    return add_across(of_modes, across, part.name), _with_diagonal(excess, required)


def _excess_along(part: FlexiblePart, body: FlexibleBody, pair: Pair | str) -> tuple[Array, Array]:
    of_modes, excess = energy_excess(part, body)
    if isinstance(pair, str):
        return of_modes, excess
    changed, alike = pair.excess_of_shapes(part.name)
    recovered = np.diag(excess)
    static = body.omega > part.modes.omega.max()
    most = np.where(static, MOST_OF_CHANGE * np.abs(changed), np.inf)
    required = np.where(alike, combine_excess(part, np.minimum(recovered, most), changed), recovered)
    return combine_modes(part, of_modes, pair), _with_diagonal(excess, required)


def energy_excess(part: FlexiblePart, body: FlexibleBody) -> tuple[Array, Array]:
    """Return the excess of a part's squared mode frequencies and of its body's eigenvalues by recovered stress."""
    from fmd.recovery.patch_stress import energy_errors

    errors = energy_errors(part.space, part.material, body.shapes)
    # The modes are combinations of the body's shapes and rigid motions.
    flat, modes = body.shapes.reshape(part.fe.K.shape[0], -1), part.modes
    weights = (flat.T @ (part.fe.K @ modes.shapes.reshape(len(flat), -1))) / body.omega[:, None] ** 2
    of_modes = np.einsum("jk,jl,lk->k", weights, errors, weights) / modes.omega**2
    return np.asarray(of_modes), np.asarray(errors / np.outer(body.omega, body.omega))


def _with_diagonal(excess: Array, required: Array) -> Array:
    """Scale products of shapes to another diagonal; entries that aren't positive there stand alone."""
    given = np.diag(excess)
    both = (given > 0.0) & (required > 0.0)
    scale = np.sqrt(np.where(both, required, 0.0) / np.where(both, given, 1.0))
    scaled = excess * np.outer(scale, scale)
    np.fill_diagonal(scaled, required)
    return np.asarray(scaled)


def combine_excess(part: FlexiblePart, recovered: Array, changed: Array) -> Array:
    """Return the excess of a part's eigenvalues by the estimates of recovered stress and of a coarser mesh, (n,).

    Behind a rigid face or a support stress has no limit at its edge, of which two meshes show little: bars with one had
    up to 60 times the excess that a coarser mesh tells. There the larger one counts, elsewhere their root mean square.
    Strain of beams jumps in truth where a mass hangs on them: recovered, it counts up to the largest of the changes.
    """
    if part.space.mesh.midsurface is not None and part.space.mesh.midsurface.has_sections:
        recovered = np.minimum(recovered, np.abs(changed).max(initial=0.0))
    rigid = any(marker.rigid for marker in part.markers.values()) or bool(part.shape.support)
    if rigid or any(link.type == "rigid" for link in part.shape.link.values()):
        return _larger(recovered, changed)
    return root_mean_square(recovered, changed)


def combine_modes(part: FlexiblePart, recovered: Array, pair: Pair) -> Array:
    """Return the excess of a part's squared frequencies by recovered stress and, of modes it has, a coarser mesh."""
    changed, alike = pair.excess_of_modes(part.name)
    return np.where(alike, combine_excess(part, recovered, changed), recovered)


def add_across(of_modes: Array, across: Pair, name: str) -> Array:
    """Add what more elements from side to side take off the squares of a part's frequencies to their excess.

    Where they are more each way, that is the whole.
    """
    changed, alike = across.excess_of_modes(name)
    along = np.where(alike & across.is_finer_each_way(name), 0.0, of_modes)
    return along + np.where(alike, changed, 0.0)


def root_mean_square(recovered: Array, changed: Array) -> Array:
    """Return the root mean square of the estimates by recovered stress and by a coarser mesh, signed as the larger.

    Neither is a bound: recovered stress states too much where stress jumps, a coarser mesh too little where corners
    slow convergence, or where it has as few elements as the run's.
    """
    return np.asarray(np.copysign(np.sqrt((recovered**2 + changed**2) / 2), _larger(recovered, changed)))


def _larger(one: Array, other: Array) -> Array:
    return np.where(np.abs(one) > np.abs(other), one, other)
