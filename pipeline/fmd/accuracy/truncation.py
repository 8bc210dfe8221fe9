"""Comparison of a run with one of a richer basis, both marched so that time integration hardly counts."""

from dataclasses import field, replace
from typing import Any

from fmd.accuracy.changed_bodies import keep_lowest
from fmd.accuracy.comparison import Comparison, change_fineness
from fmd.accuracy.details import is_reaction
from fmd.accuracy.quantities import Quantities
from fmd.accuracy.time_limit import LeftOutError
from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError
from fmd.core.limits import errors as limits
from fmd.core.limits.stability import SURELY_STABLE
from fmd.integrators.generalized_alpha import GeneralizedAlpha
from fmd.integrators.runge_kutta import RungeKutta
from fmd.recovery.motion import Motion
from fmd.stages.pipeline import Pipeline
from fmd.stages.plan import Plan
from fmd.stages.runs import plan_like


@dataclass(frozen=True)
class BasisComparison:
    """Quantities of a run and of one with a richer basis, and by how much half of the step has more of a difference."""

    ours: Quantities
    enriched: Quantities
    unresolved: dict[str, float] = field(default_factory=dict)  # relative; of quantities that steps don't follow


def compare_bases(of: Comparison, rich: Pipeline) -> BasisComparison:
    """Compare the quantities of a run with those of a richer basis, both marched with a step that suits both.

    Raises
    ------
    InputError
        The mesh has no more modes than the run's.
    LeftOutError
        No way ends within the time limit.
    """
    return _by_one_method(of, rich, {}) or _compare_lowest(of, rich)


def reactions_of_other_loops(of: Comparison, rich: Pipeline) -> list[str]:
    """Return the reactions where the richer basis moves a loop in directions in which the run's shapes don't.

    Such are motions out of a plane that round-off alone puts into later generations of static responses: what holds
    them is force by round-off.
    """
    if rich.system.compiled.rows == of.run.system.compiled.rows:
        return []
    return [name for name in of.details if is_reaction(name)]


def _by_one_method(of: Comparison, rich: Pipeline, as_if: dict[str, Array]) -> BasisComparison | None:
    if of.beside[0] is not of.plan:
        return None  # it is too slow for variants of the run's own size already
    try:
        plan, base = _comparable(of, rich)
        theirs = of.march(rich, plan)
        ours = of.quantities if base is None else of.quantities_of(of.run, base)
        enriched = of.quantities_of(rich, theirs, as_if=as_if or None)
        resolved = _is_resolved(of, rich, plan, enriched, of.changes(enriched, ours), as_if)
    except (LeftOutError, AccuracyError):  # an explicit method follows static responses for ever, or a step is long
        return None
    return BasisComparison(ours, enriched) if resolved else None


def _compare_lowest(of: Comparison, rich: Pipeline) -> BasisComparison:
    """Compare the same without the stiffest shapes of a large basis, or by implicit steps.

    Several bodies have so many static responses that neither way ends in time. What a shape yields falls with the
    square of its frequency, so that the run's shapes and the lowest ones, as many as the run's and more, tell most.
    """
    tried: list[tuple[Pipeline, dict[str, Array]]] = []
    is_implicit = isinstance(of.beside[0].integrator, GeneralizedAlpha)
    for more in (limits.LOWEST_SHAPES, 0):
        bodies = dict(rich.bodies)
        as_if: dict[str, Array] = {}
        for name, body in rich.bodies.items():
            own = of.run.bodies[name]
            bodies[name], as_if[name] = keep_lowest(body, own.shapes, len(own.omega) + more)
        lowest = sum(len(body.omega) for body in bodies.values())
        if lowest <= limits.LARGE_BASIS * sum(len(body.omega) for body in rich.bodies.values()):
            tried.append((rich.with_bodies(bodies), as_if))
        elif not tried and not is_implicit:
            tried.append((rich, {}))
    tried = tried or [(rich, {})]
    first, as_first = tried[0]
    alike = None if is_implicit or first is rich else _by_one_method(of, first, as_first)
    return alike or _by_implicit_steps(of, tried)


