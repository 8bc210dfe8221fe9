"""Pieces of a force law, on each of which it is smooth."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from fmd.dynamics.force_laws import ForceLaw
from fmd.dynamics.formula_pieces import LawPieces, divide_formula


@lru_cache(maxsize=64)
def find_pieces(law: ForceLaw) -> LawPieces:
    """Find the pieces of a law: between the knots of its table, about its stops, and where its formula is smooth."""
    of_formula = divide_formula(law.curve.formula) if law.curve.formula is not None else LawPieces(np.zeros(0))
    stops = [place for stop in law.stops for place in (stop.at, stop.at + stop.side * stop.width)]
    knots = [bend.at for bend in law.curve.bends if bend.weight]
    return LawPieces(np.array(sorted({*of_formula.edges.tolist(), *stops, *knots})), of_formula.beyond)
