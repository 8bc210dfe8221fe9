"""Steps of scenes with contacts: what their modes alone allow or ask for, and what takes longer ones."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.errors import InputError
from fmd.core.limits.contact import HALVED_STEPS, LARGEST_STEP, LOST_ENERGY
from fmd.dynamics.compiled_system.shared import make_system
from fmd.scene.runs import name_methods
from fmd.stages.run_checks import require_inertia

if TYPE_CHECKING:
    from fmd.dynamics.mechanism import Mechanism
    from fmd.recovery.motion import Motion
    from fmd.scene.scene import Scene
    from fmd.stages.pipeline import Pipeline


def require_steps_of_modes(scene: Scene, mechanism: Mechanism) -> None:
    """Check that given steps of a scene with contacts suit its modes, whose limit contacts only shorten.

    Points and flexibility of faces, which the limit with all points closed takes, cost far more than this.

    Raises
    ------
    InputError
        A step of an explicit method is longer than contact can take, or a motion has no inertia.
    """
    simulation = scene.simulation
    given = {k: run.step or simulation.step for k, run in enumerate(simulation.run) if run.is_limited}
    steps = {k: step for k, step in given.items() if isinstance(step, float)}
    if not steps:
        return
    system = make_system(mechanism)
    require_inertia(scene, system)
    limit = system.largest_step
    for k, step in steps.items():
        if step > LARGEST_STEP * limit:
            fault = (
                f"is too long for contact: without it steps of the modes are stable up to {limit:.4g} s, with it up "
                f"to half of that or less{remedies_of_contact(scene, k)}"
            )
            raise InputError(scene.file, step_key(scene, k), f"{step:.6g} s", fault)


def step_key(scene: Scene, k: int) -> str:
    """Return the key of the step of a scene's run."""
    return f"simulation.run.{k}.step" if scene.simulation.run[k].step else "simulation.step"


def remedies_of_contact(scene: Scene, k: int) -> str:
    """Say by which keys a scene with contacts takes longer steps in one of its runs: the end of a message."""
    bodies = dict.fromkeys(body for _, body, _ in scene.touching_faces)
    keys = " and ".join(
        f"body.{name}.modes.enrich" for name in bodies if scene.with_its_basis(name).modes.enrich != "none"
    )
    bare = f"; {keys} = 'none' leaves out the fastest modes" if keys else ""
    return (
        f"; simulation.step = 'auto' finds one{bare}; simulation.run.{k}.integrator = "
        f"'{name_methods('takes_contact', 'passes_over')}' with that takes longer ones, past what they don't resolve"
    )


def step_of_modes(built: Pipeline) -> float:
    """Return 2/ω of the highest mode that touching bodies' scene counts [s], which vibrates in a contact's shock.

    Faster are static responses beside them, and closed contacts, whose deflection follows at once.
    """
    bodies = {name: built.parts[name] for _, name, _ in built.scene.touching_faces}
    counted = [part.body.omega[: part.shape.modes.count or None] for part in bodies.values()]
    return float(2.0 / max((omega.max(initial=0.0) for omega in counted), default=math.inf))


def steps_settle(scene: Scene, found: Sequence[Mapping[str, Motion]]) -> bool:
    """Return true if the last of motions by halved steps is to be taken.

    Contact neither makes nor loses much energy in it and, where figures of contacts are to agree, they change no more
    than that from the one before, or no less than before.
    """
    for motion in found[-1].values():
        if any(own.lost_part(motion.energies[0]) > LOST_ENERGY for own in motion.contacts.values()):
            return False
    if not scene.refines_contacts:
        return True
    changes = [_contact_change(*pair) for pair in pairwise(found[-3:])]
    return bool(changes) and (changes[-1] <= scene.simulation.error or (len(changes) > 1 and changes[1] >= changes[0]))


def most_halvings(built: Pipeline) -> int:
    """Return how often steps of a scene with contacts may be halved: those that it leaves open."""
    simulation = built.scene.simulation
    steps = {each.step for each in simulation.run if not each.chooses_steps}
    free = built.scene.contact and simulation.step == "auto" and steps == {None}
    return HALVED_STEPS + halvings_to_closed(built) if free else 0


def _contact_change(one: Mapping[str, Motion], other: Mapping[str, Motion]) -> float:
    """Return the largest relative change between motions of like runs in contacts' impulses, largest forces and heat.

    They are compared with the larger of both, heat with the largest kinetic energy, too.
    """
    found = 0.0
    for label, motion in other.items():
        kinetic = float(motion.energies[0].max())
        for name, own in motion.contacts.items():
            its = one[label].contacts[name]
            heats = [float(at.friction_work[-1] + at.damping_work[-1]) for at in (own, its)]
            impulses, forces = np.array([own.impulse[-1], its.impulse[-1]]), (own.largest[0], its.largest[0])
            pairs = [
                (float(np.linalg.norm(impulses[0] - impulses[1])), float(np.linalg.norm(impulses, axis=1).max())),
                (abs(forces[0] - forces[1]), max(forces)),
                (abs(heats[0] - heats[1]), max(*map(abs, heats), kinetic)),
            ]
            found = max(found, *(change / size if size else 0.0 for change, size in pairs))
    return found


def halvings_to_closed(built: Pipeline) -> int:
    """Return how many halvings bring a step chosen by the modes down to one by closed contacts."""
    if not any(run.passes_over for run in built.scene.simulation.run):
        return 0
    return math.ceil(math.log2(max(1.0, step_of_modes(built) / built.system.largest_step)))
