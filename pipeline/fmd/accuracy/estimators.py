"""Estimates of the errors of a run's results, from variants that differ from it in one source of error each.

Time integration is measured by another step or tolerance, modal truncation by a basis with four generations of
load-dependent vectors, discretisation by recovered stress and by a mesh of half as many elements each way, stress
recovery by patches of elements. Where a motion rings, an error of its frequencies adds up over time and can't be
extrapolated from two motions; so the frequencies are, and the motion is computed with them.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from fmd.accuracy.changed_bodies import soften_body
from fmd.accuracy.coarse_mesh import Pair, make_coarse_pair, make_pair_across
from fmd.accuracy.comparison import Comparison, change_fineness
from fmd.accuracy.corner_stress import CornerStress, find_corner_stress
from fmd.accuracy.error_estimates import NO_PART, NO_VIBRATION, OTHER_LOOPS, Quantity, shifted_frequencies
from fmd.accuracy.mesh_excess import find_excess
from fmd.accuracy.model_errors import ModelErrors
from fmd.accuracy.quantities import find_counterparts, mesh_quantities
from fmd.accuracy.time_limit import FAULTS, LeftOutError, TimeLimit
from fmd.accuracy.truncation import compare_bases, reactions_of_other_loops
from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError, InputError
from fmd.core.limits import errors as limits
from fmd.integrators.march_pairs import motion_difference
from fmd.recovery.stress import excess_in_middle, von_mises
from fmd.scene.variants import change_modes, divide_few_elements, enrich_bases, halve_elements
from fmd.stages.part import FlexiblePart
from fmd.stages.pipeline import Pipeline

# Multiples of the extrapolated change of frequencies; the first, SAFETY, matters most.
_SHIFTS = (limits.SAFETY, 1.0, 0.5, 1.5)


class Estimates(Comparison):
    """Relative errors of a run's quantities by source; each method compares the run with one variant."""

    def __init__(self, run: Pipeline, limit: TimeLimit | None = None) -> None:
        super().__init__(run, limit or TimeLimit())
        self.left_out: list[str] = []
        self.of_integration: float | None = None  # stated error of the coordinates, by the measure of ``auto``
        self.mesh_left_out = ""  # why another mesh that gives a part of the mesh's error was left out
        self.model = ModelErrors(self)
        self.corners: list[CornerStress] = []
        self._excess: dict[str, Array] = {}  # of each body's stiffness
        self._shifts: dict[str, float] = {}  # changes of the motion by shifted frequencies
        self._across: Pair | None = None  # the run and its scene with more elements from side to side
        self._shapes: dict[str, float] = {}  # errors by shapes of the mesh
        self._no_shapes: dict[str, float | str] = {}  # why there are none, of each quantity of the motion
        self._by_recovery: set[str] = set()  # stresses whose recovery another mesh tells nothing of

    def by_source(self) -> dict[str, dict[str, float | str]]:
        """Return the relative errors of the quantities by source, or the reason why there is no estimate.

        What is cheap and says most comes first, for a time limit may end the row.
        """
        found: dict[str, dict[str, float | str]] = {}
        if self.run.parts:
            found["recovery"] = self._recovery()
            self.pair, self._across = self._coarse_pair(), self._pair_across()
            self._within_limit("stress at edges", self._corner_stress)
        found["time"] = self._within_limit("time", self._time)
        if not self.run.parts:
            return found
        found["discretisation"] = self._discretisation(found["recovery"])
        of_frequencies = self._interface_modes()
        found["truncation"] = self._within_limit("truncation", self._truncation) | of_frequencies
        with self.run.store.monitor("error budget: model"):
            self.model.estimate_left_out()
        self.left_out += self.model.left_out
        self._within_limit("discretisation, more shifts of frequencies", self._march_shifts)
        both = {name: math.hypot(shift, self._shapes.get(name, 0.0)) for name, shift in self._shifts.items()}
        found["discretisation"] |= both | self._no_shapes
        self._add_damped(found)
        return found | {"model": self.model.of_quantities}

    def _add_damped(self, found: dict[str, dict[str, float | str]]) -> None:
        """Count what the variants' steps damp of a quantity; where that is a large part, no error is stated.

        Its phase may be lost: half of it counts, so that `SAFETY` times that is stated.
        """
        errors = found["discretisation"]
        left = [name for name, part in self.damped.items() if not part < limits.MOST_OF_METHOD]
        if left:
            self.left_out.append(f"{len(left)} quantities that vibrate fast: {self.too_fast}")
        for name, part in self.damped.items():
            before = errors.get(name, NO_PART)
            if name in left:
                errors[name] = self.too_fast
            elif isinstance(before, float):
                errors[name] = math.hypot(before, 0.5 * part)

    def _within_limit(self, source: str, estimate: Callable[[], dict[str, float | str]]) -> dict[str, float | str]:
        """Return a source's estimates; if the time limit or a march leaves them out, the reason for each quantity."""
        try:
            with self.run.store.monitor(f"error budget: {source}"), self.limit.ends_searches():
                return estimate()
        except LeftOutError as left_out:
            why = str(left_out)
        except FAULTS as fault:  # of a variant: the run itself has its results
            why = f"not estimated: {fault}"
        self.left_out.append(f"{source}: {why}")
        return dict.fromkeys(self.of_motion, why)

    def _corner_stress(self) -> dict[str, float | str]:
        if isinstance(self.pair, Pair):
            self.require_modes(limits.COARSE_SHARE)
            self.corners = find_corner_stress(self.pair)
        return {}

    def _time(self) -> dict[str, float | str]:
        plan, gain = self.plan, 0.0
        for _ in range(limits.MOST_REFINEMENTS):
            integrator, gain = change_fineness(plan, self.motion.trajectory.seconds)
            try:
                other = self.march(self.run, replace(plan, integrator=integrator))
            except AccuracyError:
                if not integrator.step > plan.integrator.step:
                    raise
                integrator, gain = change_fineness(plan, 0.0)  # a longer step has no solution
                other = self.march(self.run, replace(plan, integrator=integrator))
            plan = replace(plan, integrator=integrator)
            at_outputs = self.at_outputs(other.trajectory)
            if not np.array_equal(at_outputs.q, self.motion.trajectory.q):
                break  # else a method that chooses its step had met the finer tolerance already, and took the same one
        theirs = self.quantities_of(self.run, other, self.hot)
        own = self.motion.trajectory
        self.of_integration = limits.SAFETY * motion_difference(self.plan.system, own.q, own.v, at_outputs) / gain
        # Two tolerances may take the same steps as far as a slow body is concerned, whose error then doesn't change.
        least = limits.OF_TOLERANCE * getattr(self.plan.integrator, "tolerance", 0.0)
        coarser = plan.integrator.step > self.plan.integrator.step
        self.correct_by(theirs, 1 / (1 - 2.0 ** plan.integrator.order(plan.system)) if coarser else 1 / gain)
        changes = self.changes(theirs).items()
        return {name: max(error / gain, least) if error else 0.0 for name, error in changes}

    def _interface_modes(self) -> dict[str, float | str]:
        interface = [name for name, whole in self.run.wholes.items() if whole.shape.modes.boundary == "interface"]
        names = [name for name in interface if name in self.run.parts]  # a body in pieces is none of them
        if not names:
            return {}
        rows = [row for row in self.of_mesh if row.startswith(tuple(f"{name}, frequency" for name in names))]
        most = math.ceil(limits.MORE_COARSE_MODES * max(len(self.run.parts[name].modes.omega) for name in names))
        free = {"boundary": "free", "interface": (), "enrich": "none", "count": most}
        scene = change_modes(self.run.scene, lambda body: free if body.modes.boundary == "interface" else {})
        others, found = self.run.variant(scene).parts, dict[str, float | str]()
        try:
            self.require_modes(1.0)
            modes = {name: others[name].modes for name in names}
        except (LeftOutError, *FAULTS) as why:
            self.left_out.append(f"truncation of frequencies: {why}")
            return dict.fromkeys(rows, f"not estimated: {f'{why}'.removeprefix('not estimated: ')}")
        for name in names:
            own, theirs, m = self.run.parts[name], modes[name], others[name].fe.m
            numbers, alike = find_counterparts(own.fe.x, own.modes.shapes, own.fe.x, m, theirs.shapes, theirs.omega)
            for k, hertz in enumerate(theirs.frequencies_hz[numbers]):
                row, value = f"{name}, frequency {k + 1}", own.modes.frequencies_hz[k]
                found[row] = NO_VIBRATION
                if alike[k] > limits.ALIKE_MODES:
                    found[row] = abs(float(value / hertz - 1))
                    self.correct(row, float(hertz - value))
        return found

    def _truncation(self) -> dict[str, float | str]:
        self.require_modes(1.0)
        rich = self.run.variant(
            enrich_bases(self.run.scene), stiffening_loads=self.run.stiffening_loads
        )  # what is stiffened stays so
        try:
            found = compare_bases(self, rich)
        except InputError as fault:  # the mesh has no more modes than the run's
            return dict.fromkeys(self.quantities, f"not estimated: with more modes, {fault}")
        unknown = reactions_of_other_loops(self, rich)
        enriched = {name: quantity for name, quantity in found.enriched.items() if name not in unknown}
        self.correct_by(enriched, 1.0, found.ours)
        changes = self.changes(enriched, found.ours)
        errors = {name: change + found.unresolved.get(name, 0.0) for name, change in changes.items()}
        return errors | dict.fromkeys(unknown, OTHER_LOOPS)

    def _discretisation(self, recovery: dict[str, float | str]) -> dict[str, float | str]:
        pair = self.pair
        errors: dict[str, float | str] = dict.fromkeys(self.quantities, pair if isinstance(pair, str) else NO_PART)
        for name in self.run.parts:
            of_modes, self._excess[name] = find_excess(self.run.parts[name], self.run.bodies[name], pair, self._across)
            for k, share in enumerate(1 - shifted_frequencies(np.ones(len(of_modes)), of_modes, 1.0)):
                errors[f"{name}, frequency {k + 1}"] = abs(float(share))
                self.correct(f"{name}, frequency {k + 1}", -float(share) * self.run.parts[name].modes.frequencies_hz[k])
        errors |= self._within_limit("discretisation", lambda: self._march_shift(self._excess, _SHIFTS[0]))
        if self._across is not None:
            shapes = partial(self._otherwise_across, self._across)
            self._no_shapes |= self._within_limit("discretisation, shapes across", shapes)
        if isinstance(pair, str):  # the shape of a mesh that is given is that of its elements
            given = (name for name, part in self.run.parts.items() if not part.shape.resized(0.5))
            return errors | {f"{name}, mass": NO_PART for name in given} | self._masses()
        masses, known = mesh_quantities(pair.coarse), self._masses()
        for name, quantity in self.of_mesh.items():
            if quantity.kind == "geometry" and name not in known:
                errors[name] = quantity.change(masses[name]) / abs(pair.gains["geometry"])
                self.correct(name, (quantity.scale - masses[name].scale) / pair.gains["geometry"])
        self._no_shapes |= self._within_limit("discretisation, shapes", lambda: self._otherwise_coarse(pair, recovery))
        return errors | known

    def _masses(self) -> dict[str, float | str]:
        """Errors of masses of which the geometry tells the volume: larger elements may be as coarse around a bore."""
        found = dict[str, float | str]()
        for name, part in self.run.parts.items():
            whole = getattr(part.mesh, "geometry_volume", 0.0)
            if whole:
                share, row = whole / part.mesh.volume - 1, f"{name}, mass"
                found[row] = abs(share)
                self.correct(row, share * self.of_mesh[row].scale)
        return found

    def _coarse_pair(self) -> Pair | str:
        try:
            self.require_modes(limits.QUARTERED_SHARE if halve_elements(self.run.scene) else limits.COARSE_SHARE)
        except LeftOutError as why:
            self._leave_out_mesh("another mesh", why)
            return str(why)
        with self.run.store.monitor("error budget: another mesh"):
            return make_coarse_pair(self.run)

    def _pair_across(self) -> Pair | None:
        if divide_few_elements(self.run.scene) is None:
            return None
        try:
            halved = any(part.mesh.cell_type.startswith("tetra") for part in self.run.parts.values())
            self.require_modes(limits.HALVED_SHARE if halved else limits.ACROSS_SHARE)
            return make_pair_across(self.run)
        except (LeftOutError, *FAULTS) as why:
            self._leave_out_mesh("few elements from side to side", why)
            return None

    def _leave_out_mesh(self, what: str, why: Exception) -> None:
        self.left_out.append(f"discretisation, {what}: {why}")
        self.mesh_left_out = f"{why}" if isinstance(why, LeftOutError) else f"not estimated: {why}"

    def _march_shifts(self) -> dict[str, float | str]:
        for shift in _SHIFTS[1:]:
            self._march_shift(self._excess, shift)
        return {}

    def _march_shift(self, excess: dict[str, Array], shift: float) -> dict[str, float | str]:
        """Return the change of the motion where the bodies' eigenvalues lose a multiple of their excess.

        Over time a shift turns phases, so that twice of it need not change the motion twice as much: the largest change
        on the way up to `SAFETY` counts.
        """
        bodies = {name: soften_body(body, shift * excess[name]) for name, body in self.run.bodies.items()}
        moved = self.run.with_bodies({name: body for name, (body, _) in bodies.items()})
        forces = {name: as_if for name, (_, as_if) in bodies.items()}
        ours = self.beside[1]
        theirs = self.quantities_of(moved, self.march_beside(moved), self.hot, as_if=forces)
        if shift == _SHIFTS[0]:
            self.correct_by(theirs, 1 / limits.SAFETY, ours)
        for name, quantity in theirs.items():
            if name not in ours:
                continue
            change = ours[name].error(quantity) / limits.SAFETY
            self._shifts[name] = max(self._shifts.get(name, 0.0), change)
        return dict(self._shifts)

    def _otherwise_across(self, pair: Pair) -> dict[str, float | str]:
        """Estimate what else changes with more elements from side to side: shapes without a match, and their inertia.

        Of stress the coarser mesh and its recovery tell.
        """
        for name, error in self._changes_of_softened(pair).items():
            if (kind := self.quantities[name].kind) == "displacement":
                self._shapes[name] = error / abs(pair.gains[kind])
        return {}

    def _changes_of_softened(self, pair: Pair) -> dict[str, float]:
        """Return the changes from the run, softened to another mesh's frequencies, to that mesh.

        Modal masses of a mesh that rings slower can't be changed to the run's frequencies: its modes move nearly the
        whole mass of a body, and would move more than that.
        """
        theirs, softened = pair.coarse, {name: pair.soften(name) for name in self.run.bodies}
        moved = self.run.with_bodies({name: body for name, (body, _) in softened.items()})
        forces = {name: as_if for name, (_, as_if) in softened.items()}
        ours = self.quantities_of(moved, self.march_beside(moved), as_if=forces)
        return self.changes(self.quantities_of(theirs, self.march_beside(theirs), places=self._places), ours)

    def _otherwise_coarse(self, pair: Pair, recovery: dict[str, float | str]) -> dict[str, float | str]:
        """Estimate what else changes on a coarser mesh that rings at the run's frequencies, the shapes' part.

        The difference between the stress of two meshes holds the error of its recovery; that is not counted twice.
        """
        for name, error in self._changes_by_shapes(pair).items():
            shape = error / abs(pair.gains[self.quantities[name].kind])
            if isinstance(again := recovery.get(name), float):
                if name not in self._by_recovery:
                    recovery[name] = again = min(again, limits.MOST_OF_CHANGE * shape)
                shape = max(shape - again, 0.0)
            self._shapes[name] = math.hypot(self._shapes.get(name, 0.0), shape)
        return {}

    def _changes_by_shapes(self, pair: Pair) -> dict[str, float]:
        ringing, stressed = pair.at_the_same_frequencies()
        try:
            motion = self.march_beside(ringing)
        except AccuracyError:  # free modes that a marker holds may ring slower on larger elements, too
            return self._changes_of_softened(pair)
        return self.changes(self.quantities_of(ringing, motion, places=self._places, as_if=stressed), self.beside[1])

    @property
    def _places(self) -> dict[str, Array]:
        return {name: part.element_places for name, part in self.run.parts.items() if part.elements}

    def _recovery(self) -> dict[str, float | str]:
        """Estimate the error of stress recovery by a patch of elements at the worst node.

        Next to a rigid face the elements on it have too much stress and a fit to all of them too little: half of their
        difference counts, and at least how far an element's own stress there is from the average. A coarser mesh tells
        nothing, for its largest stress is elsewhere: beside its own, larger elements on the face.
        """
        from fmd.recovery.patch_stress import element_stresses, patch_stress

        errors: dict[str, float | str] = {}
        for name, part in self.run.parts.items():
            if not part.has_stress:
                continue
            time, place, worst = self.run.stress_of(name).worst()
            if not worst:  # nothing moved
                continue
            k = int(np.abs(self.motion.times - time).argmin())
            q, node = self.motion.modal(name)[k], int(part.surface.nodes[place])
            field = (part.body.shapes @ q)[:, :, None]
            again = float(von_mises(patch_stress(part.space, part.material, field, node).T)[0])
            apart = abs(again - worst)
            if _is_next_to_rigid_face(part, node):
                each = von_mises(element_stresses(part.space, part.material, field, node)[:, :, 0])
                apart = max(apart / 2, float(np.abs(each - worst).max()))
                self._by_recovery.add(f"{name}, largest von Mises stress")
            errors[f"{name}, largest von Mises stress"] = apart / worst
            errors |= self._recovery_in_elements(part)
        return errors

    def _recovery_in_elements(self, part: FlexiblePart) -> dict[str, float | str]:
        """Estimate how far stress in the middle of quadratic elements is from that of a curve through those in its row.

        A coarser mesh tells little of it, since the same place isn't in the middle of its elements.
        """
        errors: dict[str, float | str] = {}
        if not part.elements or part.space.order == 1:
            return errors
        q = self.motion.modal(part.name)
        for (element, number), own in zip(part.elements.items(), part.element_stress, strict=True):
            beyond = excess_in_middle(part.space, part.material, part.body.shapes, number)
            if not beyond.any():
                continue
            label = f"{part.name}.{element}, von Mises stress"
            for name, largest in ((label, False), (f"{label}, largest", True)):
                stress, better = (
                    Quantity(name, "Pa", von_mises((each @ q.T)[None])[0], largest) for each in (own, own - beyond)
                )
                errors[name] = stress.change(better)
                self.correct(name, better.scale - stress.scale)
                self._by_recovery.add(name)
        return errors


def _is_next_to_rigid_face(part: FlexiblePart, node: int) -> bool:
    rigid = [marker.nodes for marker in part.markers.values() if marker.rigid]
    if not rigid or any(node in nodes for nodes in rigid):
        return False
    each = (own.first + own.space.element_nodes for own in part.space.members)
    return any(np.isin(nodes[(nodes == node).any(axis=1)], np.concatenate(rigid)).any() for nodes in each)
