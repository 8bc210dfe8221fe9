"""From a scene to its motion and stress: each stage runs when something asks for it, once, and not if it is kept."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.core.arrays import Array, BoolArray, IntArray
from fmd.core.cache import Cache
from fmd.core.errors import InputError
from fmd.core.paths import cache_folder
from fmd.core.progress import Monitor, silent
from fmd.recovery.envelope import StressEnvelope, stress_envelope
from fmd.recovery.stress import StressHistory, stress_measure
from fmd.reduction.inertia import normal_blocks
from fmd.scene.magnitudes import find_unusual
from fmd.scene.scene import Scene
from fmd.scene.source_files import collect_inputs
from fmd.stages.division import Division, complete_inertia, divide_parts
from fmd.stages.part import FlexiblePart, parts_of_scene
from fmd.stages.point_loads import limitless_nodes
from fmd.stages.stage import ALL_PACKAGES, ALL_SOURCES, Stage, stages_of
from fmd.stages.store import Log, StageStore

if TYPE_CHECKING:
    from fmd.dynamics.compiled_system.system import CompiledSystem
    from fmd.dynamics.mechanism import Mechanism
    from fmd.fem.joined import AnyMesh
    from fmd.fem.model import FEModel
    from fmd.fem.surface import SurfaceTopology
    from fmd.integrators.protocol import Trajectory
    from fmd.recovery.deformation import Deformation
    from fmd.recovery.motion import Motion
    from fmd.reduction.body import FlexibleBody
    from fmd.reduction.modes import Modes
    from fmd.stability.periodic_motion import FloquetMultipliers, PeriodicMotion
    from fmd.stages.buckling import StiffnessChange
    from fmd.stages.contact_deformation import ContactDeformation
    from fmd.stages.plan import Growth, Plan
    from fmd.stages.stiffening_check import StiffeningLoads


def _has_pieces(run: Pipeline) -> bool:
    return run.scene.moves and bool(run.scene.pieces)


def _divide(run: Pipeline) -> Division:
    return divide_parts(run.scene, run.wholes, run.like)


def _build_mechanism(run: Pipeline) -> Mechanism:
    from fmd.stages.like_mechanisms import build_like
    from fmd.stages.stiffening_check import keep_what_counts, with_whole_energy

    mechanism = build_like(run.built, run.divided_scene, run.bodies, run.lifted)
    mechanism = keep_what_counts(mechanism, run.stiffening_loads, run.scene.simulation.error)
    mechanism = with_whole_energy(mechanism) if run.whole_energy else mechanism
    if run.scene.gear_mesh:
        mechanism = import_module("fmd.stages.gear_teeth").add_gear_teeth(run, mechanism)
    if run.scene.contact:
        mechanism = import_module("fmd.stages.contacts").add_contacts(run, mechanism)
    return mechanism


def _make_system(run: Pipeline) -> CompiledSystem:
    from fmd.dynamics.compiled_system.shared import share_system

    return share_system(run.mechanism)


def _find_start(run: Pipeline) -> tuple[Array, Array]:
    from fmd.stages.mechanism import find_start

    if run.scene.repeats:
        return run.periodic.q, run.periodic.v
    return find_start(run.divided_scene, run.system)


def _own_inputs(run: Pipeline) -> Any:
    """Return all that results depend on that no other scene's bodies make; ``None`` if there are such bodies."""
    if run.has_other_bodies or run.has_other_loads or not run.stands_alone:
        return None
    return run.inputs | {"whole energy": run.whole_energy, "contact step": run.results.get("contact step")}


def _inputs_to_keep(run: Pipeline) -> Any:
    """Return all that results depend on; ``None`` if they aren't kept."""
    return run.inputs if run.stands_alone else None


