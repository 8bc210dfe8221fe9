"""The computations of a flexible part's stages, which are loaded when a result isn't kept."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fmd.core.errors import AccuracyError, InputError, as_input_error
from fmd.fem.joined import HINGE_MEND, AnyMesh
from fmd.fem.joined_model import SeamError
from fmd.fem.layered import DirectionError
from fmd.fem.surface import SurfaceTopology, surface_topology
from fmd.recovery.deformation import DeformationShapes, deformation_shapes, node_deformation_shapes
from fmd.recovery.stress import element_stress, modal_stress
from fmd.reduction.body import FlexibleBody, SecondOrder
from fmd.reduction.inertia import normal_blocks
from fmd.stages.file_sizes import require_possible_sizes
from fmd.stages.meshing.bodies import make_mesh, read_body_matrices
from fmd.stages.part import NO_MESH, FlexiblePart
from fmd.stages.reduced_files import modes_of_file, read_reduced_body, reduce_file_body

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from fmd.core.arrays import Array
    from fmd.fem.model import FEModel
    from fmd.reduction.modes import Modes


def compute_mesh(part: FlexiblePart) -> AnyMesh:
    """Mesh a part, or read its mesh; refuses a part without elements."""
    if not part.has_mesh:
        key, what = ("body", "file") if part.is_reduced else ("matrices", "matrices")
        raise InputError(part.file, f"body.{part.name}.{key}", None, NO_MESH.format(what))
    return make_mesh(part.shape, part.source)


def assemble(part: FlexiblePart) -> FEModel:
    """Assemble stiffness and mass of a part, with its links, or read them."""
    return part.find_in_common("assembly", lambda: _assemble(part))


def _assemble(part: FlexiblePart) -> FEModel:
    from fmd.fem.assembly import assemble

    if part.is_reduced:
        return read_reduced_body(part.shape, part.source, part.file, part.name)
    if not part.has_mesh:
        return read_body_matrices(part.shape, part.source)
    kinds = [own.space.kind for own in part.space.members]
    if part.formulation == "plain" and not any(kind.can_be_enhanced for kind in kinds):
        problem = f"belongs to linear hexahedra; the elements here are {kinds[0].name}"
        raise InputError(part.file, f"body.{part.name}.mesh.formulation", "plain", problem)
    key = f"body.{part.name}"
    with (
        as_input_error(part.file, f"{key}.layer_direction", of=DirectionError),
        as_input_error(part.file, f"{key}.mesh.tie", of=SeamError),
    ):
        solid = assemble(part.mesh, part.order, part.material, part.formulation)
    if not part.shape.link and part.mesh.connections is None:
        return solid
    from fmd.stages.markers import add_links

    return add_links(part.shape, solid, part.file, part.name)


def compute_modes(part: FlexiblePart) -> Modes:
    """Find the modes of a part that its scene chooses, or take those of its file."""
    from fmd.stages.basis import compute_modes

    if part.is_reduced:
        return modes_of_file(part.fe)
    try:
        with part.model.solver.telling(part.store.advance):
            modes = compute_modes(part.model, part.shape.modes)
    except AccuracyError as error:
        if hinges := [note for note in part.mesh_notes if note.endswith(HINGE_MEND)]:
            raise InputError(part.file, f"body.{part.name}.mesh", None, f"{error}; {'; '.join(hinges)}") from error
        raise
    require_possible_sizes(part, modes)
    return modes


def reduce(part: FlexiblePart) -> FlexibleBody:
    """Reduce a part to its modes, in its frame."""
    from fmd.stages.basis import reduce_body

    if part.is_reduced:
        return reduce_file_body(part.model, part.modes, part.shape, part.frame, part.stiffening)
    return reduce_body(part.model, part.modes, part.shape.modes, part.frame, part.store.advance)


def stiffen(part: FlexiblePart) -> SecondOrder:
    """Return the inertia integrals and markers of a part as all loads that pass through it stiffen it."""
    from fmd.stages.basis import stiffen_reduced

    if part.is_reduced and part.body.integrals.stiffening.size:  # by its file
        return SecondOrder(part.body.integrals, part.body.markers)
    if not part.can_be_stiffened:
        given = NO_MESH.format("file" if part.is_reduced else "matrices, without geometric_stiffness")
        mend = f"stiffening by inertia loads takes stress, and the body {given}; 'off' leaves it out"
        raise InputError(part.file, "simulation.stiffening", None, mend)
    body = stiffen_reduced(part.model, part.body, advance=part.store.advance)
    return SecondOrder(body.integrals, body.markers)


def integrate_along_normal(part: FlexiblePart) -> Array:
    """Integrate the inertia of a part along the one axis that it turns about."""
    return normal_blocks(part.body.x, part.fe.m, part.body.shapes, part.body.integrals.normal)


def find_surface(part: FlexiblePart) -> SurfaceTopology:
    """Find the outer surface of a part."""
    if part.has_mesh:
        return surface_topology(part.space)
    found = part.given_model.surface
    if found is None:
        key = "body" if part.is_reduced else "matrices.stress"
        raise InputError(part.file, f"body.{part.name}.{key}", None, "is of no file with a surface's stress")
    return found


def recover_surface_stress(part: FlexiblePart) -> Array:
    """Return the stress of each modal coordinate at the nodes of a part's surface [Pa]."""
    if not part.has_mesh:
        return part.given_model.stress_of(part.body.shapes)
    return modal_stress(part.space, part.material, part.body.shapes, part.surface.nodes)


def recover_element_stress(part: FlexiblePart) -> Array:
    """Return the stress of each modal coordinate in the middle of the named elements of a part [Pa]."""
    numbers = np.array(list(part.elements.values()))
    return element_stress(part.space, part.material, part.body.shapes, numbers, part.element_sides)


def recover_spot_stress(part: FlexiblePart) -> Array:
    """Return the stress of each modal coordinate at the points that name elements of a part [Pa]."""
    return part.stress_at(np.array([element.at for element in part.shape.element.values()]))


def evaluate_deformation(part: FlexiblePart) -> DeformationShapes:
    """Evaluate rotation and strain of each modal coordinate of a part."""
    if not part.has_mesh:
        return node_deformation_shapes(part.body, part.is_supported, of_matter=not part.is_reduced)
    return deformation_shapes(part.space, part.body, part.is_supported)


def recover_nodal_stress(part: FlexiblePart) -> NDArray[np.float32]:
    """Return the stress of each modal coordinate at all nodes of a part [Pa]."""
    nodes = np.arange(len(part.space.x))
    return modal_stress(part.space, part.material, part.body.shapes, nodes).astype(np.float32)
