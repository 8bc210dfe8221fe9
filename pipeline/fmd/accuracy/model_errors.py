"""Errors of a run's model: what it leaves out, each estimated by a run that has it.

Large deflection, whose squares are left out; stretching; geometric stiffening, where it is off; the attachment of a
clamped root, averaged or rigid; sections of layers that stay plane. Damping that a scene doesn't give is reported
beside them, and isn't counted: the scene's own.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fmd.accuracy.changed_bodies import soften_body
from fmd.accuracy.coarse_mesh import Pair
from fmd.accuracy.deflection import (
    TEXT,
    deflection_errors,
    error_in_frame,
    excess_deflection,
    is_of_second_order,
    stiffening_by_stretch,
    stretching_bodies,
)
from fmd.accuracy.quantities import find_counterparts
from fmd.accuracy.time_limit import FAULTS, LeftOutError
from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits import errors as limits
from fmd.scene.variants import attach_roots_rigidly, damp_bodies
from fmd.stages.division import part_of
from fmd.stages.pipeline import Pipeline

if TYPE_CHECKING:
    from fmd.accuracy.comparison import Comparison

_SUMS_OVER_MASSES = ("centre_of_mass", "momentum", "angular_momentum")


@dataclass(frozen=True)
class ModelError:
    """Error of a run's results by one thing that its model leaves out."""

    # ``large deflection``, ``shifted vibrations``, ``stiffening left off``, ``stretching``, ``attachment``, ``plane
    # sections`` or ``no damping``.
    cause: str
    error: float  # largest relative error of any quantity of the motion
    quantity: str  # the quantity; empty if there is no estimate
    text: str  # what is left out, and what would take it in
    counted: bool = True  # part of the stated errors


