"""Random scenes that touch, against finer marches and a model of their own; `benchmarks/contact.py` has a hundred.

Seeds are chosen: quick ones whose bodies touch, 36, whose step is halved as Newton's iteration fails, and 54, whose
slip in two marches agrees by chance, as the largest forces of 3312 do; in 78 points slip for a single step, and 3308
gained 1.2 % where its steps might make 1 %. Pairs and loops are longer, of strikers most pass beside the nodes.
"""

import importlib
from pathlib import Path
from typing import Any

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
SEEDS = {
    "drop": (36, 72, 3312),
    "hinge": (16,),
    "loop": (3308,),
    "slide": (54, 66, 78),
    "pin": (45,),
    "bore": (23,),
    "boxes": (19,),
    "striker": (70,),
    "ball": (1,),
    "balls": (3,),
    "box": (5,),
}


@pytest.fixture
def judge(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    monkeypatch.setattr(importlib.import_module("contact_reference"), "STEPS", 500)
    return importlib.import_module("contact").judge


# Two boxes take as long as all others, and no way of their own; `test_boxes.py` has such.
LONG = "boxes", "loop"


@pytest.mark.parametrize("kind", [pytest.param(kind, marks=[pytest.mark.long] * (kind in LONG)) for kind in SEEDS])
def test_no_figure_of_a_random_contact_is_beyond_three_times_what_is_stated(judge: Any, kind: str) -> None:
    """Energy with friction's and damping's heat grows by 1 % of the largest kinetic energy at most."""
    for seed in SEEDS[kind]:
        row = judge(seed)
        assert (row.kind, row.outcome, row.contacts) == (kind, "compared", 1), row
        assert row.figures == 10, row
        assert row.wrong == 0, row
        assert row.growth < 0.01, row
