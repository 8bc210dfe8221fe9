"""Digest of a mechanism's constants, by which its machine code is kept: reading it back needs no tracing."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from pipeline.dynamics.closures import Coupler
from pipeline.dynamics.compiler.coordinates import Coordinates, constant_value
from pipeline.dynamics.signals.signal import Signal

_NAMES = {"name", "joint_name", "section"}
"""Fields that are in no equation."""


def digest_mechanism(inputs: Coordinates) -> str:
    """Return the digest of all that a mechanism's functions are traced from; varying signals are inputs of these."""
    mechanism, digest = inputs.mechanism, hashlib.blake2b(digest_size=16)
    numbers = {link.name: number for number, link in enumerate(mechanism.links)}
    _update(digest, inputs, [mechanism.links, mechanism.layout, mechanism.gravity])
    for load in mechanism.loads:
        _update(digest, inputs, [numbers[load.body], load])
    for element in mechanism.elements:
        _update(digest, inputs, [[numbers.get(end.body, -1) for end in element.ends], type(element).__name__, element])
    for closure in mechanism.closures:
        if isinstance(closure, Coupler):
            _update(digest, inputs, [[numbers[body] for body in closure.joints], closure.factors, closure.offset])
        else:
            places = [numbers.get(place.body, -1) for place in (closure.first, closure.second)]
            _update(digest, inputs, [places, closure])
    return digest.hexdigest()


def _update(digest: Any, inputs: Coordinates, value: Any) -> None:
    """Add a value, with its type and shape where another could have the same bytes."""
    if isinstance(value, Signal):
        value = inputs.signals.index(value) if value in inputs.signals else constant_value(value)
        value = ("signal", value)  # an input's number, or a constant; None for the load of a prescribed joint
    if isinstance(value, np.ndarray):
        digest.update(f"{value.shape}{value.dtype}".encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    elif is_dataclass(value):
        for field in fields(value):
            if field.name not in _NAMES and field.name != "body":
                digest.update(field.name.encode())
                _update(digest, inputs, getattr(value, field.name))
    elif isinstance(value, Mapping):
        _update(digest, inputs, list(value.values()))
    elif isinstance(value, Sequence) and not isinstance(value, str):
        digest.update(f"[{len(value)}".encode())
        for item in value:
            _update(digest, inputs, item)
    else:
        digest.update(f"{value!r};".encode())
