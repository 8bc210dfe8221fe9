"""Functions of time: their values against Python and SciPy, their derivatives against Cauchy's integral."""

import cmath
import ctypes
import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.interpolate import CubicSpline

from fmd.core.formula import parse_formula
from fmd.core.limits.scene import MOST_DEPTH
from fmd.dynamics.compiler.signal_code import trace_signals
from fmd.dynamics.signals.signal import (
    Signal,
    constant,
    formula,
    half_sine,
    linear_table,
    smooth_table,
    total,
)
from tests.dynamics.compiler.comparison import load_code

# Kane, Ryan & Banerjee, J Guid Control Dyn 10 (1987) 139-151: the spin-up of a beam to 6 rad/s in 15 s
KANE = "(6/15)*(t**2/2 + (15/(2*pi))**2*(cos(2*pi*t/15) - 1)) if t < 15 else 6*t - 45"


class Instant(complex):
    """A complex time, of which a condition compares the real part."""

    def __lt__(self, other: float) -> bool:
        return self.real < other

    def __le__(self, other: float) -> bool:
        return self.real <= other

    def __gt__(self, other: float) -> bool:
        return self.real > other

    def __ge__(self, other: float) -> bool:
        return self.real >= other


COMPLEX: dict[str, object] = {n: getattr(cmath, n) for n in ("sin", "cos", "tan", "exp", "log", "sqrt", "tanh", "pi")}
COMPLEX["abs"] = lambda z: z if z.real >= 0 else -z
COMPLEX["min"] = lambda a, b: b if b.real < a.real else a
COMPLEX["max"] = lambda a, b: b if b.real > a.real else a


def by_cauchy(text: str, t: float, radius: float = 0.02, count: int = 16) -> tuple[float, float, float]:
    """Value and two derivatives of an analytic function from its values on a circle about t, by Python's own eval."""
    turns = [cmath.exp(2j * math.pi * k / count) for k in range(count)]
    values = [complex(eval(text, {"__builtins__": {}}, {"t": Instant(t + radius * z), **COMPLEX})) for z in turns]
    f, f1, f2 = (sum(v * z**-k for v, z in zip(values, turns, strict=True)) / (count * radius**k) for k in range(3))
    return f.real, f1.real, 2.0 * f2.real


def of(text: str, t: float) -> tuple[float, float, float]:
    return formula(parse_formula(text)).value(t)


def only_value(made: Signal, t: float) -> float:
    return made.value(t)[0]


def compiled(signals: Sequence[Signal], times: Sequence[float]) -> np.ndarray:
    """Value and derivatives of signals by their machine code, shape (n_times, n_signals, 3)."""
    loaded = load_code(trace_signals(signals))
    call = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(loaded.address("signals"))
    out = np.full((len(times), len(signals), 3), np.nan)
    for t, row in zip(times, out, strict=True):
        call(np.array([float(t)]).ctypes.data, row.ctypes.data)
    return out


ANALYTIC = [
    *("3", "t", "-t", "+t", "t + sin(t)", "2 - t", "t - exp(t)", "t*sin(t)", "sin(t)*exp(t)", "3*t", "t*3"),
    *("sin(t)/t", "3/t", "t/3", "exp(t)/(1 + t*t)", "sin(3*t)", "cos(3*t)", "tan(t/2)", "exp(-2*t)", "log(2*t)"),
    *("sqrt(3*t)", "tanh(2*t)", "abs(sin(t))", "abs(-t)", "abs(2 - t*t)", "min(t, 9*t*t)", "min(9*t, t*t)"),
    *("max(t, 9*t*t)", "max(9*t, t*t)", "t**2", "t**3", "t**7", "t**0", "t**1", "t**-1", "t**-2", "t**0.5", "t**2.5"),
    *(
        "(-t)**3",
        "(-t)**-2",
        "sin(t)**2",
        "2**t",
        "t**t",
        "(1 + t)**sin(t)",
        "t**(2 if t < 100 else 3)",
        "(2 + t)**t**2",
    ),
    *("sin(t) if t < 100 else t", "sin(t) if t > 100 else t*t", "t**3 if t <= 0.5 else cos(t) if t < 1 else exp(t)"),
    *("1.5*sin(2*pi*10*t)*exp(-t/0.2)", "exp(sin(3*t))*tanh(t)/sqrt(1 + t**2)", KANE),
]


