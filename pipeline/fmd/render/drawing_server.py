"""Program of a process that draws: loading VTK and drawing in software overlap with the rest of a run.

Each line of standard input names a file with a call, as `fmd.core.encoding` writes it, and is answered by a line on
standard output: ``ready`` once the process has drawn something, then ``done`` or ``failed`` for each call. A failed
call's file holds its error.
"""

import os
import sys
from pathlib import Path

from fmd.core.encoding import decode, encode
from fmd.render.calls import draw_here
from fmd.render.rendering_check import draw_sphere

_KINDS = ("OSError", "ValueError")  # errors that keep their kind; others come back as runtime errors


def serve() -> None:
    """Draw what standard input says until it ends."""
    answers = os.fdopen(os.dup(1), "w", buffering=1, encoding="utf-8")
    os.dup2(2, 1)  # whatever libraries print may not end up among the answers
    draw_sphere()
    answers.write("ready\n")
    from fmd.render.canvas import keep_windows

    with keep_windows():
        for line in sys.stdin:
            answer = _draw(Path(line.removesuffix("\n")))
            answers.write(f"{answer}\n")


def _draw(path: Path) -> str:
    """Make the call that a file holds."""
    try:
        function, arguments, settings = decode(path.read_bytes())
        draw_here(function, *arguments, **settings)
    except Exception as error:
        kind = next(name for name in (*_KINDS, "") if not name or name in {c.__name__ for c in type(error).__mro__})
        said = str(error) if kind else f"{type(error).__name__}: {error}"
        path.write_bytes(encode((kind, said)))
        return "failed"
    return "done"
