"""Estimates of the errors of a run's results, from variants that differ from it in one source of error each.

Time integration is measured by another step or tolerance, modal truncation by a basis with four generations of
load-dependent vectors, discretisation by recovered stress and by a mesh of half as many elements each way, stress
recovery by patches of elements. Where a motion rings, an error of its frequencies adds up over time and can't be
extrapolated from two motions; so the frequencies are, and the motion is computed with them.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.accuracy.coarse_mesh import Pair, make_coarse_pair
from pipeline.accuracy.error_estimates import NO_PART, SAFETY, shifted_frequencies, soften_body
from pipeline.accuracy.quantities import Quantities, mesh_quantities, motion_quantities, stress_quantities
from pipeline.core.arrays import Array, IntArray
from pipeline.core.errors import InputError
from pipeline.integrators.automatic import Automatic
from pipeline.recovery.stress import choose_frames, von_mises
from pipeline.scene.variants import enrich_bases
from pipeline.stages.runs import STABLE, plan_like

if TYPE_CHECKING:
    from pipeline.integrators.protocol import Integrator
    from pipeline.recovery.motion import Motion
    from pipeline.reduction.body import FlexibleBody
    from pipeline.stages.part import FlexiblePart
    from pipeline.stages.pipeline import Pipeline
    from pipeline.stages.runs import Plan

_SHORT = 0.5  # seconds of a march that may be taken again with half of its step
_FRAMES = 60  # at which stress is compared
_HOTTEST = 20  # of them around the largest stress
_HOT = 0.5  # of the largest stress: what other nodes have doesn't matter
_SHIFTS = (0.5, 1.0, 1.5, 2.0)  # of the extrapolated change of frequencies; the last is SAFETY
_FINER = 0.1
# Recovered stress overstates the error of static responses to forces on a face, where stress jumps, 25 times on the
# beam, and patches of elements that at edges: both count up to this many times of what the coarse mesh tells.
_MOST_OF_CHANGE = 3.0


class Estimates:
    """Relative errors of a run's quantities by source; each method compares the run with one variant."""

    def __init__(self, run: Pipeline) -> None:
        self.run = run
        self.plan = next(iter(run.plans.values()))
        self.motion = run.motion
        self.frames: IntArray = np.arange(0)
        self.of_mesh = mesh_quantities(run)
        self.quantities = self.of_mesh | motion_quantities(run, self.motion, run.fine_motion)
        self.hot: dict[str, IntArray] = {}
        if run.parts:
            self._choose_stress_samples()
            self.quantities |= stress_quantities(run, self.motion, self.frames)

    def by_source(self) -> dict[str, dict[str, float | str]]:
        """Return the relative errors of the quantities by source, or the reason why there is no estimate."""
        if not self.run.parts:
            return {"time": self._time()}
        recovery = self._recovery()
        discretisation = self._discretisation(recovery)
        return {
            "discretisation": discretisation,
            "truncation": self._truncation(),
            "time": self._time(),
            "recovery": recovery,
        }

    # The sources ------------------------------------------------------------------------------------------------

    def _time(self) -> dict[str, float | str]:
        """Estimate the error of time integration by another step or a finer tolerance."""
        integrator, gain = _change_fineness(self.plan, self.motion.trajectory.seconds)
        other = self._march(self.run, replace(self.plan, integrator=integrator))
        return {name: error / gain for name, error in self._changes(self._of(self.run, other, self.hot)).items()}

    def _truncation(self) -> dict[str, float | str]:
        """Estimate modal truncation by a richer basis, both marched with a step that is stable for the richer one."""
        rich = self.run.variant(enrich_bases(self.run.scene), spin=self.run.spin)  # what is stiffened stays so
        try:
            plan, base = self._comparable(rich)
        except InputError as fault:  # the mesh has no more modes than the run's
            return dict.fromkeys(self.quantities, f"not estimated: with more modes, {fault}")
        ours = self.quantities if base is None else self._of(self.run, base)
        return dict(self._changes(self._of(rich, self._march(rich, plan)), ours))

    def _discretisation(self, recovery: dict[str, float | str]) -> dict[str, float | str]:
        """Estimate the mesh's error: the shift of the frequencies, and everything else that a coarser mesh changes.

        The difference between the stress of two meshes holds the error of its recovery; that is not counted twice.
        """
        pair = make_coarse_pair(self.run)
        errors: dict[str, float | str] = dict.fromkeys(self.quantities, pair if isinstance(pair, str) else NO_PART)
        excess: dict[str, Array] = {}
        for name, part in self.run.parts.items():
            body = self.run.bodies[name]
            of_modes, excess[name] = _energy_excess(part, body)
            if isinstance(pair, Pair):
                of_modes = _root_mean_square(of_modes, pair.excess_of_modes(name))
                changed, alike = pair.excess_of_shapes(name)
                recovered = np.diag(excess[name])
                static = body.omega > part.modes.omega.max()
                most = np.where(static, _MOST_OF_CHANGE * np.abs(changed), np.inf)
                wanted = np.where(alike, _root_mean_square(np.minimum(recovered, most), changed), recovered)
                excess[name] = _with_diagonal(excess[name], wanted)
            for k, share in enumerate(1 - shifted_frequencies(np.ones(len(of_modes)), of_modes, 1.0)):
                errors[f"{name}, frequency {k + 1}"] = abs(float(share))
        shifted = self._shifted(excess)
        errors |= shifted
        if isinstance(pair, str):
            return errors
        masses = mesh_quantities(pair.coarse)
        for name, quantity in self.of_mesh.items():
            if quantity.kind == "geometry":
                errors[name] = quantity.change(masses[name]) / pair.gains["geometry"]
        for name, error in self._otherwise_coarse(pair).items():
            shape = error / pair.gains[self.quantities[name].kind]
            if isinstance(again := recovery.get(name), float):
                recovery[name] = again = min(again, _MOST_OF_CHANGE * shape)
                shape = max(shape - again, 0.0)
            errors[name] = math.hypot(shifted[name], shape)
        return errors

    def _shifted(self, excess: dict[str, Array]) -> dict[str, float]:
        """Return the change of the motion where the bodies' eigenvalues lose up to `SAFETY` times their excess.

        Over time a shift turns phases, so that twice of it need not change the motion twice as much: the largest change
        on the way counts.
        """
        largest = {name: 0.0 for name in self.quantities if name not in self.of_mesh}
        for shift in _SHIFTS:
            bodies = {name: soften_body(body, shift * excess[name]) for name, body in self.run.bodies.items()}
            moved = self.run.with_bodies({name: body for name, (body, _) in bodies.items()})
            forces = {name: as_if for name, (_, as_if) in bodies.items()}
            theirs = self._of(moved, self._march(moved, plan_like(self.plan, moved)), self.hot, as_if=forces)
            for name, quantity in theirs.items():
                largest[name] = max(largest[name], self.quantities[name].error(quantity) / SAFETY)
        return largest

    def _otherwise_coarse(self, pair: Pair) -> dict[str, float]:
        """Return the change of the motion on a coarser mesh that rings at the run's frequencies."""
        ringing, stressed = pair.at_the_same_frequencies()
        places = {name: part.element_places for name, part in self.run.parts.items() if part.elements}
        motion = self._march(ringing, plan_like(self.plan, ringing))
        return self._changes(self._of(ringing, motion, places=places, as_if=stressed))

    def _recovery(self) -> dict[str, float | str]:
        """Estimate the error of stress recovery by a patch of elements at the worst node."""
        from pipeline.recovery.patch_stress import patch_stress

        errors: dict[str, float | str] = {}
        for name, part in self.run.parts.items():
            time, place, worst = self.run.stress_of(name).worst()
            if not worst:  # nothing moved
                continue
            k = int(np.abs(self.motion.times - time).argmin())
            q, node = self.motion.modal(name)[k], int(part.surface.nodes[place])
            field = (part.body.shapes @ q)[:, :, None]
            again = float(von_mises(patch_stress(part.space, part.material, field, node).T)[0])
            errors[f"{name}, largest von Mises stress"] = abs(again - worst) / worst
        return errors

    # How they are computed --------------------------------------------------------------------------------------

    def _changes(self, theirs: Quantities, ours: Quantities | None = None) -> dict[str, float]:
        """Return the difference of each quantity of the motion from a variant's."""
        ours = ours or self.quantities
        return {name: ours[name].change(quantity) for name, quantity in theirs.items()}

    def _of(
        self,
        run: Pipeline,
        fine: Motion,
        nodes: dict[str, IntArray] | None = None,
        places: dict[str, Array] | None = None,
        as_if: dict[str, Array] | None = None,
    ) -> Quantities:
        """Return the quantities of a motion at the run's fine times; stress only at the chosen output times."""
        given, chosen = fine.trajectory, self.run.fine_times[1]
        motion = replace(
            fine, trajectory=replace(given, times=given.times[chosen], q=given.q[chosen], v=given.v[chosen])
        )
        quantities = motion_quantities(run, motion, fine)
        if run.parts:
            quantities |= stress_quantities(run, motion, self.frames, nodes, places, as_if)
        return quantities

    def _choose_stress_samples(self) -> None:
        """Choose the output times at which stress is compared, and the nodes that matter."""
        frames = [choose_frames(len(self.motion.times), _FRAMES)]
        for name in self.run.parts:
            values = self.run.stress_of(name).measure_at(np.arange(len(self.motion.times)))
            frames.append(np.argsort(values.max(axis=1))[-_HOTTEST:])
            self.hot[name] = np.flatnonzero(values.max(axis=0) >= _HOT * values.max())
        self.frames = np.unique(np.concatenate(frames))

    def _march(self, other: Pipeline, plan: Plan) -> Motion:
        return other.motion_by(plan, plan.march(self.run.fine_times[0]))

    def _comparable(self, rich: Pipeline) -> tuple[Plan, Motion | None]:
        """Return a plan for the richer model, and the run's own motion by its step if that is a shorter one."""
        method: Any = self.plan.integrator
        limit = STABLE * method.largest_step(rich.system)
        if not method.step > limit:
            return plan_like(self.plan, rich), None
        shorter = replace(self.plan, integrator=replace(method, step=limit))
        return plan_like(shorter, rich), self._march(self.run, shorter)


