"""Compiled code: how long it may get, and how it is laid out."""

# Formulas.
MOST_FACTORS = 16  # of a whole power that is written as products
FAR_ANGLE = 1e9  # beyond it sine and cosine need more digits of π than the short reduction has
MOST_PRODUCTS = 8  # a power that is written as a product

# Products.
UNROLLED = 16  # Matrices of so many columns are multiplied without a loop, their columns in the code.
ACCUMULATORS = 8  # Vector registers that a product sums in: enough to hide the latency of ``fma``.
COLUMNS_AT_ONCE = 4  # columns of a product that are summed one after the other: others hide the latency of ``fma``
ROWS_AT_ONCE = 4  # rows, into two sums that don't wait for each other
SQUARE_SIDE = 8  # rows and columns of the square blocks of a product that is written out