@pytest.mark.parametrize("text", ANALYTIC)
@pytest.mark.parametrize("t", [0.3, 0.9, 1.7])
def test_derivatives_of_every_operation_are_those_of_cauchys_integral(text: str, t: float) -> None:
    expected = by_cauchy(text, t)
    assert of(text, t) == pytest.approx(expected, rel=1e-9, abs=1e-9 * max(map(abs, expected)))
    assert only_value(formula(parse_formula(text)), t) == of(text, t)[0]


def combined(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    one = ["-({})", "sin({})", "cos({})", "tan(sin({}))", "exp(sin({}))", "log(2 + sin({}))", "sqrt(2 + cos({}))"]
    one += ["tanh(sin({}))", "({})**2", "sin({})**3", "(2 + sin({}))**-1.5", "2**cos({})"]
    two = ["({} + {})", "({} - {})", "({})*({})", "({})/(2 + sin({}))", "(2 + sin({}))**cos({})"]
    two += ["({} if t < -0.5 else {})", "({} if t >= 1/4 else {})", "({} if 1 < t else {})"]
    return st.one_of(
        st.builds(str.format, st.sampled_from(one), inner),
        st.builds(str.format, st.sampled_from(two), inner, inner),
    )


FORMULAS = st.recursive(st.sampled_from(["t", "t", "pi", "0.5", "2"]), combined, max_leaves=7)


@given(FORMULAS, st.floats(-2.0, 2.0), st.sampled_from([1.0, -2.5]))
def test_derivatives_of_any_formula_are_those_of_cauchys_integral(text: str, t: float, factor: float) -> None:
    assume(len(text) <= 500 and min(abs(t - c) for c in (-0.5, 0.25, 1.0)) > 0.02)
    expected = np.array(by_cauchy(text, t, 0.01))
    finer = np.array(by_cauchy(text, t, 0.005))
    scale = 1.0 + np.abs(expected).max()
    assume(np.abs(expected - finer).max() < 1e-8 * scale)  # else a pole is near, or the function turns too fast
    made = formula(parse_formula(text), factor)
    assert made.value(t) == pytest.approx(tuple(factor * finer), rel=1e-7, abs=3e-8 * scale)
    assert only_value(made, t) == made.value(t)[0]


@pytest.mark.parametrize(
    ("text", "t", "expected"),
    [
        # powers at 0: polynomials
        ("t**2", 0.0, (0.0, 0.0, 2.0)),
        ("t**1", 0.0, (0.0, 1.0, 0.0)),
        ("t**0", 0.0, (1.0, 0.0, 0.0)),
        ("t**3", 0.0, (0.0, 0.0, 0.0)),
        ("(t - 1)**2", 1.0, (0.0, 0.0, 2.0)),
        ("(2*t + t*t)**2", 0.0, (0.0, 0.0, 8.0)),
        ("(-t)**3", 2.0, (-8.0, -12.0, -12.0)),
        ("t**2.5", 0.0, (0.0, 0.0, 0.0)),
        # a constant stays one, where the derivative of the root or of the power about it is infinite
        ("sqrt(max(t - 1, 0))", 0.5, (0.0, 0.0, 0.0)),
        ("max(t - 1, 0)**0.5", 0.5, (0.0, 0.0, 0.0)),
        ("max(t - 1, 0)**1.5", 0.5, (0.0, 0.0, 0.0)),
        ("max(t - 1, 0)**1.5", 2.0, (1.0, 1.5, 0.75)),
        # kinks: abs as after them, min and max as their first argument
        ("abs(t)", 0.0, (0.0, 1.0, 0.0)),
        ("abs(t)", -0.5, (0.5, -1.0, 0.0)),
        ("min(t, 3*t)", 0.0, (0.0, 1.0, 0.0)),
        ("max(3*t, t)", 0.0, (0.0, 3.0, 0.0)),
        # only what holds is looked at
        ("sqrt(1 - t) if t < 1 else 0*t", 2.0, (0.0, 0.0, 0.0)),
        ("1/t if t > 0 else 5", 0.0, (5.0, 0.0, 0.0)),
    ],
)
def test_edges_have_the_values_of_closed_forms(text: str, t: float, expected: tuple[float, ...]) -> None:
    assert of(text, t) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "t"),
    [
        ("sqrt(t)", -1.0),
        ("log(t)", -1.0),
        ("log(t)", 0.0),
        ("1/t", 0.0),
        ("t**0.5", -1.0),
        ("(t - 2)**t", 1.5),
        *((f"{name}({text})", -1.0) for name in ("min", "max") for text in ("log(t), 5", "5, log(t)", "-5, sqrt(t)")),
    ],
)
def test_what_has_no_real_value_is_not_finite_and_does_not_get_lost(text: str, t: float) -> None:
    assert not math.isfinite(of(text, t)[0])
    assert not math.isfinite(only_value(formula(parse_formula(text)), t))


