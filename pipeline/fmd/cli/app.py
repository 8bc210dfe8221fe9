"""The command line ``fmd``: names of its commands, and how each error ends the program.

Its help has each entry as a paragraph of the terminal's width.
"""

from __future__ import annotations

import os
import sys
import textwrap
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from cyclopts import App, CycloptsError, UnknownOptionError

from fmd.core.errors import AccuracyError, InputError
from fmd.core.limits.shown import HELP_COLUMN, HELP_WIDTH

if TYPE_CHECKING:
    from cyclopts.help import HelpEntry, HelpPanel
    from rich.console import Console, ConsoleOptions


class ParagraphHelp:
    """Formatter of help: names of commands and options in a column, what they do beside or below it."""

    def __call__(self, console: Console, options: ConsoleOptions, panel: HelpPanel) -> None:
        """Print a list of commands or options, empty ones not at all."""
        if not panel.entries:
            return
        lines = [f"{panel.title}:"] if panel.title else []
        for entry in panel.entries:
            names = ", ".join(
                entry.names + entry.shorts if panel.format == "command" else entry.display_labels_with_metavar
            )
            lines += _paragraph(f"  {names}", _describe(console, entry), console.width)
        _print(console, "\n".join([*lines, ""]))

    def render_usage(self, console: Console, options: ConsoleOptions, usage: Any) -> None:
        """Print how a command is called."""
        if usage:
            _print(console, f"Usage: {_text(console, usage)}\n")

    def render_description(self, console: Console, options: ConsoleOptions, description: Any) -> None:
        """Print what a command does, each of its paragraphs filled."""
        width = min(console.width, HELP_WIDTH)
        for paragraph in _text(console, description).split("\n\n"):
            if paragraph.strip():
                _print(console, textwrap.fill(" ".join(paragraph.split()), width) + "\n")


def _describe(console: Console, entry: HelpEntry) -> str:
    """Return what an entry does, with its choices and default."""
    parts = [_text(console, entry.description)]
    parts += [f"[choices: {', '.join(entry.choices)}]"] if entry.choices else []
    # Flags are off and lists empty unless given: only other defaults say something.
    parts += [f"[default: {entry.default}]"] if entry.default not in (None, "", "False", "()", '""') else []
    return " ".join(" ".join(parts + (["[required]"] if entry.required else [])).split())


def _paragraph(names: str, text: str, width: int) -> list[str]:
    """Return lines of an entry, its text in a column, from the next line on where the names reach into it."""
    margin = HELP_COLUMN * " "
    lines = textwrap.wrap(text, min(width, HELP_WIDTH), initial_indent=margin, subsequent_indent=margin)
    if len(names) <= HELP_COLUMN - 2 and lines:
        return [names.ljust(HELP_COLUMN) + lines[0][HELP_COLUMN:], *lines[1:]]
    return [names, *lines]


def _text(console: Console, given: Any) -> str:
    with console.capture() as captured:
        console.print(given or "", highlight=False, markup=False, end="")
    return captured.get().strip()


def _print(console: Console, text: str) -> None:
    console.print(text, highlight=False, markup=False)


app = App(
    name="fmd",
    help="From the shape of a flexible part to its stress in motion. SCENE is a ready scene's name or a TOML file: "
    "`fmd run beam` runs a ready one, `fmd new part.toml` writes one to change.",
    help_format="plaintext",
    help_formatter=ParagraphHelp(),
    suppress_keyboard_interrupt=False,  # main says it and sets the status
)

