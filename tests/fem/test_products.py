"""Products of sparse matrices with many columns, beside dense ones."""

import numpy as np
import pytest
import scipy.sparse as sp

from fmd.fem import products as products_module
from fmd.fem.products import SparseProducts


@pytest.mark.parametrize("shape", [(40,), (40, 0), (40, 1), (40, 3), (40, 8), (40, 19)])
def test_products_are_those_of_the_dense_matrix(shape: tuple[int, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows with no entry, one, and even and odd numbers of them are among the matrix'."""
    rng = np.random.default_rng(0)
    A = np.where(rng.random((50, 40)) < rng.random(50)[:, None], rng.standard_normal((50, 40)), 0.0)
    A[:3] = 0.0
    A[1, 5] = 2.0
    x = rng.standard_normal(shape)
    products = SparseProducts(sp.csr_array(A))
    for given, small in ((x, 0), (np.asfortranarray(x), 0), (x, 51)):
        monkeypatch.setattr(products_module, "SMALL_SYSTEM", small)
        np.testing.assert_allclose(products @ given, A @ x, rtol=0.0, atol=1e-13)
    assert np.array_equal(abs(products).toarray(), np.abs(A))