@pytest.mark.parametrize(("text", "t"), [("sqrt(t)", 0.0), ("t**0.5", 0.0), ("(t - 2)**t", 1.0), ("0**(1 + t)", 0.5)])
def test_a_load_may_stand_where_a_motion_has_no_derivative(text: str, t: float) -> None:
    assert math.isfinite(only_value(formula(parse_formula(text)), t))
    assert not math.isfinite(of(text, t)[1])


def test_the_spin_up_of_kanes_beam_has_its_published_rate_and_settles_at_it() -> None:
    w = 2 * math.pi / 15
    for t in (0.0, 2.0, 7.5, 14.999):
        _, rate, acceleration = of(KANE, t)
        assert rate == pytest.approx(0.4 * (t - math.sin(w * t) / w), rel=1e-13, abs=1e-15)
        assert acceleration == pytest.approx(0.4 * (1 - math.cos(w * t)), rel=1e-11, abs=1e-15)
    assert of(KANE, math.nextafter(15.0, 0.0)) == pytest.approx(of(KANE, 15.0), abs=1e-12)
    assert of(KANE, 20.0) == pytest.approx((75.0, 6.0, 0.0), rel=1e-15)
    assert formula(parse_formula(KANE)).breakpoints == (15.0,)


@pytest.mark.parametrize("sign", ["<", "<=", ">", ">="])
def test_a_condition_switches_all_three_on_its_side(sign: str) -> None:
    text = f"t*t if t {sign} 0.5 else 7"
    for t in (math.nextafter(0.5, 0.0), 0.5, math.nextafter(0.5, 1.0)):
        before = eval(f"t {sign} 0.5", {"t": t})
        assert of(text, t) == ((t * t, 2 * t, 2.0) if before else (7.0, 0.0, 0.0))


def test_a_formula_may_fill_the_stack() -> None:
    text = "t*t+(" * (MOST_DEPTH - 2) + "t*t" + ")" * (MOST_DEPTH - 2)
    made = formula(parse_formula(text), 2.0)
    assert made.value(3.0) == (18.0 * (MOST_DEPTH - 1), 12.0 * (MOST_DEPTH - 1), 4.0 * (MOST_DEPTH - 1))
    with pytest.raises(ValueError, match="needs 17 values"):
        parse_formula(f"t+({text})")


def test_the_square_of_a_half_sine_has_its_impulse_and_no_kink() -> None:
    made, times = half_sine(0.2, 0.5, 3.0, power=2), np.linspace(0.0, 1.0, 10_001)
    values = made.values(times)
    inside = (times > 0.2) & (times < 0.7)
    np.testing.assert_allclose(values[:, 0], inside * 3.0 * np.sin(np.pi * (times - 0.2) / 0.5) ** 2, atol=1e-12)
    assert np.trapezoid(values[:, 0], times) == pytest.approx(0.5 * 3.0 * 0.5, rel=1e-7)
    assert np.abs(np.diff(values[:, 1])).max() < 0.1  # of a rate of 19 N m/s


