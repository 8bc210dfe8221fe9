"""Error of results by the stretch that a deflection causes: of what is fixed all around, and of plates that twist.

A strip that is free to shorten bends without stretching. One between supports, or a plate that bends to a shape that no
flat sheet can take, stretches already when it deflects by its thickness.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array
from fmd.core.cache import stage_key
from fmd.core.limits.errors import HARDLY_TURNED, OF_BENDING
from fmd.stages.division import part_of

if TYPE_CHECKING:
    from fmd.stages.part import FlexiblePart
    from fmd.stages.pipeline import Pipeline

_SOURCES, _PACKAGES = ("fmd/fem", "fmd/reduction"), ("numpy", "scipy")
TEXT = (
    "a body that can't shorten as it deflects, between supports or as a plate that twists, stretches, and is stiffer "
    "than linear bending has it; smaller deflections are right, and so is a bar whose far end a fixed joint on the "
    "ground holds instead of a support"
)


def stretching_bodies(run: Pipeline) -> list[str]:
    """Return the names of meshed bodies and pieces that may be stretched by their deflection."""
    return [
        name
        for name, deformation in run.deformations.items()
        if run.parts[name].has_mesh and (run.parts[name].shape.support or deformation.rotation > HARDLY_TURNED)
    ]


def stiffening_by_stretch(run: Pipeline, name: str) -> float:
    """Return how much stiffer stretching makes a body at its largest deflection, relative to its linear stiffness."""
    part, q = run.parts[name], run.motion.modal(name)
    worst = q[((q * run.bodies[name].omega) ** 2).sum(axis=1).argmax()]
    if not worst.any():
        return 0.0
    key = stage_key("stretch", [part.key("body"), worst.tolist()], _SOURCES, _PACKAGES)
    ratio = part.store.read_or_keep(key, lambda: _ratio(part, run.bodies[name].shapes @ worst), "float")
    return max(ratio - OF_BENDING * run.deformations[name].rotation ** 2, 0.0)


def _ratio(part: FlexiblePart, u: Array) -> float:
    """Return the stiffening by stretch of a displacement u (n_nodes, 3)."""
    from fmd.fem.geometric_stiffness import membrane_ratio, quadratic_strain_load

    f, energy = quadratic_strain_load(part.fe, u)
    v = part.model.solver.static_response(-f[:, :, None])[:, :, 0]
    return membrane_ratio(part.fe, u, v, f, energy)


def excess_deflection(ratio: float) -> float:
    """Return by how much the linear deflection is too large, over the right one.

    With a cubic force of relative size r at the linear deflection, one s times as large has ``s + r s³ = 1``.
    """
    if not ratio:
        return 0.0
    roots = np.roots([ratio, 0.0, 1.0, -1.0])
    return 1 / float(roots.real[np.abs(roots.imag).argmin()]) - 1


def stretching_warnings(run: Pipeline, too_large: float) -> list[dict[str, str]]:
    """Warn of each body whose stretch makes results wrong by more than a part of them."""
    errors = {name: excess_deflection(stiffening_by_stretch(run, name)) for name in stretching_bodies(run)}
    return [
        {
            "code": "large-deflection",
            "body": part_of(name) or name,
            "text": f"{name}: {TEXT}; results are off by about {100 * error:.2g} %",
        }
        for name, error in errors.items()
        if error > too_large
    ]
