"""Load and energy of the strain that is quadratic in a displacement, which stiffens a body that is held all around.

Green's strain of a displacement u is ``ε(u) + ½ ∂_a u·∂_b u``. A body that is free to shorten answers to the second
part by a small displacement v, which takes nearly all of its energy away; what is left stretches the body (von Kármán;
Bathe, Finite Element Procedures, section 6.2).
"""

from __future__ import annotations

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.memory import STRESSED_AT_ONCE
from fmd.fem.geometric_stiffness import geometric_stiffness
from fmd.fem.gradients import gradients
from fmd.fem.model import FEModel


def quadratic_strain_load(fe: FEModel, u: Array) -> tuple[Array, float]:
    """Return the load on a small displacement by the quadratic strain of another, and that strain's own energy.

    Parameters
    ----------
    fe : FEModel
        The body.
    u : ndarray, shape (n_nodes, 3)
        Displacement [m].

    Returns
    -------
    f : ndarray, shape (n_nodes, 3)
        ``f·v = ∫ C E : ε(v) + σ(u) : ∂u·∂v``, with ``E = ½ ∂u·∂u`` [N].
    energy : float
        ``½ ∫ E : C E`` [J].
    """
    space = fe.discretisation
    X, w = space.kind.quadrature(space.kind.mass_order)
    f, energy = np.asarray(geometric_stiffness(fe, u[:, :, None])[0] @ u), 0.0
    for start in range(0, len(space.element_nodes), STRESSED_AT_ONCE):
        part = np.arange(start, min(start + STRESSED_AT_ONCE, len(space.element_nodes)))
        g, det = gradients(space, X, part)
        nodes = space.element_nodes[part]
        slopes = np.einsum("eqia,eib->eqab", g, u[nodes], optimize=True)  # ∂_a u_b
        E = 0.5 * slopes @ slopes.swapaxes(2, 3)
        stress = np.empty_like(E)
        for own, mine in fe.material.over(part):
            lam, mu = own.lame
            stress[mine] = 2 * mu * E[mine]
            stress[mine] += lam * np.trace(E[mine], axis1=2, axis2=3)[..., None, None] * np.eye(3)
        volume = np.abs(det) * w
        energy += 0.5 * float(np.einsum("eqab,eqab,eq->", stress, E, volume, optimize=True))
        np.add.at(f, nodes, np.einsum("eqia,eqab,eq->eib", g, stress, volume, optimize=True))
    return f, energy


def membrane_ratio(fe: FEModel, u: Array, v: Array, f: Array, energy: float) -> float:
    """Return how much stiffer stretching makes a body at a displacement, relative to its linear stiffness.

    Parameters
    ----------
    u : ndarray, shape (n_nodes, 3)
        Displacement [m].
    v : ndarray, shape (n_nodes, 3)
        Static response to ``−f`` [m].
    f, energy
        As `quadratic_strain_load` returns them.
    """
    flat = u.ravel()
    linear = 0.5 * float(flat @ (fe.K @ flat))
    left = energy + 0.5 * float((f * v).sum())
    return max(2 * left / linear, 0.0) if linear else 0.0
