"""Names of the functions that a system gives a meaning."""

from inspect import signature
from typing import Any

import pytest

from fmd.dynamics import system
from fmd.dynamics.compiled_system import closed_cycle_tangents, tangent_kernels  # noqa: F401  the first gives meanings
from fmd.dynamics.compiled_system.closed_tangents import ClosedTangentParameters
from fmd.dynamics.compiled_system.parameters import ClosedParameters
from fmd.dynamics.compiled_system.touching import (
    ContactsAhead,
    Touching,
    TouchingClosedParameters,
    TouchingParameters,
)
from fmd.dynamics.compiled_system.touching_tangents import TouchingClosedTangentParameters, TouchingTangentParameters
from fmd.dynamics.system import accelerations, advance, fast_steps, find_responses, freeze_slow, velocities

NAMES = (accelerations, freeze_slow, find_responses, fast_steps, advance, velocities)


@pytest.mark.parametrize("name", NAMES, ids=lambda name: name.__name__)
def test_a_name_without_a_system_does_nothing(name: Any) -> None:
    with pytest.raises(NotImplementedError, match=r"^$"):
        name(*([None] * len(signature(name).parameters)))


LOOPS = ("project", "note_held", "project_onto_constraints")
# What parts of a system need of the names that do nothing for others. Tangents' own steps choose constraints; none of
# the methods that sum up impulses or end steps at contacts marches tangents of these.
NEEDED: list[tuple[type, tuple[str, ...]]] = [
    (ClosedParameters, (*LOOPS, "choose_constraints_anew")),
    (ClosedTangentParameters, LOOPS),
    (
        Touching,
        ("note_contacts", "remember_contacts", "remember_found", "contact_forces", "set_impulses", "is_pressed"),
    ),
    (TouchingTangentParameters, ("note_contacts", "remember_contacts", "remember_found", "change_pushes")),
    (ContactsAhead, ("answer_contacts", "answer_remembered", "remember_answered")),
]
SYSTEMS = (
    ClosedParameters,
    ClosedTangentParameters,
    TouchingParameters,
    TouchingClosedParameters,
    TouchingTangentParameters,
    TouchingClosedTangentParameters,
    ContactsAhead,
)


def does_nothing(name: Any) -> bool:
    try:
        name.dispatch(object)(*([None] * len(signature(name).parameters)))
    except NotImplementedError:
        return False
    return True


def optional_names() -> dict[str, Any]:
    """The names that do nothing for a system without the part that they are of."""
    modules = (system, tangent_kernels)
    return {
        name: found
        for module in modules
        for name, found in vars(module).items()
        if hasattr(found, "dispatch") and found.__module__ == module.__name__ and does_nothing(found)
    }


@pytest.mark.parametrize("kind", SYSTEMS, ids=lambda kind: kind.__name__)
def test_each_system_has_what_its_loops_and_contacts_need(kind: type) -> None:
    names = optional_names()
    assert {*names} == {name for _, needed in NEEDED for name in needed}
    for part, needed in NEEDED:
        if issubclass(kind, part):
            assert [name for name in needed if names[name].dispatch(kind) is names[name].dispatch(object)] == []
