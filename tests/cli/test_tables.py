"""Printed tables: nothing is cut in a file or a pipe, columns fold at a narrow terminal."""

import pytest

from fmd.cli import run
from fmd.cli.tables import new_table, open_console, tell_apart

WORDS = ["a quantity with a rather long name", "another one that goes on for quite a while", "x" * 60, "y" * 60]


@pytest.fixture(autouse=True)
def no_width(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)


def test_no_column_is_cut_in_a_file(capsys: pytest.CaptureFixture[str]) -> None:
    table = new_table("A title that is longer than any of the columns", *(f"column {k}" for k in range(len(WORDS))))
    table.add_row(*WORDS)
    open_console().print(table)
    (line,) = [line for line in capsys.readouterr().out.splitlines() if WORDS[0] in line]
    assert all(word in line for word in WORDS)


def test_a_long_line_of_text_stays_one_line_in_a_file(capsys: pytest.CaptureFixture[str]) -> None:
    open_console().print(" ".join(WORDS))
    assert capsys.readouterr().out == " ".join(WORDS) + "\n"


def test_names_in_brackets_are_no_markup(capsys: pytest.CaptureFixture[str]) -> None:
    table = new_table("budget of [body.arm]", "quantity", "value")
    table.add_row("mass [kg]", "[b]")
    console = open_console()
    console.print(table)
    console.print("pieces = 3 of [body.arm] lowers this :+1:")
    printed = capsys.readouterr().out
    for text in ("budget of [body.arm]", "mass [kg]", "[b]", "pieces = 3 of [body.arm] lowers this :+1:"):
        assert text in printed


def test_ends_of_a_narrow_interval_are_told_apart() -> None:
    assert tell_apart(11.0000002, 10.9999998, 11.0000006) == ["11.0000002", "10.9999998", "11.0000006"]
    assert tell_apart(60.0, 30.0, 90.0) == ["60", "30", "90"]
    assert tell_apart(0.0, 0.0, 0.0) == ["0", "0", "0"]


def test_a_width_that_is_given_is_kept(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    open_console().print(" ".join(WORDS))
    assert max(len(line) for line in capsys.readouterr().out.splitlines()) <= 100


@pytest.mark.parametrize(
    ("own", "errors", "line"),
    [
        ({"begin_s": None}, {}, "nothing touches"),
        ({}, {}, "0.25 to 1.5 s, largest force 1235 N, impulse 5 N s"),
        (
            {},
            {"largest_force_n": {"total": 12.0}, "impulse_n_s": {"total": None}},
            "0.25 to 1.5 s, largest force 1235 ± 12 N, impulse 5 N s",
        ),
        (
            {},
            {"largest_force_n": {"total": None, "why": "not estimated: no time"}, "impulse_n_s": {"total": 0.1}},
            "0.25 to 1.5 s, largest force 1235 N, impulse 5 ± 0.1 N s, errors not estimated: no time",
        ),
    ],
)
def test_a_contact_is_told_with_the_errors_that_are_stated(
    own: dict[str, None], errors: dict[str, dict[str, float | str | None]], line: str
) -> None:
    """The impulse is the size of its vector, 3-4-5."""
    touched = {"begin_s": 0.25, "end_s": 1.5, "largest_force_n": 1234.56, "impulse_n_s": [3.0, 0.0, -4.0]}
    assert run._describe_contact(touched | own, errors) == line
