"""One flexible body of a scene and the table of its stages, from its mesh to its modal stress."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Generic, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import InputError
from fmd.fem.surface import SurfaceTopology, surface_elements
from fmd.recovery.stress import point_stress
from fmd.reduction.inertia import add_normal_blocks
from fmd.scene.bar import Bar
from fmd.scene.gears import has_teeth
from fmd.scene.imported_bodies import MatrixPart
from fmd.scene.propeller import Propeller
from fmd.scene.reduced_bodies import ReducedPart
from fmd.scene.scene import Scene
from fmd.scene.values import Formulation
from fmd.scene.variants import without_joint_numbers
from fmd.stages.named_elements import find_sides, number_elements, stress_places
from fmd.stages.part_inputs import (
    KeyedPart,
    assembly_inputs,
    body_inputs,
    contact_inputs,
    digest_of_body,
    mesh_inputs,
    model_inputs,
    modes_inputs,
)
from fmd.stages.stage import ALL_PACKAGES, Stage, stages_of
from fmd.stages.store import StageStore

if TYPE_CHECKING:
    from fmd.contact.gear_pair import ToothFlexibility
    from fmd.contact.touching_body import ContactPoints
    from fmd.fem.formats.matrix_model import MatrixModel
    from fmd.fem.joined import AnySpace, JoinedMesh
    from fmd.fem.markers import Marker
    from fmd.fem.material import AnyMaterial
    from fmd.fem.mesh import SolidMesh
    from fmd.fem.model import FEModel
    from fmd.fem.space import Discretisation
    from fmd.recovery.deformation import DeformationShapes
    from fmd.reduction.body import FlexibleBody, SecondOrder
    from fmd.reduction.modes import Modes
    from fmd.stages.basis import ConstrainedModel
    from fmd.stages.piece_mesh import PieceMesh

NO_MESH = "is given by its {}: without elements it has no mesh, no stress and no picture"
_BASIS = ("fmd/stages/basis.py", "fmd/stages/markers.py", "fmd/stages/reduced_files.py")
_SHAPES = ("fmd/meshes", "fmd/core/involute.py")
_REDUCTION = ("fmd/fem", "fmd/reduction", *_BASIS)
_STRESS = ("fmd/fem", "fmd/recovery/stress.py")
_DEFORMATION = ("fmd/fem", "fmd/recovery/deformation.py")
_OF_TEETH = "tooth_flexibility:find_tooth_flexibility"
_TEETH = (*_SHAPES, *_REDUCTION, *_STRESS, "fmd/contact/gear_pair.py")
# Of another scene's part with the same modes: enrichment, damping and the joint's frame leave them alone.
_OF_THE_MODES = ("mesh", "assembly", "modes", "surface")
# And its files: all that a part's results are of.
_OF_THE_PART = ("shape", "joint", "contact_faces", "loaded_markers", "frame", "stiffening")
_STIFFENED = "body and what it is stiffened to"
T = TypeVar("T")


class InCommon(Generic[T]):
    """Attribute that is found once for all variants of a part with the same matrices, markers and joint.

    So modes of another number take no second factor, and no second answers to the same loads.
    """

    def __init__(self, find: Callable[[FlexiblePart], T]) -> None:
        self._find, self.__doc__ = find, find.__doc__

    @overload
    def __get__(self, part: None, kind: type) -> InCommon[T]: ...
    @overload
    def __get__(self, part: FlexiblePart, kind: type) -> T: ...
    def __get__(self, part: FlexiblePart | None, kind: type) -> InCommon[T] | T:
        """Return the attribute of a part."""
        return self if part is None else part.find_in_common(self._find.__name__, lambda: self._find(part))


def _has_mesh(part: FlexiblePart) -> bool:
    return part.has_mesh


class FlexiblePart(KeyedPart):
    """A flexible body of a scene, whose stages run on first use.

    The store runs them and keeps their results; those that it has in common with the part ``like`` of another scene are
    taken from it. Nothing may be kept in a cache where ``modes`` take the place of the scene's.
    """

    bare: Scene | None = None  # the scene without springs, rests and dampers of joints, if the part is one of its own
    # The table of stages, in their order.
    mesh: Stage[SolidMesh | JoinedMesh] = Stage(
        "mesh",
        "part_results:compute_mesh",
        (),
        mesh_inputs,
        (*_SHAPES, "fmd/stages/meshing", "fmd/fem"),
        ("gmsh", "meshio"),
        applies=_has_mesh,
    )
    # Never kept, since what follows is.
    fe: Stage[FEModel] = Stage("assembly", "part_results:assemble", ("mesh",), shared_inputs=assembly_inputs)
    modes: Stage[Modes] = Stage(
        "modes", "part_results:compute_modes", ("mesh", "assembly"), modes_inputs, (*_SHAPES, *_REDUCTION), ALL_PACKAGES
    )
    body: Stage[FlexibleBody] = Stage(
        "body", "part_results:reduce", ("mesh", "assembly", "modes"), body_inputs, _REDUCTION
    )
    second_order: Stage[SecondOrder] = Stage(
        "stiffening", "part_results:stiffen", ("mesh", "assembly", "body"), digest_of_body, _REDUCTION, ALL_PACKAGES
    )
    surface: Stage[SurfaceTopology] = Stage(
        "surface", "part_results:find_surface", ("mesh",), mesh_inputs, (*_SHAPES, "fmd/fem"), applies=_has_mesh
    )
    surface_stress: Stage[Array] = Stage(
        "stress",
        "part_results:recover_surface_stress",
        ("mesh", "surface", "body"),
        digest_of_body,
        _STRESS,
        applies=_has_mesh,
    )
    element_stress: Stage[Array] = Stage(
        "element stress",
        "part_results:recover_element_stress",
        ("mesh", "body"),
        lambda part: {"body": part.key("body"), "elements": part.elements, "sides": part.element_sides},
        _STRESS,
        in_key=("mesh",),
        applies=lambda part: bool(part.shape.element),
    )
    spot_stress: Stage[Array] = Stage(
        "spot stress",
        "part_results:recover_spot_stress",
        ("mesh", "body"),
        lambda part: {"body": part.key("body"), "points": [element.at for element in part.shape.element.values()]},
        _STRESS,
        applies=lambda part: bool(part.shape.element),
    )
    deformation_shapes: Stage[DeformationShapes] = Stage(
        "deformation", "part_results:evaluate_deformation", ("mesh", "body"), digest_of_body, _DEFORMATION
    )
    nodal_stress: Stage[NDArray[np.float32]] = Stage(
        "nodal stress",
        "part_results:recover_nodal_stress",
        ("mesh", "body"),
        digest_of_body,
        _STRESS,
        applies=_has_mesh,
    )
    contact_points: Stage[ContactPoints] = Stage(
        "contact",
        "contacts:find_contact_points",
        ("mesh", "assembly", "body"),
        contact_inputs,
        (*_REDUCTION, "fmd/contact"),
        ALL_PACKAGES,
        applies=lambda part: bool(part.contact_faces),
    )
    tooth_flexibility: Stage[ToothFlexibility] = Stage(
        "teeth", _OF_TEETH, ("mesh", "assembly"), assembly_inputs, _TEETH, applies=lambda part: has_teeth(part.shape)
    )
    inertia_along_normal: Stage[Array] = Stage(
        "inertia",
        "part_results:integrate_along_normal",
        ("mesh", "assembly", "body"),
        digest_of_body,
        _REDUCTION,
        applies=lambda part: part.joint.normal >= 0,
    )

    def __init__(
        self,
        scene: Scene,
        name: str,
        store: StageStore,
        like: FlexiblePart | None = None,
        modes: Modes | None = None,
        piece: PieceMesh | None = None,
    ) -> None:
        super().__init__(scene, name, piece)
        self.store = store if modes is None else store.alone()
        self.results: dict[str, Any] = {} if piece is None else {"mesh": piece.mesh}
        if like is not None and like.key("modes") == self.key("modes"):
            same = all(getattr(like, name) == getattr(self, name) for name in _OF_THE_PART)
            self.results |= {stage: x for stage, x in like.results.items() if same or stage in _OF_THE_MODES}
        alike = like is not None and model_inputs(like) == model_inputs(self)
        self.common: dict[str, Any] = like.common if like is not None and alike else {}
        if modes is not None:
            self.results["modes"] = modes

    def beside(self, store: StageStore) -> FlexiblePart:
        """Return the part with its results for a scene that differs in springs, rests and dampers of joints alone."""
        part = copy(self)
        part.store, part.results = store, dict(self.results)
        return part

    def find_in_common(self, name: str, find: Callable[[], T]) -> T:
        """Return what variants of the part with the same matrices, markers and joint have in common, found once."""
        if name not in self.common:
            self.common[name] = find()
        found: T = self.common[name]
        return found

    def key(self, stage: str) -> str:
        """Return the key that a stage's result is kept under; empty if it never is."""
        return PART_STAGES[stage].key(self)

    @property
    def has_stress(self) -> bool:
        """A surface with its stress: of a mesh, or of a file that gives it."""
        if isinstance(self.shape, MatrixPart):  # told without reading the matrices
            return self.shape.may_have_stress
        if self.has_mesh:  # told without a mesh where no file has sections by numbers alone
            return self.shape.shape != "mesh" or all(
                own.midsurface is None or own.midsurface.stressed() for own in self.mesh.members
            )
        return self.given_model.surface is not None

    @property
    def is_drawn(self) -> bool:
        """A surface of triangles with its stress; that of nodes alone has none."""
        return self.has_stress and len(self.surface.triangles) > 0

    @property
    def can_be_stiffened(self) -> bool:
        """Stress, or files of its geometric stiffness; a reduced body has that of its file."""
        return self.has_mesh or (isinstance(self.shape, MatrixPart) and bool(self.shape.matrices.geometric_stiffness))

    @property
    def given_model(self) -> MatrixModel:
        """The model of a body that is given by matrices or reduced."""
        from fmd.fem.formats.matrix_model import MatrixModel

        assert isinstance(self.fe, MatrixModel)
        return self.fe

    @cached_property
    def order(self) -> int:
        """Polynomial order of the displacement in an element."""
        chosen = None if isinstance(self.shape, MatrixPart | ReducedPart) else self.shape.mesh.order
        if chosen and chosen < self.mesh.order:
            mend = f"the cells are {self.mesh.cell_type}, with nodes at the middles of sides; leave `order` out"
            raise InputError(self.file, f"body.{self.name}.mesh.order", chosen, mend)
        return chosen or self.mesh.order

    @property
    def formulation(self) -> Formulation:
        """Strain of linear hexahedra, ``enhanced`` or ``plain``."""
        return getattr(getattr(self.shape, "mesh", None), "formulation", "enhanced")

    @property
    def mesh_notes(self) -> tuple[str, ...]:
        """Faults in the file that the body comes from, if it comes from one, and how they were mended."""
        if self.is_reduced:
            from fmd.stages.reduced_files import file_notes

            return file_notes(self.fe)
        return self.mesh.notes if self.shape.shape in ("mesh", "cad") else ()

    @InCommon
    def space(self) -> AnySpace:
        """Nodes and elements, without matrices."""
        from fmd.fem.joined import JoinedMesh, JoinedSpace
        from fmd.fem.space import Discretisation

        if isinstance(self.mesh, JoinedMesh):
            if self.order != self.mesh.order:
                problem = "adds nodes to solids, which shells or beams beside them don't have"
                raise InputError(self.file, f"body.{self.name}.mesh.order", self.order, problem)
            return JoinedSpace(self.mesh, self.order, self.formulation)
        return Discretisation(self.mesh, self.order, self.formulation)

    @property
    def plain_space(self) -> Discretisation:
        """Nodes and elements of one kind, as pieces and contacts take them; refuses others."""
        from fmd.fem.joined import JoinedSpace

        if isinstance(self.space, JoinedSpace):
            problem = (
                "has solids beside shells or beams: it has no pieces and no contacts; make them bodies of their own"
            )
            raise InputError(self.file, f"body.{self.name}.mesh", None, problem)
        return self.space

    @property
    def plain_mesh(self) -> SolidMesh:
        """Mesh of cells of one kind; refuses others as `plain_space` does."""
        return self.plain_space.mesh

    @property
    def material(self) -> AnyMaterial:
        """Material of the body, or of each part of its mesh."""
        from fmd.stages.meshing.bodies import find_material

        return find_material(self.shape, self.mesh, self.file, self.name)

    @property
    def mass(self) -> float:
        """Mass from the volumes of the elements, and of what is linked to them [kg]."""
        linked = sum(own.mass for own in self.shape.mass.values())
        if isinstance(self.shape, Bar | Propeller):
            return self.shape.rho * self.mesh.volume + linked
        linked += self.mesh.connections.mass if self.mesh.connections else 0.0
        volumes, material = self.space.volumes, self.material
        return float(sum(own.rho * volumes[mine].sum() for own, mine in material.over(slice(None)))) + linked

    @InCommon
    def markers(self) -> dict[str, Marker]:
        """Markers on the finite element model, by name."""
        from fmd.stages.markers import clamp_broad, place_link_markers, place_markers, place_node_markers

        if self.has_mesh:
            given = dict(self.piece.given) if self.piece else {}
            given |= place_link_markers(self.shape, lambda: self.fe, self.file, self.name)
            found = place_markers(self.shape, self.space, self.file, self.name, given)
            root = self.joint.marker
            return {**found, root: clamp_broad(found[root], self.space, found)} if self.has_default_clamp else found
        if self.is_reduced:
            from fmd.stages.reduced_files import place_file_markers

            return place_file_markers(self.fe, self.shape, self.file, self.name)
        return place_node_markers(self.shape, self.given_model, self.file, self.name)

    @InCommon
    def fixed(self) -> IntArray | None:
        """Unknowns that the supports fix, shape (n_fixed,); ``None`` if there are none."""
        from fmd.stages.markers import fixed_unknowns

        return fixed_unknowns(self.shape, self.space, self.file, self.name) if self.shape.support else None

    @InCommon
    def model(self) -> ConstrainedModel:
        """The finite element model with its markers, supports and joint."""
        from fmd.stages.basis import ConstrainedModel, choose_factorisation

        return ConstrainedModel(
            file=self.file,
            name=self.name,
            solver_name=self.shape.modes.solver,
            factorise=choose_factorisation(self.shape.modes),
            fe=self.fe,
            sectors=self.mesh.sectors if self.has_mesh else 1,
            markers=self.markers,
            fixed=self.fixed,
            joint=self.joint,
        )

    @property
    def stiffened(self) -> FlexibleBody:
        """The reduced body, stiffened by all loads that pass through it; variants with the same body have one."""
        body, (integrals, markers) = self.body, self.second_order
        kept = self.results.get(_STIFFENED)
        if kept is None or kept[0] is not body:
            kept = self.results[_STIFFENED] = body, replace(body, integrals=integrals, markers=markers)
        return kept[1]

    def for_any_motion(self, body: FlexibleBody) -> FlexibleBody:
        """Add the inertia integrals that motion about one axis doesn't take to the reduced body, stiffened or not."""
        if body.integrals.normal < 0:
            return body
        return replace(body, integrals=add_normal_blocks(body.integrals, self.inertia_along_normal))

    @cached_property
    def elements(self) -> dict[str, int]:
        """Numbers of the named elements."""
        if not self.shape.element:  # there may be no mesh
            return {}
        return number_elements(self.shape.element, self.mesh, self.file, self.name)

    @cached_property
    def element_sides(self) -> tuple[bool, ...]:
        """True for each named element of a shell whose point is nearer to the upper face; empty if solid."""
        return find_sides(self.shape.element, self.mesh, self.elements)

    @cached_property
    def element_places(self) -> Array:
        """Middles of the named elements, of shells on one face, shape (n_elements, 3) [m]."""
        return stress_places(self.mesh, self.elements, self.element_sides)

    def stress_at(self, points: Array) -> Array:
        """Return the stress of each modal coordinate at points (n, 3) [m] of the mesh, shape (n, 6, n_modes) [Pa]."""
        return point_stress(self.space, self.material, self.body.shapes, points)

    @cached_property
    def surface_elements(self) -> IntArray:
        """Element that each of the surface's triangles belongs to, shape (n_triangles,)."""
        return surface_elements(self.space)


PART_STAGES: Mapping[str, Stage[Any]] = {stage.name: stage for stage in stages_of(FlexiblePart)}


def parts_of_scene(scene: Scene, store: StageStore, like: Mapping[str, FlexiblePart]) -> dict[str, FlexiblePart]:
    """Make the parts of a scene's flexible bodies; those of one that differs in numbers of joints alone are taken."""
    bare, parts = without_joint_numbers(scene), dict[str, FlexiblePart]()
    for name in scene.flexible:
        theirs = like.get(name)
        alike = theirs is not None and theirs.bare == bare
        parts[name] = theirs.beside(store) if theirs and alike else FlexiblePart(scene, name, store, theirs)
        parts[name].bare = bare
    return parts
