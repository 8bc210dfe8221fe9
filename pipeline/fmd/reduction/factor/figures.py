"""Figures of a factorisation as plain data, which is read without loading a solver."""

from fmd.core.data_classes import dataclass


@dataclass(frozen=True, slots=True)
class FactorFigures:
    """Solver, order, size and memory of a factorisation."""

    # ``multifrontal``, ``CHOLMOD`` or ``SuperLU``; ``MUMPS`` and others of PETSc's with the number of ranks
    solver: str
    order: str  # method that reordered the unknowns: ``METIS`` (nested dissection), ``MMD`` (minimum degree) or ``own``
    unknowns: int  # number of unknowns of the matrix
    nonzeros: int  # number of nonzeros of its Cholesky factor in this order
    memory: int  # memory that the solver keeps, by prediction [bytes]
