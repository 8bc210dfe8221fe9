"""Shape functions and quadrature of scikit-fem by their names, loaded when an element is computed with."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from fmd.core.arrays import Array


def skfem_element(name: str) -> Callable[[], Any]:
    """Return a function that makes an element of scikit-fem, e.g. ``ElementTetP1``."""
    return partial(_make_element, name)


def _make_element(name: str) -> Any:
    import skfem

    return getattr(skfem, name)()


def skfem_quadrature(cell: str, order: int) -> tuple[Array, Array]:
    """Return points (n_dim, n_q) and weights (n_q,) on a reference cell of scikit-fem, e.g. ``RefTet``.

    They are exact to a polynomial degree, on lines, squares and cubes along each axis.
    """
    from skfem import quadrature, refdom

    X, w = quadrature.get_quadrature(getattr(refdom, cell), order)
    return X, w
