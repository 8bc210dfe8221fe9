"""Flexible bodies as other programs get them: for any motion in space, whatever the scene does with them."""

from dataclasses import replace

import numpy as np

from fmd.core.arrays import Array
from fmd.core.cache import stage_key
from fmd.core.errors import InputError, as_input_error
from fmd.recovery.stress import modal_stress
from fmd.reduction.body import FlexibleBody
from fmd.reduction.craig_bampton import Superelement, make_superelement
from fmd.reduction.modes import TooManyModesError
from fmd.scene.modes import damping_ratios
from fmd.stages.basis import ConstrainedModel, reduce_body, stiffen_for_any_motion, stiffen_reduced
from fmd.stages.part import FlexiblePart
from fmd.stages.reduced_files import reduce_file_body

_SOURCES = ("fmd/fem", "fmd/reduction", "fmd/stages")


def spatial_body(part: FlexiblePart, stiffened: bool) -> FlexibleBody:
    """Reduce a body for any motion in space, on request stiffened by all loads that can act on its markers.

    A body that hangs on a joint keeps the frame that its joint gives it. Without a joint its frame moves with its mean
    axes, and has its origin at the first marker. Bodies without a mesh are stiffened only if their file is.

    Raises
    ------
    InputError
        The body has no marker, by which another program could hold it.
    """
    key = stage_key("spatial body", [part.key("body"), part.key("modes"), stiffened], _SOURCES, ("numpy", "scipy"))
    return part.store.read_or_keep(key, lambda: _reduce(part, stiffened), "FlexibleBody")


def _reduce(part: FlexiblePart, stiffened: bool) -> FlexibleBody:
    elements = part.can_be_stiffened and stiffened
    if part.joint.marker and not part.is_reduced:
        body = part.for_any_motion(part.stiffened if elements else part.body)
        return stiffen_for_any_motion(part.model, body, elements) if elements or part.fe.arms is not None else body
    model = _on_any_marker(part)
    if part.is_reduced:
        return reduce_file_body(model, part.modes, part.shape, part.frame, "auto" if stiffened else "off")
    body = reduce_body(model, part.modes, part.shape.modes, part.frame)
    return stiffen_reduced(model, body) if elements else body


def surface_stress(part: FlexiblePart, body: FlexibleBody) -> Array | None:
    """Stress of a body that `spatial_body` has made, at its surface's nodes, (n_surface, 6, n); ``None`` without."""
    if part.has_mesh:
        return modal_stress(part.space, part.material, body.shapes, part.surface.nodes)
    return part.given_model.stress_of(body.shapes) if part.has_stress else None


def _on_any_marker(part: FlexiblePart) -> ConstrainedModel:
    """Return the part's model, on its first marker if no joint carries it."""
    model = part.model
    if not model.markers:
        key = f"body.{part.name}.marker"
        raise InputError(part.file, key, None, "is missing: a body is fixed at its markers; give one, e.g. at a face")
    if part.joint.marker:
        return model
    return replace(model, joint=replace(part.joint, marker=next(iter(model.markers))))


def superelement(part: FlexiblePart) -> Superelement:
    """Reduce a body to its interface, the markers that ``modes.interface`` names, or all.

    Raises
    ------
    InputError
        The body has no marker, no matrices, or fewer modes than the scene wants.
    """
    if part.is_reduced:
        mend = "is a reduced body, without the matrices that a superelement is made of"
        raise InputError(part.file, f"body.{part.name}.body", None, mend)
    model, settings = _on_any_marker(part), part.shape.modes
    markers = {name: model.markers[name] for name in settings.interface or model.markers}

    def ratios(omega: Array) -> Array:
        return np.array(damping_ratios(settings.damping, omega.tolist()))

    with as_input_error(part.file, f"body.{part.name}.modes.count", settings.count, of=TooManyModesError):
        return make_superelement(model.fe, model.solver, markers, settings.count, ratios)
