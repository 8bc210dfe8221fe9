"""Parts of a command's start, measured on this machine: imports, kernels kept on the disk, drawing."""

from __future__ import annotations

import time
from importlib import import_module

from fmd.core.paths import kernel_folder
from fmd.core.processes import ChildError, run_child
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
        output = run_child("fmd.cli.start_times:print_imports", seconds=TIMEOUT)
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
