"""One flexible body's stages: mesh, matrices, modes, reduced body, surface and modal stress, each on first use."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.arrays import Array, IntArray
from pipeline.core.cache import stage_key
from pipeline.core.errors import InputError
from pipeline.scene.bodies import Bar
from pipeline.scene.propeller import Propeller
from pipeline.scene.source_files import SourceFiles
from pipeline.stages.inboard_joint import inboard_of
from pipeline.stages.markers import known_name
from pipeline.stages.store import Keeper

if TYPE_CHECKING:
    from pipeline.fem.markers import Marker
    from pipeline.fem.material import AnyMaterial
    from pipeline.fem.mesh import SolidMesh
    from pipeline.fem.model import Discretisation, FEModel
    from pipeline.fem.surface import SurfaceTopology
    from pipeline.reduction.body import FlexibleBody
    from pipeline.reduction.eigen import FreeBodySolver
    from pipeline.reduction.factor.factor import Factor
    from pipeline.reduction.inertia import InertiaGram
    from pipeline.reduction.modes import Modes
    from pipeline.scene.any_body import Flexible
    from pipeline.scene.scene import Scene

NO_MESH = "is given by its matrices: without elements it has no mesh, no stress and no picture"
_RITZ_GENERATIONS = 4
_SHARED = ("mesh", "fe", "modes", "space", "surface", "markers", "_solver")  # what enrichment and joints leave alone
_FEM_PACKAGES = ("numpy", "scipy", "scikit-fem", "gmsh")


class FlexiblePart:
    """A flexible body of a scene.

    Parameters
    ----------
    scene : Scene
        The scene.
    name : str
        The body's name in it.
    keeper : Keeper
        Runs the stages and keeps what they give.
    """

    def __init__(self, scene: Scene, name: str, keeper: Keeper) -> None:
        self.shape: Flexible = scene.flexible[name]
        self.name, self.file = name, scene.file
        self._source = SourceFiles.find(self.shape, scene.file, name)
        self.inboard = inboard_of(scene, name)
        self._frame = scene.simulation.frame if scene.moves else "joint-conforming"
        loads = [drive for drive in scene.drive.values() if drive.type in ("point force", "point torque")]
        places = dict.fromkeys([joint.parent for joint in scene.joint.values()], True)
        for drive in loads:
            turns = drive.type == "point torque"
            out = np.cross(self.inboard.axis, drive.direction) if turns else np.dot(self.inboard.axis, drive.direction)
            places[drive.marker] = places.get(drive.marker, True) and not np.any(out)
        joint = next((j for j in scene.joint.values() if j.child.partition(".")[0] == name), None)
        at_rest = joint and joint.parent.partition(".")[0] == "ground" and joint.type not in ("prismatic", "free")
        self._accelerated = not at_rest or (scene.moves and any(scene.simulation.gravity))
        # Markers where other bodies hang or loads act, and whether those keep to the plane of motion.
        own = {at.partition(".")[2]: flat for at, flat in places.items() if at.partition(".")[0] == name}
        self._outboard = sorted(own.items())
        self._keeper = keeper

    def share(self, other: FlexiblePart) -> None:
        """Take over what another scene's part has computed already and this one would compute anew."""
        if self._modes_key == other._modes_key:
            self.__dict__.update({name: value for name, value in other.__dict__.items() if name in _SHARED})

    # Stages ------------------------------------------------------------------------------------------------------

    @cached_property
    def mesh(self) -> SolidMesh:
        """The mesh; a body that is given by its matrices has none."""
        if not self.has_mesh:
            raise InputError(self.file, f"body.{self.name}.matrices", None, NO_MESH)
        return self._keeper.kept("mesh", self._mesh_key, self._make_mesh)

    @cached_property
    def fe(self) -> FEModel:
        """Stiffness and mass; never kept, since what follows is."""
        from pipeline.fem.assembly import assemble

        if not self.has_mesh:
            from pipeline.stages.meshing import matrices_of

            return self._keeper.timed("assembly", lambda: matrices_of(self.shape, self._source))
        mesh, order = self.mesh, self.order
        return self._keeper.timed("assembly", lambda: assemble(mesh, order, self.material))

    @cached_property
    def order(self) -> int:
        """Polynomial order of the displacement in an element."""
        return self.mesh.order if self.shape.shape == "matrices" else self.shape.mesh.order or self.mesh.order

    @property
    def mesh_notes(self) -> tuple[str, ...]:
        """What was found and mended in the file that its mesh comes from, if it comes from one."""
        return self.mesh.notes if self.shape.shape in ("mesh", "cad") else ()

    @property
    def has_mesh(self) -> bool:
        """Whether it has elements, and so stress and pictures; a body that is given by its matrices has none."""
        return self.shape.shape != "matrices"

    @cached_property
    def modes(self) -> Modes:
        """The modes that the scene chooses."""
        return self._keeper.kept("modes", self._modes_key, self._make_modes)

    @cached_property
    def body(self) -> FlexibleBody:
        """The reduced body at its joint."""
        return self._keeper.kept("body", self.body_key, self._make_body)

    @cached_property
    def stiffened(self) -> FlexibleBody:
        """The reduced body, stiffened by its inertia loads."""
        return replace(self.body, gram=self._keeper.kept("stiffening", self._stiffening_key, self._make_stiffened_gram))

    def for_any_motion(self, body: FlexibleBody) -> FlexibleBody:
        """The reduced body, stiffened or not, with the inertia integrals, too, that its motion here doesn't take."""
        from pipeline.reduction.inertia import along_normal, with_normal

        if body.gram.normal < 0:
            return body
        own, normal = self.body, body.gram.normal
        along = self._keeper.kept("inertia", self.body_key, lambda: along_normal(own.x, self.fe.m, own.shapes, normal))
        return replace(body, gram=with_normal(body.gram, along))

    @cached_property
    def surface(self) -> SurfaceTopology:
        """The body's outer surface."""
        return self._keeper.kept("surface", self._modes_key, self._make_surface)

    @cached_property
    def elements(self) -> dict[str, int]:
        """Numbers of its named elements."""
        if not self.shape.element:
            return {}
        x = self.mesh.points[self.mesh.cells].mean(axis=1)
        found = {}
        for name, element in self.shape.element.items():
            chosen = (
                self.mesh.parts[known_name(self, "element", name, element.part)] if element.part else np.arange(len(x))
            )
            found[name] = int(chosen[np.linalg.norm(x[chosen] - element.at, axis=1).argmin()])
        return found

    @cached_property
    def element_stress(self) -> Array:
        """Stress of each modal coordinate in the middle of each named element, shape (n_elements, 6, n) [Pa]."""
        return self._keeper.kept("stress", self._element_key, self._make_element_stress)

    def stress_at(self, points: Array) -> Array:
        """Stress of each modal coordinate at points (n, 3) [m] of the mesh, shape (n, 6, n_modes) [Pa]."""
        from pipeline.recovery.stress import point_stress

        return point_stress(self.space, self.material, self.body.shapes, points)

    @cached_property
    def element_places(self) -> Array:
        """Middles of its named elements, shape (n_elements, 3) [m]."""
        numbers = list(self.elements.values())
        return np.asarray(self.mesh.points[self.mesh.cells[numbers]].mean(axis=1)).reshape(-1, 3)

    @cached_property
    def surface_elements(self) -> IntArray:
        """Element that each of the surface's triangles belongs to, shape (n_triangles,)."""
        from pipeline.fem.surface import surface_elements

        return surface_elements(self.space)

    @cached_property
    def nodal_stress(self) -> NDArray[np.float32]:
        """Stress of each modal coordinate at all nodes, for files in single precision, (n_nodes, 6, n) [Pa]."""

        def make() -> NDArray[np.float32]:
            return self._make_stress(np.arange(len(self.space.x))).astype(np.float32)

        return self._keeper.kept("nodal stress", self.body_key, make)

    @cached_property
    def surface_stress(self) -> Array:
        """Stress of each modal coordinate at the surface's nodes, shape (n_surface_nodes, 6, n) [Pa]."""
        return self._keeper.kept("stress", self.body_key, lambda: self._make_stress(self.surface.nodes))

    # How each is made --------------------------------------------------------------------------------------------

    @property
    def _mesh_key(self) -> str:
        part = self.shape.model_dump(
            mode="json", exclude={"E", "nu", "rho", "material", "modes", "marker", "support", "element"}
        )
        if self._source is not None:
            return stage_key("mesh", self._source.identity(part), ("meshes", "pipeline/fem"), ("gmsh", "meshio"))
        return stage_key("mesh", part, ("meshes", "pipeline/fem/mesh.py"), ("gmsh",))

    @property
    def _modes_key(self) -> str:
        part = self.shape.model_dump(
            mode="json", exclude={"marker": True, "element": True, "modes": {"damping", "enrich"}}
        )
        markers = self.shape.marker
        inputs = {
            "part": part if self._source is None else self._source.identity(part),
            "axis": self.inboard.axis,
            "rigid": {name: marker.where for name, marker in markers.items() if marker.attachment == "rigid"},
            "held": "",
        }
        if self.shape.modes.boundary == "joint":
            inputs["held"] = repr((self.inboard, markers[self.inboard.marker].where))
        elif self.shape.modes.boundary == "interface":
            inputs["held"] = repr({name: markers[name] for name in self._interface})
        return stage_key("modes", inputs, ("meshes", "pipeline/fem", "pipeline/reduction"), _FEM_PACKAGES)

    @property
    def body_key(self) -> str:
        """Digest of all that the reduced body depends on."""
        inputs = {
            "modes": self._modes_key,
            "enrich": self.shape.modes.enrich,
            "markers": self.shape.model_dump(mode="json", include={"marker"}),
            "inboard": repr(self.inboard),
            "outboard": self._outboard,
            "frame": self._frame,
        }
        return stage_key("body", inputs, ("pipeline/reduction", "pipeline/recovery/stress.py"))

    @property
    def _stiffening_key(self) -> str:
        inputs = {"gram of": self.body_key, "accelerated": self._accelerated}
        return stage_key("stiffening", inputs, ("pipeline/fem", "pipeline/reduction"), _FEM_PACKAGES)

    @property
    def _element_key(self) -> str:
        inputs = {"body": self.body_key, "elements": self.elements}
        return stage_key("element-stress", inputs, ("pipeline/recovery/stress.py",))

    def _make_mesh(self) -> SolidMesh:
        from pipeline.stages.meshing import mesh_of

        return mesh_of(self.shape, self._source)

    @cached_property
    def markers(self) -> dict[str, Marker]:
        """The body's markers on its finite element model."""
        from pipeline.stages.markers import markers_of

        return markers_of(self)

    @property
    def _interface(self) -> tuple[str, ...]:
        return self.shape.modes.interface or tuple(self.shape.marker)

    @cached_property
    def fixed(self) -> IntArray | None:
        """Unknowns that the supports hold; ``None`` if there are none."""
        from pipeline.stages.markers import fixed_unknowns

        return fixed_unknowns(self) if self.shape.support else None

    @cached_property
    def _solver(self) -> FreeBodySolver:
        from pipeline.reduction.factor.factor import MissingSolverError, TooLargeError

        rigid = [marker for marker in self.markers.values() if marker.rigid]
        key = f"body.{self.name}"
        try:
            if self.has_mesh and self.mesh.sectors > 2 and not rigid and self.fixed is None:
                from pipeline.reduction.cyclic import CyclicSolver

                return CyclicSolver(self.fe, self.mesh.sectors, self._factorise)
            from pipeline.reduction.eigen import FreeBodySolver

            return FreeBodySolver(self.fe, rigid, self.fixed, self._factorise)
        except ValueError as error:  # rigid faces that share nodes, with one another or with a support
            raise InputError(self.file, f"{key}.marker", None, str(error)) from error
        except TooLargeError as error:
            raise InputError(self.file, f"{key}.mesh", None, str(error)) from error
        except MissingSolverError as error:
            raise InputError(self.file, f"{key}.modes.solver", self.shape.modes.solver, str(error)) from error

    @property
    def _factorise(self) -> Callable[[Any], Factor]:
        """What the scene wants matrices to be factorised by."""
        wanted = self.shape.modes
        if wanted.solver == "slepc":
            from pipeline.reduction.factor.slepc import slepc_factorised

            return partial(slepc_factorised, ranks=wanted.ranks or 2)
        from pipeline.reduction.factor.factor import factorised

        return partial(factorised, solver=wanted.solver)

    @property
    def _free(self) -> Array:
        free = np.array(self.inboard.free, dtype=float).reshape(-1, 3)
        return np.asarray(free / np.linalg.norm(free, axis=1, keepdims=True))

    @property
    def _reaction(self) -> Array:
        """Forces and torques that the joint answers with, and holds the body by, shape (n_nodes, 3, 3 + k)."""
        free = self._free
        across = np.linalg.svd(np.eye(3) - free.T @ free)[0][:, : 3 - len(free)].T
        return self.markers[self.inboard.marker].columns(len(self.fe.x), across)

    @property
    def _held(self) -> Array | None:
        """The same, if the modes are to be those of the body held there."""
        return self._reaction if self.shape.modes.boundary == "joint" and not self.inboard.floating else None

    def _make_modes(self) -> Modes:
        from pipeline.reduction.mode_families import lowest_modes, modes_of_family

        wanted, axis = self.shape.modes, np.array(self.inboard.axis)
        if wanted.boundary == "interface":
            from pipeline.reduction.craig_bampton import craig_bampton

            return craig_bampton(self.fe, self._solver, [self.markers[name] for name in self._interface], wanted.count)
        if wanted.family == "any":
            return lowest_modes(self._solver, wanted.count, self._held)
        return modes_of_family(self._solver, self.fe, wanted.count, wanted.family, axis, self._held)

    def _make_body(self) -> FlexibleBody:
        from pipeline.reduction.body import floating_body, free_frame_body, reduced_body, supported_body
        from pipeline.reduction.craig_bampton import ritz
        from pipeline.reduction.enrichment import enriched, inertia_loads
        from pipeline.reduction.supports import acceleration_loads

        if not self.inboard.marker:
            raise InputError(self.file, f"body.{self.name}", None, "hangs on no joint: it has modes, but no motion")
        markers, modes, joint = self.markers, self.modes, self.inboard.marker
        omega, shapes = modes.omega, modes.shapes
        axis = np.array(self.inboard.axis)
        if self.shape.modes.enrich != "none":
            plane = axis if self.inboard.planar else None
            outboard = [(markers[at], plane if flat else None) for at, flat in self._outboard if at != joint]
            loads = inertia_loads(self.fe, markers[joint], plane, outboard)
            if self.fixed is not None:
                own = acceleration_loads(self.fe, markers[joint].position, plane)
                loads = np.concatenate([loads, own], axis=2)
            generations = _RITZ_GENERATIONS if self.shape.modes.enrich == "ritz" else 1
            omega, shapes = enriched(modes, self.fe, self._solver, loads, self._held, generations)
            if self.shape.modes.boundary == "interface":  # no eigenvectors: the new shapes mix with them
                omega, shapes = ritz(self.fe, shapes.reshape(self.fe.K.shape[0], -1))
        if self.fixed is not None:
            self._require_held(modes, self.fixed)
            return supported_body(self.fe, omega, shapes, markers, joint, self._free, self.inboard.normal)
        if self.inboard.floating:
            return floating_body(self.fe, omega, shapes, markers, joint)
        if self._frame == "free" and len(self.inboard.free) == 1:
            return free_frame_body(self.fe, omega, shapes, markers, joint, axis, self.inboard.normal)
        return reduced_body(self.fe, omega, shapes, markers, joint, self._free, self.inboard.normal)

    def _require_held(self, modes: Modes, fixed: IntArray) -> None:
        """A supported body moves with the frame of its supports, on which its joint acts."""
        if modes.n_rigid:
            message = f"leave {modes.n_rigid} rigid-body modes; to move on a joint, a body must be held whole"
            raise InputError(self.file, f"body.{self.name}.support", None, message)
        nodes = self.markers[self.inboard.marker].nodes
        if self.inboard.free and not np.isin(3 * nodes[:, None] + np.arange(3), fixed).all():
            message = "must hold the whole face of the joint's marker, on which the joint turns freely"
            raise InputError(self.file, f"body.{self.name}.support", None, message)

    def _make_stiffened_gram(self) -> InertiaGram:
        from pipeline.reduction.stiffening import stiffened

        if not self.has_mesh:
            mend = f"stiffening by inertia loads takes stress, and the body {NO_MESH}; 'off' leaves it out"
            raise InputError(self.file, "simulation.stiffening", None, mend)
        inboard = self.inboard
        reaction = None if inboard.floating or self.fixed is not None else self._reaction
        axis = np.array(inboard.axis) if inboard.planar else None
        return stiffened(self.body, self.fe, self._solver, reaction, axis, self._accelerated).gram

    def _make_surface(self) -> SurfaceTopology:
        from pipeline.fem.surface import surface_topology

        return surface_topology(self.space)

    @cached_property
    def space(self) -> Discretisation:
        """Nodes and elements; the matrices aren't needed for it."""
        from pipeline.fem.model import Discretisation

        return Discretisation(self.mesh, self.order)

    @property
    def material(self) -> AnyMaterial:
        """What it is made of."""
        from pipeline.stages.meshing import material_of

        return material_of(self.shape, self.mesh, lambda name: known_name(self, "material", name, name))

    @property
    def mass(self) -> float:
        """Its mass [kg], from the volumes of its elements."""
        if isinstance(self.shape, Bar | Propeller):
            return self.shape.rho * self.mesh.volume
        volumes, material = self.space.volumes, self.material
        return float(sum(own.rho * volumes[mine].sum() for own, mine in material.over(slice(None))))

    def _make_stress(self, nodes: IntArray) -> Array:
        from pipeline.recovery.stress import modal_stress

        return modal_stress(self.space, self.material, self.body.shapes, nodes)

    def _make_element_stress(self) -> Array:
        from pipeline.recovery.stress import element_stress

        return element_stress(self.space, self.material, self.body.shapes, np.array(list(self.elements.values())))
