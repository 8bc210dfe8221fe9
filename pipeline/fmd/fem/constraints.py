"""Linear equations between displacements, solved for all unknowns by the independent ones."""

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.mesh import DEEPEST_LINKS


def rows_of(nodes: IntArray) -> IntArray:
    """Return the displacements of nodes (k,) among those of all points, shape (3 k,)."""
    return np.asarray((3 * nodes[:, None] + np.arange(3)).ravel())


class Constraints:
    """Equations that give some unknowns of a body and its grid points by others, solved for all by independent ones.

    Unknowns are those of the body, then six of each grid point, its displacement and its rotation.
    """

    def __init__(self, n_unknowns: int, n_grids: int) -> None:
        self._n, self.n_unknowns = n_unknowns + 6 * n_grids, n_unknowns
        self._is_given = np.zeros(self._n, dtype=bool)
        self._rows: list[IntArray] = []
        self._columns: list[IntArray] = []
        self._values: list[Array] = []

    def grid(self, k: int) -> IntArray:
        """Return the six unknowns of a grid point."""
        return self.n_unknowns + 6 * k + np.arange(6)

    def give(self, unknowns: IntArray, others: IntArray, matrix: Array | sp.csr_array) -> None:
        """Let ``u[unknowns] = matrix @ u[others]``.

        Raises
        ------
        ValueError
            One of the unknowns is given already.
        """
        if self._is_given[unknowns].any():
            raise ValueError("a node is moved by two links, or by a link and a tie")
        self._is_given[unknowns] = True
        entries = sp.coo_array(matrix)
        row, column = entries.coords
        self._rows.append(unknowns[row])
        self._columns.append(others[column])
        self._values.append(entries.data)

    def are_given(self, unknowns: IntArray) -> NDArray[np.bool_]:
        """Return for each of some unknowns whether others give it."""
        return self._is_given[unknowns]

    def transformation(self) -> tuple[sp.csr_array, IntArray]:
        """Return T of ``u = T y``, shape (n, n_independent), and which of the unknowns y are, ascending.

        Raises
        ------
        ValueError
            Unknowns give one another in a circle.
        """
        place = np.concatenate([*self._rows, np.zeros(0, int)]), np.concatenate([*self._columns, np.zeros(0, int)])
        D = sp.csr_array((np.concatenate([*self._values, np.zeros(0)]), place), shape=(self._n, self._n))
        independent = np.flatnonzero(~self._is_given)
        T = E = sp.csr_array(sp.eye_array(self._n, format="csr")[:, independent])
        for _ in range(DEEPEST_LINKS):  # links that hang on links; usually once
            following = sp.csr_array(D @ T + E)
            if abs(following - T).sum() == 0.0:
                return T, independent
            T = following
        raise ValueError(f"links hang on one another in a circle, or more than {DEEPEST_LINKS} deep")