def test_a_half_sine_is_its_closed_form_and_nothing_outside() -> None:
    made = half_sine(0.2, 0.5, 3.0)
    rate = math.pi / 0.5
    for t in np.linspace(0.2, 0.7, 11):
        s, c = math.sin(rate * (t - 0.2)), math.cos(rate * (t - 0.2))
        assert made.value(t) == pytest.approx((3 * s, 3 * rate * c, -3 * rate**2 * s), rel=1e-12, abs=1e-12)
    for t in (-1.0, math.nextafter(0.2, 0.0), math.nextafter(0.7, 1.0), 5.0):
        assert made.value(t) == (0.0, 0.0, 0.0)
        assert only_value(made, t) == 0.0
    assert made.breakpoints == (0.2, 0.7)
    # its impulse, 2/π · peak · duration
    assert quad(lambda t: only_value(made, t), 0.2, 0.7)[0] == pytest.approx(2 / math.pi * 3.0 * 0.5, rel=1e-12)


def samples(count: int = 9) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    return np.cumsum(rng.uniform(0.1, 1.0, count)) - 1.0, rng.normal(size=count)


@pytest.mark.parametrize("count", [2, 3, 9])
def test_a_table_of_straight_lines_is_numpys_and_holds_at_its_ends(count: int) -> None:
    times, values = samples(count)
    made = linear_table(times, values)
    everywhere = np.sort(np.concatenate([np.linspace(times[0] - 1, times[-1] + 1, 101), times]))
    assert made.values(everywhere)[:, 0] == pytest.approx(np.interp(everywhere, times, values), rel=1e-13)
    for k in range(count - 1):
        slope = (values[k + 1] - values[k]) / (times[k + 1] - times[k])
        assert made.value(0.5 * (times[k] + times[k + 1]))[1:] == pytest.approx((slope, 0.0), rel=1e-14)
    assert made.value(times[0] - 1.0) == (values[0], 0.0, 0.0)
    assert made.value(times[-1] + 1.0) == (values[-1], 0.0, 0.0)
    assert made.breakpoints == tuple(times)


def test_a_table_breaks_only_where_its_slope_changes() -> None:
    made = linear_table(np.array([0.0, 1.0, 2.0, 3.0, 4.0]), np.array([5.0, 5.0, 6.0, 7.0, 7.0]))
    assert made.breakpoints == (1.0, 3.0)


@pytest.mark.parametrize("count", [2, 3, 9])
def test_a_smooth_table_is_scipys_clamped_spline_and_at_rest_outside(count: int) -> None:
    times, values = samples(count)
    made, spline = smooth_table(times, values), CubicSpline(times, values, bc_type="clamped")
    for t in np.sort(np.concatenate([np.linspace(times[0], times[-1], 80, endpoint=False), times[:-1]])):
        expected = [float(spline(t, order)) for order in range(3)]
        assert made.value(t) == pytest.approx(expected, rel=1e-12, abs=1e-12)
    for t, value in ((times[0] - 0.5, values[0]), (times[-1], values[-1]), (times[-1] + 0.5, values[-1])):
        assert made.value(t) == (value, 0.0, 0.0)
    assert made.breakpoints == (times[0], times[-1])


def test_a_smooth_table_has_two_continuous_derivatives_inside_and_one_at_its_ends() -> None:
    times, values = samples()
    made = smooth_table(times, values)
    for k, time in enumerate(times):
        before, after = made.value(math.nextafter(time, -9.0)), made.value(time)
        continuous = 3 if 0 < k < len(times) - 1 else 2
        assert before[:continuous] == pytest.approx(after[:continuous], abs=1e-10)
    assert abs(made.value(times[0])[2]) > 1.0  # so its ends are breakpoints


