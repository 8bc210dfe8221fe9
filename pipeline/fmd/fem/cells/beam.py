"""The layer of a beam between two sections, one cell for each quadrilateral of the section, and Timoshenko's strain.

A section moves as a rigid piece: displacement and rotation at its centroid follow from any four of its points. Of a
beam without loads between its ends, curvature is linear and shear constant. Beside the curvature κ₀ of both ends'
rotations there is a linear one, ``κ = κ₀ + α ξ`` with ξ from −1 to 1, by which shear is ``γ = γ₀ + α L / 6``. α is that
of least energy,

    α = −γ₀ (k G A L / 6) / (E I / 3 + k G A L² / 36)

so the stiffness is that of Przemieniecki's beam (Theory of Matrix Structural Analysis, 1968), without locking, and
static answers to loads on nodes are exact. Strains in the section leave it without stress but along the beam.
"""

from functools import partial
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.fem.cells.cell import SolidCell
from fmd.fem.cells.shell import QuadrilateralElement, ShellQuadrilateral
from fmd.fem.elements import ElementKind, inverse_and_determinant, shape_functions
from fmd.fem.material import Material

_UNIT = np.eye(3)


def beam_strain(space: Any, material: Material, X: Array, elements: IntArray) -> tuple[Array, Array]:
    """Return strains B of beams at points X (3, n_q), shape (n_elements, 6, n_q, 24), and Jacobian determinants."""
    line, corners = space.mesh.midsurface, space.corner_coordinates[elements]
    axes, start, length = line.axes[elements], line.start[elements], line.length[elements, None]
    _, det = inverse_and_determinant(space.jacobians(X, elements))
    moved = np.zeros((2, len(elements), 6, 24))
    for end in (0, 1):
        own = slice(4 * end, 4 * end + 4)
        centre = start + end * length * axes[:, 0]
        moved[end, :, :, 12 * end : 12 * end + 12] = _section_motion(corners[:, own], centre, axes)
    slope, mean = (moved[1] - moved[0]) / length[..., None], 0.5 * (moved[0] + moved[1])
    x = np.einsum("iq,eic->eqc", shape_functions(space.kind.geometry, X)[0], corners)
    yz = np.einsum("eqc,eac->eqa", x - start[:, None], axes[:, 1:])
    local = np.empty((len(elements), 3, X.shape[1], 24))
    for number in np.unique(line.of[elements]):
        mine = line.of[elements] == number
        local[mine] = _local_strain(line.sections[number], material, slope[mine], mean[mine], length[mine], yz[mine], X)
    B = _voigt(axes, material.nu) @ local.reshape(len(elements), 3, -1)
    return np.ascontiguousarray(B.reshape(len(elements), 6, X.shape[1], 24)), det


def uniaxial_stress(A: Array, J: Array, material: Material, elements: IntArray) -> Array:
    """Return what is left of strains A (n_elements, n_q, 3, 3) in a beam, stretch along it and free contraction."""
    along = J[..., 2] / np.linalg.norm(J[..., 2], axis=-1, keepdims=True)
    stretch = np.einsum("eqa,eqab,eqb->eq", along, A, along)[..., None, None]
    both = along[..., :, None] * along[..., None, :]
    return np.asarray(stretch * ((1 + material.nu) * both - material.nu * _UNIT))


def _local_strain(
    section: Any, material: Material, slope: Array, mean: Array, length: Array, yz: Array, X: Array
) -> Array:
    """Return stretch and shears along y and z by the displacements of a beam's corners, (n_elements, 3, n_q, 24)."""
    E, nu = material.E, material.nu
    shares, L = section.shear_areas(nu), length  # (n_elements, 1)
    kGA = shares * E / (2 * (1 + nu)) * section.area
    bent = L / 6 / (E * section.moments[::-1] / 3 / kGA + L**2 / 36)  # α over γ₀, along y and z
    gamma = np.stack([slope[:, 1] - mean[:, 5], slope[:, 2] + mean[:, 4]], axis=1)  # (n_elements, 2, 24)
    xi = (2 * X[2] - 1)[:, None]
    about_y = slope[:, None, 4] + bent[:, 1, None, None] * gamma[:, None, 1] * xi
    about_z = slope[:, None, 5] - bent[:, 0, None, None] * gamma[:, None, 0] * xi
    gamma = gamma * (1 - bent * L / 6)[..., None]
    shapes, twist = section.shear_shapes(yz, nu), section.twisting(yz) * slope[:, None, 3]
    y, z = np.split(section.places(yz), 2, axis=-1)
    by, bz = section.bending
    return np.stack(
        [
            slope[:, None, 0] + by * z * about_y - bz * y * about_z,
            shapes[..., :1] * gamma[:, None, 0] - z * twist,
            shapes[..., 1:] * gamma[:, None, 1] + y * twist,
        ],
        axis=1,
    )


def _section_motion(p: Array, centre: Array, axes: Array) -> Array:
    """Return displacement and rotation of a section at its centroid, along its axes, by four of its points.

    Shape (n_elements, 6, 12).
    """
    middle = p.mean(axis=1)
    r = p - middle[:, None]
    inertia = np.einsum("eia,eia->e", r, r)[:, None, None] * _UNIT - np.einsum("eia,eib->eab", r, r)
    moment = np.cross(r[:, :, None], _UNIT)  # (n, 4, b, a): r × e_b
    turn = np.linalg.solve(inertia, moment.transpose(0, 3, 1, 2).reshape(-1, 3, 12))
    move = np.tile(_UNIT / 4, (1, 4)) + np.cross(turn, (centre - middle)[:, :, None], axisa=1, axisb=1, axisc=1)
    return np.concatenate([axes @ move, axes @ turn], axis=1)


def _voigt(axes: Array, nu: float) -> Array:
    """Return stretch with free contraction and both shears as xx, yy, zz, 2yz, 2xz, 2xy, (n_elements, 6, 3)."""
    x, y, z = (axes[:, k] for k in range(3))
    along = (1 + nu) * x[:, :, None] * x[:, None, :] - nu * _UNIT
    shears = [0.5 * (x[:, :, None] * other[:, None, :] + other[:, :, None] * x[:, None, :]) for other in (y, z)]
    columns = [
        np.stack([*(A[:, k, k] for k in range(3)), 2 * A[:, 1, 2], 2 * A[:, 0, 2], 2 * A[:, 0, 1]], axis=1)
        for A in (along, *shears)
    ]
    return np.stack(columns, axis=2)


_QUAD = partial(QuadrilateralElement, 1)
_KIND = ElementKind(
    "beam", 12, ShellQuadrilateral, 1, _QUAD, _QUAD, 4, 3, 3, strain_matrix=beam_strain, stressed=uniaxial_stress
)
BEAM = SolidCell("hexahedron", ShellQuadrilateral, 1, (_KIND,))
