"""One flexible body turning about a fixed axis, driven by a torque at its joint.

Coordinate 0 is the angle θ of its frame, the others are the modal coordinates q.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

import pipeline.dynamics.rotor.kernels
import pipeline.dynamics.rotor.middle  # noqa: F401 - both give the functions of `system` their meaning here
from pipeline.core.arrays import EPSILON, Array, IntArray
from pipeline.dynamics.jit.compiled import aligned
from pipeline.dynamics.links import Link
from pipeline.dynamics.rotor.parameters import FrozenPlanar, MiddlePlanar, PlanarParameters, TorquePulse
from pipeline.dynamics.vibration import highest_frequency
from pipeline.reduction.body import FlexibleBody

# Below this part of the modal mass a coupling between modes is too small to tell within a major cycle.
_DIAGONAL = 1e-5
_ROUND_OFF = 1e-9


@dataclass(frozen=True)
class PlanarRotor:
    """A flexible body that turns about a fixed axis, as a system that the integrators march.

    Parameters
    ----------
    body : FlexibleBody or Link
        Referenced to the joint; its axis, inertia integrals, frequencies and rotation at the joint are read.
    pulse : TorquePulse
        The drive.
    """

    body: FlexibleBody | Link
    pulse: TorquePulse

    n_slow = 1
    holds_forces = False

    def frozen(self) -> FrozenPlanar:
        """Fresh storage for the frozen coefficients of a major cycle."""
        n = self.n
        constant, slope, v_now, k, d, load = aligned(*6 * [n])
        return FrozenPlanar(
            time=np.zeros(1),
            constant=constant,
            slope=slope,
            v_now=v_now,
            k=k,
            K=np.zeros((n, n)),
            C=np.zeros((n, n)),
            d=d,
            load=load,
        )

    def middle(self) -> MiddlePlanar:
        """Fresh storage for what a major cycle's middle holds."""
        return MiddlePlanar(self.frozen(), np.zeros(3), *aligned(*7 * [self.n]))

    @property
    def n(self) -> int:
        """Number of coordinates: the angle and the modes."""
        return 1 + len(self.body.omega)

    @property
    def n_positions(self) -> int:
        """Number of position coordinates, as many as rates."""
        return self.n

    @property
    def stiffness(self) -> Array:
        """Squared modal frequencies at the rate that the drive leads to from rest, 0 for the angle [1/s²]."""
        parameters = self._parameters
        softer = parameters.stiffness[1:] - self.driven_rate**2 * parameters.D.diagonal()[1:]
        return np.asarray(np.r_[0.0, np.maximum(softer, 0.0)])

    @property
    def driven_rate(self) -> float:
        """Rate to which the pulse brings the undeformed body from rest [rad/s]."""
        return float(2 / np.pi * self.pulse.peak * self.pulse.duration / self._parameters.D[0, 0])

    @property
    def groups(self) -> tuple[IntArray, IntArray]:
        """Group of like coordinates that each position and each rate belongs to: the angle, all modes together."""
        kind = np.minimum(np.arange(self.n), 1)
        return kind, kind

    @property
    def parameters(self) -> PlanarParameters:
        """Flat arrays for the kernels, with room to work in that is the caller's own."""
        Dp, Dv = aligned(self.n, self.n)
        return self._parameters._replace(Dp=Dp, Dv=Dv)

    @cached_property
    def _parameters(self) -> PlanarParameters:
        e, G = self.body.axis / np.linalg.norm(self.body.axis), self.body.gram.G
        D = np.einsum("ab,abij->ij", np.eye(3) - np.outer(e, e), G)
        A = np.einsum("a,abc,bcij->ij", e, EPSILON, G)
        modes = D[1:, 1:]
        off_diagonal = np.abs(modes - np.diag(modes.diagonal())).max(initial=0.0)
        # Modal masses are 1, the inertia is D[0, 0]: what a coupling is small against.
        coupling = max(np.abs(A[0]).max() / np.sqrt(D[0, 0]), np.abs(A[1:, 1:]).max(initial=0.0))
        return PlanarParameters(
            D=np.ascontiguousarray(D),
            A=np.ascontiguousarray(A),
            stiffness=np.r_[0.0, self.body.omega**2],
            lever=np.r_[1.0, np.zeros(self.n - 1) + (self.body.joint_rotation if self.body.joint_rotation.size else 0)],
            pulse=self.pulse,
            gyroscopic=bool(coupling > _ROUND_OFF),
            diagonal=bool(off_diagonal < _DIAGONAL and np.abs(A[1:, 1:]).max(initial=0.0) < _ROUND_OFF),
            Dp=np.empty(0),
            Dv=np.empty(0),
        )

    @cached_property
    def reference_mass(self) -> Array:
        """Mass matrix of angle and modes in the reference state, shape (n, n)."""
        parameters = self._parameters
        M = np.eye(self.n)
        M[0, 0] = parameters.D[0, 0]
        M[0, 1:] = M[1:, 0] = parameters.A[0, 1:]
        return M

    @property
    def linear_matrices(self) -> tuple[Array, Array, Array]:
        """Mass, stiffness and damping in the reference state, (n, n) each."""
        K = np.diag(self._parameters.stiffness)
        return self.reference_mass, K, np.zeros_like(K)

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Begin and end of the torque [s]."""
        return (self.pulse.start, self.pulse.start + self.pulse.duration)

    @property
    def coupled(self) -> bool:
        """True if angle and modes couple through the mass matrix in any state."""
        return self._parameters.gyroscopic

    @property
    def highest_frequency(self) -> float:
        """Highest coupled angular frequency in the reference state [rad/s]; it limits the plain explicit step."""
        K = np.diag(self._parameters.stiffness)
        return highest_frequency(self.reference_mass, K)

    @property
    def highest_fast_frequency(self) -> float:
        """Highest angular frequency of the modes with the frame held [rad/s]."""
        return float(self.body.omega.max())

    @property
    def highest_reacting_frequency(self) -> float:
        """Highest coupled angular frequency [rad/s]: nothing holds the angle."""
        return self.highest_frequency

    @property
    def highest_slow_frequency(self) -> float:
        """Angular frequency of the angle, all but 0: nothing holds it [rad/s]."""
        return 1e-150

    def energies(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Kinetic and strain energy [J] of states q, v, shape (n_times, n)."""
        p = np.concatenate([np.ones((len(q), 1)), q[:, 1:]], axis=1)
        rate, modal_rates = v[:, 0], v[:, 1:]
        J = np.einsum("ti,ij,tj->t", p, self._parameters.D, p)
        H = (p @ self._parameters.A)[:, 1:]
        kinetic = 0.5 * (J * rate**2 + (modal_rates**2).sum(axis=1)) + rate * (H * modal_rates).sum(axis=1)
        return kinetic, 0.5 * (q**2 @ self._parameters.stiffness)