def test_a_table_that_is_zero_beyond_its_ends_jumps_there() -> None:
    times, values = np.array([0.5, 1.0, 2.0]), np.array([3.0, 4.0, -1.0])
    made = linear_table(times, values, "zero")
    everywhere = np.array([-5.0, 0.0, 0.499, 0.5, 0.75, 1.5, 1.999999, 2.0, 7.0])
    expected = np.interp(everywhere, times, values) * ((everywhere >= 0.5) & (everywhere < 2.0))
    assert made.values(everywhere)[:, 0] == pytest.approx(expected, rel=1e-12)
    assert made.breakpoints == (0.5, 1.0, 2.0)
    smooth = smooth_table(times, values, "zero")
    assert smooth.value(0.4) == smooth.value(2.1) == (0.0, 0.0, 0.0)
    assert smooth.value(1.0)[0] == 4.0


@pytest.mark.parametrize("begin", [0.0, 0.3, -0.2])
def test_a_table_that_repeats_is_periodic_up_to_the_end(begin: float) -> None:
    times, values = begin + np.array([0.0, 0.1, 0.25, 0.4]), np.array([1.0, 3.0, -2.0, 1.0])
    everywhere = np.linspace(0.0, 3.0, 1301)
    folded = begin + np.mod(everywhere - begin, 0.4)
    lines = linear_table(times, values, "repeat", 3.0)
    assert lines.values(everywhere)[:, 0] == pytest.approx(np.interp(folded, times, values), abs=1e-12)
    smooth, spline = smooth_table(times, values, "repeat", 3.0), CubicSpline(times, values, bc_type="periodic")
    for order in range(3):
        assert smooth.values(everywhere)[:, order] == pytest.approx(spline(folded, order), rel=1e-9, abs=1e-8)
    assert smooth.breakpoints == ()  # it has two continuous derivatives everywhere
    opened = linear_table(times, np.array([1.0, 3.0, -2.0, 0.5]), "repeat", 3.0)
    join = begin + 0.4 * math.ceil((1.0 - begin) / 0.4)
    assert [round(opened.value(join + step)[0], 5) for step in (-1e-9, 1e-9)] == [0.5, 1.0]
    assert np.isclose(opened.breakpoints, join).any()


def test_a_sum_adds_values_derivatives_and_breakpoints() -> None:
    times, values = samples(4)
    parts = [
        constant(0.5),
        half_sine(0.0, 1.0, 2.0),
        formula(parse_formula("sin(3*t) if t < 0.4 else t"), 1e3),
        smooth_table(times, values),
        linear_table(times, values),
    ]
    made = total(parts)
    for t in (-3.0, -0.2, 0.3, 0.6, 4.0):
        assert made.value(t) == pytest.approx(np.sum([part.value(t) for part in parts], axis=0), rel=1e-14)
        assert only_value(made, t) == made.value(t)[0]
    assert made.breakpoints == tuple(sorted({0.0, 0.4, 1.0, *times}))
    assert total([made, constant(1.0)]).value(0.3)[0] == made.value(0.3)[0] + 1.0
    assert total([]) == Signal(())
    assert total([]).value(1.0) == (0.0, 0.0, 0.0)


def test_machine_code_gives_what_numpy_does() -> None:
    times, values = samples()
    made = [
        *(formula(parse_formula(text), 1.7) for text in ANALYTIC),
        *(
            formula(parse_formula(text))
            for text in ("sin(1e10*t)", "sqrt(max(t - 1, 0))", KANE, "1 if t <= 0.4 else t")
        ),
        linear_table(times, values),
        total([]),
        constant(4.0),
        total([smooth_table(times, values), constant(1.0), formula(parse_formula("2**t"))]),
        half_sine(0.0, 1.0, 2.0),
    ]
    everywhere = [-2.0, 0.0, 0.4, 0.4000001, 1.0, 1.3, 9.0, 20.0, *times]
    found = compiled(made, everywhere)
    for k, one in enumerate(made):
        expected = one.values(np.array(everywhere))
        finite = np.isfinite(expected).all(axis=1)
        assert found[finite, k] == pytest.approx(expected[finite], rel=1e-12, abs=1e-12), k
        assert not np.isfinite(found[~finite, k]).all(axis=1).any(), k


