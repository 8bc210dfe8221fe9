"""Faults of runs whose method of integration can't do what the scene asks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from fmd.scene.reading import FaultError
from fmd.scene.run_table import RunTable
from fmd.scene.runs import name_methods
from fmd.scene.scene_tables import SceneTables


def check_runs(scene: SceneTables, runs: Sequence[RunTable]) -> Iterator[FaultError]:
    """Yield the faults of runs whose methods take no such joints, loops or sampled controllers as a scene has."""
    turning = [name for name in scene.carrying.values() if scene.joint[name].kind.turns_in_space]
    for number, run in enumerate(runs):
        faults = []
        if turning and not run.turns_in_space:
            mend = f"{name_methods('chooses_steps', 'turns_in_space', 'keeps_loops')} do"
            faults.append(f"takes no rotations in space, such as joint '{turning[0]}' has; {mend}")
        if not run.keeps_loops and scene.closing:
            faults.append(f"doesn't keep loops closed; {name_methods('chooses_steps', 'keeps_loops')} do")
        if not run.samples and (sampled := scene.sampled):
            mend = f"{name_methods('samples')} do"
            faults.append(f"doesn't end its steps where controller '{sampled[0]}' samples; {mend}")
        for fault in faults:
            yield FaultError(fault, "simulation", "run", number, "integrator")