class Pipeline:
    """From a scene to its results, each computed on first use and only with what it needs.

    Parameters
    ----------
    scene : Scene
        As `fmd.load_scene` returns it.
    cache : Cache, optional
        Where results are kept; the user's cache folder by default.
    monitor : Monitor, optional
        Reports each stage's progress.
    keep_all : bool
        Integrate modes that nothing can excite, too.
    division : Division, optional
        Parts and pieces to use in place of the scene's own.
    bodies : mapping of str to FlexibleBody, optional
        Reduced bodies to use in place of those of the parts.
    stiffening_loads : mapping of str to StiffeningLoads, optional
        Checks of stiffening to use in place of this scene's own.
    like : mapping of str to FlexiblePart, optional
        Parts of another scene, from which results are taken that both have in common.

    Attributes
    ----------
    wholes : dict of str to FlexiblePart
        The flexible bodies as the scene has them.
    while_timed : callable
        Makes a context in which each run is timed; it may hold up whatever else uses the processor.
    stands_alone : bool
        False for one scene of many: its run times aren't compared, and results of the whole scene aren't kept.
    built : list
        Mechanisms that were built of this scene and of its variants, for `build_like`.
    store : StageStore
        Runs the stages and keeps their results.
    like : Division, optional
        Parts of another scene, from which results are taken that both have in common.
    has_other_bodies, has_other_loads : bool
        Bodies, or checks of stiffening, are given in place of the scene's own.
    whole_energy : bool
        Displacements of second order count with their whole kinetic energy: without, a motion would lose its inertia.
    """

    # The table of stages, in their order; what they read are these, and stages of each flexible body.
    division: Stage[Division] = Stage("pieces", _divide, applies=_has_pieces)
    stiffening_loads: Stage[Mapping[str, StiffeningLoads]] = Stage(
        "loads", "runs:check_loads", ("body",), _inputs_to_keep, ALL_SOURCES, ALL_PACKAGES
    )
    bodies: Stage[Mapping[str, FlexibleBody]] = Stage(
        "stiffened bodies", "runs:stiffen_bodies", ("pieces", "body", "stiffening", "loads")
    )
    mechanism: Stage[Mechanism] = Stage("mechanism", _build_mechanism, ("stiffened bodies", "loads"))
    stiffness_changes: Stage[Mapping[str, StiffnessChange]] = Stage(
        "stiffness", "runs:find_stiffness_changes", ("mechanism", "loads")
    )
    system: Stage[CompiledSystem] = Stage("equations", _make_system, ("mechanism",))
    periodic: Stage[PeriodicMotion] = Stage(
        "periodic motion", "periodic:find_own_start", ("equations",), applies=lambda run: run.scene.repeats
    )
    multipliers: Stage[FloquetMultipliers] = Stage(
        "Floquet multipliers", "periodic:find_own_multipliers", ("periodic motion",), applies=lambda r: r.scene.repeats
    )
    start: Stage[tuple[Array, Array]] = Stage("start", _find_start, ("equations", "periodic motion"))
    drafts: Stage[tuple[Plan, ...]] = Stage("steps", "runs:draft_plans", ("equations", "start"))
    growths: Stage[tuple[Growth, ...]] = Stage(
        "stability", "runs:measure_growths", ("steps",), _own_inputs, ALL_SOURCES, ALL_PACKAGES
    )
    plans: Stage[dict[str, Plan]] = Stage("plans", "runs:finish_plans", ("steps", "stability"))
    compiled_plans: Stage[dict[str, Plan]] = Stage("machine code", "runs:compile_plans", ("plans",))
    motions: Stage[dict[str, Motion]] = Stage("motion", "runs:find_motions", ("stiffness", "machine code"))
    contact_stress: Stage[Mapping[str, Mapping[str, ContactDeformation]]] = Stage(
        "contact stress",
        "contacts:find_deformations",
        ("assembly", "body", "motion"),
        applies=lambda run: bool(run.scene.contact),
    )
    fine_motion: Stage[Motion] = Stage("fine motion", "runs:march_finely", ("plans", "motion"))
    deformations: Stage[Mapping[str, Deformation]] = Stage(
        "strain", "runs:measure_deformations", ("deformation", "motion")
    )

    def __init__(
        self,
        scene: Scene,
        cache: Cache | None = None,
        monitor: Monitor = silent,
        keep_all: bool = False,
        *,
        division: Division | None = None,
        bodies: Mapping[str, FlexibleBody] | None = None,
        stiffening_loads: Mapping[str, StiffeningLoads] | None = None,
        like: Mapping[str, FlexiblePart] | None = None,
    ) -> None:
        self.scene, self.keep_all, self.whole_energy = scene, keep_all, False
        self.while_timed: Callable[[], AbstractContextManager[None]] = nullcontext
        self.stands_alone, self.lifted, self.built = True, False, list[Any]()
        self.store = StageStore(cache or Cache(cache_folder() / "stages"), monitor, lambda: find_unusual(scene))
        self.wholes = parts_of_scene(scene, self.store, like or {})
        if division is not None:
            wholes = {name: divided.whole for name, divided in division.divided.items()}
            self.wholes = {name: wholes[name] if name in wholes else division.parts[name] for name in self.wholes}
        elif not _has_pieces(self):
            division = Division(scene, self.wholes)
        self.like: Division | None = None
        self.has_other_bodies, self.has_other_loads = bodies is not None, stiffening_loads is not None
        names = (Pipeline.division.name, Pipeline.bodies.name, Pipeline.stiffening_loads.name)
        given = zip(names, (division, bodies, stiffening_loads), strict=True)
        self.results: dict[str, Any] = {name: result for name, result in given if result is not None}
        self._envelopes: dict[str, StressEnvelope] = {}
        self._limitless: dict[str, BoolArray] = {}

    def variant(
        self, scene: Scene, monitor: Monitor = silent, stiffening_loads: Mapping[str, StiffeningLoads] | None = None
    ) -> Pipeline:
        """Return a pipeline for another scene that takes over all results that both have in common."""
        loads, cache, keep_all = stiffening_loads, self.store.cache, self.keep_all
        other = Pipeline(scene, cache, monitor, keep_all, stiffening_loads=loads, like=self.wholes)
        other.whole_energy, other.stands_alone, other.built = self.whole_energy, self.stands_alone, self.built
        other.like = self.results.get(Pipeline.division.name)
        return other

    def with_bodies(
        self, bodies: Mapping[str, FlexibleBody], stiffening_loads: Mapping[str, StiffeningLoads] | None = None
    ) -> Pipeline:
        """Return a pipeline for this scene with other reduced bodies on the same meshes.

        Of their terms of stiffening those stay that count by ``stiffening_loads``, the run's own by default.
        """
        loads = self.stiffening_loads if stiffening_loads is None else stiffening_loads
        scene, cache, keep_all, division = self.scene, self.store.cache, self.keep_all, self.division
        other = Pipeline(scene, cache, keep_all=keep_all, division=division, bodies=bodies, stiffening_loads=loads)
        other.whole_energy = self.whole_energy
        return other

    @property
    def parts(self) -> Mapping[str, FlexiblePart]:
        """Flexible parts and pieces, each with a reduced body of its own."""
        return self.division.parts

    @property
    def divided_scene(self) -> Scene:
        """The scene with pieces as bodies of their own; the scene itself where nothing has pieces."""
        return self.division.scene

    def _repr_html_(self) -> str:
        return self.scene._repr_html_()

    @property
    def log(self) -> Log:
        """Time and origin of each stage's results."""
        return self.store.log

    @property
    def part(self) -> FlexiblePart:
        """First flexible body.

        Raises
        ------
        InputError
            There is none.
        """
        for part in self.wholes.values():
            return part
        raise InputError(self.scene.file, "body", sorted(self.scene.body), "no flexible body: nothing to mesh")

    @property
    def mesh(self) -> AnyMesh:
        """Mesh of the first flexible body."""
        return self.part.mesh

    @property
    def fe(self) -> FEModel:
        """Stiffness and mass of the first flexible body."""
        return self.part.fe

    @property
    def modes(self) -> Modes:
        """Modes that the scene chooses for the first flexible body."""
        return self.part.modes

    @property
    def body(self) -> FlexibleBody:
        """First flexible body, reduced and, where it matters, stiffened."""
        return self.bodies[self.frame_of(self.part.name)]

    @property
    def surface(self) -> SurfaceTopology:
        """Outer surface of the first flexible body."""
        return self.part.surface

    @cached_property
    def stress(self) -> StressHistory:
        """Stress on the first flexible body's surface over the first run's motion."""
        return self.stress_of(self.part.name)

    def stress_of(self, body: str, motion: Motion | None = None) -> StressHistory:
        """Stress on a flexible body's surface over the first run's motion, with shocks' instants, or over another."""
        if motion is None and self.at_instants is not self:
            return self.at_instants.stress_of(body)
        first = motion or self.motion
        if body in self.division.divided:
            return self.division.divided[body].stress(first)
        part, limitless, own = self.parts[body], self.limitless_of(body), self.contact_deformation(body, first)
        history = StressHistory(part.surface.nodes, part.surface_stress, first.times, first.modal(body), limitless)
        return history if own is None else own.add_stress(history)

    def contact_deformation(self, body: str, motion: Motion) -> ContactDeformation | None:
        """Return what contacts deform a body beside its modes in a motion of a run; ``None`` if it touches nothing."""
        labels = [label for label, own in self.motions.items() if own is motion and motion.mechanism.contacts]
        return self.contact_stress[labels[0]].get(body) if labels else None

    def limitless_of(self, body: str) -> BoolArray:
        """Return which nodes of a body's surface have stress that grows with each refinement, shape (n_nodes,)."""
        if body not in self._limitless:
            self._limitless[body] = limitless_nodes(self.scene, self.parts[body])
        return self._limitless[body]

    def deform(self, body: str, frames: Sequence[int] | IntArray, nodes: IntArray) -> Array:
        """Return the displacement of nodes in the frame at a body's joint at output times, (n_frames, n_nodes, 3) [m].

        The body is one of the scene's, whole or in pieces.
        """
        if body in self.division.divided:
            return self.division.divided[body].deform(self.motion, self.bodies, frames)[:, nodes]
        moved = self.bodies[body].shapes[nodes] @ self.motion.modal(body)[frames].T
        own = self.contact_deformation(body, self.motion)
        return np.moveaxis(moved if own is None else moved + own.displacements(nodes, np.array(frames)), 2, 0)

    def node_positions(self, body: str) -> Array:
        """Return the undeformed positions of a body's nodes from its joint, shape (n_nodes, 3) [m]."""
        if body in self.division.divided:
            return np.asarray(self.wholes[body].space.x - self.bodies[self.frame_of(body)].origin)
        return self.bodies[body].x

    def frame_of(self, body: str) -> str:
        """Return the name of the body whose frame is that of one of the scene's bodies: its first piece, or itself."""
        return self.pieces_of(body)[0].name if body in self.parts or body in self.division.divided else body

    def pieces_of(self, body: str) -> tuple[FlexiblePart, ...]:
        """Return the pieces of one of the scene's flexible bodies; the body itself if it is whole."""
        divided = self.division.divided.get(body)
        return (self.parts[body],) if divided is None else divided.pieces

    def envelope_of(self, body: str) -> StressEnvelope:
        """Envelope of the stress on a flexible body's surface over all times that `stress_of` has; found once."""
        if body not in self._envelopes:
            self._envelopes[body] = stress_envelope(self.stress_of(body))
        return self._envelopes[body]

    def element_stress(self, element: str, component: str = "von Mises") -> dict[str, Array]:
        """Stress in the middle of a named element, ``"body.element"``, over each run's motion, (n_times,) [Pa]."""
        body, _, name = element.partition(".")
        part = next(part for part in self.pieces_of(body) if name in part.elements)
        number, found = list(part.elements).index(name), {}
        for label, motion in self.motions.items():
            own, tensors = self.contact_deformation(part.name, motion), part.element_stress[number]
            tensors = tensors @ motion.modal(part.name).T + (0.0 if own is None else own.element_stress(number))
            found[label] = stress_measure(component)(tensors[None])[0]
        return found

    @cached_property
    def inputs(self) -> dict[str, Any]:
        """Everything in the scene and its files that results depend on, as plain data."""
        return collect_inputs(self.scene)

    @property
    def reference_matrices(self) -> tuple[Array, Array]:
        """Mass and stiffness of the motions of the undeformed mechanism that are free, (n, n) each, slow ones first."""
        M, K, _, _ = self.system.free_motion
        return M, K

    def motion_by(self, plan: Plan, trajectory: Trajectory) -> Motion:
        """Return the motion that a trajectory of one of the scene's plans describes."""
        from fmd.recovery.motion import Motion

        motion = Motion(plan.mechanism, trajectory, self.divided_scene.simulation.tip, self.with_whole_inertia)
        if not (plan.mechanism.held or plan.mechanism.states):
            return motion
        from fmd.recovery.controlled import leave_out_controllers

        return leave_out_controllers(motion)

    def with_whole_inertia(self, mechanism: Mechanism) -> Mechanism:
        """Return a mechanism whose bodies have the inertia that only their joints' reactions take, too."""
        return complete_inertia(self.bodies, self._find_inertia, mechanism)

    def _find_inertia(self, name: str) -> Array:
        """Return the blocks of a body's inertia integrals along the one axis that it turns about."""
        part = self.parts[name]
        if not self.has_other_bodies:
            return part.inertia_along_normal
        body = self.bodies[name]
        return normal_blocks(body.x, part.fe.m, body.shapes, body.integrals.normal)

    @property
    def output_times(self) -> Array:
        """Times of the results [s]."""
        simulation = self.scene.simulation
        n_outputs = int(simulation.duration / simulation.output_step * (1 + 1e-12)) + 1
        return np.arange(n_outputs, dtype=float) * simulation.output_step

    @cached_property
    def fine_times(self) -> tuple[Array, IntArray]:
        """Output times with many more between them [s], which of all are output times: `find_all_times`."""
        found: tuple[Array, IntArray] = import_module("fmd.stages.instants").find_all_times(self)
        return found

    @cached_property
    def at_instants(self) -> Pipeline:
        """The run with its first motion at instants of contacts' shocks, too; itself where output times have these."""
        return import_module("fmd.stages.instants").march_through_shocks(self) if self.scene.contact else self

    @cached_property
    def at_vibrations(self) -> Pipeline:
        """The run at instants of shocks and of vibrations whose cycles fatigue counts."""
        return import_module("fmd.stages.instants").march_through_vibrations(self) if self.scene.output else self

    @property
    def motion(self) -> Motion:
        """Motion by the scene's first run, with which the others are compared."""
        return next(iter(self.motions.values()))


RUN_STAGES: Mapping[str, Stage[Any]] = {stage.name: stage for stage in stages_of(Pipeline)}
