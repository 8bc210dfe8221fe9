"""Factor and eigensolver spread over MPI ranks: PETSc, MUMPS and SLEPc in processes of their own."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import weakref
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError
from fmd.core.limits.shown import LAST_WORDS
from fmd.core.processes import start_child
from fmd.reduction.factor.factor import Factor, MissingSolverError
from fmd.reduction.factor.figures import FactorFigures

PYTHON = "FMD_SLEPC_PYTHON"  # environment variable: the interpreter that has slepc4py, if ours hasn't
_INSTALL = (
    "slepc4py is not installed: apt-get install python3-slepc4py and set "
    f"{PYTHON}=/usr/bin/python3, or pip install petsc slepc petsc4py slepc4py, which builds for a quarter of an hour"
)


def factorise_over_ranks(A: Any, ranks: int) -> Factor:
    """Factorise a symmetric positive definite matrix over a number of MPI ranks, which end with the factor.

    Raises
    ------
    MissingSolverError
        slepc4py or ``mpiexec`` isn't installed, or the processes don't start; the message quotes their last words.
    """
    started = _Ranks(A, ranks)
    return Factor(started.solve, started.figures, started.lowest)


def _python() -> str:
    """Find the Python interpreter that has slepc4py."""
    if PYTHON in os.environ:
        python = os.environ[PYTHON]
        if shutil.which(python) is None:
            raise MissingSolverError(f"{PYTHON} = {python!r} is no program")
        return python
    if find_spec("slepc4py") is None:
        raise MissingSolverError(_INSTALL)
    return sys.executable


class _Ranks:
    """Processes of a distributed factor, and the folder that hands matrices and vectors over to them."""

    def __init__(self, A: Any, ranks: int) -> None:
        command = [_python(), str(Path(__file__).with_name("slepc_worker.py"))]
        if ranks > 1:
            if shutil.which("mpiexec") is None:
                raise MissingSolverError(
                    "mpiexec is not installed: apt-get install openmpi-bin, or use modes.ranks = 1"
                )
            command = ["mpiexec", "-n", str(ranks), *command]
        self._n = A.shape[0]
        self._folder = Path(tempfile.mkdtemp(prefix="fmd-slepc-"))
        self._write("A", A)
        self._errors = (self._folder / "errors").open("w+")
        pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": self._errors}
        self._process = start_child("exec", *command, str(self._folder), env={"OMP_NUM_THREADS": "1"}, **pipes)
        assert self._process.stdout is not None
        self._end = weakref.finalize(self, _end, self._process, self._errors, self._folder)
        line = self._process.stdout.readline()
        if not line:
            words = self._last_words()
            raise MissingSolverError(_INSTALL if "No module named" in words else f"doesn't start: {words}")
        about = json.loads(line)
        name = {"mumps": "MUMPS", "superlu_dist": "SuperLU_DIST"}.get(about["package"], "PETSc")
        nonzeros = int(about["nonzeros"])
        self.figures = FactorFigures(f"{name}, {ranks} rank{'s' * (ranks > 1)}", "own", self._n, nonzeros, 8 * nonzeros)

    def solve(self, f: Array) -> Array:
        """Solve for loads f, (n,) or (n, k)."""
        loads = f.reshape(self._n, -1)
        np.save(self._folder / "f.npy", loads)
        np.save(self._folder / "x.npy", np.empty_like(loads))
        self._send("solve")
        return np.asarray(np.load(self._folder / "x.npy").reshape(f.shape))

    def lowest(self, M: Any, count: int, ncv: int, outside: Array) -> tuple[Array, Array]:
        """Find the lowest eigenpairs of ``A φ = θ M φ`` outside known eigenvectors, as `Factor.lowest` says."""
        self._write("M", M)
        np.save(self._folder / "f.npy", outside)
        np.save(self._folder / "x.npy", np.empty((self._n, count)))
        theta = np.array(self._send("modes", count, ncv)["values"])
        if len(theta) < count:
            raise AccuracyError(f"SLEPc found only {len(theta)} of {count} modes")
        return theta, np.load(self._folder / "x.npy")

    def _write(self, name: str, A: Any) -> None:
        """Write a matrix in CSR form to the folder."""
        A = sp.csr_array(A)
        for part in ("indptr", "indices", "data"):
            np.save(self._folder / f"{name}-{part}.npy", getattr(A, part))

    def _send(self, *command: object) -> dict[str, Any]:
        """Send a command to rank 0 and wait for its answer."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with suppress(BrokenPipeError):  # then there is no answer either
            self._process.stdin.write(json.dumps(command) + "\n")
            self._process.stdin.flush()
        line = self._process.stdout.readline()
        if not line:
            raise AccuracyError(f'the processes of modes.solver = "slepc" ended: {self._last_words()}')
        answer: dict[str, Any] = json.loads(line)
        return answer

    def _last_words(self) -> str:
        """Wait for the processes to end; return the last words on their standard error."""
        self._process.wait()
        self._errors.seek(0)
        lines = [line.strip(" -") for line in self._errors.read().splitlines()]
        return " ".join(line for line in lines if line)[-LAST_WORDS:] or "they gave no reason"


def _end(process: subprocess.Popen[str], errors: Any, folder: Path) -> None:
    """Close the processes' input, wait for them and remove their folder."""
    assert process.stdin is not None
    assert process.stdout is not None
    for pipe in (process.stdin, process.stdout):
        with suppress(BrokenPipeError):
            pipe.close()
    try:
        process.wait(30)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    errors.close()
    shutil.rmtree(folder, ignore_errors=True)
