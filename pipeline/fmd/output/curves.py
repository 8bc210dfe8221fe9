"""Curves of a chart: one quantity of each run's motion, with the axis label and the names of its components."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.limits.shown import HARDLY_MOVES
from fmd.core.units import convert_values
from fmd.output.variable_errors import VariableErrors
from fmd.recovery.motion import Motion
from fmd.scene.outputs import Chart

if TYPE_CHECKING:
    from fmd.contact.histories import ContactHistory
    from fmd.stages.pipeline import Pipeline

Curves = tuple[str, dict[str, Array], tuple[str, ...]]
_XYZ = ("x", "y", "z")


class Drawn(NamedTuple):
    """A quantity that any motion has, as a chart draws it."""

    label: str  # of the axis
    values: Callable[[Motion], Array]  # of a motion, shape (n_times,) or (n_times, n_components)
    components: tuple[str, ...] = _XYZ  # their names; empty for a single curve
    stated: tuple[str, ...] = ()  # names under which the error budget has the components, or all of them


_QUANTITIES: Mapping[str, Drawn] = {
    "centre_of_mass": Drawn(
        "position of the centre of mass [m]", lambda motion: motion.centre_of_mass, stated=("centre_of_mass",)
    ),
    "com_velocity": Drawn("velocity of the centre of mass [m/s]", lambda motion: motion.centre_velocity),
    "com_angular_velocity": Drawn("angular velocity [rad/s]", lambda motion: motion.centre_angular_velocity, ()),
    "momentum": Drawn("momentum [kg m/s]", lambda motion: motion.kinematics.momentum, stated=("momentum",)),
    "angular_momentum": Drawn(
        "angular momentum [kg m²/s]", lambda motion: motion.kinematics.angular_momentum, stated=("angular_momentum",)
    ),
    "tip_position": Drawn("position of the tip [m]", lambda motion: motion.tip_position, stated=("tip.position",)),
    "tip_deflection": Drawn(
        "deflection of the tip [m]", lambda motion: motion.tip_deflection, stated=("tip.deflection",)
    ),
    "tip_displacement": Drawn("displacement by deformation [m]", lambda motion: motion.tip_displacement),
    "energy": Drawn(
        "energy [J]",
        lambda motion: np.stack(motion.energies, axis=1),
        ("kinetic", "potential"),
        ("kinetic_energy", "potential_energy"),
    ),
}
_LARGEST = "largest since the output before: {}"
_OF_CONTACTS: Mapping[str, tuple[str, Callable[[ContactHistory], Array]]] = {
    "contact_force": (_LARGEST.format("force [N]"), lambda own: own.tops[:, 0]),
    "contact_pressure": (_LARGEST.format("pressure [MPa]"), lambda own: 1e-6 * own.tops[:, 2]),
    "contact_slip": ("longest way of slip [µm]", lambda own: 1e6 * own.slip),
    "contact_area": (_LARGEST.format("area [mm²]"), lambda own: 1e6 * own.tops[:, 1]),
}
_FORMER = {"com_position": "centre_of_mass", "joint_angle": "joint_position"}


def curves_of(run: Pipeline, output: Chart) -> Curves:
    """Compute the curves of a chart: axis label, values by the runs' labels, and names of the components.

    Raises
    ------
    InputError
        The scene has no modes, or not one joint where the chart names none.
    """
    quantity = _FORMER.get(output.quantity, output.quantity)
    if quantity == "element_stress":
        return _in_an_element(run, output)
    if quantity in ("joint_position", "joint_rate"):
        return _along_a_joint(run, output, rate=quantity == "joint_rate")
    if quantity == "modal_coordinates":
        return _of_modes(run, output)
    if quantity == "marker_position":
        return _of_a_marker(run, output)
    if quantity in _OF_CONTACTS:
        return _of_contacts(run, quantity)
    drawn = _QUANTITIES[quantity]
    curves = {name: drawn.values(motion) for name, motion in run.motions.items()}
    return _moving(drawn.label, curves, drawn.components) if drawn.components == _XYZ else (drawn[0], curves, drawn[2])


def errors_of_curve(run: Pipeline, output: Chart) -> tuple[float, ...]:
    """Return the stated error of each component of a chart's first curve in its unit; empty where none is stated.

    Of a vector every component may be off by the size of the difference.
    """
    stated, quantity = VariableErrors(run), _FORMER.get(output.quantity, output.quantity)
    if not stated.has_budget:  # nothing is computed for it
        return ()
    drawn, units = _QUANTITIES.get(quantity), None
    names = [*drawn.stated] * (len(drawn.components) // max(len(drawn.stated), 1)) if drawn else []
    if quantity == "element_stress":
        name = f"{output.element}, von Mises stress"
        names = [name if output.component == "von Mises" else f"{output.element}.{output.component}"]
        units = "Pa", output.unit or "MPa"
    elif quantity in ("joint_position", "joint_rate"):
        joint = output.joint or next(iter(run.motion.joints))
        rate = quantity == "joint_rate"
        unit = run.motion.joint_unit(joint) + ("/s" if rate else "")
        names, units = [f"{joint}.{'rate' if rate else 'position'}"], (unit, output.unit or unit)
    elif quantity == "marker_position":
        names = [f"{output.marker}.position"] * 3
    sizes = [stated.of_quantity(name) for name in names]
    if not names or any(isinstance(size, str) for size in sizes):
        return ()
    errors = np.array(sizes, dtype=float)
    return tuple(float(x) for x in (errors if units is None else convert_values(errors, *units)))


def _moving(label: str, curves: dict[str, Array], components: tuple[str, ...]) -> Curves:
    """Leave out the components that hardly move; a motion in a plane has nothing to show across its plane."""
    with np.errstate(invalid="ignore"):
        sizes = np.max([np.ptp(values, axis=0) for values in curves.values()], axis=0)
    sizes = np.nan_to_num(sizes)
    moving = sizes > HARDLY_MOVES * sizes.max()
    if not moving.any():  # all is at rest: lines of what is known, or of all
        known = np.isfinite(next(iter(curves.values()))).all(axis=0)
        moving = known if known.any() else ~known
    kept = tuple(name for name, moves in zip(components, moving, strict=True) if moves)
    return label, {name: values[:, moving] for name, values in curves.items()}, kept


def _of_modes(run: Pipeline, output: Chart) -> Curves:
    """Modal coordinates of the body that a chart names; by default of the tip's, or of the first flexible one."""
    tip = run.scene.simulation.tip.partition(".")[0]
    body = output.body or (tip if tip in run.wholes else run.part.name)
    names = [part.name for part in run.pieces_of(body)]
    curves = {
        label: np.concatenate([motion.modal(name) for name in names], axis=1) for label, motion in run.motions.items()
    }
    n_modes = next(iter(curves.values())).shape[1]
    return "modal coordinate [kg^½ m]", curves, tuple(f"mode {k + 1}" for k in range(n_modes))


