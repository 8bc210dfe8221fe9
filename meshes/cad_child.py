"""Process that reads a CAD file: its time, its silence and its one message."""

import contextlib
import io
import signal
from collections.abc import Callable


class CadError(ValueError):
    """A CAD file can't be meshed; the message gives the reason."""


def report(work: Callable[[], None]) -> str | None:
    """Do some work of this process without printing; return an error message or ``None``."""
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            work()
    except CadError as error:
        return str(error)
    except Exception as error:  # Gmsh's own
        if "Could not read file" in str(error):
            return "Gmsh can't read it: is it damaged, or of another format than its suffix says?"
        return " ".join(f"Gmsh can't mesh it: {error}".split())[:200]
    finally:
        end_after(0.0)
    return None


def end_after(seconds: float) -> None:
    """Have the system end this process after some time from now, whatever Gmsh does; 0 takes it back."""
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, seconds)
