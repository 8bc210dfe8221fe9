"""Stated errors of a summary's figures, each by its place in the summary."""

from collections.abc import Iterator, Mapping
from typing import Any

from fmd.accuracy.contact_errors import CONTACT_ERRORS, ContactError
from fmd.accuracy.ply_stress import ply_row
from fmd.accuracy.requested_stress import EXTREMES
from fmd.output.error_columns import NOT_STATED
from fmd.output.variable_errors import VariableErrors
from fmd.stages.pipeline import Pipeline

_OF_RANGE = NOT_STATED + "it tells whether the model holds, and the error budget doesn't compare it"
_PLACES = ("time_s", "position_m")  # of the largest stress
_OF_PLACE = NOT_STATED + "errors are those of the value, not of its place and time"
_OF_CONTACT = {
    "radius_over_spacing": NOT_STATED + "it follows from the contact's largest area",
    "largest_stress_below_pa": NOT_STATED + "it is a half-space's under the pressures found, which no other run has",
    "its_depth_m": _OF_PLACE,
}
"""Why figures of contacts have none that no second run is compared for."""


def figure_errors(run: Pipeline, summary: Mapping[str, Any]) -> dict[str, float | str]:
    """Return the error of each figure of a run's summary in its unit, or why it is not stated.

    Keys are places in the summary: ``frequencies_hz.0``, ``final.joint_rates.hub``. Where the motion ends, the largest
    error over time counts.
    """
    stated = VariableErrors(run)
    found = {place: stated.of_quantity(name) for place, name in _quantities(run, summary)}
    of_contacts: Mapping[str, Mapping[str, ContactError]] = run.results.get(CONTACT_ERRORS, {})
    for name, own in of_contacts.items():
        for key, x in own.items():
            found[f"contacts.{name}.{key}"] = NOT_STATED + x.why if x.why else x.total
        found |= {f"contacts.{name}.{key}": why for key, why in _OF_CONTACT.items() if key in summary["contacts"][name]}
    for body, figures in summary.get("bodies", {}).items():
        for key in (key for key, x in figures.items() if isinstance(x, float) or key == "frequencies_in_frame_hz"):
            found.setdefault(f"bodies.{body}.{key}", _OF_RANGE)
    return found | {f"worst_stress.{key}": _OF_PLACE for key in _PLACES if key in summary.get("worst_stress", ())}


def _quantities(run: Pipeline, summary: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the place of each figure, and the name of the error budget's quantity that it is a value of."""
    first = next(iter(run.wholes), "")
    for k in range(len(summary.get("frequencies_hz", ()))):
        yield f"frequencies_hz.{k}", f"{first}, frequency {k + 1}"
    for body, own in summary.get("bodies", {}).items():
        for k in range(len(own["frequencies_hz"])):
            yield f"bodies.{body}.frequencies_hz.{k}", f"{body}, frequency {k + 1}"
        yield f"bodies.{body}.mass_kg", f"{body}, mass"
    for joint in summary["final"]["joint_positions"]:
        yield f"final.joint_positions.{joint}", f"{joint}.position"
        yield f"final.joint_rates.{joint}", f"{joint}.rate"
    yield "final.kinetic_energy_j", "kinetic_energy"
    yield "final.potential_energy_j", "potential_energy"
    for tip in ("final.tip", "tip"):
        yield f"{tip}.position_m", "tip.position"
        if "peak_tip_deflection_m" in summary:
            yield f"{tip}.deflection_m", "tip.deflection"
    if "peak_tip_deflection_m" in summary:
        yield "peak_tip_deflection_m", "tip, largest deflection"
    worst = summary.get("worst_stress", {})
    if worst:
        yield "worst_stress.von_mises_pa", f"{worst['body']}, largest von Mises stress"
    for body in (body for body, own in worst.items() if isinstance(own, dict)):
        yield f"worst_stress.{body}.value_pa", f"{body}, largest von Mises stress"
    for element in summary.get("element_stress", {}):
        yield f"element_stress.{element}.largest_pa", f"{element}, von Mises stress, largest"
        yield f"element_stress.{element}.at_the_end_pa", f"{element}, von Mises stress"
    for body, own in summary.get("envelope", {}).items():
        for measure in own:
            yield f"envelope.{body}.{measure}.value_pa", f"{body}, {EXTREMES[measure]}"
    for body, own in summary.get("plies", {}).items():
        for index in own:
            yield f"plies.{body}.{index}.value", ply_row(body, index)
    for contact, figures in summary.get("contacts", {}).items():
        for figure in (key for key in figures if key != "near_field"):
            yield f"contacts.{contact}.{figure}", f"{contact}.{figure}"
