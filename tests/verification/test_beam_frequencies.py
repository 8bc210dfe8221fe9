"""The paper's beam against the paper's Table 1, beam theory and a second mesh of another kind."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene

# Miao, Zhu, Shi, Chen, Comput Mech 41 (2008), Table 1: the first five in-plane bending frequencies [Hz]. They belong to
# a free beam of 340 mm, although the paper prints 300 mm.
TABLE_1 = [131.2, 349.3, 653.9, 1025.3, 1444.5]
# The README's figures for the printed length; Timoshenko's theory stands by them in a test of its own.
PRINTED_LENGTH = [167.4, 442.6, 822.0, 1276.5, 1784.1]


@pytest.fixture(scope="module")
def beam() -> Pipeline:
    return Pipeline(load_scene("beam-paper"))


def test_the_beam_has_the_frequencies_of_table_1(beam: Pipeline) -> None:
    assert beam.modes.frequencies_hz == pytest.approx(TABLE_1, rel=0.005)
    assert beam.modes.n_rigid == 6


@pytest.mark.parametrize("length", [0.34, 0.3])
def test_the_beam_has_timoshenkos_frequencies(length: float, timoshenko: Callable[..., Any]) -> None:
    run = Pipeline(load_scene("beam-paper", [f"body.beam.length={length * 1e3:g}mm"]))
    part = run.scene.body["beam"]
    theory = timoshenko(length, part.depth, part.width, run.fe.material).frequencies_hz(5)
    assert run.modes.frequencies_hz == pytest.approx(theory, rel=0.005)


def test_a_beam_of_the_printed_length_has_not_the_frequencies_of_table_1() -> None:
    # by Euler and Bernoulli f ~ 1/L²: (340/300)² = 1.28 times as high, somewhat less with shear
    found = Pipeline(load_scene("beam-paper", ["body.beam.length=300mm"])).modes.frequencies_hz
    assert found == pytest.approx(PRINTED_LENGTH, rel=0.005)
    assert found[0] / TABLE_1[0] == pytest.approx((340 / 300) ** 2, rel=0.01)
    assert (found / TABLE_1).min() > 1.2


def test_tetrahedra_give_the_same_frequencies(beam: Pipeline) -> None:
    mesh = 'body.beam.mesh={element = "tetrahedron", size = "8 mm", order = 2}'
    found = Pipeline(load_scene("beam-paper", [mesh])).modes.frequencies_hz
    assert found == pytest.approx(beam.modes.frequencies_hz, rel=0.003)


def test_the_beam_swings_about_its_hub_as_if_pinned(beam: Pipeline, timoshenko: Callable[..., Any]) -> None:
    # five shapes are too few for the exact pinned frequencies, and by Rayleigh and Ritz never below them
    part = beam.scene.body["beam"]
    theory = timoshenko(part.length, part.depth, part.width, beam.fe.material).frequencies_hz(5, pinned=True)
    found = beam.body.frequencies_hz
    assert (found > theory).all()
    assert found == pytest.approx(theory, rel=0.025)
    assert found[0] == pytest.approx(theory[0], rel=0.002)
    assert beam.body.coupling < 1e-8


def test_the_results_do_not_depend_on_the_unit_of_length(beam: Pipeline) -> None:
    sizes = ["body.beam.length=0.34m", "body.beam.depth=2.5cm", "body.beam.width=10000um"]
    again = Pipeline(load_scene("beam-paper", sizes))
    assert np.abs(again.modes.frequencies_hz / beam.modes.frequencies_hz - 1).max() < 1e-9