# Module and function of each command: cyclopts imports the module when the command is called, so --help stays quick.
_COMMANDS = {
    "run:run": "Do everything that a scene lists: mesh, modes, motion, stress, pictures, an error budget.",
    "new:new": "Write a commented scene to start from.",
    "view:view": "The mechanism in the browser: names, faces, joints moved by sliders, its run played.",
    "mesh:mesh": "Mesh alone: counts, volume, mass and the smallest scaled Jacobian.",
    "modes:modes": "Modes alone: frequencies beside the scene's reference.",
    "campbell:campbell": "Campbell diagram: frequencies on a turning hub over its rate of rotation.",
    "unbalance:unbalance": "Unbalance response of a rotor in bearings: orbits over its speed, critical speeds.",
    "frf:frf": "Frequency response about a state, and random vibration: chart, table, NetCDF.",
    "linearise:linearise": "Linear state-space model A, B, C, D about a state, as .npz and .mat.",
    "stability:stability": "Largest safe step: of a scene, or as a map for two degrees of freedom.",
    "compile:compile": "Equations of motion as machine code: operations, size, structure.",
    "export:export": "A flexible body, or the whole mechanism, for another program.",
    "sweep:sweep": "A scene at every combination of values, on all cores or a cluster.",
    "sensitivities:sensitivities": "How results depend on numbers of a scene, in per cent per per cent.",
    "fit:fit": "Numbers of a scene from measurements, with what these can tell.",
    "optimise:optimise": "The best design of a scene under limits, or the front of two aims.",
    "report:report": "One web page of all results, to be opened without a network.",
    "mcp:mcp": "Scenes as tools of an assistant, by the Model Context Protocol.",
    "verify:verify": "Published and closed-form results beside ours.",
    "bench:bench": "Run time against error of every integrator on a scene.",
    "doctor:doctor": "Check what this machine lacks, and print the command that mends it.",
}
for _number, (_place, _help) in enumerate(_COMMANDS.items()):
    app.command(f"fmd.cli.{_place}", help=_help, sort_key=_number)
app.command(
    "fmd.cli.completion:install",
    name="--install-completion",
    help="Let the shell complete commands and options (bash, zsh, fish).",
)


# Errors of numerical libraries, by name, since these aren't loaded for each command.
_NUMERICAL = ("ArpackError", "LinAlgError", "FloatingPointError", "OverflowError")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; wrong input ends with status 2, a failed check with 3, each with one message."""
    given = sys.argv[1:] if arguments is None else arguments
    try:
        try:
            app(given, print_error=False, exit_on_error=False)
        finally:
            sys.stdout.flush()
    except KeyboardInterrupt:
        _fail("interrupted", 130)
    except BrokenPipeError:  # whoever reads the output, such as `head`, has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(1) from None
    except CycloptsError as error:
        _fail(f"{error}{_find_elsewhere(error)}", 2)
    except OSError as error:  # a full disk, a folder that can't be written, a library that isn't there
        _fail(f"{error}; `fmd doctor` tells what this machine lacks", 2)
    except InputError as error:
        from fmd.scene.scene_files import with_line

        _fail(with_line(error, _overrides(given)), 2)
    except AccuracyError as error:
        _fail(error, 3)
    except Exception as error:
        if not any(kind.__name__ in _NUMERICAL for kind in type(error).__mro__):
            raise
        _fail(f"the numbers of this scene can't be computed with ({error}); check units and sizes", 3)


def _find_elsewhere(error: CycloptsError) -> str:
    """Name the commands that have an option which the called one lacks."""
    if not isinstance(error, UnknownOptionError) or not error.token.keyword:
        return ""
    option = error.token.keyword.partition("=")[0]
    called = (error.command_chain or [""])[0]
    if option == "--out" and called != "new":  # which all that write files have
        writes_none = f" `fmd {called}` writes no files; --json prints all of its results"
        return f"{writes_none}, and `fmd run` writes what the scene's outputs list."
    commands = [place.partition(":")[0] for place in _COMMANDS]
    having = [
        name for name in commands if any(option in each.names for each in app[name].assemble_argument_collection())
    ]
    return f" It is an option of {', '.join(f'`fmd {name}`' for name in having)}." if having else ""


def _overrides(arguments: Sequence[str]) -> list[str]:
    """Return the values of ``--set`` among arguments."""
    after = [value for option, value in pairwise(arguments) if option == "--set"]
    return after + [text.removeprefix("--set=") for text in arguments if text.startswith("--set=")]


def _fail(message: object, status: int) -> None:
    print(f"fmd: {message}", file=sys.stderr)
    raise SystemExit(status)
