"""Check that the mass matrix of a stiffened mechanism is positive definite at the deflections of a motion.

Displacements of second order change what a stiffened body's frame has of inertia, and by their rigid part the modal
masses (see `fmd.reduction.second_order`). What is left out can still take the inertia of a motion in which
frame and modes nearly cancel, such as that of a light end. A kinetic energy can then be negative, and a motion has no
meaning. With the whole kinetic energy of second order (see `fmd.reduction.second_order`) it never is; this
takes up to twice the time and is for motions that need it.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InertiaError, StabilityError
from fmd.core.limits.mechanism import DEFLECTED_TIMES, LOST_INERTIA

if TYPE_CHECKING:
    from fmd.dynamics.compiled_system.reference_state import ReferenceState
    from fmd.dynamics.mechanism import Mechanism

TOO_LIGHT = "combinations of modes are so light that round-off hides their inertia; fewer modes help"


def require_positive_mass(system: ReferenceState, q: Array, where: str, least: float = 0.0) -> None:
    """Raise ``InertiaError`` if deflections at positions q (n_positions,) take a part of its inertia from a motion.

    Every motion must keep the part ``least`` of what it has in the undeformed mechanism; ``where`` names the instant.
    """
    if not _stiffened(system.mechanism):
        return
    try:
        (kept,) = _kept_inertia(system, q[None])
    except np.linalg.LinAlgError:
        raise InertiaError(
            f"{where} the mass matrix isn't positive definite, nor is that of the undeformed mechanism: {TOO_LIGHT}"
        ) from None
    if kept > least:
        return
    raise InertiaError(
        f"{where} the mass matrix isn't positive definite: a motion has {kept:.2g} times its inertia in the undeformed "
        "mechanism, because of displacements of second order, which stiffening takes in; fewer modes with "
        'modes.enrich = "none" make them smaller for light motions, and simulation.stiffening = "off" leaves them out'
    )


def require_positive_over(system: ReferenceState, times: Array, q: Array) -> None:
    """Raise ``InertiaError`` if the mass isn't positive definite at one of a motion's largest deflections.

    The motion has positions q (n_times, n_positions) at times [s].
    """
    mechanism = system.mechanism
    stiffened = _stiffened(mechanism)
    if not stiffened:
        return
    modes = np.concatenate([mechanism.modal_positions_of(k) for k in stiffened])
    omega = np.concatenate([mechanism.links[k].omega for k in stiffened])
    energies = ((q[:, modes] * omega) ** 2).sum(axis=1)
    chosen = np.argsort(energies)[-DEFLECTED_TIMES:]
    with suppress(np.linalg.LinAlgError):
        if (_kept_inertia(system, q[chosen]) > 0.0).all():
            return
    for k in chosen:
        require_positive_mass(system, q[k], f"at t = {times[k]:.4g} s")


def _kept_inertia(system: ReferenceState, q: Array) -> Array:
    """Return the least part that a motion has of its inertia in the undeformed mechanism, at many positions.

    Raises
    ------
    LinAlgError
        The mass matrix of the undeformed mechanism isn't positive definite at one of them.
    """
    mechanism = system.mechanism
    undeformed = q.copy()
    for k in range(len(mechanism.links)):
        undeformed[:, mechanism.modal_positions_of(k)] = 0.0
    M, M0 = np.split(system.mass_matrices(np.concatenate([q, undeformed])), 2)
    half = np.linalg.inv(np.linalg.cholesky(M0))
    finite = np.isfinite(M).all(axis=(1, 2))
    kept = np.full(len(q), -np.inf)
    kept[finite] = np.linalg.eigvalsh(half[finite] @ M[finite] @ half[finite].swapaxes(1, 2))[:, 0]
    return kept


def _stiffened(mechanism: Mechanism) -> list[int]:
    """Return the numbers of the bodies whose inertia holds displacements of second order."""
    return [
        k
        for k, link in enumerate(mechanism.links)
        if link.integrals.stiffening.size
        or link.integrals.displacement2.size
        or link.integrals.rotation2.size
        or link.place.displacement2.size
    ]


def explain_failure(system: ReferenceState, failure: StabilityError) -> None:
    """Raise ``InertiaError`` if a march failed because a motion of its system lost its inertia."""
    mechanism = system.mechanism
    if all(mechanism.links[k].integrals.whole for k in _stiffened(mechanism)):  # for another reason
        return
    if isinstance(failure.positions, np.ndarray) and len(failure.positions) == mechanism.n_positions:
        require_positive_mass(system, failure.positions, f"at t = {failure.time:.4g} s", LOST_INERTIA)
