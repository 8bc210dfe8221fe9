"""Pieces of force laws: short about what is narrow, none where a law is smooth; and the work over them."""

import numpy as np
import pytest
from scipy.integrate import quad

from fmd.core.formula import parse_formula
from fmd.dynamics.force_laws import ForceCurve, ForceLaw, Stop, straight_curve
from fmd.dynamics.law_pieces import find_pieces


def law_of(formula: str) -> ForceLaw:
    return ForceLaw(ForceCurve(formula=parse_formula(formula, "x")))


@pytest.mark.parametrize("formula", ["2000*x", "2000*x + 5e5*x**3", "1e3*abs(x)", "100*x**5", "500"])
def test_a_law_without_a_narrow_feature_bounds_no_step(formula: str) -> None:
    assert not find_pieces(law_of(formula)).are_short


@pytest.mark.parametrize(
    ("shape", "place", "width"),
    [
        ("exp(-((x-(P))/W)**2)", -0.07, 1e-5),
        ("1/(1+((x-(P))/W)**2)", 1e-4, 3e-6),
        ("max(0,1-abs(x-(P))/W)", 0.3, 2e-4),
        ("tanh((x-(P))/W)", 40.0, 0.01),
    ],
)
def test_pieces_are_as_short_as_what_is_narrow(shape: str, place: float, width: float) -> None:
    law = law_of("50*x + 1000*" + shape.replace("P", f"{place}").replace("W", f"{width}"))
    edges = find_pieces(law).edges
    about = np.diff(edges)[(edges[1:] > place - 0.5 * width) & (edges[:-1] < place + 0.5 * width)]
    assert len(about)
    assert about.max() < 4 * width
    assert len(edges) < 100


def test_knots_of_a_table_and_widths_of_stops_are_pieces() -> None:
    law = ForceLaw(
        straight_curve([0.0, 0.1, 0.2, 0.3], [0.0, 1.0, 0.0, 0.0]), stops=(Stop(-0.4, -1.0, 1e4, 0.0, 1e-3),)
    )
    assert find_pieces(law).edges == pytest.approx([-0.401, -0.4, 0.1, 0.2])
    assert not find_pieces(ForceLaw(straight_curve([0.0, 0.1, 0.2], [0.0, 1.0, 0.0]))).are_short  # one bend


def test_waves_without_end_are_pieces_beyond_those_that_are_listed() -> None:
    pieces = find_pieces(law_of("sin(1000*x)"))
    assert pieces.beyond < 2 * np.pi / 1000 * 1.5
    assert np.diff(pieces.edges).max() < 2 * np.pi / 1000 * 1.5


@pytest.mark.parametrize(
    "formula",
    ["10*x + 1000*exp(-((x-0.3)/0.0002)**2)", "0 if x < 0.3 else 625 if x < 0.3002 else 0", "1/(1+x)**2", "exp(9*x)"],
)
def test_the_work_over_a_way_is_its_integral(formula: str) -> None:
    law = law_of(formula)
    found = np.diff(law.energies(np.array([-0.2, 0.7])))[0]
    force = lambda x: float(law.forces(np.array([x]), np.zeros(1))[0])  # noqa: E731
    ways = [(-0.2, 0.299), (0.299, 0.3), (0.3, 0.3002), (0.3002, 0.302), (0.302, 0.7)]
    exact = sum(quad(force, *way, epsabs=1e-12, epsrel=1e-10)[0] for way in ways)
    assert found == pytest.approx(exact, rel=1e-6)


def test_energies_are_zero_at_rest_and_pass_ranges_without_values() -> None:
    for text, at, exact in (
        ("exp(9*x)", 0.5, np.expm1(4.5) / 9),
        ("sqrt(x)", 0.49, 0.343 * 2 / 3),
        ("1/(1+x)**2", -0.9, -9.0),
        ("100*exp(-((x+0.4)/0.001)**2)", -2.0, -0.1 * np.sqrt(np.pi)),
    ):
        assert law_of(text).energies(np.array([0.0, at])) == pytest.approx([0.0, exact], rel=1e-7, abs=1e-12), text
