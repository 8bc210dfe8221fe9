"""Flat arrays of a planar rotor: what its kernels read, and what they hold over a major cycle."""

from __future__ import annotations

from typing import NamedTuple

from pipeline.core.arrays import Array


class TorquePulse(NamedTuple):
    """A half-sine torque, ``peak sin(π (t − start)/duration)``, of angular impulse ``2/π peak duration``.

    Attributes
    ----------
    start, duration : float
        When it acts [s].
    peak : float
        Largest torque [N m].
    """

    start: float
    duration: float
    peak: float


class PlanarParameters(NamedTuple):
    """Flat arrays for the kernels; those of length 1 + n begin with the frame's angle."""

    D: Array
    A: Array
    stiffness: Array  # (1 + n,) ω², 0 for the angle
    lever: Array  # (1 + n,) work of the torque on each coordinate: 1, ψ
    pulse: TorquePulse
    gyroscopic: bool  # A is not zero
    diagonal: bool  # modes don't couple with each other through the spin
    Dp: Array  # (1 + n,), room to work in: D p and D ṗ of the last solution
    Dv: Array


class FrozenPlanar(NamedTuple):
    """The fast coordinates' equation over a major cycle: ``a_S = constant + slope s − K q_S − C v_S + τ ψ``.

    ``s`` is the time since the cycle began; the slope is what is known then of the held terms' rate of change.
    """

    time: Array  # (1,), when the cycle began
    constant: Array  # (1 + n,)
    slope: Array  # (1 + n,)
    v_now: Array  # (1 + n,), room to work in
    k: Array  # (1 + n,), instead of K and C where modes don't couple with each other
    K: Array  # (1 + n, 1 + n), transposed
    C: Array  # (1 + n, 1 + n), transposed and negative
    d: Array  # (1 + n,), of the last step where modes don't couple: h v
    load: Array  # (1 + n,), of the next step: h² (constant + slope s)


class MiddlePlanar(NamedTuple):
    """The equations at a major cycle's middle: the fast ones, with S̄ divided out unless diagonal, and the angle's.

    ``J a_y = force − k (q_S − q*_S) − c (v_S − v*_S) + τ``.
    """

    frozen: FrozenPlanar  # of the fast coordinates
    angle: Array  # (3,): J, force, 1/(J − HᵀH)
    H: Array  # (1 + n,)
    lever: Array  # (1 + n,), work of the torque on the fast coordinates, the angle reacting
    turn: Array  # (1 + n,), 2 θ̇ D p + 2 A ṗ
    k: Array  # (1 + n,)
    c: Array  # (1 + n,)
    q: Array  # (1 + n,): q*, v*
    v: Array  # (1 + n,)
