"""Changes of frequencies with a body's matrices, also within groups of one frequency."""

from __future__ import annotations

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.modes import SAME_FREQUENCY
from fmd.stages.pipeline import Pipeline


def frequency_change(run: Pipeline, minus: Pipeline, plus: Pipeline, body: str, mode: int) -> Array:
    """Return the change of a frequency [Hz] as stiffness and mass go from those of one variant to those of another.

    That is ``δω² = φᵀ (δK − ω² δM) φ`` for a mode with unit modal mass. Modes of one frequency turn into each other:
    their changes are the eigenvalues of this matrix for the whole group, in ascending order.

    Parameters
    ----------
    run, minus, plus : Pipeline
        The scene, and variants of it with the same nodes on both sides.
    body : str
        Name of the flexible body.
    mode : int
        Number of the mode, from 0.

    Returns
    -------
    ndarray, shape (3,)
        The mode's change, the mean change of its group, and the same from the variants' own modes, as a check.

    References
    ----------
    Fox & Kapoor, Rates of change of eigenvalues and eigenvectors, AIAA J 6, 1968; Mills-Curran, Calculation of
    eigenvector derivatives for structures with repeated eigenvalues, AIAA J 26, 1988.
    """
    part, before, after = (each.wholes[body] for each in (run, minus, plus))
    if before.key("modes") == after.key("modes"):
        return np.zeros(3)
    omega, shapes = part.modes.omega, part.modes.shapes
    group = np.flatnonzero(np.abs(omega - omega[mode]) <= SAME_FREQUENCY * omega[mode])
    Phi = shapes[:, :, group].reshape(-1, len(group))
    stiffer, heavier = (Phi.T @ (change @ Phi) for change in (after.fe.K - before.fe.K, after.fe.M - before.fe.M))
    change = stiffer - omega[mode] ** 2 * heavier
    changes = np.linalg.eigvalsh(0.5 * (change + change.T)) / (2.0 * omega[mode] * 2.0 * np.pi)
    solved = (after.modes.frequencies_hz - before.modes.frequencies_hz)[group]
    return np.array([changes[int(np.flatnonzero(group == mode)[0])], changes.mean(), solved.mean()])
