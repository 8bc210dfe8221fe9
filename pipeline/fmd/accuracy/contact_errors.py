"""Errors of contacts' figures, source by source: the step, the mesh, the modes and the near field's grid.

After a contact two motions part whatever their errors, since a vibration's phase decides what comes next. Impulse,
largest force, pressure, times and heat of contacts converge, so that they are compared with those of variants of a run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.accuracy.coarse_mesh import NO_COARSER_MESH
from fmd.accuracy.error_estimates import NO_PART, Quantity, refinement_gain
from fmd.accuracy.time_limit import FAULTS, LeftOutError, TimeLimit
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError, StabilityError
from fmd.core.limits.contact import CHOSEN_STEP, FEWER_POINTS, LARGEST_STEP, LOOSER, MORE_MODES, SHORTER, STEPS_OF_SHOCK
from fmd.core.limits.errors import SAFETY
from fmd.scene.variants import change_modes, coarsen_meshes, compare_element_sizes
from fmd.stages.runs import plan_like

if TYPE_CHECKING:
    from fmd.contact.histories import ContactHistory
    from fmd.core.arrays import Array
    from fmd.scene.scene import Scene
    from fmd.stages.pipeline import Pipeline

    _Variant = tuple[Scene, Callable[[Pipeline], float]]

CONTACT_ERRORS = "contact errors"
_OF_ITSELF = {"energy_error_j": "it is an error itself"}
_HISTORIES: Mapping[str, Callable[[ContactHistory], Array]] = {
    "largest_force_n": lambda own: own.force,
    "largest_pressure_pa": lambda own: own.peak_pressure,
    "largest_area_m2": lambda own: own.area,
}
"""What figures are the largest of: two marches may have the same by chance, and peaks near it tell them apart."""
_HEATS: Mapping[str, Callable[[ContactHistory], Array]] = {
    "friction_work_j": lambda own: own.friction_work,
    "damping_work_j": lambda own: own.damping_work,
}
_WEAR: Mapping[str, Callable[[ContactHistory], Array]] = {
    "wear_volume_m3": lambda own: own.wear_volume,
    "largest_wear_depth_m": lambda own: own.wear_depth,
}
_SUMS: Mapping[str, Callable[[ContactHistory], Array]] = {
    **_HEATS,
    **_WEAR,
    "largest_slip_m": lambda own: own.slip,
    "mean_slip_m": lambda own: own.mean_slip,
}
"""What figures are the end of; there, too, two marches may meet by chance."""
_OTHERS = ("mesh", "modes", "near field")
Differences = Mapping[str, Mapping[str, float | str]]
"""Errors of figures by contact and figure, or why there is none."""


@dataclass(frozen=True)
class ContactError:
    """Errors of a contact's figure in its unit, by source, or in words why one isn't known."""

    value: Any
    parts: Mapping[str, float | str]

    @property
    def total(self) -> float:
        """Stated error: `SAFETY` times the root of the sum of the estimates' squares, as of other results."""
        return SAFETY * math.hypot(*(own for own in self.parts.values() if isinstance(own, float)))

    @property
    def why(self) -> str:
        """Why the error isn't stated: the estimates that are missing; empty if it is."""
        return "; ".join(dict.fromkeys(x for x in self.parts.values() if isinstance(x, str) and x != NO_PART))

    def summary(self) -> dict[str, Any]:
        """Return the errors by source, and what is stated with its interval, or why nothing is."""
        if self.why:
            return {**self.parts, "total": None, "interval": None, "why": self.why}
        value = float(np.linalg.norm(self.value))
        return {**self.parts, "total": self.total, "interval": [max(0.0, value - self.total), value + self.total]}


def contact_errors(run: Pipeline, seconds: float = math.inf) -> Mapping[str, Mapping[str, ContactError]]:
    """Return the errors of the first run's contacts by contact and figure, within a time limit [s]; once found, kept.

    An interval is of a vector's size.
    """
    if CONTACT_ERRORS not in run.results:
        run.results[CONTACT_ERRORS] = _find_errors(run, TimeLimit(seconds))
    found: Mapping[str, Mapping[str, ContactError]] = run.results[CONTACT_ERRORS]
    return found


def _find_errors(run: Pipeline, limit: TimeLimit) -> dict[str, dict[str, ContactError]]:
    sources = {"step": step_differences(run)} | {source: _differences_by(run, source, limit) for source in _OTHERS}
    return {
        name: {
            key: ContactError(value, {source: found[name][key] for source, found in sources.items()})
            for key, value in own.figures.items()
        }
        for name, own in run.motion.contacts.items()
    }


