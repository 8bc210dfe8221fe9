"""Standard input data (SID) of a flexible body: the terms of its equations of motion, to first order in its modes.

In the frame of the body, with its origin's acceleration a, its angular velocity ω and acceleration α::

    [ m 1    −c̃    Ctᵀ ] [ a ]   [ ω̃ω̃ c + 2 ω̃ Ctᵀ q̇       ]   [ f ]
    [ c̃      J     Crᵀ ] [ α ] + [ ω̃ J ω + Σ_j Gr_j q̇_j ω  ] = [ l ]
    [ Ct     Cr    Me  ] [ q̈ ]   [ Oe Ω + Σ_j Ge_j q̇_j ω   ]   [ h − Ke q − De q̇ ]

with ``c = mdCM``, ``Ω = (ω₁², ω₂², ω₃², ω₁ω₂, ω₂ω₃, ω₁ω₃)``; mdCM, J, Ct, Cr, Gr and Oe are linear in q. Geometric
stiffening is in the first orders of Ct, Cr and Oe, which linear acceleration, angular acceleration and rotation take,
and in those of a node's phi and psi, which forces and torques there take.

Wallrapp, Standardization of flexible body modeling in multibody system codes, Mechanics of Structures and Machines 22
(1994) 283–304; Schwertassek & Wallrapp, Dynamik flexibler Mehrkörpersysteme, Vieweg (1999), section 6.
"""

from collections.abc import Mapping
from dataclasses import field
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.files import LOST_BY_SUBTRACTION, SAME_INTEGRAL, STIFFENS
from fmd.reduction.body import MarkerShapes
from fmd.reduction.inertia import InertiaIntegrals
from fmd.reduction.modal_data import ModalData, integrals_of, rate_products, rate_turns

PARTS = ("mdCM", "J", "Ct", "Cr", "Me", "Gr", "Ge", "Oe", "ksigma", "Ke", "De")
"""Terms of a body, in the order of its file."""


@dataclass(frozen=True)
class Taylor:
    """A term of SID: ``M0 + Σ_k M1[:, k] q_k``."""

    M0: Array  # (n_rows, n_columns): order zero
    # (n_rows, n, n_columns) or (n_rows, 0, n_columns): first order; no entries if it is left out
    M1: Array = field(default_factory=lambda: np.zeros((0, 0, 0)))

    @property
    def order(self) -> int:
        """Highest order of the term, 0 or 1."""
        return int(self.M1.size > 0)

    def at(self, q: Array) -> Array:
        """Return the term at modal coordinates q (n,), shape (n_rows, n_columns)."""
        return self.M0 + np.einsum("rkc,k->rc", self.M1, q) if self.order else self.M0


def sid_terms(data: ModalData) -> dict[str, Taylor]:
    """Compute the terms of a body's equations of motion from its inertia integrals; keys are `PARTS`."""
    integrals, n = data.integrals, data.n
    G, S = integrals.G, integrals.S
    modal, mixed = G[:, :, 1:, 1:], G[:, :, 0, 1:]
    displacement2 = integrals.displacement2 if integrals.displacement2.size else np.zeros((3, n, n))
    rotation2 = integrals.rotation2 if integrals.rotation2.size else np.zeros((3, n, n))
    P = G[:, :, 0, 0]
    # ∫ x̃ φ̃_j dm = ∫ φ_j xᵀ dm − 1 ∫ x·φ_j dm, for the undeformed body and by another mode.
    pure = modal + integrals.stiffening if integrals.stiffening.size else modal
    C4 = mixed.transpose(1, 0, 2) - np.eye(3)[:, :, None] * np.einsum("aaj->j", mixed)
    C6 = pure.transpose(1, 0, 2, 3) - np.eye(3)[:, :, None, None] * np.einsum("aakj->kj", pure)
    J1 = -(C4 + C4.transpose(1, 0, 2))
    turns = rate_turns(modal)
    return {
        "mdCM": Taylor(S[:, :1], S[:, 1:, None]),
        "J": Taylor(np.trace(P) * np.eye(3) - P, J1.transpose(0, 2, 1)),
        "Ct": Taylor(S[:, 1:].T, displacement2.transpose(1, 2, 0)),
        "Cr": Taylor(rate_turns(mixed).T, (turns.transpose(0, 2, 1) + rotation2).transpose(1, 2, 0)),
        "Me": Taylor(data.M),
        "Gr": Taylor(-2 * C4.transpose(0, 2, 1).reshape(3, 3 * n), -2 * C6.transpose(0, 2, 3, 1).reshape(3, n, 3 * n)),
        "Ge": Taylor(2 * turns.transpose(2, 1, 0).reshape(n, 3 * n)),
        "Oe": Taylor(rate_products(mixed).T, rate_products(modal).transpose(1, 2, 0)),
        "ksigma": Taylor(np.zeros((n, 1))),
        "Ke": Taylor(data.K),
        "De": Taylor(data.D),
    }


