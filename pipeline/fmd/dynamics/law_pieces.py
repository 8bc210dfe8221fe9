"""Pieces of force laws, on each of which a law is smooth, and the laws whose pieces a step may miss."""

from functools import lru_cache

import numpy as np

from fmd.core.data_classes import dataclass
from fmd.dynamics.elements import PointSpring
from fmd.dynamics.force_laws import ForceLaw
from fmd.dynamics.formula_pieces import LawPieces, divide_formula
from fmd.dynamics.mechanism import Mechanism


@lru_cache(maxsize=64)
def find_pieces(law: ForceLaw) -> LawPieces:
    """Find the pieces of a law: between the knots of its table, about its stops, and where its formula is smooth."""
    of_formula = divide_formula(law.curve.formula) if law.curve.formula is not None else LawPieces(np.zeros(0))
    stops = [place for stop in law.stops for place in (stop.at, stop.at + stop.side * stop.width)]
    knots = [bend.at for bend in law.curve.bends if bend.weight]
    return LawPieces(np.array(sorted({*of_formula.edges.tolist(), *stops, *knots})), of_formula.beyond)


@dataclass(frozen=True)
class PiecewiseLaw:
    """A force law with short pieces."""

    name: str
    law: ForceLaw
    pieces: LawPieces
    holder: PointSpring | int  # the spring, or the number of the body whose joint has the law
    unit: str


def find_piecewise_laws(mechanism: Mechanism) -> tuple[PiecewiseLaw, ...]:
    """Find the force laws of joints and springs that have short pieces; prescribed joints feel none."""
    laws: list[tuple[str, ForceLaw, PointSpring | int, str]] = []
    for number, link in enumerate(mechanism.links):
        if link.unit and link.motion is None:
            laws += [(f"joint {link.joint_name or link.name}", law, number, link.unit) for law in link.laws]
    springs = (element for element in mechanism.elements if isinstance(element, PointSpring))
    laws += [(f"spring {element.name}", element.law, element, "m") for element in springs]
    found = (PiecewiseLaw(name, law, find_pieces(law), holder, unit) for name, law, holder, unit in laws)
    return tuple(law for law in found if law.pieces.are_short)
