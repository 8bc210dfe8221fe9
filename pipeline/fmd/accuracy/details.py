"""Quantities of single joints and markers over time, by the names that files hold them under.

They are stated beside the quantities of `fmd.accuracy.quantities`, but no required accuracy counts them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fmd.accuracy.error_estimates import OrientationQuantity, Quantity
from fmd.core.arrays import Array
from fmd.core.limits.errors import COMPARED_TIMES, NOTHING
from fmd.recovery.motion import Motion
from fmd.recovery.motion_file import Variable, motion_variables
from fmd.recovery.quantities import marker_variables, reaction_variables
from fmd.recovery.stress import choose_frames

if TYPE_CHECKING:
    from fmd.accuracy.quantities import Quantities
    from fmd.dynamics.mechanism import Mechanism
    from fmd.scene.scene import Scene

# Variables that have a row of the same values in the budget under another name.
_SAME = {
    "tip.deflection": "tip, deflection",
    "kinetic_energy": "kinetic energy",
    "potential_energy": "potential energy",
}
# Of variables without a row: why.
NO_MEANING = {
    "modal_coordinates": "belongs to the modes of this run; what they move has an error",
    "coordinates": "mixes lengths and angles; orientation and position have errors",
    "rates": "mixes lengths and angles; the markers' velocities have errors",
}


class PlaceQuantity(Quantity):
    """Place in space over time (n_times, 3); its size is the way from where it was at the start [m]."""

    @property
    def sizes(self) -> Array:
        """Distances from the first place [m], (n_times,)."""
        return np.asarray(np.linalg.norm(self.values - self.values[0], axis=1))


def detail_quantities(scene: Scene, motion: Motion) -> Quantities:
    """Compute force and moment of each joint, and places, rates and accelerations, at many of the output times.

    Vectors are in space. Reactions and accelerations follow from the equations of motion at each state.
    """
    chosen = choose_frames(len(motion.times), COMPARED_TIMES)
    given = motion.trajectory
    part = replace(motion, trajectory=replace(given, times=given.times[chosen], q=given.q[chosen], v=given.v[chosen]))
    found = (_quantity(variable) for variable in detail_variables(scene, part))
    return {quantity.name: quantity for quantity in found if quantity is not None}


def leave_out_nothing(quantities: Quantities, mechanism: Mechanism) -> Quantities:
    """Return the quantities that aren't `round_off_sizes`.

    What has no velocity has no acceleration, of which redundant constraints of a loop may leave a millionth.
    """
    largest: dict[str, float] = {}
    for quantity in quantities.values():
        largest[quantity.unit] = max(largest.get(quantity.unit, 0.0), quantity.scale)
    least = round_off_sizes(largest, mechanism)
    found = {name: each for name, each in quantities.items() if each.scale > least[each.unit]}
    still = {f"{name.removesuffix('.velocity')}.acceleration" for name in {*quantities} - {*found}}
    return {name: each for name, each in found.items() if name not in still}


def round_off_sizes(largest: Mapping[str, float], mechanism: Mechanism) -> dict[str, float]:
    """Return sizes, by their units, that are round-off beside the largest one of the same unit, or of a related one.

    To momentum the speed of markers is related, to what a free joint bears the forces that accelerate the bodies.
    """
    mass, size = mechanism.mass, mechanism.reach
    speed, force = largest.get("m/s", 0.0), max(largest.get("N", 0.0), mass * largest.get("m/s^2", 0.0))
    related = {"rad/s": speed / size if size else 0.0, "kg m/s": mass * speed, "kg m^2/s": mass * speed * size}
    related |= {"N": force, "N m": force * size, "m/s^2": force / mass if mass else 0.0}
    return {unit: NOTHING * max(own, related.get(unit, 0.0)) for unit, own in largest.items()}


def row_name(variable: str) -> str:
    """Return the name of the budget's row of a variable of a motion in space."""
    return _SAME.get(variable, variable)


def detail_variables(scene: Scene, motion: Motion) -> Iterator[Variable]:
    """Return the variables of ``motion.nc``, and what histories add to them."""
    yield from (variable for variable in motion_variables(motion) if variable.name not in _SAME)
    yield from reaction_variables(motion, tuple(scene.joint), in_body=False)
    for kind in ("marker_velocity", "marker_acceleration"):
        yield from marker_variables(motion, kind, named_markers(motion), in_body=False)


def named_markers(motion: Motion) -> tuple[str, ...]:
    """Return all named markers as ``"body.marker"``, those of pieces under their parts' names."""
    return tuple(
        f"{link.part or link.name}.{marker}"
        for link in motion.mechanism.links
        for marker in link.markers
        if not marker.startswith("cut:")
    )


def is_reaction(name: str) -> bool:
    """Return true for force and moment of a joint, by the name of their row."""
    return name.rpartition(".")[2] in ("force", "moment")


def _quantity(variable: Variable) -> Quantity | None:
    name, values = variable.name, np.asarray(variable.values)
    if name.rpartition(".")[2] in NO_MEANING:
        return None
    if variable.dims == ("quaternion",):
        return OrientationQuantity(name, "rad", values)
    kind = PlaceQuantity if is_place(variable) else Quantity
    return kind(name, variable.units, values)


def is_place(variable: Variable) -> bool:
    """Return true for a place in space, whose error is a share of how far it moves."""
    of_place = variable.name == "centre_of_mass" or variable.name.rpartition(".")[2] in ("position", "origin")
    return of_place and variable.dims == ("axis",)
