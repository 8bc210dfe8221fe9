"""What a chart can show of a motion: axis label, one curve a run, names of the components."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.core.arrays import Array
from pipeline.core.errors import InputError

if TYPE_CHECKING:
    from pipeline.scene.outputs import Chart
    from pipeline.stages.pipeline import Pipeline

Curves = tuple[str, dict[str, Array], tuple[str, ...]]
_XYZ = ("x", "y", "z")
_ENERGIES: tuple[str, Callable[[Any], Array]] = ("energy [J]", lambda motion: np.stack(motion.energies, axis=1))

# Axis label, values, names of the components. Of one body on a hinge, whatever its name:
_OF_A_ROTOR: dict[str, tuple[str, Callable[[Any], Array], tuple[str, ...]]] = {
    "com_position": ("position [m]", lambda motion: motion.com_position, _XYZ),
    "com_velocity": ("velocity [m/s]", lambda motion: motion.com_velocity, _XYZ),
    "com_angular_velocity": ("angular velocity [rad/s]", lambda motion: motion.com_angular_velocity, ()),
    "tip_deflection": ("deflection [m]", lambda motion: motion.tip_deflection, ()),
    "tip_position": ("position [m]", lambda motion: motion.tip_position, _XYZ),
    "joint_angle": ("angle [rad]", lambda motion: motion.joint_angle, ()),
    "joint_rate": ("rate [rad/s]", lambda motion: motion.joint_rate, ()),
    "modal_coordinates": ("modal coordinate [kg^½ m]", lambda motion: motion.q, ()),
    "energy": (*_ENERGIES, ("kinetic", "strain")),
}
# Of a chain.
_OF_A_CHAIN: dict[str, tuple[str, Callable[[Any], Array], tuple[str, ...]]] = {
    "tip_position": ("position [m]", lambda motion: motion.tip_position, _XYZ),
    "tip_displacement": ("displacement by deformation [m]", lambda motion: motion.tip_displacement, _XYZ),
    "modal_coordinates": ("modal coordinate [kg^½ m]", lambda motion: motion.modal(motion.tip[0]), ()),
    "energy": (*_ENERGIES, ("kinetic", "potential")),
}


def curves_of(run: Pipeline, output: Chart) -> Curves:
    """Find the curves of a chart.

    Raises
    ------
    InputError
        The scene's mechanism has no such quantity.
    """
    motions: dict[str, Any] = dict(run.motions)
    if output.joint is not None:
        return _along_a_joint(run, motions, output)
    if output.element is not None:
        return _in_an_element(run, output)
    known = _OF_A_ROTOR if run.is_rotor else _OF_A_CHAIN
    if output.quantity not in known:
        works = ", ".join(["joint_position", *known])
        raise InputError(run.scene.file, "output", output.quantity, f"can't be had of this mechanism; it has {works}")
    label, quantity, components = known[output.quantity]
    curves = {name: quantity(motion) for name, motion in motions.items()}
    first = curves[next(iter(curves))]
    if components == _XYZ:  # a planar motion has nothing to show across its plane
        moving = np.abs(first).max(axis=0) > 1e-9 * np.abs(first).max()
        components = tuple(name for name, moves in zip(components, moving, strict=True) if moves)
        curves = {name: values[:, moving] for name, values in curves.items()}
    elif first.ndim == 2 and not components:
        components = tuple(f"mode {k + 1}" for k in range(first.shape[1]))
    return label, curves, components


def _in_an_element(run: Pipeline, output: Chart) -> Curves:
    """A named element's stress in the unit that the scene asks for."""
    from pipeline.core.units import convert_values

    unit = output.unit or "MPa"
    curves = {
        name: convert_values(values, "Pa", unit)
        for name, values in run.element_stress(str(output.element), output.component).items()
    }
    return f"{output.component} [{unit}]", curves, ()


def _along_a_joint(run: Pipeline, motions: dict[str, Any], output: Chart) -> Curves:
    """A joint's position or rate in the unit that the scene asks for."""
    from pipeline.core.units import convert_values

    joint, rate = str(output.joint), output.quantity == "joint_rate"
    unit = ("rad" if run.is_rotor else run.chain.units[joint]) + ("/s" if rate else "")
    wanted = output.unit or unit

    def values(motion: Any) -> Array:
        if run.is_rotor:
            return np.asarray(motion.joint_rate if rate else motion.joint_angle)
        return np.asarray(motion.joint_rate(joint) if rate else motion.joint_position(joint))

    curves = {name: convert_values(values(motion), unit, wanted) for name, motion in motions.items()}
    return f"{joint} [{wanted}]", curves, ()
