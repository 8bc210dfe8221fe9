"""The one launcher of child processes: nothing in the working folder is imported, and none outlives its parent."""

import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fmd.core.limits.shown import LAST_WORDS

_ROOT = Path(__file__).parents[2]
_CHILD = Path(__file__).with_name("child.py")


class ChildError(Exception):
    """A child process has failed; the message is one line, what it said last or how it ended.

    ``output`` is all that it has said on standard error.
    """

    def __init__(self, message: str, late: bool = False, output: str = "") -> None:
        super().__init__(message)
        self.late, self.output = late, output


def child_command(target: str, *arguments: str, memory: int = 0) -> list[str]:
    """Return the command of a child process that may take some memory [bytes], without limit by default.

    Its target is a function of this package, ``fmd.meshes.cad:main``, or ``exec`` for the command in the arguments.
    """
    return [sys.executable, "-P", str(_CHILD), str(_ROOT), str(os.getpid()), str(memory), target, *arguments]


def start_child(target: str, *arguments: str, memory: int = 0, **options: Any) -> subprocess.Popen[str]:
    """Start a child process, which is to be waited for by its caller; the options are those of ``Popen``."""
    # Python's own modules come first, wherever a process is started.
    environment = os.environ | dict(options.pop("env", {})) | {"PYTHONSAFEPATH": "1"}
    command = child_command(target, *arguments, memory=memory)
    return subprocess.Popen(command, text=True, encoding="utf-8", errors="replace", env=environment, **options)


def run_child(
    target: str,
    *arguments: str,
    seconds: float,
    memory: int = 0,
    folder: Path | None = None,
    environment: Mapping[str, str] | None = None,
) -> str:
    """Run a child process as of `child_command` to its end, within some seconds, and return its standard output.

    It has variables of the environment beside those of this process.

    Raises
    ------
    ChildError
        It failed, died or took too long.
    OSError
        It can't be started.
    """
    pipes: dict[str, Any] = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = start_child(target, *arguments, memory=memory, cwd=folder, env=environment or {}, **pipes)
    with process:
        try:
            output, errors = process.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            raise ChildError(f"it took more than {seconds:.0f} s", late=True) from None
        except BaseException:
            process.kill()
            raise
    if process.returncode:
        raise ChildError(*describe_end(process.returncode, errors), errors)
    return output


def describe_end(status: int, errors: str) -> tuple[str, bool]:
    """Say in a line why a process has ended, from status and standard error, and return whether it was too late."""
    if status < 0:
        late = hasattr(signal, "SIGALRM") and -status == signal.SIGALRM
        return (f"it died of {signal.Signals(-status).name}", late)
    lines = [line.strip() for line in errors.splitlines() if line.strip()]
    return (lines[-1][-LAST_WORDS:] if lines else f"exit status {status}"), False