def modal_data_of(mass: float, terms: Mapping[str, Taylor], nodes: Mapping[str, MarkerShapes]) -> ModalData:
    """Recover a body's inertia integrals from its mass [kg] and the terms `PARTS` of its equations of motion.

    They are taken from Oe, Ge, Cr, Ct, J and mdCM; J may be a matrix or the vector xx, yy, zz, xy, xz, yz. Gr and the
    first orders of mdCM and J hold nothing more: where a file has something else there, a note of the body says so,
    since only one of both can be right.

    Raises
    ------
    ValueError
        Ge isn't antisymmetric in the modes.
    """
    n = terms["Ke"].M0.shape[0]
    J = _tensor(terms["J"])
    Ct, Cr, Ge, Oe = (terms[name] for name in ("Ct", "Cr", "Ge", "Oe"))
    first = {
        name: term.M1 if term.order else np.zeros((term.M0.shape[0], n, term.M0.shape[1]))
        for name, term in terms.items()
    }
    G = np.zeros((3, 3, 1 + n, 1 + n))
    G[:, :, 0, 0] = 0.5 * np.trace(J.M0) * np.eye(3) - J.M0
    mixed = integrals_of(Oe.M0.T, Cr.M0.T)
    G[:, :, 0, 1:], G[:, :, 1:, 0] = mixed, mixed.transpose(1, 0, 2)
    scale = float(np.abs(terms["Me"].M0).max())
    turns = _turns(Ge.M0, scale)
    products = first["Oe"].transpose(2, 0, 1)
    products = 0.5 * (products + products.transpose(0, 2, 1))  # some programs write one half of it, doubled
    modal = integrals_of(products, turns)
    G[:, :, 1:, 1:] = modal
    S = np.column_stack([terms["mdCM"].M0, Ct.M0.T])
    C4 = mixed.transpose(1, 0, 2) - np.eye(3)[:, :, None] * np.einsum("aaj->j", mixed)
    J1 = -(C4 + C4.transpose(1, 0, 2))
    notes = [
        *_compare("Gr", terms["Gr"].M0.reshape(3, n, 3), -2 * C4.transpose(0, 2, 1), "Oe and Cr"),
        *_compare("the first order of mdCM", first["mdCM"][:, :, 0], Ct.M0.T, "Ct"),
        *(_compare("the first order of J", J.M1, J1.transpose(0, 2, 1), "Oe") if J.order else ()),
    ]
    stiffening, exact = _stiffening(terms["Gr"], terms["Me"].M0, modal, scale)
    displacement2 = first["Ct"].transpose(2, 0, 1)
    rotation2 = first["Cr"].transpose(2, 0, 1) - turns.transpose(0, 2, 1) if Cr.order else np.zeros((3, n, n))
    second: dict[str, Any] = {}
    for name, term, least in (
        ("stiffening", stiffening, STIFFENS),
        ("displacement2", displacement2, 0.0),
        ("rotation2", rotation2, LOST_BY_SUBTRACTION),
    ):
        if np.abs(term).max(initial=0.0) > least * scale:
            second[name] = 0.5 * (term + term.swapaxes(-1, -2))
    integrals = InertiaIntegrals(G, S, mass, **second)
    bound = bool(second) or any(node.displacement2.any() for node in nodes.values())
    separable = exact or "stiffening" not in second
    return ModalData(integrals, terms["Ke"].M0, terms["De"].M0, nodes, tuple(notes), bound, separable)


def _tensor(J: Taylor) -> Taylor:
    """Return the inertia as a matrix, which files may hold as a vector xx, yy, zz, xy, xz, yz."""
    if J.M0.shape != (6, 1):
        return J
    place = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])
    return Taylor(J.M0[place, 0], np.moveaxis(J.M1[place, :, 0], 2, 1) if J.order else J.M1)


def _stiffening(Gr: Taylor, Me: Array, modal: Array, scale: float) -> tuple[Array, bool]:
    """Geometric stiffness that is in the first order of Oe, shape (3, 3, n, n), and if it is known axis by axis.

    The first order of Gr has the same integrals without it, where a file holds it. Else only their sum is known, from
    Me, which is all that the equations of motion in the file's own frame take.
    """
    n = len(Me)
    loss = Me - np.einsum("aaij->ij", modal)
    if Gr.order:
        C6 = -0.5 * Gr.M1.reshape(3, n, n, 3).transpose(0, 3, 1, 2)
        pure = C6.transpose(1, 0, 2, 3) - 0.5 * np.eye(3)[:, :, None, None] * np.einsum("aakj->kj", C6)
        found = pure - modal
        found = 0.25 * (found + found.transpose(1, 0, 2, 3) + found.swapaxes(2, 3) + found.transpose(1, 0, 3, 2))
        if np.abs(np.einsum("aaij->ij", found) - loss).max(initial=0.0) < SAME_INTEGRAL * scale:
            return np.asarray(found), True
    return np.asarray(np.eye(3)[:, :, None, None] * loss / 3), False


def _turns(Ge: Array, scale: float) -> Array:
    """Integrals ``ε_abc ∫ φ_b φ_c dm``, shape (3, n, n), of Ge, whose columns go by modes, in some files by axes."""
    n = len(Ge)
    by_modes, by_axes = 0.5 * Ge.reshape(n, n, 3).transpose(2, 1, 0), 0.5 * Ge.reshape(n, 3, n).transpose(1, 2, 0)
    defects = [float(np.abs(turns + turns.transpose(0, 2, 1)).max(initial=0.0)) for turns in (by_modes, by_axes)]
    if min(defects) > SAME_INTEGRAL * max(scale, float(np.abs(Ge).max(initial=0.0))):
        raise ValueError(f"Ge isn't antisymmetric in the modes: its halves differ by {min(defects):.1e}")
    turns = by_modes if defects[0] <= defects[1] else by_axes
    return np.asarray(0.5 * (turns - turns.transpose(0, 2, 1)))


def _compare(name: str, term: Array, expected: Array, others: str) -> list[str]:
    """Say how far a term is from what others give, unless they agree."""
    size = max(float(np.abs(term).max(initial=0.0)), float(np.abs(expected).max(initial=0.0)))
    apart = float(np.abs(term - expected).max(initial=0.0))
    if apart <= SAME_INTEGRAL * size:
        return []
    return [f"{name} is not what {others} give, by {apart / size:.1e} of its largest entry; the latter are taken"]
