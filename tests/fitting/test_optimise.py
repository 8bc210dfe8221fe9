"""Best designs of a scene: against closed forms, against other designs around them, and what is refused."""

import copy
import csv
import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import fmd as package
from benchmarks.design_grid import ROD, search_grid
from fmd.core import progress
from fmd.core.errors import AccuracyError, InputError
from fmd.fitting import optimise, pareto
from fmd.fitting.designs import DesignSpace
from fmd.fitting.optimise import NoDesignError, Optimum, optimise_scene, read_limits
from fmd.fitting.pareto import find_front
from fmd.fitting.varied import read_varied
from fmd.output.channels import find_channels, follow_mode
from fmd.stages.pipeline import Pipeline

BAR: dict[str, Any] = {
    "title": "Bar",
    "body": {
        "bar": {
            "shape": "bar",
            "length": 0.4,
            "depth": 0.02,
            "width": 0.03,
            "E": 210e9,
            "nu": 0.3,
            "rho": 7850.0,
            "mesh": {"divisions": [6, 1, 1]},
            "modes": {"count": 4},
            "marker": {"end": {"face": "x-"}, "tip": {"face": "x+"}},
        }
    },
}
PUSHED: dict[str, Any] = copy.deepcopy(BAR) | {
    "joint": {"clamp": {"type": "fixed", "parent": "ground", "child": "bar.end"}},
    # The load is slow beside the lowest frequency, some 100 Hz: stress is that of statics but for little.
    "drive": {
        "push": {
            "type": "point force",
            "marker": "bar.tip",
            "direction": [0, 2, 1],
            "force": {"formula": "400*sin(2*pi*t/0.2)**2", "unit": "N"},
        }
    },
    "simulation": {
        "duration": 0.1,
        "step": 1e-3,
        "output_step": 1e-3,
        "tip": "bar.tip",
        "run": [{"integrator": "exponential"}],
    },
    "output": [
        {
            "type": "fatigue",
            "file": "life.csv",
            "body": "bar",
            "stress": "signed von Mises",
            "sn": {"amplitude": 90e6, "cycles": 1e6, "slope": 5},
        }
    ],
}
PUSHED["body"]["bar"]["modes"] = {"count": 4, "boundary": "joint", "enrich": "none", "damping": 0.05}
BOUNDS = ["body.bar.depth=10..60 mm", "body.bar.width=10..60 mm"]


def find(scene: Any, aim: str, limits: list[str], vary: list[str], sign: int = 1) -> Optimum:
    run = package.load(scene).run
    return optimise_scene(run, aim, read_limits(run, limits), read_varied(run, vary), sign)


def numbers_of(found: Optimum) -> dict[str, float]:
    return {parameter.key: float(value) for parameter, value in found.design.values.items()}


def test_the_lightest_bar_of_a_given_frequency_is_as_narrow_as_may_be() -> None:
    """Frequencies of bending over the depth go with the depth and, of a slender bar, not with the width."""
    start = package.load(BAR).run.modes.frequencies_hz[0]
    found = find(BAR, "mass", [f"frequency.1 >= {1.1 * start} Hz"], BOUNDS)
    depth, width = numbers_of(found).values()
    assert width == pytest.approx(0.01, rel=1e-9)
    assert found.design.results[1] == pytest.approx(1.1 * start, rel=1e-6)
    assert found.design.results[0] == pytest.approx(7850.0 * 0.4 * depth * width, rel=1e-9)
    assert found.at_bounds.tolist() == [0.0, -1.0]
    (of_limit,), _, left = found.multipliers
    # Mass goes with the depth, so a limit costs the inverse of how the frequency goes with it.
    (by_depth,) = package.jacobian(
        package.load(BAR, f"body.bar.depth={depth!r} m", f"body.bar.width={width!r} m"),
        ["frequency.2"],  # by now the bar is deeper than wide
        ["body.bar.depth"],
    )
    assert of_limit == pytest.approx(1.0 / by_depth.relative, rel=1e-4)
    assert left < 1e-6
    assert [each["code"] for each in found.warnings()] == ["modes-crossed"]
    assert "is mode 2 of the design" in found.warnings()[0]["text"]


