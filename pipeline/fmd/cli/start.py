"""Entry point of ``fmd``: what else is loaded is loaded within reach of Ctrl-C."""

import atexit
import gc
import os
import signal
import sys
import warnings
from importlib import import_module
from types import FrameType

from fmd.core.limits.memory import ALLOCATIONS


def main() -> None:
    """Run the command line with the program's arguments; Ctrl-C ends it by one line at any time.

    At the end Python doesn't look for garbage once more: the memory is given back whole.
    Warnings of NumPy about numbers that overflow aren't shown: results are checked where they are made.
    Plug-ins of Pydantic, of which there are none, aren't looked for in the files of all packages.
    """
    pressed = []

    def interrupt(number: int, frame: FrameType | None) -> None:
        pressed.append(number)
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, interrupt)
    atexit.register(gc.freeze)
    gc.set_threshold(ALLOCATIONS)
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    warnings.filterwarnings("ignore", category=RuntimeWarning)
    try:
        import_module("fmd.cli.app").main()
    except BaseException as error:
        # A library that is interrupted while it is loaded may raise an error of its own.
        if not pressed or isinstance(error, SystemExit):
            raise
        sys.stderr.write("fmd: interrupted\n")
        sys.exit(130)
