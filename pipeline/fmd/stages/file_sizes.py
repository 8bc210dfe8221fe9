"""Sizes of bodies from meshes, CAD files and matrices, by which a wrong unit of a file shows."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.errors import InputError
from fmd.core.limits.scene import POSSIBLE, USUAL_OF_FILES

if TYPE_CHECKING:
    from fmd.core.arrays import Array
    from fmd.reduction.modes import Modes
    from fmd.stages.part import FlexiblePart


def require_possible_sizes(part: FlexiblePart, modes: Modes) -> None:
    """Raise ``InputError`` if a body from a file is larger, smaller, faster or slower than anything is."""
    if not part.shape.file_keys:
        return
    extent, lowest = _measure(part.fe.x, modes)
    for kind, value, unit in (("length", extent, "m across"), ("frequency", lowest, "Hz in its first mode")):
        low, high = POSSIBLE[kind]
        if value and not low <= value <= high:
            problem = f"can't be: the body would have {value:.3g} {unit}; is the unit of its file another?"
            raise InputError(part.file, f"body.{part.name}.{part.shape.file_keys[0]}", None, problem)


def unusual_sizes(part: FlexiblePart) -> Iterator[str]:
    """Write a sentence for each size of a body from a file that is far from usual ones."""
    if not part.shape.file_keys:
        return
    x = part.mesh.points if part.has_mesh else part.body.x if part.joint.marker else part.fe.x  # what is kept, if any
    for value, (what, low, high, unit, examples) in zip(_measure(x, part.modes), USUAL_OF_FILES, strict=True):
        if value and not low <= value <= high:
            yield (
                f"{part.name}: {what} is {value:.4g} {unit}, which is unusual: {examples}; is the unit of its file "
                "another?"
            )


def _measure(x: Array, modes: Modes) -> tuple[float, float]:
    """Return the diagonal of a body's box [m] and its lowest frequency [Hz], 0 if it has no mode."""
    lowest = float(modes.frequencies_hz.min()) if modes.omega.size else 0.0
    return float(np.linalg.norm(np.ptp(x, axis=0))), lowest