@pytest.mark.parametrize(("left", "codes"), [(1e-3, []), (0.5, ["not-stationary"])])
def test_a_design_inside_all_limits_is_stationary_where_next_to_none_of_the_first_gradient_is_left(
    left: float, codes: list[str]
) -> None:
    numbers = {"depth": 2.0, "width": 3.0}
    first, last = (
        SimpleNamespace(sensitivities=size * np.array([[0.6, -0.8]]), values=numbers, channels=())
        for size in (1.0, left)
    )
    space = SimpleNamespace(
        varied=[SimpleNamespace(per_share=lambda x: x)] * 2, at=lambda shares: last if shares.any() else first
    )
    found = Optimum(cast(DesignSpace, space), (), 1, np.array([0.5, 0.5]))
    vars(found).update(at_bounds=np.zeros(2), active=np.zeros(0, dtype=bool))
    assert found.multipliers[2] == pytest.approx(left)
    assert [each["code"] for each in found.warnings()] == codes


@pytest.mark.parametrize("limit", ["stress <= 90 MPa", pytest.param("life >= 1e6", marks=pytest.mark.long)])
def test_no_design_of_a_grid_around_is_lighter_and_within_the_limit(limit: str) -> None:
    """Of a beam with 2 F over its depth and F over its width the lightest is about twice as deep as wide.

    Stress at its corner is ``6 F L / (b d) (2/d + 1/b)``, least for a given ``b d`` where ``d = 2 b``.
    """
    found = find(PUSHED, "mass", [limit], BOUNDS)
    depth, width = numbers_of(found).values()
    mass = found.design.results[0]
    assert depth / width == pytest.approx(2.0, rel=0.1)
    assert not found.at_bounds.any()
    assert found.active.all()
    assert found.multipliers[2] < 0.02
    (bound,) = (each.bound for each in read_limits(found.space.run, [limit]))
    for by_depth, by_width in ((0.95, 0.95), (0.95, 1.0), (1.0, 0.95), (0.95, 1.05), (1.05, 0.95)):  # all lighter
        settings = [f"body.bar.depth={by_depth * depth!r} m", f"body.bar.width={by_width * width!r} m"]
        run = package.load(PUSHED, *settings).run
        mass_there, value_there = (
            float(find_channels(run, name)[0].read(run)) for name in ("mass", found.space.names[1])
        )
        assert mass_there < mass * (1.0 - 1e-4)
        assert (value_there < bound) == (">" in limit), settings


@pytest.mark.long
def test_a_start_that_breaks_a_limit_comes_to_the_same_design_as_one_that_meets_it() -> None:
    both = []
    for size in (0.015, 0.045):
        scene = copy.deepcopy(PUSHED)
        scene["body"]["bar"] |= {"depth": size, "width": size}
        both.append(np.array([*numbers_of(find(scene, "mass", ["stress <= 90 MPa"], BOUNDS)).values()]))
    np.testing.assert_allclose(*both, rtol=0.03)
    assert both[0].prod() == pytest.approx(both[1].prod(), rel=1e-3)


def test_a_mode_is_followed_when_another_passes_it() -> None:
    run = package.load(BAR).run
    (first,) = find_channels(run, "frequency.1")
    # Bending over the depth goes with it: at twice the depth it is above bending over the width.
    deep = package.load(BAR, "body.bar.depth=40 mm").run
    assert first.mode == 0
    assert follow_mode(first, run, deep).mode == 1
    few = copy.deepcopy(BAR)
    few["body"]["bar"]["modes"]["count"] = 1
    with pytest.raises(AccuracyError, match=r"bar\.frequency\.1 is lost.*modes\.count"):
        follow_mode(first, run, package.load(few, "body.bar.depth=40 mm").run)


@pytest.mark.long
def test_a_front_goes_from_the_best_of_one_aim_to_that_of_the_other() -> None:
    run = package.load(PUSHED).run
    front = find_front(
        run, (("mass", 1), ("tip", 1)), read_limits(run, ["stress <= 200 MPa"]), read_varied(run, BOUNDS), 3
    )
    masses, tips = np.array([each.design.results[[0, -1]] for each in front]).T
    assert (np.diff(masses) > 0.0).all()
    assert (np.diff(tips) < 0.0).all()
    np.testing.assert_allclose(tips, np.geomspace(tips[0], tips[-1], 3), rtol=1e-3)
    assert numbers_of(front[-1]) == pytest.approx(dict.fromkeys(numbers_of(front[-1]), 0.06), rel=1e-3)


