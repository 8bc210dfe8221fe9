"""The lazy stage graph: each stage runs when something asks for it, once, and not at all if its result is kept."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from pipeline.cache import Cache, stage_key
from pipeline.checks import Array, InputError, IntArray
from pipeline.folders import cache_folder
from pipeline.progress import Monitor, silent

if TYPE_CHECKING:
    from pipeline.chain import Chain
    from pipeline.dynamics.planar import PlanarRotor
    from pipeline.dynamics.system import System
    from pipeline.fem.marker import Marker
    from pipeline.fem.mesh import SolidMesh
    from pipeline.fem.model import FEModel
    from pipeline.fem.surface import SurfaceTopology
    from pipeline.integrators.protocol import Integrator, Trajectory
    from pipeline.recovery.chain_motion import ChainMotion
    from pipeline.recovery.motion import Motion
    from pipeline.recovery.stress import StressHistory
    from pipeline.reduction.body import FlexibleBody
    from pipeline.reduction.eigen import FreeBodySolver
    from pipeline.reduction.modes import Modes
    from pipeline.scene import Bar, Revolute, Scene

T = TypeVar("T")
STAGES = ("mesh", "assembly", "modes", "body", "motion", "surface", "stress", "pictures")
_SHORT_SECONDS = 0.1
_REPEATS = 4
_FEM_PACKAGES = ("numpy", "scipy", "scikit-fem", "gmsh")


@dataclass
class Log:
    """What has happened to each stage, in order.

    Attributes
    ----------
    seconds : dict of str to float
        Time that each stage took, whether it ran or was read from the cache [s].
    run, cached : list of str
        Stages that were computed and stages that were read.
    """

    seconds: dict[str, float] = field(default_factory=dict)
    run: list[str] = field(default_factory=list)
    cached: list[str] = field(default_factory=list)

    @property
    def skipped(self) -> list[str]:
        """Stages that nothing asked for."""
        return [stage for stage in STAGES if stage not in self.seconds]


class Pipeline:
    """From a scene to its results, each computed on first use and only with what it needs.

    Parameters
    ----------
    scene : Scene
        As `pipeline.load_scene` returns it.
    cache : Cache, optional
        Where results are kept; the user's cache folder by default.
    monitor : Monitor, optional
        Is told of each stage's progress.

    Raises
    ------
    InputError
        The scene has a flexible body among several, or on a joint that is not a revolute one: this version moves one
        flexible body on a torque-driven hinge, or a chain of rigid ones.
    """

    def __init__(self, scene: Scene, cache: Cache | None = None, monitor: Monitor = silent) -> None:
        self.flexible = any(part.shape == "bar" for part in scene.body.values())
        if self.flexible and (len(scene.body) != 1 or next(iter(scene.joint.values())).type != "revolute"):
            mend = "this version moves one flexible body on a revolute joint, or a chain of rigid ones"
            raise InputError(scene.file, "body", sorted(scene.body), mend)
        self.scene = scene
        self.log = Log()
        self._cache = Cache(cache_folder() / "stages") if cache is None else cache
        self.monitor = monitor

    # What the scene says, resolved -------------------------------------------------------------------------------

    @property
    def part(self) -> Bar:
        """The flexible body as the scene describes it.

        Raises
        ------
        InputError
            There is none.
        """
        part = next(iter(self.scene.body.values()))
        if part.shape != "bar":
            raise InputError(self.scene.file, "body", sorted(self.scene.body), "no flexible body: nothing to mesh")
        return part

    @property
    def _joint(self) -> Revolute:
        joint = next(iter(self.scene.joint.values()))
        assert joint.type == "revolute"  # the constructor's own check
        return joint

    @property
    def _joint_marker(self) -> str:
        return self._joint.child.partition(".")[2]

    @property
    def _axis(self) -> Array:
        return np.array(self._joint.axis, dtype=float)

    # Stages ------------------------------------------------------------------------------------------------------

    @cached_property
    def mesh(self) -> SolidMesh:
        """The mesh."""
        return self._kept("mesh", self._mesh_key, self._make_mesh)

    @cached_property
    def fe(self) -> FEModel:
        """Stiffness and mass; never kept, since what follows is."""
        from pipeline.fem.assembly import assemble
        from pipeline.fem.material import Material

        mesh, part = self.mesh, self.part
        return self.timed("assembly", lambda: assemble(mesh, part.mesh.order, Material(part.E, part.nu, part.rho)))

    @cached_property
    def modes(self) -> Modes:
        """The free modes that the scene chooses."""
        return self._kept("modes", self._modes_key, self._make_modes)

    @cached_property
    def body(self) -> FlexibleBody:
        """The reduced body at its joint."""
        return self._kept("body", self._body_key, self._make_body)

    @cached_property
    def rotor(self) -> PlanarRotor:
        """The mechanism: the body on its torque-driven joint."""
        from pipeline.dynamics.planar import PlanarRotor, TorquePulse

        pulse = TorquePulse(0.0, 1.0, 0.0)
        for drive in self.scene.drive.values():
            if drive.type != "torque pulse":
                mend = "a flexible body takes a torque pulse in this version"
                raise InputError(self.scene.file, "drive", drive.type, mend)
            if drive.speed is None:
                peak = float(drive.torque or 0.0)
            else:
                peak = np.pi / 2 * self.body.inertia_about_joint * drive.speed / drive.duration
            pulse = TorquePulse(drive.start, drive.duration, peak)
        return PlanarRotor(self.body, pulse)

    @cached_property
    def chain(self) -> Chain:
        """The mechanism of a scene of rigid bodies."""
        from pipeline.chain import chain_of

        return chain_of(self.scene)

    @property
    def mechanism(self) -> System:
        """What is integrated: the rotor, or the chain."""
        return self.rotor if self.flexible else self.chain.tree

    @cached_property
    def motions(self) -> dict[str, Motion] | dict[str, ChainMotion]:
        """The motion by each of the scene's runs; the label tells integrator and ratio.

        Raises
        ------
        InputError
            A step is beyond its stability limit; nothing has been integrated then.
        """
        mechanism, integrators = self.mechanism, self._integrators()
        for key, integrator in zip(self._step_keys(), integrators.values(), strict=True):
            limit = integrator.largest_step(mechanism)
            if not integrator.step < limit:
                raise InputError(
                    self.scene.file,
                    key,
                    f"{integrator.step:.6g} s",
                    f"{integrator.name} would diverge; the largest stable step of this model is {limit:.4g} s "
                    f"(2/ω of its highest frequency, {1 / (np.pi * limit):.5g} Hz)",
                )
        trajectories = self.timed("motion", lambda: self._march_all(integrators))
        if self.flexible:
            from pipeline.recovery.motion import Motion

            tip = self.scene.simulation.tip.partition(".")[2]
            return {label: Motion(self.rotor, trajectory, tip) for label, trajectory in trajectories.items()}
        from pipeline.recovery.chain_motion import ChainMotion

        chain = self.chain
        return {
            label: ChainMotion(chain.tree, trajectory, chain.tip, chain.joints)
            for label, trajectory in trajectories.items()
        }

    @property
    def motion(self) -> Motion:
        """The flexible body's motion by the scene's first run, with which the others are compared."""
        from pipeline.recovery.motion import Motion

        first = next(iter(self.motions.values()))
        if not isinstance(first, Motion):
            raise InputError(self.scene.file, "body", sorted(self.scene.body), "no flexible body; see Pipeline.motions")
        return first

    @cached_property
    def surface(self) -> SurfaceTopology:
        """The body's outer surface."""
        return self._kept("surface", self._modes_key, self._make_surface)

    @cached_property
    def stress(self) -> StressHistory:
        """Stress on the body's surface over the first run's motion."""
        from pipeline.recovery.stress import StressHistory

        nodes = self.surface.nodes
        modal = self._kept("stress", self._body_key, lambda: self._modal_stress(nodes))
        return StressHistory(nodes, modal, self.motion.times, self.motion.q)

    # How each is made --------------------------------------------------------------------------------------------

    @property
    def _mesh_key(self) -> str:
        part = self.part.model_dump(mode="json", include={"shape", "length", "depth", "width", "mesh"})
        return stage_key("mesh", part, ("meshes", "pipeline/fem/mesh.py"), ("gmsh",))

    @property
    def _modes_key(self) -> str:
        part = self.part.model_dump(mode="json", exclude={"marker"})
        inputs = {"part": part, "axis": self._joint.axis}
        return stage_key("modes", inputs, ("meshes", "pipeline/fem", "pipeline/reduction"), _FEM_PACKAGES)

    @property
    def _body_key(self) -> str:
        inputs = {
            "modes": self._modes_key,
            "markers": self.part.model_dump(mode="json", include={"marker"}),
            "joint": self._joint_marker,
            "frame": self.scene.simulation.frame,
        }
        return stage_key("body", inputs, ("pipeline/reduction", "pipeline/recovery/stress.py"))

    def _make_mesh(self) -> SolidMesh:
        from meshes.bar import hexahedral_bar, tetrahedral_bar
        from pipeline.fem.mesh import SolidMesh

        part = self.part
        size = (part.length, part.depth, part.width)
        if part.mesh.element == "hexahedron":
            assert part.mesh.divisions is not None  # the scene's own check
            return SolidMesh(*hexahedral_bar(*size, part.mesh.divisions))
        assert part.mesh.size is not None
        return SolidMesh(*tetrahedral_bar(*size, part.mesh.size))

    @cached_property
    def _solver(self) -> FreeBodySolver:
        from pipeline.reduction.eigen import FreeBodySolver

        return FreeBodySolver(self.fe)

    def _make_modes(self) -> Modes:
        from pipeline.reduction.families import lowest_modes, modes_of_family

        wanted = self.part.modes
        if wanted.family == "any":
            return lowest_modes(self._solver, wanted.count)
        return modes_of_family(self._solver, self.fe, wanted.count, wanted.family, self._axis)

    def _make_body(self) -> FlexibleBody:
        from pipeline.reduction.body import free_frame_body, joint_conforming_body
        from pipeline.reduction.enrichment import enriched, inertia_loads

        markers, modes = self._markers(), self.modes
        omega, shapes = modes.omega, modes.shapes
        if self.part.modes.enrich == "inertia":
            loads = inertia_loads(self.fe, markers[self._joint_marker], self._axis)
            omega, shapes = enriched(modes, self.fe, self._solver, loads)
        conforming = self.scene.simulation.frame == "joint-conforming"
        make = joint_conforming_body if conforming else free_frame_body
        return make(self.fe, omega, shapes, markers, self._joint_marker, self._axis)

    def _markers(self) -> dict[str, Marker]:
        from pipeline.fem.marker import face_marker

        space, faces = self.fe.discretisation, self.mesh.faces
        return {name: face_marker(space, faces[marker.face]) for name, marker in self.part.marker.items()}

    def _make_surface(self) -> SurfaceTopology:
        from pipeline.fem.model import Discretisation
        from pipeline.fem.surface import surface_topology

        return surface_topology(Discretisation(self.mesh, self.part.mesh.order))

    def _modal_stress(self, nodes: IntArray) -> Array:
        from pipeline.fem.material import Material
        from pipeline.fem.model import Discretisation
        from pipeline.recovery.stress import modal_stress

        part = self.part
        space = Discretisation(self.mesh, part.mesh.order)
        return modal_stress(space, Material(part.E, part.nu, part.rho), self.body.shapes, nodes)

    def _integrators(self) -> dict[str, Integrator]:
        from pipeline.integrators.central_difference import CentralDifference
        from pipeline.integrators.exponential import Exponential
        from pipeline.integrators.generalized_alpha import GeneralizedAlpha
        from pipeline.integrators.scipy_ivp import ScipyIvp
        from pipeline.integrators.subcycling import Subcycling

        made: dict[str, Integrator] = {}
        for k, run in enumerate(self.scene.simulation.run):
            step, label = run.step or self.scene.simulation.step, str(run.integrator)
            integrator: Integrator
            match run.integrator:
                case "central-difference":
                    integrator = CentralDifference(step)
                case "sub-cycling":
                    label, integrator = f"{label} {run.substeps}:1", Subcycling(step, run.substeps)
                case "exponential":
                    integrator = Exponential(step)
                case "generalized-alpha":
                    integrator = GeneralizedAlpha(step, run.rho)
                case _:
                    integrator = ScipyIvp(run.integrator, run.tolerance)
            made[f"{label} ({k})" if label in made else label] = integrator
        return made

    def _step_keys(self) -> list[str]:
        runs = enumerate(self.scene.simulation.run)
        return [f"simulation.run.{k}.step" if run.step else "simulation.step" for k, run in runs]

    @property
    def start(self) -> tuple[Array, Array]:
        """Positions and rates at the start."""
        if not self.flexible:
            return self.chain.q0, self.chain.v0
        q0, v0 = np.zeros(self.rotor.n), np.zeros(self.rotor.n)
        q0[0], v0[0] = self._joint.angle, self._joint.rate
        return q0, v0

    def _march_all(self, integrators: dict[str, Integrator]) -> dict[str, Trajectory]:
        simulation, mechanism = self.scene.simulation, self.mechanism
        n_outputs = int(simulation.duration / simulation.output_step * (1 + 1e-12)) + 1
        times = np.arange(n_outputs, dtype=float) * simulation.output_step
        start = self.start
        trajectories = {}
        for label, integrator in integrators.items():
            integrator.march(mechanism, *start, times[:2])  # compiles, or reads kernels: not part of the run time
            with self.monitor(label) as advance:
                trajectories[label] = integrator.march(mechanism, *start, times, advance)
        if sum(trajectory.seconds for trajectory in trajectories.values()) < _SHORT_SECONDS:
            for _ in range(_REPEATS):  # side by side, so that the ratios of run times mean something
                for label, integrator in integrators.items():
                    again = integrator.march(mechanism, *start, times)
                    if again.seconds < trajectories[label].seconds:
                        trajectories[label] = again
        return trajectories

    def _kept(self, stage: str, key: str, make: Callable[[], T]) -> T:
        """Read a stage's result, or compute and keep it."""
        key = f"{stage}-{key}"
        tick = time.perf_counter()
        value: T | None = self._cache.load(key)
        if value is not None:
            self.log.cached.append(stage)
            self.log.seconds[stage] = time.perf_counter() - tick
            return value
        value = self.timed(stage, make)
        self._cache.save(key, value)
        return value

    def timed(self, stage: str, make: Callable[[], T]) -> T:
        """Compute a stage; stages that it asks for in turn don't count as its own time."""
        from threadpoolctl import threadpool_limits

        others = sum(self.log.seconds.values())
        tick = time.perf_counter()
        with (
            self.monitor(stage),
            threadpool_limits(1),
        ):  # the products here are small: two BLAS threads only spin
            value = make()
        spent = time.perf_counter() - tick
        self.log.run.append(stage)
        self.log.seconds[stage] = spent - (sum(self.log.seconds.values()) - others)
        return value
