"""The command line as a whole: names of commands, exit status, one message."""

from importlib import import_module

import pytest
from rich.console import Console

from fmd.cli import app


def test_a_missing_scene_names_the_ready_ones(fmd, capsys):
    assert fmd("modes", "baem") == 2
    assert "beam" in capsys.readouterr().err


def test_a_failed_check_ends_with_status_3_and_its_figure(fmd, capsys, monkeypatch):
    monkeypatch.setattr("fmd.reduction.eigen.LARGEST_RESIDUAL", 0.0)
    assert fmd("modes", "beam", "--no-cache") == 3
    assert "residual" in capsys.readouterr().err


def test_every_command_has_a_module_of_its_name():
    for place in app._COMMANDS:
        module, _, function = place.partition(":")
        assert callable(getattr(import_module(f"fmd.cli.{module}"), function))
        assert module == function


def test_help_lists_commands_as_they_are_used_and_tells_what_each_option_does(fmd, capsys, monkeypatch):
    monkeypatch.setattr(app.app, "console", Console(width=72))  # whatever a test before has left
    commands = [place.partition(":")[0] for place in app._COMMANDS]
    assert fmd("--help") == 0
    listed = [
        line.split()[0] for line in capsys.readouterr().out.splitlines() if line.startswith("  ") and line[2] != " "
    ]
    assert listed[: len(commands)] == commands
    for command in commands:
        assert fmd(command, "--help") == 0
        lines = capsys.readouterr().out.splitlines()
        assert max(map(len, lines)) <= 72
        entries = [k for k, line in enumerate(lines) if line.startswith("  ") and line[2] != " "]
        for k in entries:  # what it does stands beside its names, or below them in the same column
            assert (len(lines[k]) > 18 and lines[k][16:18] == "  ") or lines[k + 1].startswith(18 * " "), lines[k]


def test_an_unknown_option_is_one_message_with_the_command_that_has_it(fmd, capsys):
    assert fmd("sweep", "beam", "--vary", "simulation.step=1us,2us", "--minimise", "mass") == 2
    assert capsys.readouterr().err == "fmd: Unknown option: --minimise. It is an option of `fmd optimise`.\n"
    assert fmd("modes", "beam", "--out", "o") == 2
    assert "`fmd modes` writes no files; --json prints" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "status", "message"),
    [
        (KeyboardInterrupt(), 130, "fmd: interrupted\n"),
        (OSError("no space left"), 2, "fmd: no space left; `fmd doctor` tells what this machine lacks\n"),
    ],
)
def test_an_interrupt_and_a_full_disk_are_one_message(fmd, capsys, monkeypatch, error, status, message):
    def fail(*_):
        raise error

    monkeypatch.setattr("fmd.cli.inputs.load_scene", fail)
    assert fmd("modes", "beam") == status
    assert capsys.readouterr().err == message


def test_a_fault_of_the_program_is_not_hidden(fmd, monkeypatch):
    def fail(*_):
        raise ZeroDivisionError

    monkeypatch.setattr("fmd.cli.inputs.load_scene", fail)
    with pytest.raises(ZeroDivisionError):
        fmd("modes", "beam")
