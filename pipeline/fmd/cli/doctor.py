"""``fmd doctor``: a check of the machine."""

import ctypes
import os
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path

from fmd.cli.options import Json, print_json
from fmd.core.data_classes import dataclass
from fmd.core.paths import cache_folder, is_private, kernel_folder
from fmd.core.processes import ChildError, run_child
from fmd.render import rendering_check
from fmd.render.rendering_check import TIMEOUT, rendering_failure

# What a run without anything new to compute loads, in this order; each part leaves out what those before have loaded.
_IMPORTS = {
    "NumPy": "numpy",
    "scene and stages": "fmd.cli.inputs",
    "LLVM": "llvmlite.binding",
    "mechanism": "fmd.dynamics.compiled_system.system",
    "error budget and files": "fmd.output.write",
}


def measure_start() -> dict[str, float]:
    """Measure the parts of a command's start, each once.

    Returns
    -------
    dict of str to float
        Wall time by part [s]: Python, imports, reading all kernels that this version keeps, and drawing, which a run
        does in another process meanwhile.

    Raises
    ------
    OSError
        A process can't be started, or a kernel can't be read.
    """
    tick = time.perf_counter()
    try:
        output = run_child("fmd.cli.doctor:print_imports", seconds=TIMEOUT)
    except ChildError as error:
        raise OSError(str(error)) from None
    whole = time.perf_counter() - tick
    imports = dict(zip(_IMPORTS, map(float, output.split()), strict=True))
    kernels, drawing = time_of_kernels(), time.perf_counter()
    rendering_failure()
    return {
        "Python": whole - sum(imports.values()),
        **imports,
        "kernels from the disk": kernels,
        "drawing, beside the rest": time.perf_counter() - drawing,
    }


def print_imports() -> None:
    """Load what a run loads, and print the time of each part, a line each [s]."""
    for module in _IMPORTS.values():
        tick = time.perf_counter()
        import_module(module)
        print(time.perf_counter() - tick)


def time_of_kernels() -> float:
    """Return the time that reading all kernels takes which this version keeps [s]; 0 if none is kept yet."""
    tick, n_bytes = time.perf_counter(), 0
    for path in kernel_folder().rglob("*"):
        n_bytes += len(path.read_bytes()) if path.is_file() else 0
    return time.perf_counter() - tick if n_bytes else 0.0


# The libraries that Gmsh's wheel takes from the system, and the Debian packages that hold them.
GMSH_LIBRARIES = {
    "libGL.so.1": "libgl1",
    "libGLU.so.1": "libglu1-mesa",
    "libX11.so.6": "libx11-6",
    "libXcursor.so.1": "libxcursor1",
    "libXext.so.6": "libxext6",
    "libXfixes.so.3": "libxfixes3",
    "libXft.so.2": "libxft2",
    "libXinerama.so.1": "libxinerama1",
    "libXrender.so.1": "libxrender1",
    "libfontconfig.so.1": "libfontconfig1",
    "libgomp.so.1": "libgomp1",
}
DEBIAN_PACKAGES: tuple[str, ...] = tuple(sorted({*GMSH_LIBRARIES.values(), *rendering_check.PACKAGES}))


@dataclass(frozen=True, slots=True)
class Problem:
    """Something that doesn't work on this machine, and its remedy."""

    what: str  # the failure
    mend: str  # the remedy, a command where there is one


def find_problems(cache: Path) -> tuple[Problem, ...]:
    """Check the system's libraries, drawing and the cache folder, which is made if it is missing."""
    checks = (_library_problem(), _drawing_problem(), _cache_problem(cache))
    return tuple(problem for problem in checks if problem is not None)


def describe_machine() -> dict[str, str]:
    """Return the number of processor cores and the numbers of threads that the environment sets."""
    from joblib import cpu_count  # loads NumPy, whose time `print_imports` measures

    return {
        "processor cores": str(cpu_count()),
        "BLAS threads": _threads("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"),
    }


def can_load(library: str) -> bool:
    """Return True if the system has a shared library."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _library_problem() -> Problem | None:
    """List all libraries that Gmsh lacks in one problem, so that one command mends it."""
    if sys.platform != "linux":  # elsewhere the wheel brings what it needs
        return None
    missing = [library for library in GMSH_LIBRARIES if not can_load(library)]
    if not missing:
        return None
    packages = " ".join(GMSH_LIBRARIES[library] for library in missing)
    return Problem(
        f"Gmsh can't be loaded without {', '.join(missing)}",
        f"on Debian and Ubuntu: apt-get install {packages}",
    )


def _drawing_problem() -> Problem | None:
    failure = rendering_check.rendering_failure()
    return None if failure is None else Problem(failure, rendering_check.MEND)


def _cache_problem(cache: Path) -> Problem | None:
    """Write a file into the cache folder: permissions alone don't show a full or read-only disk."""
    try:
        is_private(cache, make=True)
        with tempfile.TemporaryFile(dir=cache):
            return None
    except OSError as error:
        reason = error.strerror or str(error)
        return Problem(f"the cache folder {cache} can't be written ({reason})", "choose another folder for it")


def _threads(*variables: str) -> str:
    """Return the number of threads that the first of these environment variables sets."""
    for variable in variables:
        if variable in os.environ:
            return f"{os.environ[variable]} ({variable})"
    return "one a core"


def doctor(*, json: Json = False) -> None:
    """Check what this machine lacks, print the command that mends it, and say what a command's start is made of."""
    problems, start = find_problems(cache_folder()), measure_start()
    if json:
        found = [{"what": p.what, "mend": p.mend} for p in problems]
        print_json({"ok": not problems, "problems": found, "start_seconds": start})
    else:
        for name, value in describe_machine().items():
            print(f"{name}: {value}")
        for name, seconds in start.items():
            print(f"start, {name}: {seconds:.2f} s")
        if not start["kernels from the disk"]:
            print("start, kernels: none kept yet, so the first run of a scene compiles")
        for problem in problems:
            print(f"lacking: {problem.what}\n  mend: {problem.mend}")
        print(f"{len(problems)} to mend" if problems else "this machine can do everything")
    if problems:
        raise SystemExit(3)