def _energy_excess(part: FlexiblePart, body: FlexibleBody) -> tuple[Array, Array]:
    """Return the excess of a part's squared mode frequencies and of its body's eigenvalues by recovered stress."""
    from pipeline.recovery.energy_error import energy_errors

    errors = energy_errors(part.space, part.material, body.shapes)
    # The modes are combinations of the body's shapes and rigid motions.
    flat, modes = body.shapes.reshape(part.fe.K.shape[0], -1), part.modes
    weights = (flat.T @ (part.fe.K @ modes.shapes.reshape(len(flat), -1))) / body.omega[:, None] ** 2
    of_modes = np.einsum("jk,jl,lk->k", weights, errors, weights) / modes.omega**2
    return np.asarray(of_modes), np.asarray(errors / np.outer(body.omega, body.omega))


def _with_diagonal(excess: Array, wanted: Array) -> Array:
    """Scale products of shapes to another diagonal; entries that aren't positive there stand alone."""
    scale = np.sqrt(np.maximum(wanted, 0.0) / np.diag(excess))
    scaled = excess * np.outer(scale, scale)
    np.fill_diagonal(scaled, wanted)
    return np.asarray(scaled)


def _root_mean_square(recovered: Array, changed: Array) -> Array:
    """Return the root mean square of the estimates by recovered stress and by a coarser mesh, signed as the larger.

    Neither is a bound: recovered stress states too much where stress jumps, a coarser mesh too little where corners
    slow convergence, or where it has as few elements as the run's.
    """
    larger = np.where(np.abs(recovered) > np.abs(changed), recovered, changed)
    return np.asarray(np.copysign(np.sqrt((recovered**2 + changed**2) / 2), larger))


def _change_fineness(plan: Plan, seconds: float) -> tuple[Integrator, float]:
    """Return the method with another step or tolerance, and the difference of the results over the plan's error."""
    method: Any = plan.integrator
    if isinstance(method, Automatic):
        return replace(method, error=_FINER * method.error), 1 - _FINER
    if not method.step:
        return replace(method, tolerance=max(_FINER * method.tolerance, 3e-14)), 1 - _FINER
    order = method.order(plan.system)
    if seconds < _SHORT or not 8 * method.step < method.largest_step(plan.system):
        return replace(method, step=method.step / 2), 1 - 0.5**order
    return replace(method, step=2 * method.step), 2.0**order - 1
