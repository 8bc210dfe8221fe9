"""Inputs and outputs of a linear model: what acts on a mechanism, and what is observed of it."""

from dataclasses import field

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.reduction.body import MarkerShapes

Direction = tuple[float, float, float]


@dataclass(frozen=True)
class Port:
    """An input or an output."""

    name: str  # e.g. ``plate.tip.z``
    unit: str  # SI
    # Of an output: 0 for a displacement, 1 for its rate, 2 for its acceleration.
    order: int = field(default=0, kw_only=True)


@dataclass(frozen=True)
class MarkerPort(Port):
    """Force on a marker or its displacement along a direction; moment and rotation if it turns."""

    body: int  # number of the body
    # The marker in the body's frame; what it consists of doesn't count in comparisons.
    marker: MarkerShapes = field(compare=False, repr=False)
    direction: Direction  # unit vector in space
    turns: bool  # moment and rotation


@dataclass(frozen=True)
class JointPort(Port):
    """Torque or force along a joint with one coordinate, or its position, by the number of the body it carries."""

    body: int


@dataclass(frozen=True)
class LoadPort(Port):
    """Size of one of the mechanism's loads at points, by its number."""

    number: int


@dataclass(frozen=True)
class MotionPort(Port):
    """Acceleration of a prescribed joint, by the number of the body it carries."""

    body: int


@dataclass(frozen=True)
class GroundPort(Port):
    """Acceleration of the ground; what is observed then moves against the ground."""

    direction: Direction


@dataclass(frozen=True)
class ModalPort(Port):
    """A linear function of a body's modal coordinates, such as a component of stress."""

    body: int  # number of the body
    row: Array = field(compare=False, repr=False)  # (n_modes,): its value for unit modal coordinates