@pytest.mark.parametrize(
    "aims",
    [
        pytest.param((("mass", 1), ("frequency.1", -1)), marks=pytest.mark.long),
        (("frequency.1", -1), ("mass", 1)),
    ],
)
def test_no_end_of_a_front_has_more_of_the_other_aim_than_it_needs(aims: Any) -> None:
    """Bending over the depth depends on the width by nu²/2 at most, less than counts, so all designs are narrow."""
    run = package.load(BAR, "body.bar.nu=0.01", "body.bar.mesh.divisions=[4,1,1]").run
    varied = read_varied(run, ["body.bar.depth=15..30 mm", "body.bar.width=20..40 mm"])
    front = find_front(run, aims, (), varied, 3)
    depths, widths = np.array([[*numbers_of(each).values()] for each in front]).T
    np.testing.assert_allclose(widths, 0.02, rtol=2e-4)
    ends = [0.015, 0.03] if aims[0][0] == "mass" else [0.03, 0.015]
    np.testing.assert_allclose(depths[[0, -1]], ends, rtol=2e-4)
    assert min(ends) < depths[1] < max(ends)
    assert not any(each["code"] == "not-stationary" for one in front for each in one.warnings())


def test_a_front_is_found_from_its_other_end_where_a_search_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    """Searches towards deeper bars fail here, as past a resonance."""

    def search(space: Any, limits: Any, sign: int, starts: Any) -> Optimum:
        found = optimise.search(space, limits, sign, starts)
        if found.shares[0] > starts[0][0] + 0.01:
            raise NoDesignError("stuck")
        return found

    run = package.load(BAR, "body.bar.mesh.divisions=[4,1,1]").run
    aims, varied = (("mass", 1), ("frequency.1", -1)), read_varied(run, ["body.bar.depth=15..30 mm"])
    monkeypatch.setattr(pareto, "search", search)
    front = find_front(run, aims, (), varied, 3)
    frequencies = np.array([each.design.results[-1] for each in front])
    np.testing.assert_allclose(frequencies, np.geomspace(*frequencies[[0, -1]], 3), rtol=1e-3)
    assert [numbers_of(each)["body.bar.depth"] for each in front][:: len(front) - 1] == pytest.approx(
        [0.015, 0.03], rel=2e-4
    )


