"""Checks that matrices from files are those of a free body of some material, by motions that need no elements.

Every body has motions that are linear and quadratic in its nodes' coordinates: rigid ones, even strain, even bending
and torsion. Their energies are products with the matrices, so they tell without an eigenvalue solver how stiff the body
is in its smoothest deformations, and what else its stiffness holds.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree

from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError
from fmd.core.limits.files import DENSEST, DEPENDENT_SHAPES, FASTEST_WAVE, RIGID_FORCE, SUPPORT_STIFFNESS
from fmd.core.rotations import RIGID_MOTIONS, rigid_motions

if TYPE_CHECKING:
    from fmd.fem.model import FEModel


def require_free_body(path: Path, model: FEModel) -> None:
    """Check that rigid motions of a body cause no forces, and that its mass and its speed of sound are some matter's.

    Messages name ``path``, the file of the stiffness.

    Raises
    ------
    AccuracyError
        A rigid motion has forces or energy, or no matter is so dense or so stiff for its mass; with the figure.
    """
    size = float(np.ptp(model.x, axis=0).max())
    centre = model.m.sum(axis=0) @ model.x / model.mass
    x = (model.x - centre) / size
    R = rigid_motions(x).reshape(-1, 6)
    defect = np.abs(model.K @ R).max(axis=0) / (abs(model.K) @ np.abs(R)).max(axis=0)
    if not defect.max() < RIGID_FORCE:
        raise AccuracyError(
            f"{path}: the body isn't free: {RIGID_MOTIONS[int(defect.argmax())]} as a whole it answers with "
            f"{defect.max():.1e} of its elements' forces (at most {RIGID_FORCE:.0e}); write the matrices without "
            "supports, and check units"
        )
    smooth = _smooth_deformations(model, x, R)
    heavy, vectors = la.eigh(smooth.T @ (model.M @ smooth))
    smooth = smooth @ vectors[:, heavy > DEPENDENT_SHAPES * heavy[-1]]  # of nodes in a plane some move no mass
    stiffness, mass = (smooth.T @ (A @ smooth) for A in (model.K, model.M))
    softest = float(la.eigvalsh(stiffness, mass)[0])
    of_rigid, vectors = la.eigh(R.T @ (model.K @ R), R.T @ (model.M @ R))
    support = float(np.abs(of_rigid).max()) / softest if softest > 0.0 else np.inf
    if not support < SUPPORT_STIFFNESS:
        worst = vectors[:, np.abs(of_rigid).argmax()] * np.sqrt((R.T @ (model.M @ R)).diagonal())
        raise AccuracyError(
            f"{path}: the body isn't free: {RIGID_MOTIONS[int(np.abs(worst).argmax())]} as a whole it has "
            f"{100 * support:.2g} % of the stiffness of its softest even bending, and its frequencies are off by about "
            f"half of that (at most {100 * SUPPORT_STIFFNESS:g} %); write the matrices without supports "
            "and springs, and all digits"
        )
    _require_matter(path, model, size)


def _require_matter(path: Path, model: FEModel, size: float) -> None:
    """Raise ``AccuracyError`` if no matter is so dense, or so stiff for its mass.

    A node's stiffness and mass make about the speed of sound over the distance to the nearest node. The median node's
    is that of the material, whatever masses and rigid regions the body has.
    """
    density = model.mass / size**3
    if density > DENSEST:
        raise AccuracyError(
            f"{path}: {model.mass:.3g} kg in a cube of {1e3 * size:.3g} mm would be {density:.2g} kg/m³, and no matter "
            "is so dense; check unit and mass_unit of the matrices"
        )
    n = len(model.x) if model.arms is None else int(model.arms.points.min())  # points on arms come behind the nodes
    nearest = cKDTree(model.x[:n]).query(model.x[:n], 2)[0][:, 1]
    stiffness, mass = model.K.diagonal().reshape(-1, 3).max(axis=1)[:n], model.m.diagonal()[:n]
    speed = float(np.median(nearest * np.sqrt(stiffness / np.where(mass > 0.0, mass, np.inf))))
    if speed > FASTEST_WAVE:
        raise AccuracyError(
            f"{path}: sound would run through the body at about {1e-3 * speed:.2g} km/s, and in no matter it is so "
            "fast; check unit, stiffness_unit and mass_unit of the matrices"
        )


def _smooth_deformations(model: FEModel, x: Array, R: Array) -> Array:
    """Return independent motions linear and quadratic in the coordinates without rigid ones, shape (3 n_nodes, n)."""
    products = [x[:, a] * x[:, b] for a in range(3) for b in range(a, 3)]
    functions = np.column_stack([np.ones(len(x)), x, *products])
    shapes = np.einsum("ik,ab->iakb", functions, np.eye(3)).reshape(3 * len(x), -1)
    if model.T is not None:  # points on arms move as their nodes do, and show no strain
        shapes = model.T @ spsolve(sp.csc_array(model.T.T @ model.T), model.T.T @ shapes)
    MR = model.M @ R
    shapes = shapes - R @ np.linalg.solve(R.T @ MR, MR.T @ shapes)
    sizes = np.linalg.norm(shapes, axis=0)
    kept, values, _ = np.linalg.svd(
        shapes[:, sizes > DEPENDENT_SHAPES] / sizes[sizes > DEPENDENT_SHAPES], full_matrices=False
    )
    return np.asarray(kept[:, values > DEPENDENT_SHAPES * values[0]])
