"""Plans of a scene's runs: an integrator, a mechanism and a start each; and what planning needs of a scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import StabilityError
from fmd.dynamics.compiled_system.positive_mass import require_positive_over
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.excited_modes import Excited
from fmd.dynamics.mechanism import Mechanism
from fmd.integrators.protocol import Integrator, Progress, Trajectory
from fmd.stages.run_checks import describe_fastest

if TYPE_CHECKING:
    from fmd.recovery.motion import Motion
    from fmd.reduction.body import FlexibleBody
    from fmd.scene.scene import Scene
    from fmd.stages.buckling import StiffnessChange
    from fmd.stages.part import FlexiblePart
    from fmd.stages.stiffening_check import StiffeningLoads
    from fmd.stages.store import StageStore


@dataclass(frozen=True)
class Plan:
    """A run of a scene, ready to be integrated: an integrator, a mechanism and a start.

    Attributes
    ----------
    key : str
        The scene's key of its step.
    mechanism : Mechanism
        With the run's own split into slow and fast coordinates.
    system : CompiledSystem
        The mechanism as it is marched, whose steps are limited.
    start : tuple of ndarray, shapes (n_positions,) and (n,)
        Positions and rates.
    excited : Excited, optional
        The part of the mechanism that is integrated, if some modes can be left at rest.
    excited_system : CompiledSystem, optional
        That part as it is marched.
    growth : float
        Factor by which an explicit method itself makes small vibrations grow over the scene.
    """

    key: str
    integrator: Integrator
    mechanism: Mechanism
    system: CompiledSystem
    start: tuple[Array, Array]
    excited: Excited | None = None
    excited_system: CompiledSystem | None = None
    growth: float = 1.0

    def require_positive_mass(self, trajectory: Trajectory) -> None:
        """Raise ``AccuracyError`` if the mass matrix isn't positive definite along a march of this plan."""
        require_positive_over(self.system, trajectory.times, trajectory.q)

    def compile(self) -> None:
        """Compile all functions that a march calls, or read them where they are kept; not of a method yet to choose."""
        if not self.integrator.chooses_method:
            self.march(np.zeros(1))

    @property
    def marched(self) -> tuple[CompiledSystem, Array, Array]:
        """System, positions and rates that are integrated: those of the modes that don't stay at rest."""
        (q0, v0), part = self.start, self.excited
        if part is None or self.excited_system is None:
            return self.system, q0, v0
        return self.excited_system, q0[part.positions], v0[part.rates]

    def spread_out(self, march: Trajectory) -> Trajectory:
        """Return what was integrated with all coordinates; those of modes that stay at rest are 0."""
        (q0, v0), part = self.start, self.excited
        if part is None or self.excited_system is None:
            return march
        q, v = np.tile(q0, (len(march.times), 1)), np.zeros((len(march.times), len(v0)))
        q[:, part.positions], v[:, part.rates] = march.q, march.v
        return replace(march, q=q, v=v)

    def march(self, times: Array, progress: Progress | None = None) -> Trajectory:
        """Integrate; coordinates of modes that stay at rest are 0. The end is that of what was integrated."""
        return self.spread_out(self._march(*self.marched, times, progress))

    def _march(
        self, system: CompiledSystem, q0: Array, v0: Array, times: Array, progress: Progress | None
    ) -> Trajectory:
        """Integrate a system; an error says if a motion has lost its inertia, or which part is too fast to follow."""
        try:
            return self.integrator.march(system, q0, v0, times, progress)
        except StabilityError as failure:
            system.explain_failure(failure)
            duration = max(float(times[-1]), self.mechanism.horizon)
            raise StabilityError(
                f"{failure}{describe_fastest(system, duration)}", failure.time, failure.positions
            ) from failure


def repeat_choice(plan: Plan, trajectory: Trajectory) -> Plan:
    """Return a run's plan by the method and the step that an automatic choice ended with, which it made by marching."""
    return replace(plan, integrator=trajectory.chosen or plan.integrator)


@dataclass(frozen=True)
class Growth:
    """Step of a run that is safe to take, and the growth of small vibrations by the method itself.

    Attributes
    ----------
    step : float, optional
        Step in place of the plan's, which is too long [s].
    factor : float
        Factor by which small vibrations grow over the scene.
    carried : bool
        Sub-cycling carries forces on from cycle to cycle, for that is cheapest.
    """

    step: float | None = None
    factor: float = 1.0
    carried: bool = False


class BuiltScene(Protocol):
    """A scene with its mechanism, as a `Pipeline` has it.

    Attributes
    ----------
    scene : Scene
        The scene.
    keep_all : bool
        Integrate modes that nothing can excite, too.
    store : StageStore
        Times what is compiled.
    results : dict of str to object
        Results of stages by their names.
    while_timed : callable
        Makes a context in which each run is timed.
    stands_alone : bool
        False for one scene of many: its run times aren't compared, and results of the whole scene aren't kept.
    whole_energy : bool
        Displacements of second order count with their whole kinetic energy.
    has_other_bodies : bool
        Bodies are given in place of the scene's own.
    """

    scene: Scene
    keep_all: bool
    store: StageStore
    results: dict[str, Any]
    while_timed: Callable[[], AbstractContextManager[None]]
    stands_alone: bool
    whole_energy: bool
    has_other_bodies: bool

    @property
    def divided_scene(self) -> Scene:
        """The scene with pieces as bodies of their own."""

    @property
    def parts(self) -> Mapping[str, FlexiblePart]:
        """Flexible parts and pieces."""

    @property
    def stiffening_loads(self) -> Mapping[str, StiffeningLoads]:
        """Loads through each of them, and if they count."""

    @property
    def bodies(self) -> Mapping[str, FlexibleBody]:
        """Reduced flexible bodies."""

    @property
    def mechanism(self) -> Mechanism:
        """Mechanism with the scene's own slow joints."""

    @property
    def system(self) -> CompiledSystem:
        """System that marches it."""

    @property
    def start(self) -> tuple[Array, Array]:
        """Positions and rates at the start."""

    @property
    def reference_matrices(self) -> tuple[Array, Array]:
        """Mass and stiffness of the undeformed mechanism."""

    @property
    def drafts(self) -> tuple[Plan, ...]:
        """Runs whose stability isn't known yet."""

    @property
    def growths(self) -> tuple[Growth, ...]:
        """Safe step of each run, and the growth of small vibrations by its method."""

    @property
    def compiled_plans(self) -> Mapping[str, Plan]:
        """Runs, ready to be integrated, whose machine code is there."""

    @property
    def stiffness_changes(self) -> Mapping[str, StiffnessChange]:
        """Change of each stiffened body's stiffness by the loads through it."""

    @property
    def output_times(self) -> Array:
        """Times of the results [s]."""

    def motion_by(self, plan: Plan, trajectory: Trajectory) -> Motion:
        """Return the motion that a trajectory describes."""

    @property
    def plans(self) -> dict[str, Plan]:
        """Runs with stable steps."""

    @property
    def motion(self) -> Motion:
        """Motion by the first run."""

    @property
    def fine_times(self) -> tuple[Array, IntArray]:
        """Output times with many more around the tip's largest deflections [s]; which of them are output times."""
