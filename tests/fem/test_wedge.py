"""Wedges: the quadrature; their shape functions are tested with those of the other elements."""

from math import factorial

import pytest

from fmd.fem.cells.wedge import Wedge


@pytest.mark.parametrize("degree", [2, 4, 6])
def test_the_wedges_quadrature_is_exact(degree: int) -> None:
    (x, y, z), w = Wedge.quadrature(degree)
    # ∫ x^a y^b over the triangle is a! b! / (a + b + 2)!, ∫ z^c over the line 1 / (c + 1)
    for a in range(degree + 1):
        b = degree - a
        exact = factorial(a) * factorial(b) / factorial(degree + 2) / (degree + 1)
        assert w @ (x**a * y**b * z**degree) == pytest.approx(exact, rel=1e-12)