def test_machine_code_of_impulses_alone_is_that_of_numpy_between_and_after_them() -> None:
    made = [half_sine(0.1, 0.2, 2.0), total([half_sine(0.5, 0.1, 3.0), half_sine(0.25, 0.1, -1.0)])]
    times = np.array([0.0, 0.1, 0.15, 0.28, 0.3, 0.4, 0.55, 0.7, np.nextafter(0.5, 0.0)])
    expected = np.stack([one.values(times) for one in made], axis=1)
    assert compiled(made, times.tolist()) == pytest.approx(expected, rel=1e-12, abs=1e-12)
    assert not expected[[0, 5, 7, 8]].any()


@settings(max_examples=30, deadline=None)
@given(text=st.sampled_from(ANALYTIC), other=st.sampled_from(ANALYTIC), operation=st.sampled_from("+-*/"))
def test_machine_code_of_composed_formulas_is_that_of_numpy(text: str, other: str, operation: str) -> None:
    made = formula(parse_formula(f"({text}) {operation} ({other})"))
    times = np.array([0.31, 0.77, 1.9])
    expected, found = made.values(times), compiled([made], times.tolist())[:, 0]
    finite = np.isfinite(expected).all(axis=1)
    assert found[finite] == pytest.approx(expected[finite], rel=1e-10, abs=1e-10)


def test_a_constant_is_one_whatever_it_is_made_of() -> None:
    assert formula(parse_formula("2*pi"), 3.0) == constant(3.0 * (2 * math.pi))
    assert constant(-2).value(7) == (-2.0, 0.0, 0.0)
    assert constant(2.0).breakpoints == ()


def test_signals_can_be_compared_and_hashed() -> None:
    times, values = samples()
    makers: list[Callable[[], Signal]] = [
        lambda: constant(1.0),
        lambda: formula(parse_formula("2*t")),
        lambda: half_sine(0.0, 1.0, 2.0),
        lambda: linear_table(times, values),
        lambda: smooth_table(times, values),
    ]
    assert len({make() for make in makers + makers}) == len(makers)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: constant(math.nan), r"^the constant of a signal is nan, which isn't finite$"),
        (lambda: formula(parse_formula("t"), math.inf), r"^the factor of a signal is inf"),
        (lambda: formula(parse_formula("1e300"), 1e300), r"^the constant of a signal is inf"),
        (lambda: half_sine(math.nan, 1.0, 1.0), r"^the start of a signal is nan"),
        (lambda: half_sine(0.0, math.inf, 1.0), r"^the duration of a signal is inf"),
        (lambda: half_sine(0.0, 1.0, -math.inf), r"^the peak of a signal is -inf"),
        (lambda: half_sine(1.0, 0.0, 1.0), r"^a half sine that begins at 1 s can't last 0 s; give more than 0$"),
        (lambda: half_sine(1.0, -2.0, 1.0), r"can't last -2 s"),
        (lambda: half_sine(1e20, 1.0, 1.0), r"begins at 1e\+20 s can't last 1 s"),
    ],
)
def test_a_signal_that_is_none_is_refused(make: Callable[[], Signal], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("make", [linear_table, smooth_table])
@pytest.mark.parametrize(
    ("times", "values", "message"),
    [
        ([0.0, 1.0, 1.0], [1.0, 2.0, 3.0], r"^the times of a table must ascend, but 1 s comes after 1 s$"),
        ([0.0, 2.0, 1.5], [1.0, 2.0, 3.0], r"but 1.5 s comes after 2 s$"),
        ([0.0, 1.0, 2.0], [1.0, 2.0], r"^values has shape \(2,\), expected \(3\)$"),
        ([[0.0, 1.0]], [1.0, 2.0], r"^times has shape \(1, 2\), expected \(any\)$"),
        ([1.0], [1.0], r"^a table of 1 times is none; give 2 at least, or a constant$"),
        ([], [], r"^a table of 0 times"),
        ([0.0, math.nan], [1.0, 2.0], r"^a table holds a number that isn't finite$"),
        ([0.0, 1.0], [1.0, math.inf], r"^a table holds a number that isn't finite$"),
    ],
)
def test_a_table_that_is_none_is_refused(
    make: Callable[..., Signal], times: list[float], values: list[float], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        make(np.array(times), np.array(values))
