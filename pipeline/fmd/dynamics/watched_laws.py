"""Force laws of a mechanism that a step may pass unseen: which they are, and the pieces of each."""

from __future__ import annotations

from dataclasses import dataclass

from fmd.dynamics.elements import PointSpring
from fmd.dynamics.force_laws import ForceLaw
from fmd.dynamics.formula_pieces import LawPieces
from fmd.dynamics.law_pieces import find_pieces
from fmd.dynamics.mechanism import Mechanism


@dataclass(frozen=True)
class WatchedLaw:
    """A force law with short pieces.

    Attributes
    ----------
    name : str
        What it is of, for messages.
    law : ForceLaw
        The law.
    pieces : LawPieces
        Its pieces.
    holder : PointSpring or int
        The spring, or the number of the body whose joint has the law.
    unit : str
        Unit of its elongation.
    """

    name: str
    law: ForceLaw
    pieces: LawPieces
    holder: PointSpring | int
    unit: str


def find_watched(mechanism: Mechanism) -> tuple[WatchedLaw, ...]:
    """Find the force laws of joints and springs that have short pieces; prescribed joints feel none."""
    laws: list[tuple[str, ForceLaw, PointSpring | int, str]] = []
    for number, link in enumerate(mechanism.links):
        if link.unit and link.motion is None:
            laws += [(f"joint {link.joint_name or link.name}", law, number, link.unit) for law in link.laws]
    springs = (element for element in mechanism.elements if isinstance(element, PointSpring))
    laws += [(f"spring {element.name}", element.law, element, "m") for element in springs]
    found = (WatchedLaw(name, law, find_pieces(law), holder, unit) for name, law, holder, unit in laws)
    return tuple(watched for watched in found if watched.pieces.are_short)