def step_differences(run: Pipeline) -> Differences:
    """Return the errors of the first run's contacts by its step, by contact and figure, or why there is none.

    A march with twice the step differs by 2^p − 1 times the error of ours, of order p, or, where contact doesn't allow
    that, one with half the step by 1 − 2^-p of it. The order is 2, and 1 of the largest values, which the steps just
    meet, with friction, whose slip is counted by steps, with damping, and of wear. Times are known to a step,
    slips to the longest in one, areas to a point, and no heat, wear, impulse or force better than the energy that steps
    make or lose allows. Steps by a tolerance are compared with those by `LOOSER` times it, errors taken to fall as its
    root at least, with looks at contacts twice as far apart, and with a shorter longest step, lest both take that.
    """
    plan = next(iter(run.plans.values()))
    method: Any = plan.integrator
    step, ratio = run.motion.trajectory.step, math.sqrt(LOOSER)
    if method.step:
        longer = 2.0 * method.step <= LARGEST_STEP * min(method.largest_step(plan.system), plan.system.largest_step)
        ratio = 2.0 if longer else 0.5
        other = replace(plan, integrator=replace(method, step=method.step * ratio))
    else:
        step = min(step, method.looks * plan.system.shock_step)  # contacts are looked at as often
        looser = {"tolerance": min(0.5, LOOSER * method.tolerance), "looks": 2.0 * method.looks}
        other = replace(plan, integrator=replace(method, reach=SHORTER * method.reach, **looser))
    try:
        march = other.march(run.output_times)
        if method.step and march.step == step:  # it has been halved where Newton's iteration failed
            ratio, other = 0.5, replace(plan, integrator=replace(method, step=0.5 * step))
            march = other.march(run.output_times)
        histories = run.motion_by(other, march).contacts
    except (StabilityError, AccuracyError) as error:
        return _all(run, f"the march with {'longer' if ratio > 1.0 else 'half the'} steps failed: {error}")
    order = 1.0 if not method.step or any(body.is_lossy for body in plan.mechanism.contacts) else 2.0

    def share(key: str) -> float:
        return float(1.0 / abs(ratio ** (1.0 if key in (*_HISTORIES, *_WEAR) else order) - 1.0))

    times, points = dict.fromkeys(("begin_s", "end_s"), step), _areas_of_points(run)
    found = {}
    for name, own in run.motion.contacts.items():
        fastest = float((np.diff(own.slip) / np.diff(run.motion.times)).max(initial=0.0))
        slips = dict.fromkeys(("largest_slip_m", "mean_slip_m"), fastest * step)
        known_to = times | slips | {"largest_area_m2": points.get(name, 0.0)}
        if not method.step and own.span[0] is not None:
            looks = _between_looks(own, method.looks * plan.system.shock_step, method.tolerance)
            known_to |= {key: size + known_to.get(key, 0.0) for key, size in looks.items()}
        found[name] = _differences(own, histories[name], share, known_to)
        if method.step:  # else the sum of the energy is that of looks
            found[name] |= _at_least(found[name], own, run.motion.energies[0])
    return found


def _between_looks(own: ContactHistory, apart: float, tolerance: float) -> dict[str, float]:
    """Return by how much at least figures are known from looks that are so far apart [s], by steps with a tolerance.

    Of a shock like half a sine the highest look is lower by ``½ (π/2 apart/duration)²``; impulses have the tolerance of
    several steps. As two marches may agree by chance, half of that stands beside their difference.
    """
    begin, end = own.span
    low = min(1.0, 0.25 * (0.5 * math.pi * apart / max((end or 0.0) - (begin or 0.0), apart)) ** 2)
    found = {
        key: low * size for key, size in zip(_HISTORIES, (own.largest[0], own.largest[2], own.largest[1]), strict=True)
    }
    return found | {"impulse_n_s": STEPS_OF_SHOCK * tolerance * float(np.linalg.norm(own.impulse[-1]))}


def _at_least(errors: Mapping[str, float | str], own: ContactHistory, kinetic: Array) -> dict[str, float | str]:
    """Return errors of a contact's figures that are no less than the energy that the steps made or lost tells.

    Heats and wear may miss their part of that energy, however little they are: points that slip in a single step may
    have stuck. Speeds have half of its share of the energy (n_times,), and so have impulses by what is left of it, and
    forces. All that is of one march alone, so that no other can agree with it by chance.
    """
    sums = {key: float(np.abs(of(own)).max()) for key, of in {**_HEATS, **_WEAR}.items()}
    lost = np.abs(own.energy_error)
    heat = sum(sums[key] for key in _HEATS) or math.inf
    sizes = {key: float(lost.max()) / heat * size for key, size in sums.items()}
    half = 0.5 * own.lost_part(kinetic)
    left = half * float(lost[-1] / (lost.max() or 1.0))
    for key, part in {"impulse_n_s": left, "largest_force_n": half, "largest_pressure_pa": half}.items():
        sizes[key] = part * float(np.linalg.norm(own.figures[key] or 0.0))
    return {key: max(error, size) for key, size in sizes.items() if not isinstance(error := errors.get(key, ""), str)}


def _areas_of_points(run: Pipeline) -> dict[str, float]:
    """Return the area of a point of each contact of a flexible face, of which it presses whole ones [m²]."""
    bodies = [body for body in run.motion.mechanism.contacts if not body.points.has_primitives]
    return {name: float(body.points.areas[body.face_of(name)].mean()) for body in bodies for name in body.names}


