"""One rank of a distributed factor, run by `slepc.py` under ``mpiexec``; needs NumPy and slepc4py only.

A folder that all ranks see holds matrices and vectors as NumPy files, of which each rank maps its own rows. Rank 0
reads one command a line from standard input and answers each with one line on standard output; the end of input ends
all ranks.
"""

import itertools
import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import petsc4py

from fmd.core.limits.modes import SLEPC_RESIDUAL
from fmd.core.limits.patience import LOOK_SECONDS

petsc4py.init(["worker"])
from petsc4py import PETSc  # noqa: E402
from slepc4py import SLEPc  # noqa: E402


def _matrix(folder: Path, name: str) -> Any:
    """Read this rank's rows of a symmetric matrix in CSR form."""
    indptr, indices, data = (
        np.load(folder / f"{name}-{part}.npy", mmap_mode="r") for part in ("indptr", "indices", "data")
    )
    n = len(indptr) - 1
    first, last = _rows(n)
    begin, end = indptr[first], indptr[last]
    own = (np.asarray(indptr[first : last + 1] - begin), np.asarray(indices[begin:end]), np.asarray(data[begin:end]))
    A = PETSc.Mat().createAIJ(
        ((last - first, n), (last - first, n)),
        csr=(own[0].astype(PETSc.IntType), own[1].astype(PETSc.IntType), own[2]),
        comm=PETSc.COMM_WORLD,
    )
    A.setOption(PETSc.Mat.Option.SPD, True)
    return A


def _rows(n: int) -> tuple[int, int]:
    """First row of this rank, and of the next, of n rows."""
    rank, ranks = PETSc.COMM_WORLD.getRank(), PETSc.COMM_WORLD.getSize()
    return n * rank // ranks, n * (rank + 1) // ranks


class _Distributed:
    """Matrix and its factor, of which each rank has a block of rows."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._A = _matrix(folder, "A")
        self._rows = slice(*_rows(self._A.getSize()[0]))
        ranks = PETSc.COMM_WORLD.getSize()
        # Of the packages that factorise over all ranks the best.
        self.package = next((p for p in ("mumps", "superlu_dist") if PETSc.Sys.hasExternalPackage(p)), "petsc")
        self._ksp = PETSc.KSP().create(PETSc.COMM_WORLD)
        self._ksp.setOperators(self._A)
        self._ksp.setType("preonly")
        pc = self._ksp.getPC()
        if self.package == "petsc" and ranks > 1:
            pc.setType("redundant")  # each rank has the whole factor
        else:
            pc.setType("lu" if self.package == "superlu_dist" else "cholesky")
            pc.setFactorSolverType(self.package)
        self._ksp.setUp()

    def about(self) -> dict[str, Any]:
        """Return the solver's name and the number of entries of its factor, 0 if the package doesn't give it."""
        entries = 0
        if self.package == "mumps":
            entries = self._ksp.getPC().getFactorMatrix().getMumpsInfog(29)
            entries = entries if entries >= 0 else -1_000_000 * entries  # given in millions then
        return {"package": self.package, "nonzeros": entries}

    def solve(self) -> dict[str, Any]:
        """Solve for all columns of ``f.npy``; solutions go to ``x.npy``."""
        f = np.load(self._folder / "f.npy", mmap_mode="r")
        x = np.load(self._folder / "x.npy", mmap_mode="r+")
        load, solution = self._A.createVecs()
        for k in range(f.shape[1]):
            load.getArray()[:] = f[self._rows, k]
            self._ksp.solve(load, solution)
            x[self._rows, k] = solution.getArray()
        x.flush()
        return {}

    def modes(self, count: int, ncv: int) -> dict[str, Any]:
        """Find the lowest eigenpairs of ``A φ = θ M φ`` outside the columns of ``f.npy``; fields go to ``x.npy``."""
        eps = SLEPc.EPS().create(PETSc.COMM_WORLD)
        eps.setOperators(self._A, _matrix(self._folder, "M"))
        eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
        eps.setType(SLEPc.EPS.Type.KRYLOVSCHUR)
        eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
        eps.setTarget(0.0)
        st = eps.getST()
        st.setType(SLEPc.ST.Type.SINVERT)
        st.setShift(0.0)
        st.setKSP(self._ksp)
        eps.setDimensions(count, ncv)
        eps.setTolerances(SLEPC_RESIDUAL, 1000)
        outside = np.load(self._folder / "f.npy", mmap_mode="r")
        vectors = []
        for k in range(outside.shape[1]):
            vector = self._A.createVecRight()
            vector.getArray()[:] = outside[self._rows, k]
            vectors.append(vector)
        if vectors:
            eps.setDeflationSpace(vectors)
        eps.solve()
        n_converged = min(eps.getConverged(), count)
        x = np.load(self._folder / "x.npy", mmap_mode="r+")
        field, values = self._A.createVecRight(), []
        for k in range(n_converged):
            values.append(float(np.real(eps.getEigenpair(k, field))))
            x[self._rows, k] = field.getArray()
        x.flush()
        return {"values": values}


def _commands(folder: Path) -> Iterator[list[Any]]:
    """Read commands on rank 0; the others look for its note, since waiting in MPI would take a core each."""
    for number in itertools.count():
        note = folder / f"command-{number}"
        if PETSc.COMM_WORLD.getRank() == 0:
            line = sys.stdin.readline() or "[]"
            draft = folder / "draft"
            draft.write_text(line)
            draft.rename(note)
        while not note.exists():
            time.sleep(LOOK_SECONDS)
        command = json.loads(note.read_text())
        if not command:
            return
        yield command


def _answer(values: dict[str, Any]) -> None:
    """Write one line to standard output when all ranks are done."""
    PETSc.COMM_WORLD.barrier()
    if PETSc.COMM_WORLD.getRank() == 0:
        sys.stdout.write(json.dumps(values) + "\n")
        sys.stdout.flush()


def _main(folder: Path) -> None:
    distributed = _Distributed(folder)
    _answer(distributed.about())
    for name, *arguments in _commands(folder):
        _answer(distributed.solve() if name == "solve" else distributed.modes(*arguments))


if __name__ == "__main__":
    _main(Path(sys.argv[1]))
