"""SuperLU's factors of symmetric matrices, which bodies of few unknowns need alone."""

from typing import Any

import scipy.sparse as sp
from scipy.sparse.linalg import splu


def superlu(A: sp.csr_array) -> Any:
    """Factorise a symmetric matrix by SuperLU, without leaving the diagonal for pivots."""
    return splu(sp.csc_array(A), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
