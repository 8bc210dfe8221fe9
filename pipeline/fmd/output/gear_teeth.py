"""Gears in motion in numbers: transmission error and force between their teeth, and how far the table of it holds."""

from math import pi
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.html import scaled
from fmd.core.limits.contact import LARGE_TABLE_ERROR, LIGHT_TEETH
from fmd.dynamics.elements import GearTeeth
from fmd.recovery.motion_file import gear_variables
from fmd.stages.pipeline import Pipeline


def gear_teeth_figures(run: Pipeline) -> dict[str, Any]:
    """Return the gears in mesh of the first run by name; nothing without them."""
    found, values = {}, _values(run)
    for own in _teeth(run):
        error, force = values[f"{own.name}.transmission_error"], values[f"{own.name}.force"]
        found[own.name] = {
            "mean_transmission_error_m": float(error.mean()),
            "peak_to_peak_m": float(np.ptp(error)),
            "largest_force_n": float(force.max()),
            "least_force_n": float(force.min()),
            "apart": float(own.is_apart(error).mean()),
            "mean_stiffness_n_per_m": own.energy.mean,
            "backlash_m": own.backlash,
            "table_error": own.energy.error,
        }
    return {"gear_meshes": found} if found else {}


def gear_teeth_warnings(run: Pipeline) -> list[dict[str, str]]:
    """Return warnings about loads beyond the table, its error, stress by forces on teeth, and teeth not meshed."""
    found, values = [], _values(run)
    for own in _teeth(run):
        error = values[f"{own.name}.transmission_error"]
        if (most := max(error.max(), -error.min() - own.backlash)) > own.energy.reach:
            text = (
                f"gear_mesh.{own.name}: teeth are pressed by {scaled(most, 'm')}, and forces are tabulated up to "
                f"{scaled(own.energy.reach, 'm')}, beyond which they rise straight; a larger torque there helps"
            )
            found.append({"code": "gear-table", "text": text})
        if own.energy.error > LARGE_TABLE_ERROR:
            text = (
                f"gear_mesh.{own.name}: forces between the table's places are off by {own.energy.error:.2g} of the load"
                ", which no key makes less: count it to the errors of forces, and its part to those of motions"
            )
            found.append({"code": "gear-table", "text": text})
        text = (
            f"gear_mesh.{own.name}: stress of {' and '.join(end.body for end in own.ends)} leaves out what the forces "
            "on their teeth cause; an output of type gear-mesh has it at the roots"
        )
        found.append({"code": "gear-stress", "text": text})
    for name in dict.fromkeys(body for own in run.scene.gear_mesh.values() for body in (own.pinion, own.wheel)):
        share = _missing_inertia(run, name)
        if share > LIGHT_TEETH:
            text = (
                f"body.{name}: the teeth that aren't meshed would add {share:.0%} to its inertia about the axis; "
                "mesh.teeth = the number of teeth has them all"
            )
            found.append({"code": "gear-inertia", "text": text})
    return found


def _teeth(run: Pipeline) -> list[GearTeeth]:
    return [own for own in run.motion.mechanism.elements if isinstance(own, GearTeeth)]


def _values(run: Pipeline) -> dict[str, Array]:
    """Return the gears' variables of the first run by name."""
    return {variable.name: variable.values for variable in gear_variables(run.motion)}


def _missing_inertia(run: Pipeline, name: str) -> float:
    """Return the inertia about the axis of teeth that aren't meshed, over that of the body; teeth by their angles."""
    gear: Any = run.scene.body[name]
    each, rim = gear.tooth.polar_moment, 0.5 * pi * (gear.tooth.root_radius**4 - (0.5 * gear.bore) ** 4)
    return float((gear.teeth - gear.meshed_teeth) * each / (rim + gear.meshed_teeth * each))
