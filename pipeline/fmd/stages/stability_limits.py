"""Largest stable steps of a scene's own mechanism, with the split of its first sub-cycled run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from fmd.core.limits.contact import CHOSEN_STEP
from fmd.core.progress import Advance
from fmd.dynamics.vibration import inertial_coupling
from fmd.scene.run_table import SubCycledRun
from fmd.stability.limits import MechanismLimits, find_limits
from fmd.stability.operating_points import find_operating_points
from fmd.stages.run_checks import require_no_contact
from fmd.stages.runs import plan_sub_cycled

if TYPE_CHECKING:
    from fmd.dynamics.compiled_system.system import CompiledSystem
    from fmd.stages.pipeline import Pipeline


def find_scene_limits(pipeline: Pipeline, ratios: Sequence[int], along: bool) -> MechanismLimits:
    """Find the largest stable steps of a scene's mechanism about its reference state or, ``along`` its motion, too.

    Without a sub-cycled run in the scene its joints are slow. Contacts count as closed, and are for plain central
    differences alone.

    Raises
    ------
    InputError
        Along the motion of a scene with contacts, whose operating points would leave them out.
    """
    simulation = pipeline.scene.simulation
    if along:
        require_no_contact(pipeline.scene, "--along")
    ratios = [1] if pipeline.scene.contact else ratios
    system = _split(pipeline)
    reference, points = system.stiffest_motion, None
    if along:
        points = find_operating_points(system, pipeline.mechanism, *pipeline.start, simulation.duration)
    with pipeline.store.monitor("stability") as advance:
        counted = _counted(ratios, advance)
        limits = find_limits(system, reference, counted, simulation.duration, simulation.error, points)
    if points and not system.mechanism.closures:
        masses = [system.mass_matrix(at.q, at.time) for at in points.points]
        coupling = max(limits.coupling, *(inertial_coupling(mass, system.n_slow) for mass in masses))
        limits = replace(limits, coupling=coupling)
    if pipeline.scene.contact:  # longer steps let opening and closing feed the highest modes
        step = min(limits.recommended[0], CHOSEN_STEP * limits.limits[0].critical_step)
        limits = replace(limits, recommended=(step, 1))
    return limits


def _counted(ratios: Sequence[int], advance: Advance) -> Iterator[int]:
    """Go through the ratios, and report the part of them that is done."""
    for k, m in enumerate(ratios):
        yield m
        advance((k + 1) / len(ratios))


def _split(pipeline: Pipeline) -> CompiledSystem:
    """Return the mechanism with the split of the scene's first sub-cycled run, as it is marched."""
    simulation = pipeline.scene.simulation
    step = simulation.step if isinstance(simulation.step, float) else 1.0  # only a split that is chosen depends on it
    for run in simulation.run:
        if isinstance(run, SubCycledRun):
            chosen = run.split == "auto" and simulation.step == "auto"
            return plan_sub_cycled(pipeline, run, "", None if chosen else run.step or step).system
    return pipeline.system
