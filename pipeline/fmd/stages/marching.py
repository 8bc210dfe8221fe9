"""Motions of a scene's runs: checked before anything is integrated, and again when it is."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fmd.core.errors import InertiaError
from fmd.stages.result_size import require_room
from fmd.stages.stage import forget

if TYPE_CHECKING:
    from fmd.integrators.protocol import Trajectory
    from fmd.recovery.motion import Motion
    from fmd.stages.runs import BuiltScene, Plan


def find_motions(run: BuiltScene) -> dict[str, Motion]:
    """Return the motion by each run; one that lost its inertia is found anew with the whole energy of second order.

    The errors are those of `Pipeline.motions`.
    """
    try:
        return _find_motions(run)
    except InertiaError:
        if run.whole_energy:
            raise
    run.whole_energy = True
    forget(run, "mechanism")
    return _find_motions(run)


def _find_motions(run: BuiltScene) -> dict[str, Motion]:
    from fmd.stages.stiffening_check import require_unbuckled

    require_room(run.scene, run.mechanism)
    require_unbuckled(run.scene, run.stiffness_changes)
    plans = run.compiled_plans  # refuses a step before anything is timed
    trajectories = {label: _march(run, label, plan) for label, plan in plans.items()}
    for label, plan in plans.items():
        plan.require_positive_mass(trajectories[label])
    return {label: run.motion_by(plan, trajectories[label]) for label, plan in plans.items()}


def _march(run: BuiltScene, label: str, plan: Plan) -> Trajectory:
    """Integrate a run of the scene."""
    with run.store.monitor(label) as advance, run.while_timed():
        return plan.march(run.output_times, advance)
