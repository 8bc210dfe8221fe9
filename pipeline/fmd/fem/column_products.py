"""Kernel of a sparse matrix' product with as many columns as a register of the processor holds."""

from fmd.core.arrays import Array, IntArray
from fmd.kernels.kernel import contracted, kernel
from fmd.kernels.machine import register_width
from fmd.kernels.vectors import fill_vector, read_vector, write_vector

LANES = register_width()  # columns at a time


@kernel
def multiply_columns(indptr: IntArray, indices: IntArray, data: Array, x: Array, product: Array) -> None:
    """Set ``product`` (m, lanes) to the matrix times x (n, lanes)."""
    for i in range(len(indptr) - 1):
        _multiply_row(indices, data, indptr[i], indptr[i + 1], x, LANES * i, product)


@contracted
def _multiply_row(indices: IntArray, data: Array, first: int, end: int, x: Array, at: int, product: Array) -> None:
    """Write a row's product, the sum of its entries from ``first`` to ``end``."""
    even = odd = fill_vector(0.0, LANES)  # two sums, of which neither waits for the other
    for k in range(first, end - 1, 2):
        even = even + data[k] * read_vector(x, LANES * indices[k], LANES)
        odd = odd + data[k + 1] * read_vector(x, LANES * indices[k + 1], LANES)
    if (end - first) % 2:
        even = even + data[end - 1] * read_vector(x, LANES * indices[end - 1], LANES)
    write_vector(product, at, even + odd)
