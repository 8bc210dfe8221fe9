"""Help of the command line: each entry as a paragraph of the terminal's width."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

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
