"""The basis of a flexible body: its modes, the reduced body on its joint, and geometric stiffening."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from functools import cached_property, partial
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError, as_input_error
from fmd.core.limits.modes import RITZ_GENERATIONS
from fmd.core.limits.rank import DEPENDENT_CONSTRAINT, NEW_RESIDUAL_VECTOR, NEW_RESPONSE
from fmd.core.progress import Advance
from fmd.fem.markers import Marker
from fmd.fem.model import FEModel
from fmd.reduction.body import FlexibleBody, floating_body, free_frame_body, reduced_body, supported_body
from fmd.reduction.craig_bampton import craig_bampton_modes, craig_bampton_modes_of_family, rayleigh_ritz
from fmd.reduction.cyclic import CyclicSolver
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.factor.factor import Factor, MissingSolverError, TooLargeError, factorise
from fmd.reduction.factor.slepc import factorise_over_ranks
from fmd.reduction.held_by_joint import JointHeldSolver, StaticSolver
from fmd.reduction.loads import acceleration_loads, enrich_modes, motion_loads
from fmd.reduction.mode_families import lowest_modes, modes_of_family
from fmd.reduction.modes import Modes, TooManyModesError
from fmd.reduction.stiffening import stiffen_body
from fmd.scene.modes import AnyModes
from fmd.stages.parent_joint import ParentJoint


@dataclass(frozen=True)
class ConstrainedModel:
    """A body's finite element model with its markers, its supports and the joint that carries it."""

    file: str  # the scene's file, for messages
    name: str  # the body's name in it, for messages
    solver_name: str  # solver that the scene chooses
    factorise: Callable[[Any], Factor]  # factorises a matrix by that solver
    fe: FEModel
    sectors: int  # how many equal sectors a cyclic mesh has; 1 if it isn't cyclic
    markers: Mapping[str, Marker]
    fixed: IntArray | None  # unknowns that the supports fix
    joint: ParentJoint

    @cached_property
    def solver(self) -> FreeBodySolver:
        """Solver of the model's eigenvalue problem and of static responses.

        Raises
        ------
        InputError
            Rigid faces share nodes, the factor doesn't fit into memory, or the chosen solver isn't installed.
        """
        rigid = [marker for marker in self.markers.values() if marker.rigid]
        key = f"body.{self.name}"
        try:
            repeats = self.sectors > 2 and self.fe.material.repeats(self.sectors)
            with self.fitting():
                if repeats and not rigid and self.fixed is None:
                    return CyclicSolver(self.fe, self.sectors, self.factorise)
                return FreeBodySolver(self.fe, rigid, self.fixed, self.factorise)
        except ValueError as error:  # rigid faces that share nodes, with one another or with a support
            raise InputError(self.file, f"{key}.marker", None, str(error)) from error
        except MissingSolverError as error:
            raise InputError(self.file, f"{key}.modes.solver", self.solver_name, str(error)) from error

    def solver_on_joint(self, touching: Sequence[str]) -> StaticSolver:
        """Return the solver of static responses of a body that touches something with the faces of some markers.

        A joint that holds all but turns, or moves as it is given, holds it in these, unless its reaction would act on
        the nodes of these faces alone, which it would keep from giving way.
        """
        if self.fixed is not None or not (self.joint.welded or self.joint.prescribed or self.joint.free):
            return self.solver
        at, reaction = self.markers[self.joint.marker].nodes, self.reaction
        beside = ~np.isin(at, np.concatenate([self.markers[name].nodes for name in touching]))
        rows = (reaction[at] / np.linalg.norm(reaction, axis=(0, 1)))[beside].reshape(-1, reaction.shape[2])
        if np.linalg.matrix_rank(rows, tol=DEPENDENT_CONSTRAINT) < reaction.shape[2]:
            return self.solver
        return JointHeldSolver(self.fe, self.solver, reaction)

    def fitting(self) -> AbstractContextManager[None]:
        """Return a context that names the mesh where what is computed of it doesn't fit into memory."""
        return as_input_error(self.file, f"body.{self.name}.mesh", of=TooLargeError)

    @property
    def reaction(self) -> Array:
        """Forces and torques by which the joint constrains the body, shape (n_nodes, 3, 3 + k)."""
        free = self.joint.free_directions
        across = np.linalg.svd(np.eye(3) - free.T @ free)[0][:, : 3 - len(free)].T
        return self.markers[self.joint.marker].columns(len(self.fe.x), across)

    def reaction_if_fixed(self, settings: AnyModes) -> Array | None:
        """Return the joint's reaction if the modes are to be those of the body fixed there; else ``None``."""
        return self.reaction if settings.boundary == "joint" and not self.joint.floating else None


def choose_factorisation(settings: AnyModes) -> Callable[[Any], Factor]:
    """Return the function that factorises a matrix by the solver that a scene chooses."""
    if settings.solver == "slepc":
        return partial(factorise_over_ranks, ranks=settings.ranks or 2)
    return partial(factorise, solver=settings.solver)


def compute_modes(model: ConstrainedModel, settings: AnyModes) -> Modes:
    """Compute the modes that a scene chooses for a body.

    Raises
    ------
    InputError
        The mesh has fewer modes; the message says how many.
    """
    solver, count = model.solver, settings.count
    with as_input_error(model.file, f"body.{model.name}.modes.count", count, of=TooManyModesError):
        if settings.boundary == "interface":
            interface = [model.markers[name] for name in settings.interface or tuple(model.markers)]
            if settings.family == "any":
                return craig_bampton_modes(model.fe, solver, interface, count)
            normal = np.array(model.joint.axis)
            return craig_bampton_modes_of_family(model.fe, solver, interface, count, settings.family, normal)
        reaction = model.reaction_if_fixed(settings)
        if settings.family == "any":
            return lowest_modes(solver, count, reaction)
        return modes_of_family(solver, model.fe, count, settings.family, np.array(model.joint.axis), reaction)


