"""Steps of scenes with contacts: what their modes alone allow or ask for, and what takes longer ones."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.errors import InputError
from fmd.core.limits.contact import CHOSEN_STEP, HALVED_STEPS, LARGEST_STEP, LINEAR_TIMES, SHOCK_STEPS
from fmd.core.limits.round_off import SOLVED
from fmd.dynamics.compiled_system.shared import make_system
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.integrators.protocol import evaluate
from fmd.integrators.work_bounds import round_down
from fmd.scene.runs import name_methods
from fmd.stages.plan import Growth, Plan
from fmd.stages.run_checks import require_free_start, require_inertia

if TYPE_CHECKING:
    from fmd.dynamics.mechanism import Mechanism
    from fmd.recovery.motion import Motion
    from fmd.scene.runs import Run
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


def limit_contact_step(built: Pipeline, plan: Plan, run: Run, free: bool, apart: Growth) -> Growth:
    """Shorten the step of a run with contacts, or refuse it: from half of its limit on the highest modes gain energy.

    They do so without damping, by opening and closing, though each of the two is stable by itself. Operating points,
    which a motion without contacts would have, tell of sub-cycling alone, whose cycles are taken
    ``apart`` from contacts.
    """
    require_free_start(built.scene, plan.system, plan.start)
    step, substeps, limit = plan.integrator.step, plan.integrator.substeps, plan.integrator.largest_step(plan.system)
    if run.chooses_steps:
        return apart
    if run.keeps_energy:
        require_linear_rest(built.scene, built.scene.simulation.run.index(run), plan.system)
    if free:
        round_laws = any(own.law for body in plan.mechanism.contacts for own in body.contacts)
        share = built.results.get("contact step", CHOSEN_STEP) * (SHOCK_STEPS if round_laws else 1.0)
        resolved = 0.0 if round_laws or not run.passes_over else step_of_modes(built)
        longest = substeps * share * min(limit, max(plan.system.largest_step, resolved))  # loads are frozen in a cycle
        longest = plan.system.resolving_step(longest)[0] / substeps
        return replace(apart, step=min(longest, apart.step or longest))
    if step > LARGEST_STEP * limit:  # which an implicit method has none of
        mend = (
            f"lets contact feed the highest modes; with all points closed, steps are stable up to {limit:.4g} s, and "
            f"{round_down(LARGEST_STEP * limit):g} s is the longest step, {round_down(CHOSEN_STEP * limit):g} s a good "
            f"one{remedies_of_contact(built.scene, built.scene.simulation.run.index(run))}"
        )
        raise InputError(built.scene.file, plan.key, f"{step:.6g} s", mend)
    return apart


def require_linear_rest(scene: Scene, k: int, system: CompiledSystem) -> None:
    """Check that all but contacts is linear in a mechanism whose energy a run's steps are to keep.

    Raises
    ------
    InputError
        Mass changes, or dampers, joints' stops or other forces that aren't linear act.
    """
    from fmd.integrators.energy_exact import stiffness_under_loads

    plain, rng = CompiledSystem(replace(system.mechanism, contacts=())), np.random.default_rng(0)
    M, _, C = plain.linear_matrices
    q, v = rng.standard_normal((2, plain.n))
    pulled = np.linalg.solve(M, stiffness_under_loads(plain) @ q)
    (found, rest), unlinear = np.zeros((2, plain.n)), False
    for t in scene.simulation.duration * rng.random(LINEAR_TIMES):
        evaluate(plain.parameters, t, q, v, found)
        evaluate(plain.parameters, t, 0.0 * q, 0.0 * v, rest)
        largest = np.abs(rest - pulled).max(initial=1.0)
        unlinear |= bool(np.abs(found - rest + pulled).max(initial=0.0) > SOLVED * largest)
    if plain.has_loops or C.any() or unlinear:  # dampers may be lost in the forces of stiff modes
        fault = (
            "keeps the energy of contacts beside gravity, loads in time and linear springs alone, without dampers, "
            f"loops or stops; {name_methods('takes_contact', 'turns_in_space')} take what else there is"
        )
        name = scene.simulation.run[k].integrator
        raise InputError(scene.file, f"simulation.run.{k}.integrator", name, fault)


def step_key(scene: Scene, k: int) -> str:
    """Return the key of the step of a scene's run."""
    return f"simulation.run.{k}.step" if scene.simulation.run[k].step else "simulation.step"


def remedies_of_contact(scene: Scene, k: int) -> str:
    """Say by which keys a scene with contacts takes longer steps in one of its runs: the end of a message."""
    return (
        f"; simulation.step = 'auto' finds one{leave_fastest_out(scene)}; simulation.run.{k}.integrator = "
        f"'{name_methods('takes_contact', 'passes_over')}' with that takes longer ones, past what they don't resolve"
    )


def leave_fastest_out(scene: Scene) -> str:
    """Say by which keys bodies that touch leave out their fastest modes, if they have static responses."""
    bodies = dict.fromkeys(body for _, body, _ in scene.touching_faces)
    keys = [f"body.{name}.modes.enrich" for name in bodies if scene.with_its_basis(name).modes.enrich != "none"]
    return f"; {' and '.join(keys)} = 'none' leaves out the fastest modes" if keys else ""


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
        if not all(own.keeps_energy(motion.energies[0]) for own in motion.contacts.values()):
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
