"""Threads of the libraries that are loaded."""

import sys
from contextlib import AbstractContextManager, nullcontext
from functools import lru_cache

from threadpoolctl import ThreadpoolController

_WITH_THREADS = ("numpy", "scipy.linalg", "scipy.sparse.linalg", "gmsh", "petsc4py", "vtkmodules")


@lru_cache(maxsize=1)
def _thread_pools(loaded: tuple[str, ...]) -> ThreadpoolController:
    """Return the libraries with threads of their own; to look for them takes 2 ms, and so is done once they change."""
    return ThreadpoolController()


def one_thread() -> AbstractContextManager[object]:
    """Return a context with one thread: the products here are small, and two threads of BLAS only spin.

    To set the numbers, and to put them back, takes fifteen times as long as to ask for them.
    """
    pools = _thread_pools(tuple(name for name in _WITH_THREADS if name in sys.modules))
    return nullcontext() if all(pool.num_threads == 1 for pool in pools.lib_controllers) else pools.limit(limits=1)
