"""Factors of large symmetric positive definite matrices, by the best sparse solver that is installed.

CHOLMOD, which cvxopt's wheels bring, on METIS' nested dissection (pymetis) is the fastest solver that comes in plain
wheels. SciPy's own SuperLU is always there and gains from the same order. The factor's size is known from the
elimination tree before anything is factorised, so a factor that doesn't fit is refused at once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from typing import Any, Literal

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import AccuracyError
from fmd.core.limits.memory import BYTES_OF_NONZERO, SMALL_SYSTEM
from fmd.core.memory import available_memory
from fmd.reduction.factor.figures import FactorFigures


def node_graph(A: sp.csr_array, size: int) -> sp.csr_array:
    """Graph of the nodes, of ``size`` unknowns each, that a matrix couples; symmetric, without loops."""
    n = A.shape[0]
    rows, columns = np.repeat(np.arange(n) // size, np.diff(A.indptr)), A.indices // size
    apart = rows != columns
    ones = np.ones(np.count_nonzero(apart), dtype=np.float32)
    return sp.csr_array(sp.coo_array((ones, (rows[apart], columns[apart])), (n // size, n // size)))


def factor_nonzeros(graph: sp.csr_array, size: int = 1) -> int:
    """Count the nonzeros of the Cholesky factor of a matrix with this graph, in this order.

    Column j of L holds a row i for each row whose subtree of the elimination tree j is in (Liu, SIAM J Matrix Anal Appl
    11, 1990); a node's unknowns have a column each, one shorter than the one before.
    """
    counts = np.ones(graph.shape[0], dtype=np.int64)
    work = np.full((2, graph.shape[0]), -1, dtype=np.int64)
    indptr, indices = graph.indptr.astype(np.int64), graph.indices.astype(np.int64)
    _count_columns()(indptr, indices, counts, *work)
    return int(size**2 * counts.sum() - size * (size - 1) // 2 * len(counts))


@cache
def _count_columns() -> Any:
    """Return `_counts` as a kernel."""
    from fmd.kernels.kernel import kernel

    return kernel(_counts)


def _counts(indptr: IntArray, indices: IntArray, counts: IntArray, parent: IntArray, seen: IntArray) -> None:
    """Add to each column's count the rows below the diagonal, walking up the elimination tree from each row."""
    for i in range(len(counts)):
        seen[i] = i
        for k in range(indptr[i], indptr[i + 1]):
            j = indices[k]
            while j < i and seen[j] != i:
                if parent[j] < 0:
                    parent[j] = i
                counts[j] += 1
                seen[j] = i
                j = parent[j]


Solver = Literal["auto", "cholesky", "superlu"]

_BYTES = {"cholesky": 10.5, "superlu": 21.0}  # for each nonzero of L; SuperLU keeps U as well
_GIGA = 1e9


class TooLargeError(MemoryError):
    """A factor needs more memory than there is; nothing has been factorised."""


class MissingSolverError(ImportError):
    """The solver that a scene names isn't installed; the message says what to install."""


@dataclass(frozen=True)
class Factor:
    """Factorised matrix: its solves, and its size."""

    solve: Callable[[Array], Array]  # ``A⁻¹ f`` of f, (n,) or (n, k)
    figures: FactorFigures
    # Where the factor's package has a method of its own: ``lowest(M, count, ncv, Z)`` finds the lowest eigenpairs of
    # ``A φ = θ M φ`` outside known eigenvectors Z (n, k): θ (count,), Φ (n, count) with ``Φᵀ M Φ = 1``.
    lowest: Callable[[Any, int, int, Array], tuple[Array, Array]] | None = None