def reduce_body(
    model: ConstrainedModel, modes: Modes, settings: AnyModes, frame: str, advance: Advance = lambda done: None
) -> FlexibleBody:
    """Reduce a body to its modes and static responses, with the frame that its joint asks for.

    What is on rigid arms moves in second order, too, whatever the scene says about stiffening.

    Raises
    ------
    InputError
        The body hangs on no joint, or its supports don't fix it.
    """
    if not model.joint.marker:
        mend = 'a [joint.NAME] with it as child carries it, of type "free" if bearings or springs hold it'
        raise InputError(
            model.file, f"body.{model.name}", None, f"hangs on no joint: it has modes, but no motion; {mend}"
        )
    body = _on_its_joint(model, modes, settings, frame, advance)
    return body if model.fe.arms is None else stiffen_reduced(model, body, elements=False)


def _on_its_joint(
    model: ConstrainedModel, modes: Modes, settings: AnyModes, frame: str, advance: Advance
) -> FlexibleBody:
    """Reduce a body to first order, with the frame that its joint asks for."""
    fe, markers, joint, fixed = model.fe, model.markers, model.joint, model.fixed
    omega, shapes = modes.omega, modes.shapes
    if settings.enrich != "none":
        with model.fitting(), model.solver.telling(advance):
            omega, shapes = _enriched_shapes(model, modes, settings)
    common = (fe, omega, shapes, markers, joint.marker)
    if fixed is not None:
        _require_fixed(model, modes, fixed)
        return supported_body(*common, joint.free_directions, joint.normal)
    if joint.floating:
        return floating_body(*common)
    if frame == "free" and len(joint.free) == 1:
        return free_frame_body(*common, np.array(joint.axis), joint.normal)
    return reduced_body(*common, joint.free_directions, joint.normal)


def stiffen_reduced(
    model: ConstrainedModel, body: FlexibleBody, elements: bool = True, advance: Advance = lambda done: None
) -> FlexibleBody:
    """Stiffen a reduced body by the loads that a scene can put on it, or what is on rigid arms alone."""
    return _stiffen(model, body, model.joint.plane, True, model.markers, elements, advance)


def stiffen_for_any_motion(model: ConstrainedModel, body: FlexibleBody, elements: bool) -> FlexibleBody:
    """Add to a body that `stiffen_reduced` has stiffened what a motion in a plane leaves out.

    Its markers answer to all forces already, so only loads by the frame's own motion are solved for.
    """
    return body if model.joint.plane is None else _stiffen(model, body, None, False, {}, elements)


def _stiffen(
    model: ConstrainedModel,
    body: FlexibleBody,
    plane: Array | None,
    linear: bool,
    moving: Mapping[str, Marker],
    elements: bool,
    advance: Advance = lambda done: None,
) -> FlexibleBody:
    joint = model.joint
    reaction = None if joint.floating or model.fixed is not None else model.reaction
    free = joint.free_directions if model.fixed is not None else None
    with model.fitting():
        return stiffen_body(body, model.fe, model.solver, reaction, plane, linear, moving, free, elements, advance)


def _enriched_shapes(model: ConstrainedModel, modes: Modes, settings: AnyModes) -> tuple[Array, Array]:
    """Frequencies and shapes of the modes with static responses to inertia loads and joint forces beside them."""
    fe, markers, joint = model.fe, model.markers, model.joint
    if settings.family != "any" and joint.floating:
        mend = 'takes enrich = "none": static responses of a body on a free joint are of every kind'
        raise InputError(model.file, f"body.{model.name}.modes.family", settings.family, mend)
    outboard = [(markers[at], joint.plane if flat else None) for at, flat in joint.loaded if at != joint.marker]
    loads = motion_loads(fe, markers[joint.marker], joint.plane, outboard)
    if model.fixed is not None:
        own = acceleration_loads(fe, markers[joint.marker].position, joint.plane)
        loads = np.concatenate([loads, own], axis=2)
    generations = RITZ_GENERATIONS if settings.enrich == "ritz" else 1
    reaction = model.reaction_if_fixed(settings)
    least = NEW_RESIDUAL_VECTOR if settings.enrich == "residual" else NEW_RESPONSE
    omega, shapes = enrich_modes(modes, fe, model.solver, loads, reaction, generations, least)
    if settings.boundary == "interface":  # no eigenvectors: the new shapes mix with them
        omega, shapes = rayleigh_ritz(fe, shapes.reshape(fe.K.shape[0], -1))
    return omega, shapes


def _require_fixed(model: ConstrainedModel, modes: Modes, fixed: IntArray) -> None:
    """A supported body moves with the frame of its supports, on which its joint acts."""
    if modes.n_rigid:
        message = f"leave {modes.n_rigid} rigid-body modes; to move on a joint, a body must be fixed whole"
        raise InputError(model.file, f"body.{model.name}.support", None, message)
    nodes = model.markers[model.joint.marker].nodes
    if model.joint.free and not np.isin(3 * nodes[:, None] + np.arange(3), fixed).all():
        message = "must fix the whole face of the joint's marker, on which the joint turns freely"
        raise InputError(model.file, f"body.{model.name}.support", None, message)
