"""The verification suite: each case keeps its tolerance, and what is out of one is said and ends the command."""

import csv
import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fmd.core.errors import AccuracyError, InputError
from fmd.fem.material import Material
from fmd.verification import closed_forms, suite
from fmd.verification.case import Figure, VerificationCase
from fmd.verification.suite import CASES, Outcome, require_tolerances, run_cases

STEEL = Material(210e9, 0.3, 7800.0)
LONG = (
    pytest.mark.long
)  # test_bouncing_bar.py, test_loops.py and test_friction.py have what these show, in a second or two
LONGER = ("bouncing-bar", "four-bar", "slope", "struck-beam")


@cache
def outcome_of(case: str) -> Outcome:
    (outcome,) = run_cases([CASES[case]])
    return outcome


@pytest.mark.parametrize("case", [pytest.param(name, marks=LONG if name in LONGER else ()) for name in CASES])
def test_each_case_keeps_its_tolerances(case: str) -> None:
    outcome = outcome_of(case)
    if outcome.skipped:
        pytest.skip(outcome.skipped)
    require_tolerances([outcome])
    assert len(outcome.figures) >= 2
    assert all(np.isfinite([figure.ours, figure.published]).all() for figure in outcome.figures)
    json.dumps(suite.tabulate([outcome]), allow_nan=False)  # as the command writes it


def test_a_case_whose_program_is_missing_is_skipped_with_a_word(fmd, monkeypatch, tmp_path, capsys) -> None:
    monkeypatch.setattr("fmd.verification.functional_mockup.find_spec", lambda name: None)
    assert fmd("verify", "fmu", "--out", tmp_path) == 0
    printed = capsys.readouterr().out
    assert "fmu skipped: FMPy, which runs FMUs, isn't installed; pip install fmpy" in printed
    assert "0 figures of 0 cases" in printed
    (row,) = json.loads((tmp_path / "verification.json").read_text())
    assert row["holds"] is None
    assert row["error"].startswith("skipped: ")


def test_the_page_counts_and_has_all_cases() -> None:
    page = (Path(__file__).parents[2] / "docs" / "verification.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([a-z][a-z0-9-]+(?:, [a-z0-9-]+)*) \|", page, re.MULTILINE)
    assert set(CASES) <= {name for row in rows for name in row.split(", ")}
    assert f"`fmd verify` runs {len(CASES)} cases" in page


def test_the_tolerances_mean_something() -> None:
    """A per cent or two for a printed number or a coarse published mesh, a few thousandths for theory."""
    for case in ("table-1", "fv52", "rotating-rod"):
        for figure in outcome_of(case).figures:
            assert figure.tolerance <= 0.025
            assert not replace(figure, ours=figure.ours * 1.06).holds


# What it is compared with ----------------------------------------------------------------------------------------


def test_huangs_equation_is_that_of_timoshenkos_system(timoshenko: Any) -> None:
    for nu in (0.0, 0.3):
        material = Material(70e9, nu, 2700.0)
        system = timoshenko(1.2, 0.1, 0.03, material).frequencies_hz(4)
        assert closed_forms.timoshenko_free(1.2, 0.1, material, 4) == pytest.approx(system, rel=1e-8)


def test_a_slender_supported_beam_has_euler_and_bernoullis_frequencies() -> None:
    found = closed_forms.timoshenko_supported(1.0, 1e-3, STEEL, 3)
    euler = np.pi / 2 * np.array([1, 4, 9]) * 1e-3 * np.sqrt(STEEL.E / (12 * STEEL.rho))
    assert found == pytest.approx(euler, rel=1e-4)


def test_waves_in_a_plate_give_the_frequencies_that_srinivas_printed() -> None:
    # J Sound Vib 12 (1970), h/a = 0.1, ν = 0.3: ω h √(ρ/G)
    printed = {(1, 1): 0.0932, (1, 2): 0.2226, (2, 2): 0.3421, (1, 3): 0.4171, (2, 3): 0.5239, (3, 3): 0.6889}
    unit = 0.1 * np.sqrt(STEEL.rho / STEEL.lame[1]) * 2 * np.pi
    for (m, n), value in printed.items():
        assert closed_forms.supported_plate(1.0, 0.1, STEEL, m, n) * unit == pytest.approx(value, abs=6e-5)


def test_polynomials_on_a_box_converge_from_above_and_bend_as_a_beam() -> None:
    coarse, fine = (closed_forms.free_box((0.1, 0.07, 0.05), STEEL, 6, degree) for degree in (7, 10))
    assert (coarse >= fine * (1 - 1e-10)).all()
    assert coarse == pytest.approx(fine, rel=4e-3)
    # Of a slender bar the first of its modes across the thin side is Timoshenko's.
    bar = closed_forms.free_box((1.0, 0.05, 0.04), STEEL, 1, 12)[0]
    assert bar == pytest.approx(closed_forms.timoshenko_free(1.0, 0.04, STEEL, 1)[0], rel=2e-3)