def factorise(A: Any, solver: Solver = "auto") -> Factor:
    """Factorise a symmetric positive definite matrix by the fastest solver installed, or by a named one.

    ``cholesky`` is cvxopt's CHOLMOD, ``superlu`` SciPy's; ``auto`` takes the faster of those installed. If n of A (n,
    n) is a multiple of three, so are the places of each node's unknowns.

    Raises
    ------
    TooLargeError
        The factor wouldn't fit into the memory that is available; the message gives both.
    MissingSolverError
        The solver is ``cholesky``, and cvxopt is not installed.
    AccuracyError
        A is not positive definite.
    """
    chosen = _choose_solver(solver, A.shape[0])
    if chosen == "superlu" and A.shape[0] < SMALL_SYSTEM:
        factor = _superlu(A)
        return Factor(factor.solve, _figures(chosen, "MMD", A.shape[0], (factor.nnz + A.shape[0]) // 2))
    A = sp.csr_array(A)
    order, name, nonzeros = _ordered(A)
    figures = _figures(chosen, name, A.shape[0], nonzeros)
    _refuse_too_large(figures, A.nnz)
    return Factor({"cholesky": _cholmod, "superlu": _superlu_in_order}[chosen](A, order), figures)


def _choose_solver(solver: Solver, n: int) -> Literal["cholesky", "superlu"]:
    """Choose the solver for n unknowns among those installed."""
    has_cvxopt = find_spec("cvxopt") is not None
    if solver == "cholesky" and not has_cvxopt:
        raise MissingSolverError("cvxopt, which brings CHOLMOD, is not installed: pip install cvxopt, or use 'superlu'")
    if solver == "auto":
        return "cholesky" if has_cvxopt and n >= SMALL_SYSTEM else "superlu"
    return solver


def _figures(chosen: str, order: str, n: int, nonzeros: int) -> FactorFigures:
    """Predict the memory of a factor from its nonzeros."""
    name = {"cholesky": "CHOLMOD", "superlu": "SuperLU"}[chosen]
    return FactorFigures(name, order, n, nonzeros, int(_BYTES[chosen] * nonzeros))


def _ordered(A: sp.csr_array) -> tuple[IntArray, str, int]:
    """Find a fill-reducing order of the unknowns; its name and the number of nonzeros of the factor come with it."""
    size = 3 if A.shape[0] % 3 == 0 else 1
    graph = node_graph(A, size)
    if find_spec("pymetis") is not None and graph.nnz:
        import pymetis

        name, order = "METIS", np.array(pymetis.nested_dissection(pymetis.CSRAdjacency(graph.indptr, graph.indices))[0])
    else:  # SuperLU's minimum degree, by a factorisation of the graph: 1/27 of the work
        dominant = sp.csc_array(graph + sp.diags_array(graph.sum(axis=0) + 1.0))
        name, order = "MMD", np.argsort(_superlu(dominant).perm_c)
    unknowns = (size * order.astype(np.int64)[:, None] + np.arange(size)).ravel()
    return unknowns, name, factor_nonzeros(graph[order][:, order], size)


def _refuse_too_large(figures: FactorFigures, nonzeros: int) -> None:
    """Raise `TooLargeError` if factor and matrix don't fit into the available memory."""
    needed, there = figures.memory + BYTES_OF_NONZERO * nonzeros, available_memory()
    if needed > there:
        raise TooLargeError(
            f"the factor of its {figures.unknowns} unknowns needs about {needed / _GIGA:.3g} GB of memory "
            f"({figures.solver}, {figures.order} order, {figures.nonzeros:.3g} nonzeros), the machine has "
            f"{there / _GIGA:.3g} GB to spare; make the mesh coarser, or take several machines: "
            'modes.solver = "slepc"'
        )


def _cholmod(A: sp.csr_array, order: IntArray) -> Callable[[Array], Array]:
    """Factorise by CHOLMOD with the unknowns in the given order; returns the solve."""
    from cvxopt import cholmod, matrix, sparse, spmatrix

    lower = sp.tril(A, format="coo")
    rows, columns = (matrix(index.astype(np.int64)) for index in lower.coords)
    C = spmatrix(matrix(lower.data), rows, columns, A.shape)
    factor = cholmod.symbolic(C, p=matrix(order))
    try:
        cholmod.numeric(C, factor)
    except ArithmeticError as error:
        raise AccuracyError(
            f"the shifted stiffness is not positive definite: CHOLMOD stopped at pivot {error}"
        ) from error

    def solve(f: Array) -> Array:
        x = matrix(np.asfortranarray(f))
        if x.size[1] == 1:
            cholmod.solve(factor, x)
        else:  # solve() takes one column at a time, spsolve() four: half the time
            x = matrix(cholmod.spsolve(factor, sparse(x)))
        return np.array(x).reshape(f.shape)

    return solve


def _superlu(A: Any) -> Any:
    """Factorise a symmetric matrix by SuperLU, without leaving the diagonal for pivots."""
    return splu(sp.csc_array(A), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def _superlu_in_order(A: sp.csr_array, order: IntArray) -> Callable[[Array], Array]:
    """Factorise by SuperLU with the unknowns in the given order; returns the solve."""
    inside = sp.csc_array(A[order][:, order])
    factor = splu(inside, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True})

    def solve(f: Array) -> Array:
        x = np.empty_like(f)
        x[order] = factor.solve(np.ascontiguousarray(f[order]))
        return x

    return solve
