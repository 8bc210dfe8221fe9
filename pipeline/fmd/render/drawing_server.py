"""Program of a process that draws: loading VTK and drawing in software overlap with the rest of a run.

Each line of standard input names a file with a pickled call. Each is answered by a line on standard output: ``ready``
once the process has drawn something, then ``done`` or ``failed`` for each call. A failed call's file holds its error.
"""

from __future__ import annotations

import os
import pickle
import sys
from pathlib import Path

from fmd.render.calls import draw_here
from fmd.render.rendering_check import draw_sphere


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
        function, arguments, settings = pickle.loads(path.read_bytes())
        draw_here(function, *arguments, **settings)
    except Exception as error:
        path.write_bytes(_pickled(error))
        return "failed"
    return "done"


def _pickled(error: Exception) -> bytes:
    """Pickle an error; one that can't be restored is replaced by its text."""
    try:
        content = pickle.dumps(error)
        pickle.loads(content)
    except Exception:
        return pickle.dumps(RuntimeError(f"{type(error).__name__}: {error}"))
    return content