def test_the_best_of_several_searches_is_taken_and_a_front_has_the_warnings_of_both_aims(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of an aim with two minima over a logarithm x, at x = 0.08 and, lower, at 0.73, and an aim x + 2."""

    def design(space: Any, shares: Any) -> Any:
        (x,) = shares
        first = 2.0 + 2.0 * (x - 0.05) ** 2 * (x - 0.7) ** 2 - 0.05 * x
        slope = 4.0 * (x - 0.05) * (x - 0.7) * (2.0 * x - 0.75) - 0.05
        both = {"mass": (first, slope), "frequency.1": (x + 2.0, 1.0)}
        results, slopes = np.array([both[name] for name in space.names]).T
        channels = [SimpleNamespace(name=name, part="", mode=0) for name in space.names]
        values = {each.parameter: each.from_share(x) for each in space.varied}
        return SimpleNamespace(results=np.exp(results), sensitivities=slopes[:, None], values=values, channels=channels)

    run = package.load(BAR).run
    varied = read_varied(run, ["body.bar.depth=17..45 mm"])
    monkeypatch.setattr(optimise.DesignSpace, "at", design)
    near, best = (optimise_scene(run, "mass", (), varied, starts=starts).shares for starts in (1, 4))
    assert (near, best) == (pytest.approx(0.08, abs=0.01), pytest.approx(0.73, abs=0.01))
    front = find_front(run, (("mass", 1), ("frequency.1", 1)), (), varied, 3, starts=4)
    assert front[0].shares == pytest.approx(best, abs=0.02)  # of those that are as good but for a ten-thousandth
    monkeypatch.setattr(optimise, "STATIONARY", -1.0)
    texts = [each["text"] for each in front[-1].warnings()]
    assert [text.startswith("of the best in") for text in texts] == [False, True, True]
    assert "frequency.1" in texts[-1]


def test_several_searches_pass_a_resonance_at_which_one_ends() -> None:
    """A bar on a spring is turned to and fro, and bends least far from its resonance, most so with the stiff spring.

    With little damping a turn is 1/(1 − k/Jω²) times that of the free bar: 1.25 at one bound and 1/3 at the other.
    """
    inertia, omega = 7850.0 * 0.4 * 0.02 * 0.03 * 0.4**2 / 3.0, 100.0
    unit = inertia * omega**2
    hinge = {"type": "revolute", "parent": "ground", "child": "bar.end", "axis": [0, 0, 1]}
    turn = {"formula": f"10*sin({omega}*t)", "unit": "N m"}
    table = copy.deepcopy(BAR) | {
        "joint": {"hinge": {**hinge, "spring": 0.5 * unit, "damper": 0.3 * inertia * omega}},
        "drive": {"turn": {"type": "torque", "joint": "hinge", "torque": turn}},
        "simulation": {
            "duration": 0.3,
            "output_step": 2e-3,
            "tip": "bar.tip",
            "run": [{"integrator": "central-difference", "step": 1e-4}],
        },
    }
    modes = {"count": 1, "family": "in-plane bending", "boundary": "joint", "enrich": "none", "damping": 0.05}
    table["body"]["bar"] |= {"mesh": {"divisions": [2, 1, 1]}, "modes": modes}
    run = package.load(table).run
    varied = read_varied(run, [f"joint.hinge.spring={0.2 * unit}..{4.0 * unit}"])
    one, several = (optimise_scene(run, "tip", (), varied, starts=starts) for starts in (1, 3))
    assert (one.at_bounds, several.at_bounds) == (-1.0, 1.0)
    stiffness = np.geomspace(0.2, 4.0, 11)
    tips = [one.space.at(np.array([varied[0].to_share(x * unit)])).results[0] for x in stiffness]
    assert 3 < int(np.argmax(tips)) < 8  # at the resonance, 1
    assert several.design.results[0] == pytest.approx(min(tips), rel=1e-9)
    assert one.design.results[0] == pytest.approx(tips[0], rel=1e-9)
    assert one.design.results[0] > 1.5 * several.design.results[0]


@pytest.mark.parametrize(("low", "high", "depth"), [(0.4, 0.8, 16.0), (0.7, 1.5, 10.0)])
def test_a_frequency_is_kept_out_of_a_band_on_its_better_side(low: float, high: float, depth: float) -> None:
    """It goes with the depth, 20 mm at the start: no bar is below the first band, the lightest is below the second."""
    first = float(package.load(BAR).run.modes.frequencies_hz[0])
    found = find(BAR, "mass", [f"frequency.1 outside {low * first!r}..{high * first!r} Hz"], BOUNDS[:1])
    assert numbers_of(found)["body.bar.depth"] == pytest.approx(1e-3 * depth, rel=0.02)
    assert not low < found.design.results[1] / first * (1.0 + 1e-9) < high
    (row,) = found.summary()["results"][1:]
    assert (row["must"], row["active"]) == ((">=", True) if depth > 10.0 else ("<=", False))


def test_a_side_of_a_band_that_fails_leaves_the_other_and_both_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    first, search = float(package.load(BAR).run.modes.frequencies_hz[0]), optimise._search
    limit = f"frequency.1 outside {0.7 * first!r}..{1.5 * first!r} Hz"

    def fail_above(space: Any, limits: Any, *more: Any) -> Optimum:
        if limits[0].sign > 0:
            raise AccuracyError("a design can't be computed")
        return search(space, limits, *more)

    monkeypatch.setattr(optimise, "_search", fail_above)
    assert numbers_of(find(BAR, "mass", [limit], BOUNDS[:1]))["body.bar.depth"] == pytest.approx(0.01, rel=0.02)
    with pytest.raises(AccuracyError, match=r"on any side of the band: .*no design was found with.*can't be computed"):
        find(BAR, "mass", [f"frequency.1 outside {0.4 * first!r}..{1.5 * first!r} Hz"], BOUNDS[:1])


def test_the_largest_of_a_result_is_found_too() -> None:
    found = find(BAR, "frequency.1", ["mass <= 3 kg"], ["body.bar.depth=10..60 mm", "body.bar.width=25..60 mm"], -1)
    depth, width = numbers_of(found).values()
    assert width == pytest.approx(0.025)
    assert depth * width * 0.4 * 7850.0 == pytest.approx(3.0, rel=1e-5)
    row = found.summary()["results"][1]
    assert row["active"]
    assert 0.8 < row["per_cent_of_aim"] < 1.0  # 1 of a Bernoulli bar


@pytest.mark.parametrize(
    ("aim", "limits", "vary", "error", "words"),
    [
        (
            "mass",
            ["frequency.1 >= 4 kHz"],
            ["body.bar.depth=15..30 mm"],
            AccuracyError,
            "no design was found with frequency.1 >= 4000 Hz: the search ended at body.bar.depth = 0.03 m",
        ),
        ("mass", ["frequency.1 > 40"], BOUNDS, InputError, "must be a result and its bound"),
        ("mass", ["frequency.1 >= 40 kg"], BOUNDS, InputError, "must be in a unit of Hz"),
        ("mass", ["frequency.1 >= -40 Hz"], BOUNDS, InputError, "must be above 0"),
        ("mass", ["frequency.1 >= 40"], BOUNDS, InputError, "needs a unit, such as Hz"),
        ("mass", ["frequency.1 outside 60..40 Hz"], BOUNDS, InputError, "must go from a value above 0 to a higher one"),
        ("mass", 5 * ["frequency.1 outside 40..60 Hz"], BOUNDS, InputError, "5 bands take 32 searches; 4 at most"),
        ("mass", [], ["body.bar.depth"], InputError, "needs bounds of one sign"),
        ("mess", [], BOUNDS, InputError, "without it a scene has mesh and modes alone"),
    ],
)
def test_what_cannot_be_is_refused(aim: str, limits: list[str], vary: list[str], error: Any, words: str) -> None:
    with pytest.raises(error, match=words):
        find(BAR, aim, limits, vary)


@pytest.mark.parametrize(
    ("start", "words"), [(0.5, "start from others, --starts tries some"), (1.0, "x = 1, .*widen the bounds")]
)
def test_a_start_halfway_between_mirrored_designs_is_told_for_what_it_is(start: float, words: str) -> None:
    """Slopes of 2 - (x - 1/2)² are round-off there, so that bounds have nothing to do with it, as at an end."""

    def at(shares: Any) -> Any:
        x, stress = shares[0], 2.0 - (shares[0] - 0.5) ** 2
        slopes = np.array([[0.0], [x * (1e-13 - 2.0 * (x - 0.5)) / stress]])
        return SimpleNamespace(
            results=[1.0, stress], channels=[SimpleNamespace(unit="Pa")] * 2, values={key: x}, sensitivities=slopes
        )

    key = type("Key", (), {"key": "x", "unit": ""})()
    number = SimpleNamespace(low=0.1, high=1.0, to_share=lambda x: x, per_share=lambda x: 1.0)
    space = cast(Any, SimpleNamespace(at=at, varied=[number]))
    limit = cast(Any, SimpleNamespace(name="stress", sense="<=", bound=1.0, sign=-1.0))
    with pytest.raises(NoDesignError, match=words):
        optimise._search(space, (limit,), 1, np.array([start]))


def test_a_limit_on_what_there_is_not_is_refused_before_a_motion_is_computed() -> None:
    run = package.load(PUSHED).run
    with pytest.raises(InputError, match=r"--subject: tipp: no such result; did you mean 'tip'\?"):
        read_limits(run, ["stress <= 90 MPa", "tipp <= 1 mm"])
    assert Pipeline.motions.name not in run.results


def test_a_history_is_no_aim_and_a_life_takes_its_output() -> None:
    with pytest.raises(InputError, match="is no result of one number above 0"):
        find(PUSHED, "bar.tip.position.y", [], BOUNDS)
    with pytest.raises(InputError, match=r"takes one \[\[output\]\] of type fatigue for bar; the scene has 0"):
        find({name: table for name, table in PUSHED.items() if name != "output"}, "life", [], BOUNDS)


def test_the_command_writes_the_design_as_a_scene(
    fmd: Any, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "SAY_AFTER_SECONDS", 1e-3)
    path = tmp_path / "bar.toml"
    path.write_text(
        """
title = "Bar"
[body.bar]
shape = "bar"
length = "400 mm"
depth = "20 mm"
width = "30 mm"
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
mesh = { divisions = [4, 1, 1] }
modes = { count = 2 }
marker = { end = { face = "x-" } }
"""
    )
    given = ["--vary", "body.bar.depth=10..60mm,body.bar.width=25..60mm", "--out", tmp_path / "best"]
    limit = ["--subject", "frequency.1 >= 500 Hz"]
    assert fmd("optimise", path, "--minimise", "mass", *limit, *given, "--json") == 0
    out, lines = capsys.readouterr()
    assert re.search(r"s: derivatives of a design, 50 %, about \d+ s left\n", lines)
    told = json.loads(out)
    assert told["files"] == ["design.toml", "design.json"]
    run = package.load(tmp_path / "best" / "design.toml").run
    assert run.modes.frequencies_hz[0] == pytest.approx(500.0, rel=1e-4)
    assert told["designs"][0]["results"][0]["value"] == pytest.approx(run.part.mass, rel=1e-9)
    assert fmd("optimise", path, "--minimise", "mass", *limit, *given) == 0
    assert "at its lower bound" in capsys.readouterr().out
    both = ["--minimise", "mass", "--maximise", "frequency.1", "--points", "3"]
    assert fmd("optimise", path, *both, *given) == 0
    assert "Front" in capsys.readouterr().out
    with (tmp_path / "best" / "front.csv").open() as file:
        header, *rows = csv.reader(file)
    assert header == ["body.bar.depth [m]", "body.bar.width [m]", "mass [kg]", "bar.frequency.1 [Hz]"]
    assert len(rows) == 3
    assert (tmp_path / "best" / "front.png").stat().st_size > 10_000
    assert fmd("optimise", path, *limit, *given) == 2
    assert "one result, or two for their front" in capsys.readouterr().err
    assert fmd("optimise", path, "--minimise", "mass", "--points", "5", *given) == 2
    assert "belongs to two aims" in capsys.readouterr().err


def test_a_profile_is_designed_with_the_beams_of_its_first_mesh(tmp_path: Path) -> None:
    """A rectangle's bending frequency is in proportion to its height over the square of the length, but for shear."""
    path = tmp_path / "rail.toml"
    path.write_text(
        """
title = "Rail"

[body.rail]
shape = "profile"
length = "600 mm"
section = { type = "rectangle", width = "24 mm", height = "12 mm" }
E = "70 GPa"
nu = 0.33
rho = "2700 kg/m^3"
mesh = { size = "150 mm" }
modes = { count = 3 }
"""
    )
    run = package.load(path).run
    first = float(run.wholes["rail"].modes.frequencies_hz[0])
    longer = read_varied(run, ["body.rail.length=500..900 mm"])
    found = optimise_scene(run, "mass", read_limits(run, [f"frequency.1 >= {0.81 * first!r} Hz"]), longer, -1)
    (length,) = numbers_of(found).values()
    assert length == pytest.approx(0.6 / 0.9, rel=1e-3)
    assert found.design.run.wholes["rail"].shape.divisions == (4,)
    assert found.multipliers[0] == pytest.approx(0.5, rel=1e-2)


@pytest.mark.long
def test_no_connecting_rod_of_a_grid_as_light_as_the_best_is_within_its_limits() -> None:
    """Of docs/fitting.md: half a per cent more of both is within them; `benchmarks/design_grid.py` has 1,024."""
    found = search_grid(0.011583324, 0.010822791, 0.005, 2)
    assert (found.designs, found.depth_mm) == (4, pytest.approx(11.583324 * np.exp(0.005)))


@pytest.mark.long
def test_no_connecting_rod_around_the_best_is_lighter_and_lives_as_long() -> None:
    """Of a slider-crank, a loop: by its life, and by a frequency a tenth below that of the rod that it begins with."""
    run = package.load("slider-crank", *ROD).run
    varied = read_varied(run, ["body.rod.depth=6..30 mm", "body.rod.width=6..30 mm"])
    life, frequency = (float(find_channels(run, name)[0].read(run)) for name in ("life", "frequency.1"))
    limits = [f"life >= {life!r}", f"frequency.1 >= {0.9 * frequency!r}"]
    found = optimise_scene(run, "rod.mass", read_limits(run, limits), varied)
    assert found.active.all()
    assert found.multipliers[2] < 0.01
    shares = np.log([value / 0.012 for value in numbers_of(found).values()])
    for angle in np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False):
        mass, *others = found.space.at(shares + 0.02 * np.array([np.cos(angle), np.sin(angle)])).results
        bounds = np.array([life, 0.9 * frequency])
        assert mass > found.design.results[0] or (np.array(others) < bounds).any()
