"""Program of every child process, run by its path: ``child.py ROOT PARENT BYTES TARGET …``.

It ends with its parent, keeps to a limit of memory, and then becomes the command after ``exec``, or calls a function of
this package, ``module:function``, with the arguments behind it. Needs the standard library only.
"""

import ctypes
import os
import signal
import sys
import threading
import time
from importlib import import_module

_PR_SET_PDEATHSIG = 1


def main() -> object:
    """Do what the command line says; the exit status is what the function returns."""
    root, parent, memory, target, *arguments = sys.argv[1:]
    end_with_parent(int(parent))
    if int(memory):
        limit_memory(int(memory))
    if target == "exec":
        os.execvp(arguments[0], arguments)
    if root not in sys.path:
        sys.path.append(root)
    module, _, function = target.partition(":")
    sys.argv = [module, *arguments]
    return getattr(import_module(module), function)(*([arguments] if arguments else []))


def end_with_parent(parent: int) -> None:
    """Have this process killed once its parent is no more: by the system on Linux, elsewhere by a thread that looks."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # it has ended meanwhile
            os._exit(1)
    elif hasattr(os, "getppid"):
        threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)


def limit_memory(size: int) -> None:
    """Limit this process's memory, beside what it has now, to a number of bytes; on Windows there is no such limit."""
    try:
        import resource
    except ImportError:
        return
    try:
        with open("/proc/self/statm", encoding="ascii") as file:
            size += int(file.read().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        pass
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (size if hard == resource.RLIM_INFINITY else min(size, hard), hard))


if __name__ == "__main__":
    sys.exit(main())  # type: ignore[arg-type]
