"""Round-off taken out of a mechanism's constants, so that what is zero in theory is zero in its graph.

A plane part's finite element mesh leaves integrals and shapes of 1e-10 where theory has 0. They cost as much arithmetic
as all others. An entry is taken for round-off if it is below `SOLVED` of its natural scale: for inertia integrals
that of the modes' unit mass and the body's size, for markers the largest entry of its kind. So cleaning changes forces
by that share at most, and an entry above it is kept: a part that is nearly plane stays spatial.
"""

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.round_off import SOLVED, SUMMED
from fmd.dynamics.links import Link
from fmd.reduction.body import MarkerShapes
from fmd.reduction.second_order import SecondOrderMass, second_order_mass


@dataclass(frozen=True)
class InertiaForms:
    """Constant inertia integrals of a body, in the combinations that its equations take."""

    # (3, 3, 1 + n, 1 + n): ``I_aa = G_bb + G_cc`` and ``I_ab = −½ (G_ab + G_ba)``, symmetric each: with p = (1, q), the
    # inertia tensor is ``J_ab = pᵀ I_ab p``
    I_ab: Array
    A_a: Array  # (3, 1 + n, 1 + n): ``A_a = G_bc − G_cb`` by the axis a across b and c, antisymmetric each
    S: Array  # (3, 1 + n): first moments
    displacement2: Array  # (3, n, n) or (3, 0, 0): second-order first moments
    rotation2: Array  # (3, n, n) or (3, 0, 0): second-order angular momentum
    mass: float  # [kg]
    normal: int  # number of the only axis that the body turns about, or -1

    @property
    def second_order(self) -> SecondOrderMass | None:
        """Modal mass of displacements of second order, if they have momenta."""
        if not (self.displacement2.size or self.rotation2.size):
            return None
        W, J = np.concatenate([self.S[:, 1:], -self.A_a[:, 1:, 0]]), self.I_ab[:, :, 0, 0]
        return second_order_mass(self.mass, self.S[:, 0], J, W, self.displacement2, self.rotation2, self.normal)


@dataclass(frozen=True)
class WholeForms(InertiaForms):
    """Constant inertia integrals of a body whose displacements of second order count with their whole energy."""

    F: Array  # (k, n, n): as in `SecondOrderFields`, whose fields are behind the modes in all forms
    W: Array  # (k, n): as in `SecondOrderFields`

    @property
    def second_order(self) -> SecondOrderMass:
        """Modal mass of displacements of second order."""
        return SecondOrderMass(self.F, self.W, np.eye(len(self.F)))


def inertia_forms(link: Link, threshold: float = SOLVED) -> InertiaForms:
    """Form a body's inertia integrals without their round-off, of which a threshold of 0 leaves all."""
    integrals = link.integrals
    fields = integrals.fields
    G, S = (integrals.G, integrals.S) if fields is None else (fields.G, fields.S)
    n = G.shape[-1]
    scale = np.ones(n)  # a mode's is its unit mass
    scale[0] = np.sqrt(max(np.trace(G[:, :, 0, 0]), 1e-300))
    limit = threshold * np.outer(scale, scale)
    forms, antisymmetric = np.zeros((3, 3, n, n)), np.zeros((3, n, n))
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        forms[a, a] = G[b, b] + G[c, c]
        forms[a, b] = forms[b, a] = -0.5 * (G[a, b] + G[b, a])
        antisymmetric[a] = G[b, c] - G[c, b]
    forms[np.abs(forms) <= limit], antisymmetric[np.abs(antisymmetric) <= limit] = 0.0, 0.0
    units = np.sqrt(integrals.mass) * scale
    S = np.where(np.abs(S) <= threshold * units, 0.0, S)
    if fields is not None:
        empty = np.zeros((3, 0, 0))
        F, W = _cut(fields.F, threshold), _cut(fields.W, threshold)
        return WholeForms(forms, antisymmetric, S, empty, empty, integrals.mass, integrals.normal, F, W)
    displacement2, rotation2 = _cut(integrals.displacement2, threshold), _cut(integrals.rotation2, threshold)
    return InertiaForms(forms, antisymmetric, S, displacement2, rotation2, integrals.mass, integrals.normal)


def rigid_constants(forms: InertiaForms) -> tuple[float, Array, Array]:
    """Return mass, first moment (3,) and inertia tensor (3, 3) of an undeformed body."""
    return forms.mass, forms.S[:, 0], forms.I_ab[:, :, 0, 0]


def clean_marker(at: MarkerShapes, n: int, threshold: float = SOLVED) -> MarkerShapes:
    """Return a marker of a body of n modes without round-off; shapes that are absent are zero."""
    shapes, rotations = (
        _cut(values, threshold) if values.size else np.zeros((3, n)) for values in (at.translation, at.rotation)
    )
    halves = [_cut(half, threshold) for half in (at.displacement2[:3], at.displacement2[3:])]
    displacement2 = np.concatenate(halves) if at.displacement2.size else np.zeros((6, n, n))
    return MarkerShapes(_cut(at.position, threshold), shapes, rotations, displacement2)


def clean_direction(direction: Array, threshold: float = SOLVED) -> Array:
    """Return the unit vector along a direction, shape (3,), without round-off."""
    unit = _cut(direction / np.linalg.norm(direction), threshold)
    return np.asarray(unit / np.linalg.norm(unit))


def _cut(values: Array, threshold: float) -> Array:
    values = np.asarray(values, dtype=float)
    return np.where(np.abs(values) <= threshold * np.abs(values).max(initial=0.0), 0.0, values)


def orthonormal_rows(rows: Array) -> tuple[Array, Array]:
    """Return an orthonormal basis Q, shape (rank, n), of rows (m, n), and the factor L (m, rank) with ``rows = L Q``.

    Row by row (Gram–Schmidt, twice), which keeps the zeros of the rows: the rows' own number of them spans Q.
    """
    basis: list[Array] = []
    for row in rows:
        rest = row.copy()
        for _ in range(2):
            for known in basis:
                rest = rest - (known @ rest) * known
        if float(np.linalg.norm(rest)) > SUMMED * float(np.linalg.norm(row)):
            basis.append(rest / np.linalg.norm(rest))
    Q = np.reshape(basis, (-1, rows.shape[1]))
    L = rows @ Q.T
    return Q, np.where(np.abs(L) <= SUMMED * np.linalg.norm(rows, axis=1)[:, None], 0.0, L)
