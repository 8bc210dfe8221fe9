"""The command line: ``fmd``. Each command's module is loaded when it is called."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from cyclopts import App

app = App(
    name="fmd",
    help="From the shape of a flexible part to its stress in motion. SCENE is a ready scene's name or a TOML file.",
    help_format="plaintext",
    help_formatter="plain",
)

_COMMANDS = {
    "run:run": "Do everything that a scene asks for: mesh, modes, motion, stress, pictures, an error budget.",
    "pages:new": "Write a commented scene to start from.",
    "modes:mesh": "Mesh alone: counts, volume, mass and the smallest scaled Jacobian.",
    "modes:modes": "Modes alone: frequencies beside the scene's reference.",
    "modes:campbell": "Campbell diagram: frequencies on a turning hub over its rate of rotation.",
    "stability:stability": "Which step is safe: for a scene, or as a map for two degrees of freedom.",
    "sweep:sweep": "A scene at every combination of values, on all cores or a cluster.",
    "pages:report": "One web page of all results, to be opened without a network.",
    "verify:verify": "Published and closed-form results beside ours.",
    "bench:bench": "Run time against error: integrators, elements, whole runs, stability.",
    "doctor:doctor": "Tell what this machine lacks, and the command that mends it.",
}
for _place, _help in _COMMANDS.items():
    app.command(f"pipeline.cli.{_place}", help=_help)
app.register_install_completion_command(help="Let the shell complete commands and options (bash, zsh, fish).")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; what must be mended ends with status 2, a failed check with 3, each with one message."""
    try:
        app(sys.argv[1:] if arguments is None else arguments)
    except KeyboardInterrupt:
        _fail("interrupted", 130)
    except OSError as error:  # a full disk, a folder that can't be written, a library that isn't there
        _fail(f"{error}; `fmd doctor` tells what this machine lacks", 2)
    except Exception as error:
        from pipeline.core.errors import AccuracyError, InputError  # here: they load NumPy, which --help does without

        if not isinstance(error, InputError | AccuracyError):
            raise
        _fail(error, 2 if isinstance(error, InputError) else 3)


def _fail(message: object, status: int) -> None:
    print(f"fmd: {message}", file=sys.stderr)
    raise SystemExit(status)
