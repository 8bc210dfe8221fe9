"""Motions of links that nothing resists: left out if nothing moves by them, refused if a mass does."""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from fmd.core.limits.mesh import IDLE


def without_idle_motions(
    T: sp.csr_array, stretch: sp.csr_array, m: sp.csr_array, n_nodes: int, names: Sequence[str]
) -> tuple[sp.csr_array, int]:
    """Leave out motions of links that strain nothing and move no mass, as that of a bar about itself.

    Names are those of the links of the last columns of T. Returns T, and how many of its last columns are motions of
    links.

    Raises
    ------
    ValueError
        A mass moves in one of them: it hangs on too few nodes.
    """
    first = T.shape[1] - len(names)
    own = sp.csc_array(T[:, first:])
    own = sp.csc_array(own @ sp.diags_array(1.0 / abs(own).max(axis=0).toarray().ravel()))  # to displacements
    sizes = abs(stretch).max(axis=1).toarray().ravel()
    felt = sp.csr_array(sp.vstack([own[: 3 * n_nodes], sp.diags_array(1.0 / sizes) @ stretch @ own]))
    strained = sp.csr_array(felt.T @ felt)
    masses = np.repeat(m.diagonal(), 3)
    moved = sp.csr_array(own.T @ sp.diags_array(np.where(np.arange(len(masses)) < 3 * n_nodes, 0.0, masses)) @ own)
    n_groups, group = connected_components(strained, directed=False)
    columns, found = [], False
    for k in range(n_groups):
        members = np.flatnonzero(group == k)
        size, motion = np.linalg.eigh(strained[members][:, members].toarray())
        idle = size <= IDLE * max(size[-1], 1.0)
        found |= bool(idle.any())
        inertia = moved[members][:, members].toarray()
        moving = motion[:, idle].T @ inertia @ motion[:, idle]
        if np.abs(moving).max(initial=0.0) > IDLE * np.abs(moved.diagonal()).max():
            raise ValueError(
                f"{names[members[0]]} carries a mass that nothing holds in all directions; tie it to nodes that "
                "don't lie on a line, or by springs"
            )
        columns.append(own[:, members] @ motion[:, ~idle])
    if not found:
        return T, len(names)
    kept = sp.csr_array(np.concatenate(columns, axis=1))
    return sp.csr_array(sp.hstack([T[:, :first], kept])), kept.shape[1]
