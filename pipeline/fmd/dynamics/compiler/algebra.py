"""Vectors of three or six scalars and small matrices of them, as lists."""

from collections.abc import Sequence

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.dynamics.compiler.graph import Graph, Scalar, total

Vector3 = list[Scalar]
Vector6 = list[Scalar]
Matrix = list[list[Scalar]]


def constants(graph: Graph, values: Array | Sequence[float]) -> list[Scalar]:
    """Make scalars of numbers."""
    return [graph.number(float(value)) for value in values]


def identity(graph: Graph, size: int) -> Matrix:
    """Make the unit matrix."""
    return [[graph.number(float(i == j)) for j in range(size)] for i in range(size)]


def add(*vectors: Sequence[Scalar]) -> list[Scalar]:
    """Return the sum of vectors."""
    return [total(entries) for entries in zip(*vectors, strict=True)]


def subtract(a: Sequence[Scalar], b: Sequence[Scalar]) -> list[Scalar]:
    """Return ``a − b``."""
    return [x - y for x, y in zip(a, b, strict=True)]


def scale(factor: Scalar | float, a: Sequence[Scalar]) -> list[Scalar]:
    """Return ``factor a``."""
    return [x * factor for x in a]


def multiply(a: Sequence[Scalar], b: Sequence[Scalar]) -> list[Scalar]:
    """Return the products of entries."""
    return [x * y for x, y in zip(a, b, strict=True)]


def dot(a: Sequence[Scalar], b: Sequence[Scalar]) -> Scalar:
    """Return ``a · b``; products with 0 aren't tried, for most of them are."""
    terms = [x * y for x, y in zip(a, b, strict=True) if x.constant != 0.0 and y.constant != 0.0]
    return total(terms) if terms else a[0].graph.number(0.0)


def cross(a: Sequence[Scalar], b: Sequence[Scalar]) -> Vector3:
    """Return ``a × b``."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def tilde(a: Sequence[Scalar]) -> Matrix:
    """Return the matrix of the cross product, ``ã b = a × b``."""
    zero = a[0].graph.number(0.0)
    return [[zero, -a[2], a[1]], [a[2], zero, -a[0]], [-a[1], a[0], zero]]


def diagonal(values: Sequence[Scalar]) -> Matrix:
    """Make a diagonal matrix."""
    zero = values[0].graph.number(0.0)
    return [[value if i == j else zero for j in range(len(values))] for i, value in enumerate(values)]


def transpose(A: Matrix) -> Matrix:
    """Return ``Aᵀ``."""
    return [list(row) for row in zip(*A, strict=True)]


def times(A: Matrix, x: Sequence[Scalar]) -> list[Scalar]:
    """Return ``A x``."""
    return [dot(row, x) for row in A]


def product(A: Matrix, B: Matrix) -> Matrix:
    """Return ``A B``."""
    columns = transpose(B)
    return [[dot(row, column) for column in columns] for row in A]


def add_matrices(A: Matrix, B: Matrix) -> Matrix:
    """Return ``A + B``."""
    return [add(a, b) for a, b in zip(A, B, strict=True)]


def subtract_matrices(A: Matrix, B: Matrix) -> Matrix:
    """Return ``A − B``."""
    return [subtract(a, b) for a, b in zip(A, B, strict=True)]


def symmetric_product(A: Matrix, B: Matrix) -> Matrix:
    """Return ``A Bᵀ`` where that is known to be symmetric: its lower triangle is computed and mirrored."""
    out: Matrix = [[] for _ in A]
    for i, row in enumerate(A):
        out[i] = [dot(row, B[j]) for j in range(i + 1)]
    return [[out[max(i, j)][min(i, j)] for j in range(len(A))] for i in range(len(A))]


def congruence(R: Matrix, A: Matrix) -> Matrix:
    """Return ``R A Rᵀ`` for a symmetric A."""
    return symmetric_product(product(R, A), R)


@dataclass(frozen=True)
class SymmetricFactor:
    """Factors of a symmetric positive definite matrix ``A = L D Lᵀ``, L unit lower."""

    L: Matrix  # its entries below the diagonal; the others are unused
    inverse_D: list[Scalar]  # inverses of the diagonal of D

    def forward(self, x: Sequence[Scalar]) -> list[Scalar]:
        """Return ``L⁻¹ x``."""
        x = list(x)
        for i in range(len(x)):
            for k in range(i):
                x[i] = x[i] - self.L[i][k] * x[k]
        return x

    def divide(self, x: Sequence[Scalar]) -> list[Scalar]:
        """Return ``D⁻¹ x``."""
        return multiply(x, self.inverse_D)

    def backward(self, x: Sequence[Scalar]) -> list[Scalar]:
        """Return ``L⁻ᵀ x``."""
        x = list(x)
        for i in reversed(range(len(x))):
            for k in range(i + 1, len(x)):
                x[i] = x[i] - self.L[k][i] * x[k]
        return x

    def solve(self, x: Sequence[Scalar]) -> list[Scalar]:
        """Return ``A⁻¹ x``."""
        return self.backward(self.divide(self.forward(x)))


def factor_symmetric(A: Matrix) -> SymmetricFactor:
    """Factor a symmetric positive definite matrix by its lower triangle."""
    zero = A[0][0].graph.number(0.0)
    n = len(A)
    L, LD = ([[zero] * n for _ in range(n)] for _ in range(2))
    inverse_D: list[Scalar] = []
    for j in range(n):
        pivot = A[j][j]
        for k in range(j):
            pivot = pivot - L[j][k] * LD[j][k]
        inverse_D.append(pivot.inverse())
        for i in range(j + 1, n):
            LD[i][j] = A[i][j]
            for k in range(j):
                LD[i][j] = LD[i][j] - L[i][k] * LD[j][k]
            L[i][j] = LD[i][j] * inverse_D[j]
    return SymmetricFactor(L, inverse_D)


def spatial(upper_left: Matrix, upper_right: Matrix, lower_right: Matrix) -> Matrix:
    """Assemble a symmetric 6 × 6 matrix of its blocks for translation and rotation."""
    lower_left = transpose(upper_right)
    upper = [a + b for a, b in zip(upper_left, upper_right, strict=True)]
    return upper + [a + b for a, b in zip(lower_left, lower_right, strict=True)]


def rotate(R: Matrix, x: Sequence[Scalar]) -> Vector6:
    """Return the translational and the rotational part of a vector of six, each turned by R."""
    return times(R, x[:3]) + times(R, x[3:])


def rotate_inertia(R: Matrix, A: Matrix) -> Matrix:
    """Return a symmetric 6 × 6 matrix in axes turned by R."""
    upper_left, lower_right = [row[:3] for row in A[:3]], [row[3:] for row in A[3:]]
    upper_right = product(product(R, [row[3:] for row in A[:3]]), transpose(R))
    return spatial(congruence(R, upper_left), upper_right, congruence(R, lower_right))


def shift_matrix(arm: Sequence[Scalar]) -> Matrix:
    """Return B with ``B x`` the acceleration at the end of an arm, for x = (a, α) at its start."""
    graph = arm[0].graph
    minus = [scale(-1.0, row) for row in tilde(arm)]
    unit, zero = identity(graph, 3), [graph.number(0.0)] * 3
    return [unit[i] + minus[i] for i in range(3)] + [zero + unit[i] for i in range(3)]
