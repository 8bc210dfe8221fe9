"""Names of a run's results, which are checked by the scene alone, before anything is computed."""

from collections.abc import Sequence
from typing import Any

from fmd.core.errors import InputError, as_input_error
from fmd.core.state_formula import StateFormula
from fmd.scene.cross_checks import CrossCheck
from fmd.scene.outputs import FrequencyResponseChart
from fmd.scene.reading import suggest_name
from fmd.scene.scene import Scene
from fmd.scene.state_loads import FormulaVariables
from fmd.scene.stress_outputs import Fatigue

OF_A_BODY = ("stress", "life", "frequency")
_COMPONENTS = (*"xyz", "size")
_MARKERS = ("position", "displacement", "velocity", "acceleration")
_ALONG_JOINTS = (
    "position",
    "rate",
    "coordinates",
    "rates",
    "orientation",
    "angular_velocity",
    "displacement",
    "velocity",
)
BY = " by "


def require_results(scene: Scene, names: Sequence[str], origin: str = "--of") -> None:
    """Raise ``InputError`` for a name of an option that no result has, before anything is computed."""
    for name in names:
        if "=" in name:
            read_formula(scene, name, origin)
        elif BY in name:
            listed_response(scene, name, origin)
        elif name == "tip":
            require_deflecting_tip(scene, origin)
        elif not (_is_of_a_body(scene, name, origin) or name == "mass" or name.startswith("critical_speed.")):
            require_quantity(scene, name, origin)


def require_deflecting_tip(scene: Scene, origin: str) -> None:
    """Raise ``InputError`` unless the tip is on a flexible body."""
    tip = scene.simulation.tip
    if tip.partition(".")[0] not in scene.flexible:
        mend = f"is on a rigid body and doesn't deflect; '{tip}.position' or '{tip}.velocity' works"
        raise InputError(origin, "tip", tip, mend)


def find_fatigue_output(scene: Scene, body: str, origin: str) -> Fatigue:
    """Return the only output of type fatigue of a body, which its life is by; raises ``InputError`` without."""
    outputs = [output for output in scene.output if isinstance(output, Fatigue) and output.body == body]
    if len(outputs) != 1:
        mend = f"takes one [[output]] of type fatigue for {body}; the scene has {len(outputs)}"
        raise InputError(origin, f"{body}.life", None, mend)
    return outputs[0]


def with_body(scene: Scene, name: str) -> list[str]:
    """Return the parts of a result's name, with that of the only flexible body where it is left out."""
    parts = name.split(".")
    return [*scene.flexible, *parts] if parts[0] in OF_A_BODY and len(scene.flexible) == 1 else parts


def _is_of_a_body(scene: Scene, name: str, origin: str) -> bool:
    """Tell whether a result is a body's, and raise ``InputError`` where that body can't have it."""
    match with_body(scene, name):
        case [body, "mass"]:
            return body in scene.body
        case [body, "stress"]:
            return body in scene.flexible
        case [body, "life"] if body in scene.flexible:
            find_fatigue_output(scene, body, origin)
            return True
        case [body, "frequency", number]:
            return body in scene.flexible and number.isdecimal() and int(number) > 0
    return False


def takes_motion(name: str) -> bool:
    """Return false for a name of results that bodies have by themselves: frequencies, masses, frequency responses."""
    if "=" in name:
        return True
    parts = name.split(".")
    return not (BY in name or parts[-1] == "mass" or "frequency" in parts[:2] or parts[0] == "critical_speed")


def is_of_parts(name: str) -> bool:
    """Return true for a name of results that bodies have without a mechanism: masses and frequencies."""
    return not takes_motion(name) and BY not in name and name.split(".", maxsplit=1)[0] != "critical_speed"


def read_formula(scene: Scene, given: str, origin: str) -> tuple[str, str]:
    """Return name and text of a formula of the motion."""
    name, _, text = (part.strip() for part in given.partition("="))
    if not name:
        raise InputError(origin, name, text, "a formula needs a name, name = formula")
    try:
        read_observed(scene, text)
    except InputError as error:
        raise InputError(origin, name, text, error.mend) from None
    return name, text


def read_observed(scene: Scene, text: str) -> tuple[FormulaVariables, StateFormula]:
    """Read a formula of the motion that stands in no scene, but is of one.

    Raises
    ------
    InputError
        It isn't one, or names what the scene doesn't have.
    """
    table = FormulaVariables()
    with as_input_error(scene.file, "observe", text):
        parsed = table.parse(text)
        faults = CrossCheck(scene).find_unknown_parts(table, text)
    if faults:
        raise InputError(scene.file, "observe", text, str(faults[0]))
    return table, parsed


def listed_response(scene: Scene, name: str, origin: str) -> tuple[FrequencyResponseChart, int]:
    """Return the output of the scene that has a frequency response, and the response's number there."""
    pairs = {
        f"{output}{BY}{each.input}": (each, k)
        for each in scene.output
        if isinstance(each, FrequencyResponseChart)
        for k, output in enumerate(each.outputs)
    }
    if name not in pairs:
        raise InputError(
            origin, name, None, f"no [[output]] of type frf has it; {suggest_name(name, pairs, 'there are')}"
        )
    return pairs[name]


def require_quantity(scene: Scene, name: str, origin: str) -> dict[str, Any]:
    """Return the keys of a history that holds a quantity; raises ``InputError`` if no quantity has such a name."""
    asked = _asked_quantity(scene, name)
    if asked is None:
        raise InputError(origin, name, None, f"no such result; {suggest_name(name, _examples(scene), 'such as')}")
    return asked


def _asked_quantity(scene: Scene, name: str) -> dict[str, Any] | None:
    """Return the keys of a history that holds a quantity; ``None`` if no quantity has such a name."""
    if name in ("kinetic_energy", "potential_energy"):
        return {"quantities": ["energy"]}
    parts = name.split(".")
    first, second, kind = parts[0], ".".join(parts[:2]), parts[2] if len(parts) > 2 else ""
    if parts[-1] in _COMPONENTS and len(parts) > 2:
        parts.pop()
    if first in scene.body and parts[2:] == [kind] and kind in _MARKERS and parts[1] in scene.body[first].marker:
        return {"quantities": [f"marker_{kind}"], "markers": [second]}
    if first in scene.flexible and kind and parts[1] in getattr(scene.body[first], "element", {}):
        return {"quantities": ["element_stress"], "elements": [second], "components": [kind.replace("_", " ")]}
    if first in scene.joint and len(parts) > 1:
        if parts[1:] in (["force"], ["moment"]):
            return {"quantities": ["joint_reaction"], "joints": [first]}
        if parts[1] in _ALONG_JOINTS:
            return {"quantities": ["joint_position", "joint_rate"], "joints": [first]}
    if first in scene.gear_mesh and parts[1:] in (["force"], ["transmission_error"]):
        return {"quantities": ["gear_mesh"]}
    return None


def _examples(scene: Scene) -> list[str]:
    """Return names of results that a run has."""
    found = ["tip", "mass", *(f"{body}.{kind}" for body in scene.flexible for kind in ("stress", "frequency.1"))]
    for name, joint in scene.joint.items():
        found += [f"{name}.force"] + [f"{name}.position"] * bool(joint.kind.unit)
        found += [f"{name}.orientation"] * joint.kind.turns_in_space
    found += [f"{mesh}.{kind}" for mesh in scene.gear_mesh for kind in ("force", "transmission_error")]
    markers = [f"{body}.{marker}" for body, table in scene.body.items() for marker in table.marker]
    return [*found, *(f"{marker}.position" for marker in markers)]
