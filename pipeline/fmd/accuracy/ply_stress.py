"""Stress and failure indices of laminates' plies as quantities of the error budget, where files hold them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fmd.accuracy.error_estimates import Quantity
from fmd.core.arrays import Array
from fmd.fem.layered import Layered
from fmd.recovery.plies import FAILURE_INDICES, StressOfPlies, extremes_of_laminates, modal_ply_stress

if TYPE_CHECKING:
    from fmd.accuracy.quantities import Quantities
    from fmd.stages.part import FlexiblePart

_IN_PLANE = ("11", "22", "12")
PLY_ROWS = (*_IN_PLANE, *FAILURE_INDICES)
"""Names of components and indices, which the budget has a row of each."""
ACROSS = "it is largest in a layer along edges as wide as the shell is thick, which few meshes resolve"
"""Why transverse shear has none: two meshes of elements larger than that have it too small alike."""


def ply_row(body: str, name: str) -> str:
    """Return the name of the budget's row of a component's extreme, as ``11 max``, or of a failure index."""
    return f"{body}.plies.{name.removesuffix(' max').removesuffix(' min')}"


def has_plies(part: FlexiblePart) -> bool:
    """Return true for a body with layers."""
    return part.has_mesh and any(isinstance(own, Layered) for own, _ in part.material.over(slice(None)))


def ply_quantities(part: FlexiblePart, q: Array, stress: StressOfPlies = modal_ply_stress) -> Quantities:
    """Compute the extremes of a part's plies at their faces over modal coordinates (n_times, n).

    Each has the extremes of all plies in place of values over time, so that its error holds for each of them. A ply
    without strengths has the index 0.
    """
    found = extremes_of_laminates(part.space, part.material, part.body.shapes, q, part.shape, stress)
    quantities: Quantities = {}
    for name in PLY_ROWS:
        ends = ("max", "min") if name in _IN_PLANE else ("",)
        values = [(own.values[f"{name} {end}".rstrip()], end or "max") for own in found for end in ends]
        extremes = [getattr(each, end)(axis=0).ravel() for each, end in values]
        label, unit = ply_row(part.name, name), "Pa" if name in _IN_PLANE else "1"
        quantities[label] = Quantity(label, unit, np.nan_to_num(np.concatenate(extremes)), kind="stress")
    return quantities
