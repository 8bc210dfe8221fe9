"""Vibrations of a scene's rotor over its rate of rotation: what turns on a hub, or a shaft in bearings."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from fmd.reduction.rotating import WhirlingModes, rotating_modes
from fmd.responses.interpolated_models import interpolate_models, matrices_of
from fmd.responses.whirl import hub_modes, whirling_modes
from fmd.scene.modes import damping_ratios
from fmd.scene.variants import complete_for_linear_answers
from fmd.stages.run_checks import require_no_contact, require_no_gears
from fmd.stages.turning import OnHub, TurningRotor, require_one_axis, scene_in_space
from fmd.stages.whirl_tables import find_vibrations_by_whirl

if TYPE_CHECKING:
    from fmd.scene.scene import Scene
    from fmd.stages.pipeline import Pipeline

Vibrations = Callable[[float], WhirlingModes]
"""Vibrations at a rate of rotation [rad/s]."""


def coupled(run: Pipeline) -> Pipeline:
    """Return the stages of a scene with its joints and force elements also where it has no simulation.

    Raises
    ------
    InputError
        It has contacts, or gears in mesh.
    """
    scene = run.scene
    require_no_contact(scene, "a rotor's vibrations")
    require_no_gears(scene, "a rotor's vibrations")
    if scene.moves or not (scene.joint or any(scene.elements.values())):
        return run
    return run.variant(complete_for_linear_answers(scene), run.store.monitor)


def runs_in_bearings(scene: Scene) -> bool:
    """Return True if a scene's first body is free, and bearings hold what it carries."""
    joint = next((scene.joint[name] for name in scene.carrying.values()), None)
    return bool(scene.bearing) and joint is not None and joint.kind.is_free


def find_vibrations(run: Pipeline, highest: float | None = None) -> Vibrations:
    """Return the vibrations of a scene's rotor as a function of its rate of rotation [rad/s].

    With a highest rate, the linear models up to it are interpolated between few that are computed now.

    Those of a shaft in bearings are seen from space, those of what turns on a hub from the hub. A part that is alone on
    its hub is linearised undeformed, others where they are at rest in their own turning axes.

    Raises
    ------
    InputError
        There is no flexible part; the axis isn't given; the equations vary with the rotor's angle, since what supports
        it isn't the same all around; or a load turns the rotor ever faster.
    """
    if _is_alone(run.scene):
        return _part_on_hub(run)
    if runs_in_bearings(run.scene) and any(bearing.whirl_tables for bearing in run.scene.bearing.values()):
        return find_vibrations_by_whirl(run, highest)
    in_bearings = runs_in_bearings(run.scene)
    if not in_bearings:
        require_one_axis(run.scene)
    rotor = TurningRotor(run, in_bearings)
    way, states = rotor.way, rotor.model(0.0).states
    interpolated = None if highest is None else interpolate_models(rotor.model, 0.0, highest, rotor.bends)

    def vibrations(rate: float) -> WhirlingModes:
        A, C = matrices_of(rotor.model, rate) if interpolated is None else interpolated(rate)
        if isinstance(way, OnHub):
            first, second, *_ = np.split(C, 6)
            return hub_modes(A, (first, second), [k for k, (name, _) in enumerate(states) if name in way.still])
        return whirling_modes(A, rotor.view(C, rate)).seen

    return vibrations


def _is_alone(scene: Scene) -> bool:
    """Return True if a scene is one part on a revolute joint, or has parts alone."""
    if not scene.moves:
        return True
    coupled = any(scene.elements.values())
    return len(scene.body) == 1 and [joint.kind.is_hinge for joint in scene.joint.values()] == [True] and not coupled


def _part_on_hub(run: Pipeline) -> Vibrations:
    """Return the vibrations of a part that turns about its joint, or about its z axis if it has none."""
    part = run.variant(scene_in_space(run.scene), run.store.monitor).part if run.scene.moves else run.part
    off = run.scene.moves and run.scene.simulation.stiffening == "off"
    body = part.body if off else part.stiffened
    ratios = np.array(damping_ratios(part.shape.modes.damping, body.omega.tolist()))

    def on_hub(rate: float) -> WhirlingModes:
        return rotating_modes(body, np.array(part.joint.axis), rate, len(part.joint.free) == 1, ratios)

    return on_hub
