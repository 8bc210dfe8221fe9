"""Checks of the machine: libraries that Gmsh needs, drawing off-screen, the cache folder."""

from __future__ import annotations

import ctypes
import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from joblib import cpu_count

from fmd.core.paths import is_private
from fmd.render import rendering_check

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
    """Something that doesn't work on this machine, and its remedy.

    Attributes
    ----------
    what : str
        The failure.
    mend : str
        The remedy, a command where there is one.
    """

    what: str
    mend: str


def find_problems(cache: Path) -> tuple[Problem, ...]:
    """Check the system's libraries, drawing and the cache folder, which is made if it is missing."""
    checks = (_library_problem(), _drawing_problem(), _cache_problem(cache))
    return tuple(problem for problem in checks if problem is not None)


def describe_machine() -> dict[str, str]:
    """Return the number of processor cores and the numbers of threads that the environment sets."""
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
