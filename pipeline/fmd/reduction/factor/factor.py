"""Factors of large symmetric positive definite matrices, by our own multifrontal method or by CHOLMOD.

Both work on an order that fills in little, by METIS or minimum degree; of small matrices SciPy's SuperLU makes the
factor.
Its size is known from the elimination tree before anything is factorised, so one that doesn't fit is refused at once.
"""

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any, Literal

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError
from fmd.core.limits.memory import (
    BYTES_FOR_CHOLMOD,
    BYTES_OF_MATRICES,
    BYTES_OF_SHIFTED,
    SMALL_SYSTEM,
    VECTORS_BESIDE,
    VECTORS_OF_BLOCK,
    VECTORS_OF_MODE,
)
from fmd.core.memory import available_memory
from fmd.core.threads import one_thread
from fmd.reduction.factor.figures import FactorFigures
from fmd.reduction.factor.superlu import superlu


def factor_nonzeros(counts: IntArray, size: int = 1) -> int:
    """Sum up a factor's nonzeros of its columns' counts, by nodes of ``size`` columns, each one shorter than before."""
    return int(size**2 * counts.sum() - size * (size - 1) // 2 * len(counts))


Solver = Literal["auto", "cholesky", "multifrontal"]

_BYTES = {"CHOLMOD": 10.5, "SuperLU": 21.0}  # for each nonzero of L; SuperLU keeps U as well
_GIGA = 1e9


class TooLargeError(MemoryError):
    """A factor, or static responses by it, need more memory than there is; nothing has been computed."""


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
    at_once: int = 1  # loads that it solves for in the time of one


def factorise(A: Any, solver: Solver = "auto") -> Factor:
    """Factorise a symmetric positive definite matrix (n, n), both of whose triangles are given.

    A node's three unknowns that begin at a multiple of three make it quicker. ``multifrontal`` is our own, ``cholesky``
    cvxopt's CHOLMOD; ``auto`` takes our own for all but small matrices.

    Raises
    ------
    TooLargeError
        The factor wouldn't fit into the memory that is available; the message gives both.
    MissingSolverError
        The solver is ``cholesky``, and cvxopt is not installed.
    AccuracyError
        A is not positive definite, or has entries that are no finite numbers.
    """
    if not np.isfinite(A.data).all():
        raise AccuracyError(f"{np.count_nonzero(~np.isfinite(A.data))} entries of the stiffness are no finite numbers")
    if solver == "cholesky" and find_spec("cvxopt") is None:
        raise MissingSolverError("cvxopt, which brings CHOLMOD, is not installed: pip install cvxopt, or use 'auto'")
    n = A.shape[0]
    if solver == "auto" and n < SMALL_SYSTEM:
        factor = superlu(A)
        nonzeros = (factor.nnz + n) // 2
        return Factor(factor.solve, FactorFigures("SuperLU", "MMD", n, nonzeros, int(_BYTES["SuperLU"] * nonzeros)))
    A = sp.csr_array(A)
    from fmd.reduction.factor import multifrontal as own
    from fmd.reduction.factor.order import fill_reducing_order, node_graph
    from fmd.reduction.factor.panels import LANES

    order = fill_reducing_order(*node_graph(A))
    counts, parent = own.elimination_tree(order.graph)
    nonzeros = factor_nonzeros(counts, order.size)
    if solver == "cholesky":
        figures = FactorFigures("CHOLMOD", order.name, n, nonzeros, int(_BYTES["CHOLMOD"] * nonzeros))
        _refuse_too_large(figures, BYTES_FOR_CHOLMOD * A.nnz)
        return Factor(_cholmod(A, order.unknowns), figures)
    again, fronts = own.plan_fronts(order, counts, parent)
    figures = FactorFigures("multifrontal", order.name, n, nonzeros, 8 * sum(front.entries for front in fronts))
    stack = own.plan_stack(fronts)
    widened = 8.0 * A.nnz if A.indices.itemsize < 8 else 0.0
    _refuse_too_large(figures, own.bytes_beside(fronts, stack, A.nnz) + widened)
    with one_thread():
        return Factor(own.factorise_fronts(A, order.unknowns[again], fronts, stack), figures, at_once=LANES)


def _refuse_too_large(figures: FactorFigures, beside: float) -> None:
    """Raise `TooLargeError` if a factor and what is needed beside it [bytes] don't fit into the available memory."""
    refuse_too_large(
        figures.memory + beside,
        f"the factor of its {figures.unknowns} unknowns needs",
        f" ({figures.solver}, {figures.order} order, {figures.nonzeros:.3g} nonzeros)",
        ', or take several machines: modes.solver = "slepc"',
    )


def refuse_too_large(needed: float, what: str, how: str = "", remedy: str = "") -> None:
    """Raise `TooLargeError` if what is needed [bytes] doesn't fit into the available memory."""
    there = available_memory()
    if needed > there:
        raise TooLargeError(
            f"{what} about {needed / _GIGA:.3g} GB of memory{how}, the machine has {there / _GIGA:.3g} GB to spare; "
            f"make the mesh coarser{remedy}"
        )


def refuse_large_search(factor: Factor, unknowns: int, count: int) -> None:
    """Raise `TooLargeError` if the vectors of a search for so many modes don't fit into the available memory."""
    if factor.lowest is None:  # in this process
        what = f"the search for {count} modes of its {unknowns} unknowns needs"
        refuse_too_large(_search_bytes(unknowns, count, factor.at_once), what, remedy=", or take fewer modes")


def _search_bytes(unknowns: int, count: int, at_once: int) -> float:
    """Memory of the vectors of a search for so many modes [bytes]."""
    return 8.0 * unknowns * (VECTORS_OF_MODE * count + VECTORS_OF_BLOCK * at_once + VECTORS_BESIDE)


def predict_bytes(nodes: IntArray, count: int) -> float:
    """Predict the memory of a search for so many modes [bytes], with matrices and our own factor.

    Each element couples all unknowns of its nodes (n_elements, n_local), three a node.
    """
    from fmd.reduction.factor import multifrontal as own
    from fmd.reduction.factor.order import fill_reducing_order
    from fmd.reduction.factor.panels import LANES

    ends = np.arange(len(nodes) + 1) * nodes.shape[1]
    within = sp.csr_array((np.ones(nodes.size, dtype=np.int8), nodes.ravel(), ends))
    graph = sp.csr_array(within.T @ within)
    order, unknowns = fill_reducing_order(graph, 3), 3 * graph.shape[0]
    _, fronts = own.plan_fronts(order, *own.elimination_tree(order.graph))
    beside = own.bytes_beside(fronts, own.plan_stack(fronts), 9 * graph.nnz) + BYTES_OF_SHIFTED * graph.nnz
    kept = 8 * sum(front.entries for front in fronts) + BYTES_OF_MATRICES * graph.nnz
    return float(kept + max(beside, _search_bytes(unknowns, count, LANES)))


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