class ModelErrors:
    """Errors of a run's model, quantity by quantity, gathered cause by cause."""

    def __init__(self, comparison: Comparison) -> None:
        self._comparison, self._run = comparison, comparison.run
        self.of_quantities: dict[str, float | str] = {}
        self.causes: list[ModelError] = []
        self.left_out: list[str] = []  # causes that weren't estimated, with the reason
        self.missing: dict[str, str] = {}  # the reason for each quantity whose error one of these counts in
        self._by_shift: dict[str, float] = {}

    @property
    def _causes_of_marches(self) -> tuple[tuple[str, Callable[[], dict[str, float] | None], str], ...]:
        """Names, estimates and texts of the causes that take a march each."""
        return (
            (
                "stiffening left off",
                self._stiffening,
                "geometric stiffening is off; simulation.stiffening = 'on' takes it in",
            ),
            (
                "shifted vibrations",
                self._shifted_vibrations,
                "vibrations of large deflection ring at other frequencies; pieces take this in",
            ),
            (
                "large deflection",
                self._large_deflection,
                "deformation is linear within a body's frame; more pieces of a body take more of it in",
            ),
            ("stretching", self._stretching, TEXT),
            (
                "attachment",
                self._attachment,
                "a clamped root is fixed on average; attachment = 'rigid' of its marker fixes every point of it",
            ),
            (
                "plane sections",
                self._plane_sections,
                "sections of layers stay plane; solid elements in each ply take their warping in",
            ),
            (
                "no damping",
                self._damping,
                f"a body has no damping, and its vibrations never die; with {100 * limits.BARE_METAL:g} % of critical, "
                "as of bare metal, results would change so much; modes.damping of the body takes it in",
            ),
        )

    def estimate_left_out(self) -> None:
        """Estimate large deflection, and the causes that take a march each.

        These are shifted vibrations, stiffening, attachment and damping.
        """
        for cause, estimate, text in self._causes_of_marches:
            counted = cause != "no damping"  # a scene may mean it so
            try:
                with self._comparison.limit.ends_searches():
                    errors = estimate()
            except LeftOutError as why:
                self.left_out.append(f"{cause}: {why}")
                missing = str(why)
            except FAULTS as why:  # no time would help
                missing = f"not estimated: {why}"
                self.causes.append(ModelError(cause, 0.0, "", f"{cause}: {missing}", False))
            else:
                self._add(cause, errors or {}, text, counted)
                continue
            if counted:
                self.missing |= dict.fromkeys(self._comparison.of_motion, missing)

    def _add(self, cause: str, errors: dict[str, float], text: str, counted: bool = True) -> None:
        named = [name for name in errors if name not in self._comparison.details] or [*errors]
        quantity = max(named, key=lambda name: errors[name], default="")
        if errors.get(quantity, 0.0) > limits.WORTH_NAMING:
            self.causes.append(ModelError(cause, errors[quantity], quantity, text, counted))
        for name, error in errors.items() if counted else ():
            before = self.of_quantities.get(name, 0.0)
            self.of_quantities[name] = math.hypot(before, error) if isinstance(before, float) else error

    def _changes(self, other: Pipeline, forces: dict[str, Array] | None = None) -> dict[str, float]:
        """Return the relative change of the motion's quantities in another run of the same meshes.

        ``forces`` takes each body's coordinates to those that have the same forces, and so its stress.
        """
        comparison = self._comparison
        motion, ours = comparison.march_beside(other), comparison.beside[1]
        return comparison.changes(comparison.quantities_of(other, motion, as_if=forces), ours)

    def _softened(self, excess: dict[str, Array]) -> dict[str, float]:
        bodies, forces = (
            dict(self._run.bodies),
            {name: np.eye(len(own.omega)) for name, own in self._run.bodies.items()},
        )
        for name, part in excess.items():
            bodies[name], forces[name] = soften_body(bodies[name], part)
        return self._changes(self._run.with_bodies(bodies), forces)

    def _shifted_vibrations(self) -> dict[str, float] | None:
        shifts = {name: self._shift_of_eigenvalues(name) for name in self._run.deformations}
        if not max(shifts.values(), default=0.0) > limits.HARDLY_SHIFTED:
            return None
        self._by_shift = self._softened(
            {name: shift * np.eye(len(self._run.bodies[name].omega)) for name, shift in shifts.items()}
        )
        return self._by_shift

    def _large_deflection(self) -> dict[str, float]:
        """Return the error of each quantity by the squares of rotation and strain within the bodies' frames.

        What hardly changes with the bodies' stiffness is hardly off by them: the march of the shifted vibrations has
        told that, if there is one. Of what it can't tell the whole error counts: stress, which balances forces, and
        momenta, in whose sums displacements of second order may be left out; and so it does where bodies have none.
        """
        run, of_motion = self._run, self._comparison.of_motion
        errors = deflection_errors(run, of_motion)
        if not self._by_shift or not all(is_of_second_order(run, body) for body in run.wholes):
            return errors
        ratio, squared = 0.0, 0.0
        for name in run.deformations:
            error, shift = error_in_frame(run, name), self._shift_of_eigenvalues(name)
            ratio, squared = max(ratio, error / shift if shift else 0.0), max(squared, error**2)
        for name, change in self._by_shift.items():
            if of_motion[name].kind == "displacement" and name not in _SUMS_OVER_MASSES:
                errors[name] = min(errors[name], ratio * change + squared if change else 0.0)
        return errors

    def _shift_of_eigenvalues(self, name: str) -> float:
        bowed = any(marker.displacement2.size for marker in self._run.bodies[name].markers.values())
        share = limits.OF_EIGENVALUE_SECOND_ORDER if bowed else limits.OF_EIGENVALUE
        return share * self._run.deformations[name].rotation ** 2

    def _stretching(self) -> dict[str, float] | None:
        """Return how much too far bodies deflect where that stretches them, and what they ring at changes."""
        names = stretching_bodies(self._run)
        if not names:
            return None
        self._comparison.require_modes(0.5)  # a factor
        ratios = {name: stiffening_by_stretch(self._run, name) for name in names}
        too_far = max(excess_deflection(ratio) for ratio in ratios.values())
        errors = dict.fromkeys(self._comparison.of_motion, too_far)
        if too_far > limits.WORTH_NAMING:
            sizes = {
                name: -limits.OF_VIBRATION * r * np.eye(len(self._run.bodies[name].omega)) for name, r in ratios.items()
            }
            errors |= {name: max(too_far, change) for name, change in self._softened(sizes).items()}
        return errors

    def _stiffening(self) -> dict[str, float] | None:
        if all(check.stiffened for check in self._run.stiffening_loads.values()):
            return None
        stiff = {name: replace(check, stiffened=True) for name, check in self._run.stiffening_loads.items()}
        return self._changes(self._run.variant(self._run.scene, stiffening_loads=stiff))

    def _attachment(self) -> dict[str, float] | None:
        """Return the change of the motion and the frequencies with rigidly fixed roots.

        A rigid face also holds the contraction of the elements behind it, far more than of the body behind a real
        clamp if they are long. That part falls with the elements' size, and two meshes tell it from the rest. Of a
        large mesh it would cost more than all else: there the coarser mesh alone says what rigid roots change.
        """
        run, pair = self._run, self._comparison.pair
        pair = pair if isinstance(pair, Pair) and pair.is_coarser else "a finer one would cost still more"
        clamped = [name for name, part in run.parts.items() if not (part.joint.free or part.joint.floating)]
        clamped = [name for name in clamped if not run.parts[name].shape.support]  # else the supports clamp it
        clamped = [name for name in clamped if name in run.wholes or run.frame_of(part_of(name)) == name]
        clamped = [name for name in clamped if not run.parts[name].markers[run.parts[name].joint.marker].rigid]
        roots = {part_of(name) or name: run.parts[name].joint.marker for name in clamped}
        scene = attach_roots_rigidly(run.scene, roots)
        if scene is None:
            return None
        large = [name for name in clamped if run.parts[name].modes.dofs > limits.LARGE_MESH]
        by_coarse_alone = isinstance(pair, Pair) and large == clamped
        self._comparison.require_modes(limits.COARSE_SHARE if by_coarse_alone else 1.0)
        rigid = run.variant(scene, stiffening_loads=run.stiffening_loads)
        errors, excess = dict[str, float](), dict[str, Array]()
        coarse = None if not isinstance(pair, Pair) else attach_roots_rigidly(pair.coarse.scene, roots)
        on_coarse = None if coarse is None else Pipeline(coarse, run.store.cache, stiffening_loads=run.stiffening_loads)
        for name in clamped:
            if not isinstance(pair, Pair) or on_coarse is None:
                of_modes, of_shapes = _gain_by_rigid_root(run, rigid, name)
            else:
                of_modes, of_shapes = _gain_by_rigid_root(pair.coarse, on_coarse, name)
                of_shapes = of_shapes[pair.counterparts(name)[0]]
                if name not in large:
                    own_modes, own_shapes = _gain_by_rigid_root(run, rigid, name)
                    of_modes, of_shapes = (
                        limits.OF_LIMIT * (2 * own_modes - of_modes),
                        limits.OF_LIMIT * (2 * own_shapes - of_shapes),
                    )
            excess[name] = -np.diag(of_shapes)
            fixed = run.parts[name].modes.n_rigid == 0  # a free part's own frequencies know of no root
            for k, gain in enumerate(of_modes if fixed else ()):
                errors[f"{name}, frequency {k + 1}"] = abs(float(np.sqrt(max(1 + gain, 0.0)) - 1))
        return errors | self._softened(excess)

    def _plane_sections(self) -> dict[str, float]:
        """Return the error of the stress of plies by the warping of sections, which makes it better, too.

        What this lacks, as stress through the thickness, is of the order of the largest change of any component.
        """
        from fmd.recovery.ply_warping import warped_ply_stress  # with scikit-fem

        comparison, motion = self._comparison, self._comparison.motion
        q = {name: motion.modal(name) for name in self._run.parts}
        warped = comparison.requested.of_plies(self._run, q, comparison.frames, warped_ply_stress)
        warped = {name: quantity for name, quantity in warped.items() if name in comparison.details}
        comparison.correct_by(warped, 1.0)
        changes, largest = comparison.changes(warped), dict[str, float]()
        for name, change in changes.items():
            body = name.rpartition(".")[0]
            largest[body] = max(largest.get(body, 0.0), change)
        return {name: math.hypot(change, largest[name.rpartition(".")[0]]) for name, change in changes.items()}

    def _damping(self) -> dict[str, float] | None:
        scene = damp_bodies(self._run.scene, limits.BARE_METAL)
        if scene is None:
            return None
        return self._changes(self._run.variant(scene, stiffening_loads=self._run.stiffening_loads))


def _gain_by_rigid_root(run: Pipeline, rigid: Pipeline, name: str) -> tuple[Array, Array]:
    """Return what the squares of a part's frequencies, and of its body's, gain on the same mesh with a rigid root."""
    part, m = run.parts[name], run.parts[name].fe.m
    gains = []
    other_part = rigid.parts[name]  # stiffening would change neither shapes nor frequencies
    for own, other in ((part.modes, other_part.modes), (part.body, other_part.body)):
        x = part.fe.x
        numbers, alike = find_counterparts(x, own.shapes, x, m, other.shapes, other.omega)
        gains.append(np.where(alike > limits.ALIKE, (other.omega[numbers] / own.omega) ** 2 - 1, 0.0))
    return gains[0], gains[1]
