"""Strain of shells: assumed shear, plane stress, and parameters of their own, on the displacements at both faces.

A shell is a solid of one element through the thickness whose points at both faces hang on a node of the midsurface by
a straight, inextensible director (Ahmad, Irons & Zienkiewicz, Int J Num Meth Eng 2, 1970). So its strains are those of
a solid on its true, curved or warped geometry, and a rigid motion costs no energy. With covariant components
``e_ab = ½ (g_a·u,b + g_b·u,a)`` of the displacement

- the stretch through the thickness is left out, and follows from plane stress: ``ε_nn = −ν/(1−ν) (ε_11 + ε_22)``;
  that of laminates does no work (`fmd.fem.laminate`);
- transverse shear is interpolated between the tying points of MITC4 (Dvorkin & Bathe, Eng Comput 1, 1984) and of MITC3+
  (Lee, Lee & Bathe, Comput Struct 138, 2014), without which thin shells lock;
- transverse shear has Reissner's parabola ``5/4 (1 − ζ²)`` through the thickness: its energy is 5/6 of that of the
  mean, and there is none on the faces;
- quadrilaterals have four parameters for bending in their own plane (Simo & Rifai, Int J Num Meth Eng 29, 1990),
  triangles two for a cubic rotation in their middle; both are condensed as those of enhanced hexahedra.
"""

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.mesh import INNER_TYING
from fmd.fem.elements import ElementSpace, inverse_and_determinant, shape_functions
from fmd.fem.material import AnyElastic

_COMPONENTS = ((0, 0), (1, 1), (0, 1), (0, 2), (1, 2))  # covariant: rr, ss, rs, rt, st
_TYING4 = np.array([(0.5, 0, 0.5), (0.5, 1, 0.5), (0, 0.5, 0.5), (1, 0.5, 0.5)]).T
_TYING3 = np.array(
    [
        *((1 / 6, 2 / 3, 0.5), (2 / 3, 1 / 6, 0.5), (1 / 6, 1 / 6, 0.5)),  # A, B, C
        *(
            (1 / 3 + INNER_TYING, 1 / 3 - 2 * INNER_TYING, 0.5),
            (1 / 3 - 2 * INNER_TYING, 1 / 3 + INNER_TYING, 0.5),
        ),  # D, E
        (1 / 3 + INNER_TYING, 1 / 3 + INNER_TYING, 0.5),  # F
    ]
).T


def quadrilateral_strain(
    space: ElementSpace, material: AnyElastic, X: Array, elements: IntArray
) -> tuple[Array, Array]:
    """Return strains [B, G] of MITC4 at points X (3, n_q), shape (n_elements, 6, n_q, 28), and determinants."""
    J, tied = space.jacobians(X, elements), space.jacobians(_TYING4, elements)
    inverse, det = inverse_and_determinant(J)
    e = _covariant(shape_functions(space.kind.element, X)[1], J)
    shear = _covariant(shape_functions(space.kind.element, _TYING4)[1], tied, _COMPONENTS[3:])
    x, y = X[0][:, None], X[1][:, None]
    e[3] = (1 - y) * shear[0][:, :1] + y * shear[0][:, 1:2]
    e[4] = (1 - x) * shear[1][:, 2:3] + x * shear[1][:, 3:]
    B = _combined(_tensors(inverse), e, J, X, material, elements)
    # Strains of the midsurface, linear in the middle's coordinates; constant stress does no work on them.
    at_middle, det_middle = inverse_and_determinant(space.jacobians(np.full((3, 1), 0.5), elements))
    rr, ss, rs = _tensors(at_middle)[:3]
    xi, eta = ((2 * each - 1) * det_middle / det for each in X[:2])
    own = [xi[..., None, None] * rr, eta[..., None, None] * ss, xi[..., None, None] * rs, eta[..., None, None] * rs]
    G = np.stack([_voigt(material.through_shell(one, J, None, elements)) for one in own], axis=-1)
    return np.concatenate([B, G.swapaxes(1, 2)], axis=-1), det


def triangle_strain(space: ElementSpace, material: AnyElastic, X: Array, elements: IntArray) -> tuple[Array, Array]:
    """Return strains [B, G] of MITC3+ at points X (3, n_q), shape (n_elements, 6, n_q, 20), and determinants."""
    J, tied = space.jacobians(X, elements), space.jacobians(_TYING3, elements)
    inverse, det = inverse_and_determinant(J)
    corners = space.corner_coordinates[elements]
    director = (corners[:, 3:] - corners[:, :3]).mean(axis=1) / 2
    across = _across(director)
    e, shear = (
        np.concatenate([_covariant(dN, g, which), _turned_middle(dB, g, across, which)], axis=-1)
        for (dN, dB), g, which in ((_gradients3(X), J, _COMPONENTS), (_gradients3(_TYING3), tied, _COMPONENTS[3:]))
    )
    rt, st = (each.swapaxes(0, 1)[:, :, None] for each in shear)  # (n_tying, n_elements, 1, n)
    twist = rt[5] - rt[3] - st[5] + st[4]
    r, s = X[0][:, None], X[1][:, None]
    common = (rt[2] + st[2]) / 3
    e[3] = 2 / 3 * (rt[1] - st[1] / 2) + common + twist * (3 * s - 1) / 3
    e[4] = 2 / 3 * (st[0] - rt[0] / 2) + common + twist * (1 - 3 * r) / 3
    return _combined(_tensors(inverse), e, J, X, material, elements), det