def _of_contacts(run: Pipeline, quantity: str) -> Curves:
    """Quantity of all contacts, each a component by its name."""
    label, values = _OF_CONTACTS[quantity]
    curves = {
        name: np.stack([values(own) for own in motion.contacts.values()], axis=1)
        for name, motion in run.motions.items()
    }
    return label, curves, tuple(run.motion.contacts)


def _of_a_marker(run: Pipeline, output: Chart) -> Curves:
    """Position in space of the marker that a chart names as ``"body.marker"``."""
    body, _, name = run.division.find_place(str(output.marker)).partition(".")
    number = run.mechanism.number_of(body)
    curves = {label: motion.kinematics.marker_position(number, name) for label, motion in run.motions.items()}
    return _moving(f"position of {output.marker} [m]", curves, _XYZ)


def _in_an_element(run: Pipeline, output: Chart) -> Curves:
    """Stress in a named element, in the unit that the chart asks for."""
    unit = output.unit or "MPa"
    stress = run.element_stress(str(output.element), output.component)
    curves = {name: convert_values(values, "Pa", unit) for name, values in stress.items()}
    name = f"σ{output.component}" if len(output.component) == 2 else f"{output.component} stress"
    return f"{name} in {output.element} [{unit}]", curves, ()


def _along_a_joint(run: Pipeline, output: Chart, rate: bool) -> Curves:
    """Position or rate of the joint that a chart names, in its unit; without a name, of the only one there is."""
    joints = list(run.motion.joints)
    if output.joint is None and len(joints) != 1:
        raise InputError(run.scene.file, "output.joint", None, f"must be one of {', '.join(joints) or 'no joints'}")
    joint = output.joint or joints[0]
    unit = run.motion.joint_unit(joint) + ("/s" if rate else "")
    wanted = output.unit or unit
    curves = {
        name: convert_values(motion.joint_rate(joint) if rate else motion.joint_position(joint), unit, wanted)
        for name, motion in run.motions.items()
    }
    slides = run.motion.joint_unit(joint) == "m"
    name = ("speed of" if slides else "rate of") if rate else ("displacement of" if slides else "angle of")
    return f"{name} {joint} [{wanted}]", curves, ()