@pytest.mark.parametrize("moments", [(1.0, 1.0, 1.6), (1.0, 2.0, 3.0)])
def test_tops_obey_eulers_equations(moments: tuple[float, float, float]) -> None:
    a, b, c = moments
    times = np.linspace(0.0, 10.0, 21)
    solution = solve_ivp(
        lambda _, w: [(b - c) / a * w[1] * w[2], (c - a) / b * w[2] * w[0], (a - b) / c * w[0] * w[1]],
        (0.0, 10.0),
        [1.0, 0.0, 2.0],
        method="DOP853",
        rtol=1e-11,
        atol=1e-13,
        t_eval=times,
    )
    if a == b:
        found = closed_forms.symmetric_top((a, c), (1.0, 2.0), times)
    else:
        found, period = closed_forms.asymmetric_top(moments, (1.0, 2.0), times)
        again, _ = closed_forms.asymmetric_top(moments, (1.0, 2.0), times + period)
        assert again == pytest.approx(found, abs=1e-9)
    assert found == pytest.approx(solution.y.T, abs=1e-8)


def test_the_rods_extension_is_what_the_benchmark_prints() -> None:
    linear, nonlinear = closed_forms.stretched_rod(0.5, Material(200e9, 0.0, 7800.0), 3000.0)
    assert linear == pytest.approx(0.014625, rel=1e-12)
    assert nonlinear == pytest.approx(0.0151572, abs=5e-8)


# The command -----------------------------------------------------------------------------------------------------


def test_the_table_is_printed_and_written(
    fmd: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fmd("verify", "fv52", "symmetric-top", "--out", str(tmp_path)) == 0
    printed = capsys.readouterr().out
    for word in (
        "NAFEMS FV52",
        "45.897",
        "allowed",
        "20 s [rad/s]",
        "11 figures of 2 cases",
        "all within their tolerances",
    ):
        assert word in printed
    with (tmp_path / "verification.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["case"] for row in rows] == ["fv52"] * 8 + ["symmetric-top"] * 3
    assert float(rows[0]["published"]) == 45.897
    assert json.loads((tmp_path / "verification.json").read_text())[0]["holds"] is True


def test_an_unknown_case_is_wrong_input(
    fmd: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fmd("verify", "fv25", "--out", str(tmp_path / "out")) == 2
    assert "did you mean 'fv52'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_figure_out_of_its_tolerance_ends_with_status_3_and_is_written(
    fmd: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    figures = [Figure("length [m]", 1.0, 1.0, 0.0), Figure("mass [kg]", 1.02, 1.0, 0.01), Figure("x", np.nan, 1.0, 0.1)]
    monkeypatch.setitem(suite.CASES, "wrong", VerificationCase("wrong", "a case", "nowhere", lambda _: figures))
    assert fmd("verify", "wrong", "--json", "--out", str(tmp_path)) == 3
    printed = capsys.readouterr()
    assert "case wrong is out of its tolerance: mass [kg] is 1.02, published 1; +2 % exceeds 1 %" in printed.err
    rows = json.loads(printed.out)["rows"]
    assert [row["holds"] for row in rows] == [True, False, False]
    assert (rows[2]["ours"], rows[2]["difference"]) == (None, None)
    assert fmd("verify", "wrong", "--out", str(tmp_path)) == 3
    assert "OUT" in capsys.readouterr().out


def test_a_case_whose_check_fails_does_not_keep_others_from_running(
    fmd: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: object) -> list[Figure]:
        raise AccuracyError("residual 1 exceeds 0")

    monkeypatch.setitem(suite.CASES, "wrong", VerificationCase("wrong", "a case", "nowhere", fail))
    assert fmd("verify", "wrong", "fv52", "--out", str(tmp_path)) == 3
    printed = capsys.readouterr()
    assert "wrong FAILED: residual 1 exceeds 0" in printed.out
    assert "45.897" in printed.out
    assert printed.err == "fmd: case wrong failed: residual 1 exceeds 0\n"
    assert [row["error"] for row in json.loads((tmp_path / "verification.json").read_text())][:2] == [
        "residual 1 exceeds 0",
        "",
    ]


def test_a_folder_that_cannot_be_written_is_wrong_input(
    fmd: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("in the way")
    assert fmd("verify", "fv52", "--out", str(tmp_path / "file" / "out")) == 2
    assert "can't be written" in capsys.readouterr().err


def test_several_cases_out_of_tolerance_are_counted() -> None:
    case = VerificationCase("a", "a case", "nowhere", lambda _: [])
    wrong = Outcome(case, (Figure("x", 2.0, 1.0, 0.1),), 0.0)
    with pytest.raises(AccuracyError, match=r"\+100 % exceeds 10 % \(and 1 more cases\)"):
        require_tolerances([wrong, Outcome(case, (), 0.0, "failed")])
    require_tolerances([Outcome(case, (Figure("x", 1.05, 1.0, 0.1),), 0.0)])


def test_a_subject_names_its_cases_once_and_an_unknown_one_is_refused_with_the_names() -> None:
    chosen = [case.name for case in suite.choose_cases(["slope", "contact", "fv52"])]
    assert chosen == ["slope", "bouncing-bar", "ball", "struck-beam", "pushed-ball", "fv52"]
    assert len(suite.choose_cases([])) == len(CASES)
    with pytest.raises(InputError, match="did you mean 'contact'"):
        suite.choose_cases(["contacts"])
