"""Motions of a scene's runs: checked before anything is integrated, and again when it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any, Protocol

from fmd.core.errors import InertiaError
from fmd.stages.result_size import require_room

if TYPE_CHECKING:
    from fmd.core.arrays import Array
    from fmd.dynamics.mechanism import Mechanism
    from fmd.integrators.protocol import Trajectory
    from fmd.recovery.motion import Motion
    from fmd.scene.scene import Scene
    from fmd.stages.runs import Plan
    from fmd.stages.stiffening_check import StiffnessChange
    from fmd.stages.store import StageStore

_OF_MECHANISM = ("mechanism", "system", "start", "plans", "stiffness_changes")


class MarchedScene(Protocol):
    """A scene whose runs are integrated, as a `Pipeline` has it; attributes are those of that class."""

    scene: Scene
    store: StageStore
    results: dict[str, Any]
    while_timed: Callable[[], AbstractContextManager[None]]
    whole_energy: bool

    @property
    def bodies(self) -> Mapping[str, Any]:
        """Reduced flexible bodies."""

    @property
    def mechanism(self) -> Mechanism:
        """Bodies, joints and loads."""

    @property
    def stiffness_changes(self) -> Mapping[str, StiffnessChange]:
        """Change of each stiffened body's stiffness by the loads through it."""

    @property
    def plans(self) -> Mapping[str, Plan]:
        """Runs, ready to be integrated."""

    @property
    def output_times(self) -> Array:
        """Times of the results [s]."""

    @property
    def trajectories(self) -> Mapping[str, Trajectory]:
        """Motions in coordinates, by the names of the runs."""

    def motion_by(self, plan: Plan, trajectory: Trajectory) -> Motion:
        """Return the motion that a trajectory describes."""


def march_runs(run: MarchedScene) -> dict[str, Trajectory]:
    """Integrate the scene's runs, one after the other."""
    times, trajectories = run.output_times, {}
    for label, plan in run.plans.items():
        if run.while_timed is not nullcontext:
            plan.march(times[:2])  # compiles, or reads kernels, while others may use the processor
        with run.store.monitor(label) as advance, run.while_timed():
            trajectories[label] = plan.march(times, advance)
    return trajectories


def find_motions(run: MarchedScene) -> dict[str, Motion]:
    """Return the motion by each run; one that lost its inertia is found anew with the whole energy of second order.

    The errors are those of `Pipeline.motions`.
    """
    run.bodies  # noqa: B018 - stages of their own; what the plans add is kernels, compiled or read
    try:
        return _find_motions(run)
    except InertiaError:
        if run.whole_energy:
            raise
    run.whole_energy = True
    for name in _OF_MECHANISM:
        vars(run).pop(name, None)
    run.results.clear()  # the trajectories
    return _find_motions(run)


def _find_motions(run: MarchedScene) -> dict[str, Motion]:
    from fmd.stages.stiffening_check import require_unbuckled

    require_room(run.scene, run.mechanism)
    require_unbuckled(run.scene, run.stiffness_changes)
    run.plans  # noqa: B018 - refuses a step before anything is timed
    trajectories = run.trajectories
    for label, plan in run.plans.items():
        plan.require_positive_mass(trajectories[label])
    return {label: run.motion_by(plan, trajectories[label]) for label, plan in run.plans.items()}