def _covariant(dN: Array, J: Array, which: tuple[tuple[int, int], ...] = _COMPONENTS) -> Array:
    """Return covariant strains by nodal displacements, shears doubled: (n_components, n_elements, n_q, n_columns).

    Shape functions have derivatives dN (n_local, 3, n_q), and J (n_elements, n_q, 3, 3) base vectors, last axis
    reference.
    """
    d, g = dN.transpose(1, 2, 0)[:, None, :, :, None], np.moveaxis(J, 3, 0)[:, :, :, None, :]
    each = [d[a] * g[b] + d[b] * g[a] if a != b else d[a] * g[a] for a, b in which]
    return np.stack(each).reshape(len(which), *J.shape[:2], -1)


def _turned_middle(dB: Array, J: Array, across: Array, which: tuple[tuple[int, int], ...]) -> Array:
    """Return covariant strains by the two rotations of a triangle's middle, as `_covariant` does those of nodes."""
    along = np.einsum("eqcb,ekc->beqk", J, across)
    d = dB[:, None, :, None]
    return np.stack([d[a] * along[b] + d[b] * along[a] if a != b else d[a] * along[a] for a, b in which])


def _gradients3(X: Array) -> tuple[Array, Array]:
    """Return derivatives of MITC3+'s functions of six points, (6, 3, n_q), and of the middle's rotation, (3, n_q)."""
    r, s, zeta = X[0], X[1], 2 * X[2] - 1
    h = np.stack([1 - r - s, r, s])
    dh = np.broadcast_to(np.array([(-1.0, -1.0), (1.0, 0.0), (0.0, 1.0)])[..., None], (3, 2, X.shape[1]))
    bubble = 27 * r * s * h[0]
    slopes = 27 * np.stack([s * (1 - 2 * r - s), r * (1 - r - 2 * s)])
    f, df = h - bubble / 3, dh - slopes / 3
    half = np.concatenate([0.5 * zeta * df, f[:, None]], axis=1)  # of the difference between the faces
    mean = np.concatenate([0.5 * dh, np.zeros_like(f)[:, None]], axis=1)
    return np.concatenate([mean - half, mean + half]), np.concatenate([zeta * slopes, 2 * bubble[None]])


def _across(director: Array) -> Array:
    """Return two vectors across each director (n, 3), as long as it is, shape (n, 2, 3)."""
    axis = np.eye(3)[np.abs(director).argmin(axis=1)]
    size = np.linalg.norm(director, axis=1, keepdims=True)
    one = _unit(np.cross(director, axis)) * size
    return np.stack([one, np.cross(director / size, one)], axis=1)


def _combined(tensors: Array, e: Array, J: Array, X: Array, material: AnyElastic, elements: IntArray) -> Array:
    """Return the strains of covariant components e by Voigt's order, shape (n_elements, 6, n_q, n_columns)."""
    W = np.stack([_voigt(material.through_shell(A, J, X[2], elements)) for A in tensors], axis=-1)
    return np.ascontiguousarray((W @ np.moveaxis(e, 0, 2)).swapaxes(1, 2))


def _tensors(inverse: Array) -> Array:
    """Return the tensors ``½ (gᵃ⊗gᵇ + gᵇ⊗gᵃ)`` of covariant components, shape (5, n_elements, n_q, 3, 3)."""
    products = [inverse[..., a, :, None] * inverse[..., b, None, :] for a, b in _COMPONENTS]
    return np.stack([0.5 * (one + one.swapaxes(2, 3)) for one in products])


def across_plane_stress(A: Array, J: Array, material: AnyElastic, elements: IntArray) -> Array:
    """Return what is left of strains A (n_elements, n_q, 3, 3) in a shell without stress through its thickness."""
    return material.through_shell(A, J, None, elements)


def from_middle(A: Array, J: Array, material: AnyElastic, elements: IntArray, zeta: Array) -> Array:
    """Return strains A, whose transverse shear is that of the shell's middle, as they are at places across it."""
    return material.through_shell(A, J, zeta, elements, 0.5)


def _voigt(A: Array) -> Array:
    """Return symmetric tensors (…, 3, 3) as xx, yy, zz, 2yz, 2xz, 2xy, shape (…, 6)."""
    return np.stack([*(A[..., k, k] for k in range(3)), 2 * A[..., 1, 2], 2 * A[..., 0, 2], 2 * A[..., 0, 1]], axis=-1)


def _unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))
