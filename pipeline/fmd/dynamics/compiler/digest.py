"""Digest of a mechanism's constants, by which its machine code is kept: reading it back needs no tracing."""

import hashlib
import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from functools import cache
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from fmd.core.joint_kinds import JOINT_CONSTANTS
from fmd.dynamics.closures import Coupler
from fmd.dynamics.compiler.coordinates import Coordinates, constant_value, without_constants
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import Signal

_NAMES = {"name", "joint_name", "section", "body", "part", "effort", "initial", "state"}
"""Fields that are in no equation, or in it by a number."""


_PLAIN = {float, int, bool, str, type(None)}

_digests: WeakKeyDictionary[Mechanism, str] = WeakKeyDictionary()


def digest_mechanism(inputs: Coordinates) -> str:
    """Return the digest of all that a mechanism's functions are traced from.

    Varying signals, joints' springs and dampers, and held values are inputs of these.
    """
    if inputs.mechanism not in _digests:
        _digests[inputs.mechanism] = _digest(inputs)
    return _digests[inputs.mechanism]


def share_digest(mechanism: Mechanism, like: Mechanism) -> None:
    """Take a mechanism's digest from one that differs in values of `Coordinates.numbers` alone, if that is known."""
    if like in _digests:
        _digests[mechanism] = _digests[like]


def _digest(inputs: Coordinates) -> str:
    mechanism, pieces = inputs.mechanism, list[bytes]()
    numbers = {link.name: number for number, link in enumerate(mechanism.links)}
    links = list(mechanism.links)
    for body, name in (key for key in inputs.numbers if key[0] >= 0 and key[1] in JOINT_CONSTANTS):
        changes: dict[str, Any] = {name: math.nan}  # no number, so that none of them counts
        links[body] = replace(links[body], **changes)
    if mechanism.lifted:
        _add(pieces, inputs, ["lifted", *inputs.numbers])
        links = [without_constants(link) for link in links]
    _add(pieces, inputs, [links, mechanism.layout, np.zeros(3) if mechanism.lifted else mechanism.gravity])
    for load in mechanism.loads:
        _add(pieces, inputs, [numbers[load.body], load])
    efforts = [*(link.effort for link in mechanism.links), *(load.effort for load in mechanism.loads)]
    for number, effort in enumerate(efforts):
        if effort is not None:
            _add(pieces, inputs, [number, [numbers[body] for body in effort.bodies], effort])
    measured = [function for controller in mechanism.controllers for function in controller.measured]
    for function in measured:
        _add(pieces, inputs, ["measured", [numbers[body] for body in function.bodies], function])
    for element in mechanism.elements:
        _add(pieces, inputs, [[numbers.get(end.body, -1) for end in element.ends], type(element).__name__, element])
    for contact in mechanism.contacts:  # whose forces are arguments
        markers = [*links[numbers[contact.body]].markers]
        _add(pieces, inputs, ["touches", numbers[contact.body], [markers.index(name) for name in contact.felt]])
    for closure in mechanism.closures:
        if isinstance(closure, Coupler):
            _add(pieces, inputs, [[numbers[body] for body in closure.joints], closure.factors, closure.offset])
        else:
            places = [numbers.get(place.body, -1) for place in (closure.first, closure.second)]
            _add(pieces, inputs, [places, closure])
    return hashlib.blake2b(b"".join(pieces), digest_size=16).hexdigest()


def names_of(mechanism: Mechanism) -> Hashable:
    """Return the names, breakpoints, controllers, contacts and positions of assembly of a mechanism.

    The digest leaves these out. Mechanisms that are equal in both, and in signals, differ in numbers of joints, and in
    values that controllers hold, at most.
    """
    names = tuple((link.name, link.joint_name, link.section, *link.markers) for link in mechanism.links)
    acting = [(load.body, load.size.breakpoints) for load in mechanism.loads]
    acting += [(link.name, (link.motion or link.load).breakpoints) for link in mechanism.links]
    joined = tuple((closure.name, *closure.bodies) for closure in mechanism.closures)
    placed = tuple((name, *position) for name, position in mechanism.assembled.items())
    sampled = tuple((at.name, at.period, at.output, at.law) for at in mechanism.controllers)
    touching = tuple(contact.digest for contact in mechanism.contacts)
    return names, tuple(acting), joined, placed, sampled, touching


@cache
def _fields_of(kind: Any) -> tuple[tuple[str, bytes], ...] | None:
    """Return the names of a dataclass's fields that count; None for another type."""
    if not is_dataclass(kind):
        return None
    return tuple((field.name, field.name.encode()) for field in fields(kind) if field.name not in _NAMES)


@cache
def _describe_array(shape: tuple[int, ...], dtype: Any) -> bytes:
    return f"{shape}{dtype}".encode()


def _add(pieces: list[bytes], inputs: Coordinates, value: Any) -> None:
    """Add a value's bytes, with its type and shape where another could have the same ones."""
    if value.__class__ in _PLAIN:
        pieces.append(f"{value!r};".encode())
    elif isinstance(value, np.ndarray):
        pieces += (_describe_array(value.shape, value.dtype), value.tobytes())
    elif isinstance(value, Signal):  # an input's number, or a constant; None for the load of a prescribed joint
        number = inputs.signals.index(value) if value in inputs.signals else constant_value(value)
        pieces.append(f"signal {number!r};".encode())
    elif (names := _fields_of(value.__class__)) is not None:
        for name, piece in names:
            pieces.append(piece)
            _add(pieces, inputs, getattr(value, name))
    elif isinstance(value, Mapping):
        _add(pieces, inputs, list(value.values()))
    elif isinstance(value, Sequence) and not isinstance(value, str):
        pieces.append(f"[{len(value)}".encode())
        for item in value:
            _add(pieces, inputs, item)
    else:
        pieces.append(f"{value!r};".encode())
