"""Faults of runs whose method of integration can't do what the scene asks."""

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


def check_contact_runs(scene: SceneTables) -> Iterator[FaultError]:
    """Yield the faults of runs of a scene with contacts, which some methods and starts don't take."""
    simulation = scene.simulation_table
    assert simulation is not None
    for number, run in enumerate(simulation.run):
        if scene.refines_contacts and len(simulation.run) > 1:
            fault = f"is a scene's only run with contacts; {name_methods('takes_contact')} stand beside others"
            yield FaultError(fault, "simulation", "run", 0, "integrator")
        if not (run.takes_contact or scene.refines_contacts):
            mend = f"{name_methods('takes_contact')} do"
            fault = f"takes no contact; 'auto' does, and {mend}"
            yield FaultError(fault, "simulation", "run", number, "integrator")
        turning = [name for name, joint in scene.joint.items() if joint.kind.turns or joint.kind.turns_in_space]
        if run.keeps_energy and turning:
            fault = (
                f"takes contacts of bodies that slide alone, and joint '{turning[0]}' turns, by which its energy "
                f"would move by 2e-6 to 6e-5; {name_methods('takes_contact', 'turns_in_space')} take that"
            )
            yield FaultError(fault, "simulation", "run", number, "integrator")
        lossy = [name for name, own in scene.contact.items() if own.has_memory]
        if run.takes_contact and not run.takes_memory and lossy:
            mend = f"{name_methods('takes_contact', 'takes_memory')} take those"
            fault = f"takes no contact with friction, damping or restitution, as of contact.{lossy[0]}; {mend}"
            yield FaultError(fault, "simulation", "run", number, "integrator")
    if getattr(scene, "accuracy", None) is not None:
        yield FaultError("can't be required of a scene with contacts: no error budget states theirs", "accuracy")
    if simulation.start in ("steady", "periodic"):
        yield FaultError("doesn't know of contacts; 'undeformed' and 'equilibrium' do", "simulation", "start")
