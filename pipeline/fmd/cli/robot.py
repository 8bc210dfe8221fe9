"""A robot as a file of URDF or MJCF describes it: links with inertia and shapes, joints, and what else it holds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import field
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError


@dataclass(frozen=True)
class Pose:
    """Place and axes in the frame of something else: position (3,) [m] and rotation (3, 3)."""

    at: Array = field(default_factory=lambda: np.zeros(3))
    axes: Array = field(default_factory=lambda: np.eye(3))

    def then(self, other: Pose) -> Pose:
        """Return a pose that is given in this one."""
        return Pose(self.at + self.axes @ other.at, self.axes @ other.axes)


@dataclass(frozen=True)
class Shape:
    """Shape of a link: ``box``, ``cylinder``, ``sphere`` or ``mesh``, with its sizes [m], or file and scale."""

    kind: str
    pose: Pose
    size: tuple[float, ...] = ()
    file: str = ""
    scale: tuple[float, ...] = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class RobotLink:
    """A link: mass [kg], centre of mass (3,) [m] and inertia about it (3, 3) [kg m²] in the link's axes, and shapes."""

    name: str
    mass: float
    centre: Array
    inertia: Array
    visuals: tuple[Shape, ...] = ()
    collisions: tuple[Shape, ...] = ()


@dataclass(frozen=True)
class RobotJoint:
    """A joint: where it is on its parent, its axis there, and numbers of its table, by their keys.

    ``spring`` and ``rest`` are stiffness [N m/rad or N/m] and the position at which it pulls nowhere [rad or m].
    """

    name: str
    kind: str
    parent: str
    child: str
    pose: Pose
    axis: Array
    limits: dict[str, float]
    damping: float = 0.0
    friction: float = 0.0
    mimic: tuple[str, float, float] | None = None
    spring: float = 0.0
    rest: float = 0.0


@dataclass(frozen=True)
class Robot:
    """A robot: links and joints by name, the link that nothing carries, gravity [m/s²] and what a scene can't hold."""

    name: str
    links: dict[str, RobotLink]
    joints: dict[str, RobotJoint]
    root: str
    notes: tuple[str, ...]
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)


def read_xml(path: Path) -> ElementTree.Element:
    """Return the first element of an XML file; raises ``InputError`` where it can't be read."""
    try:
        return ElementTree.parse(path).getroot()
    except OSError as error:
        raise InputError(str(path), "", None, f"can't be read: {error.strerror or error}") from None
    except ElementTree.ParseError as error:
        raise InputError(str(path), "", None, f"is no XML: {error}") from None


def read_robot_xml(path: Path, tag: str, what: str) -> ElementTree.Element:
    """Return the first element of a robot's file.

    Raises
    ------
    InputError
        The file can't be read, or its first element isn't ``tag``.
    """
    top = read_xml(path)
    if top.tag != tag:
        raise InputError(str(path), top.tag, None, f"is no {what}, whose first element is <{tag}>")
    return top


@contextmanager
def naming(path: Path, what: str) -> Iterator[None]:
    """Name the file and the innermost element at fault."""
    try:
        yield
    except KeyError as error:
        raise InputError(str(path), what, None, f"has an element without its {error}") from None
    except ValueError as error:
        raise InputError(str(path), what, None, f"can't be read: {error}") from None


def read_numbers(text: str | None, default: str) -> Array:
    """Return as many finite numbers as a default has; raises ``ValueError`` for others."""
    values = read_list(text or default)
    if len(values) != len(default.split()):
        raise ValueError(f"{text!r} where {len(default.split())} numbers belong")
    return np.array(values)


def read_list(text: str) -> list[float]:
    """Return finite numbers, however many; raises ``ValueError`` for others."""
    values = [float(word) for word in text.split()]
    if not np.isfinite(values).all():
        raise ValueError(f"{text!r} where finite numbers belong")
    return values


def read_number(given: Mapping[str, str], key: str, default: str | None = None, least: float = -np.inf) -> float:
    """Return a finite number of an element, by default or, without one, required.

    Raises
    ------
    KeyError
        It isn't there and has no default.
    ValueError
        It is no finite number, or below ``least``.
    """
    text = given[key] if default is None else given.get(key, default)
    try:
        (value,) = read_list(text)
    except ValueError:
        raise ValueError(f"{key} {text!r} is not one finite number") from None
    if value < least:
        raise ValueError(f"{key} {text!r} is below {least:g}")
    return value