def _differences_by(run: Pipeline, source: str, limit: TimeLimit) -> Differences:
    """Return the errors by a source, from a variant of the run.

    Mesh and modes of flexible bodies have a part in contacts of rigid ones, too, which they may carry.
    """
    with_part = _gridded(run) if source == "near field" else {*run.motion.contacts} if run.parts else set[str]()
    found = _compare(run, source, limit) if with_part else _all(run, NO_PART)
    return {name: own if name in with_part else dict.fromkeys(own, NO_PART) for name, own in found.items()}


def _compare(run: Pipeline, source: str, limit: TimeLimit) -> Differences:
    other_by, vary = _VARIANTS[source]
    try:
        variant = vary(run)
        if isinstance(variant, str):
            return _all(run, variant)
        limit.require(run.motion.trajectory.seconds)
        scene, gain = variant
        other = run.variant(scene, run.store.monitor)
        if (times := gain(other)) <= 0.0:
            return _all(run, f"not estimated: the {other_by} are as fine")
        plan = plan_like(next(iter(run.plans.values())), other)
        method: Any = plan.integrator
        if method.step:
            longest = min(method.largest_step(plan.system), plan.system.largest_step)
            plan = replace(plan, integrator=replace(method, step=min(method.step, CHOSEN_STEP * longest)))
        histories = other.motion_by(plan, plan.march(run.output_times, limit.watch())).contacts
    except LeftOutError as left:
        return _all(run, str(left))
    except FAULTS as fault:
        return _all(run, f"not estimated: with {other_by}, {fault}")
    return {
        name: _differences(own, histories[name], lambda _: 1.0 / times, {}) for name, own in run.motion.contacts.items()
    }


def _on_coarser_meshes(run: Pipeline) -> _Variant | str:
    scene = coarsen_meshes(run.scene)
    if scene is None:
        return NO_COARSER_MESH

    def gain(other: Pipeline) -> float:
        pairs = [(own, other.parts[name]) for name, own in run.parts.items()]
        ratio = min(compare_element_sizes(own.shape, own.mesh.n_cells, its.mesh.n_cells) for own, its in pairs)
        order = min(own.order for own in run.parts.values())
        return refinement_gain(ratio, order, order, "stress")  # pressure is one, and forces converge no slower

    gridded = _gridded(run)
    return _with_contacts(scene, lambda name: {"near_field": "half-space" if name in gridded else "mesh"}), gain


def _with_more_modes(run: Pipeline) -> _Variant:
    """Return the scene with more modes; what those left out take from an impulse falls as their number grows."""
    more = change_modes(run.scene, lambda body: {"count": math.ceil(MORE_MODES * body.modes.count)})
    return more, lambda _: 1.0 - 1.0 / MORE_MODES


def _on_coarser_grids(run: Pipeline) -> _Variant:
    scene = _with_contacts(run.scene, lambda name: {"points": int(FEWER_POINTS * run.scene.contact[name].points)})
    return scene, lambda _: FEWER_POINTS**-0.5 - 1.0


def _with_contacts(scene: Scene, change: Callable[[str], dict[str, Any]]) -> Scene:
    changed = {name: own.model_copy(update=change(name)) for name, own in scene.contact.items()}
    return scene.model_copy(update={"contact": changed})


def _gridded(run: Pipeline) -> set[str]:
    """Return the contacts whose near field is that of a grid."""
    bodies = run.motion.mechanism.contacts
    return {plane.name for body in bodies for plane in body.planes if plane.face in body.points.grids}


_VARIANTS: Mapping[str, tuple[str, Callable[[Pipeline], _Variant | str]]] = {
    "mesh": ("coarser meshes", _on_coarser_meshes),
    "modes": ("more modes", _with_more_modes),
    "near field": ("coarser grids", _on_coarser_grids),
}
"""Variants of a run by source: what they have, and the scene with how many times of our error it differs from us."""


def _differences(
    own: ContactHistory, other: ContactHistory, share: Callable[[str], float], known_to: Mapping[str, float]
) -> dict[str, float | str]:
    found, theirs = dict[str, float | str](_OF_ITSELF), other.figures
    for key, value in own.figures.items():
        if key in _OF_ITSELF:
            continue
        if value is None or theirs[key] is None:
            found[key] = "nothing touches" if value is None else "in the other march nothing touches"
            continue
        change = float(np.linalg.norm(np.subtract(value, theirs[key])))
        if key in _SUMS:
            change = max(change, 0.5 * float(np.abs(_SUMS[key](own) - _SUMS[key](other)).max()))
        if key in _HISTORIES:
            mine, its = (Quantity(key, "", _HISTORIES[key](at), largest=True) for at in (own, other))
            change = max(change, mine.change(its) * max(mine.scale, its.scale))
        found[key] = share(key) * change + known_to.get(key, 0.0)
    return found


def _all(run: Pipeline, text: str) -> Differences:
    """Return the same text for each figure of each contact."""
    return {name: {**dict.fromkeys(own.figures, text), **_OF_ITSELF} for name, own in run.motion.contacts.items()}