def _by_implicit_steps(of: Comparison, tried: list[tuple[Pipeline, dict[str, Array]]]) -> BasisComparison:
    """Compare the run with the first of some richer bases that marches by generalised-α, with the same steps.

    Steps without a solution, as of a loop that starts at rest with fast static responses, are halved. So are steps of
    both where the difference between the two changes by that, as long as this takes a small part of the time left.
    """
    method: Any = of.beside[0].integrator
    if not isinstance(method, GeneralizedAlpha):
        method = of.implicit_method
    for k in range(limits.MOST_REFINEMENTS * len(tried)):
        rich, as_if = tried[k % len(tried)]
        halved = replace(method, step=method.step / 2 ** (k // len(tried)))
        try:
            found = _by_steps(of, rich, as_if, halved)
        except (LeftOutError, AccuracyError) as fault:
            if k + 1 == limits.MOST_REFINEMENTS * len(tried):
                raise
            if isinstance(fault, LeftOutError) and k % len(tried) + 1 == len(tried):
                raise  # smaller steps take longer
        else:
            break
    while True:
        begun, halved = of.limit.spent, replace(halved, step=halved.step / 2)
        try:
            finer = _by_steps(of, rich, as_if, halved)
            before, after = (of.changes(each.enriched, each.ours) for each in (found, finer))
            found = replace(finer, unresolved={name: max(part - before[name], 0.0) for name, part in after.items()})
            if all(
                abs(part - before[name]) < limits.RESOLVED_PART * max(part, before[name], limits.LEAST_SHOWN)
                for name, part in after.items()
            ):
                return found
            of.limit.require(limits.WORTH_HALVING * (of.limit.spent - begun))
        except (LeftOutError, AccuracyError):
            return found


def _by_steps(of: Comparison, rich: Pipeline, as_if: dict[str, Array], method: GeneralizedAlpha) -> BasisComparison:
    beside, ours = of.beside
    plan = _begin_alike(of, rich, replace(of.plan, integrator=method))
    theirs = of.march(rich, plan_like(plan, rich))
    if of.run.scene.repeats or method != beside.integrator:
        again = of.quantities_of(of.run, of.march(of.run, plan))
        ours = {name: quantity for name, quantity in again.items() if name in ours}
    return BasisComparison(ours, of.quantities_of(rich, theirs, as_if=as_if or None))


def _begin_alike(of: Comparison, rich: Pipeline, plan: Plan) -> Plan:
    """Return the run's plan, where the scene begins on a periodic motion on that which its own steps repeat.

    The richer basis gets such a start, too: a search by a method that follows its vibrations takes far longer.

    Raises
    ------
    LeftOutError
        The search with the richer basis would take longer than the time limit leaves.
    """
    if not of.run.scene.repeats:
        return plan
    from fmd.stages.periodic import find_periodic_start

    plan.compile()
    begun = of.limit.spent
    found = find_periodic_start(of.run.divided_scene, of.run.system, plan.integrator)
    of.limit.require((rich.system.n / of.run.system.n) ** 2 * (of.limit.spent - begun))
    theirs = find_periodic_start(rich.divided_scene, rich.system, plan.integrator)
    rich.results[Pipeline.periodic.name] = theirs
    rich.results.pop(Pipeline.start.name, None)
    return replace(plan, start=(found.q, found.v))


def _is_resolved(
    of: Comparison, rich: Pipeline, plan: Plan, enriched: Quantities, changes: dict[str, float], as_if: dict[str, Array]
) -> bool:
    """Return true if the march of a richer basis has an error in time far below what the basis changes.

    Its fastest vibrations may be a hundred times those that the method's fixed step was chosen for. Where the
    basis changes little, nothing can be far off.
    """
    rows = [name for name in changes if name not in of.details and changes[name] > limits.DOUBTED]
    if not rows or not plan.integrator.step:
        return True
    finer = of.march(rich, replace(plan, integrator=change_fineness(plan, 0.0)[0]))
    again = of.changes(of.quantities_of(rich, finer, as_if=as_if or None), enriched)
    return all(again[name] < limits.RESOLVED_PART * changes[name] for name in rows)


def _comparable(of: Comparison, rich: Pipeline) -> tuple[Plan, Motion | None]:
    """Return a plan for the richer model, and the run's own motion by its step if that is a shorter one.

    Raises
    ------
    LeftOutError
        The march of a method that chooses its steps, or both by the shorter step, would take longer than the time limit
        leaves. It is told before their machine code is made, which may take as long.
    """
    require_start(of, rich)
    method: Any = of.plan.integrator
    limit = SURELY_STABLE * method.largest_step(rich.system)
    if not method.step > limit:
        of.limit.require(_work_of_vibrations(of, rich) * of.run.fine_motion.trajectory.seconds)
        return plan_like(of.plan, rich), None
    size = rich.system.n / of.plan.system.n  # a step takes about its square; the richer march is repeated finer
    work = method.step / limit * (1 + (1 + limits.FINER_WORK) * size**2)
    of.limit.require(work * of.run.fine_motion.trajectory.seconds)
    shorter = replace(of.plan, integrator=replace(method, step=limit))
    return plan_like(shorter, rich), of.march(of.run, shorter)


def require_start(of: Comparison, rich: Pipeline) -> None:
    """Raise ``LeftOutError`` if the search for a richer model's periodic motion would take longer than is left."""
    if of.run.scene.repeats and Pipeline.periodic.name not in rich.results:
        found = of.run.periodic
        periods = found.marches * found.period / float(of.run.output_times[-1])
        of.limit.require(
            periods * _work_of_vibrations(of, rich, limits.DIE_OUT) * of.run.fine_motion.trajectory.seconds
        )


def _work_of_vibrations(of: Comparison, rich: Pipeline, followed: float = limits.FOLLOWED) -> float:
    """Return the work of a method on a richer basis over the run's own: of Runge-Kutta's where steps follow vibrations.

    Of generalised-α tangents take the most, which are renewed each few steps.
    """
    if isinstance(of.plan.integrator, GeneralizedAlpha):
        return float((rich.system.n / of.plan.system.n) ** 3)
    if not isinstance(of.plan.integrator, RungeKutta):
        return 1.0
    steps = rich.system.highest_frequency * float(of.run.output_times[-1]) / followed
    more = limits.EVALUATIONS_A_STEP * steps / of.run.fine_motion.trajectory.evaluations
    return max(more, 1.0) * (rich.system.n / of.plan.system.n) ** 2
