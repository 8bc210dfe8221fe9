"""The equations of motion of a compiled mechanism as functions of arrays, for solvers and integrators of one's own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.parameters import CompiledParameters
from fmd.dynamics.compiler.compiled import CompiledMechanism
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.system import PlainSystem, velocities
from fmd.kernels.kernel import kernel

OwnLoad = Callable[[float, Array, Array], Array]
"""Generalised forces (n,) of a time t [s], positions q (n_positions,) and rates v (n,)."""


class Equations(PlainSystem):
    """Equations ``M(q) v̇ = Q(t, q, v) − J(q)ᵀ λ``, ``J(q) v = …`` of a mechanism, compiled when first called.

    Positions q are joint coordinates [rad, m], unit quaternions and modal coordinates; rates v are as many, but for
    joints that turn in space, whose rates are angular velocities.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.compiled = CompiledMechanism(mechanism)

    @property
    def n(self) -> int:
        """Number of rates."""
        return self.mechanism.n

    @property
    def n_positions(self) -> int:
        """Number of position coordinates."""
        return self.mechanism.n_positions

    @property
    def n_slow(self) -> int:
        """Number of slow rates."""
        return self.mechanism.n_slow

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates in the order of the rates, such as ``"hinge.position"`` and ``"arm.mode 1"``."""
        return tuple(name for name, _ in self.mechanism.coordinates)

    @property
    def parameters(self) -> CompiledParameters:
        """Addresses and arrays for the kernels, with room to work in that is the caller's own."""
        raise NotImplementedError

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return the mass matrix M at positions q, shape (n, n); t [s] counts where motions are prescribed."""
        return self.compiled.mass_matrix(self.compiled.signal_values(t), _sized("q", q, self.n_positions))

    def mass_matrices(self, q: Array, t: float = 0.0) -> Array:
        """Return the mass matrix at many positions q (n_states, n_positions), shape (n_states, n, n)."""
        if np.ndim(q) != 2 or np.shape(q)[1] != self.n_positions:
            raise ValueError(f"q has shape {np.shape(q)}, expected (n_states, {self.n_positions})")
        return self.compiled.mass_matrices(self.compiled.signal_values(t), np.ascontiguousarray(q, dtype=float))

    def constraint_jacobian(self, q: Array, t: float = 0.0) -> Array:
        """Return the constraint Jacobian J of closed loops at positions q, shape (n_constraints, n)."""
        q = _sized("q", q, self.n_positions)
        return self.compiled.constraint_jacobian(t, q) if self.compiled.rows else np.zeros((0, self.n))

    def joint_jacobian(self, joint: str, q: Array, t: float = 0.0) -> Array:
        """Return the rate of a joint's angle or displacement for unit rates, shape (n,).

        Raises
        ------
        ValueError
            No body is carried by such a joint with one coordinate.
        """
        bodies = {link.joint_name: k for k, link in enumerate(self.mechanism.links) if link.unit}
        if joint not in bodies:
            raise ValueError(
                f"no joint with one coordinate is named {joint!r}; there are {', '.join(bodies) or 'none'}"
            )
        return self._rates_for_units(t, q, lambda motion: motion.along_joint(bodies[joint])[1])

    def marker_jacobian(self, marker: str, q: Array, t: float = 0.0) -> Array:
        """Return the velocity of a marker, ``"body.marker"``, in space for unit rates, shape (3, n).

        Raises
        ------
        ValueError
            There is no such marker.
        """
        body, _, name = marker.partition(".")
        if body not in {at for link in self.mechanism.links for at in (link.name, link.part)}:
            raise ValueError(f"no body is named {body!r}")
        number = self.mechanism.number_of(body)
        return self._rates_for_units(t, q, lambda motion: motion.marker_velocity(number, name)).T

    def _rates_for_units(self, t: float, q: Array, rate: Callable[[Kinematics], Array]) -> Array:
        """Return rates for unit rates of the coordinates, without those of prescribed motions, shape (n, …)."""
        q, states = _sized("q", q, self.n_positions), np.concatenate([np.eye(self.n), np.zeros((1, self.n))])
        found = rate(Kinematics(self.mechanism, np.full(len(states), float(t)), np.tile(q, (len(states), 1)), states))
        return np.asarray(found[:-1] - found[-1])

    def position_rates(self, q: Array, v: Array) -> Array:
        """Return the time derivatives of the positions, shape (n_positions,): the rates, but for quaternions."""
        rates = np.zeros(self.n_positions)
        _find_position_rates(self.parameters, _sized("q", q, self.n_positions), _sized("v", v, self.n), rates)
        return rates

    def accelerations(self, t: float, q: Array, v: Array, load: OwnLoad | None = None) -> Array:
        """Return the accelerations v̇ (n,) with which loops stay closed, at a time [s] and a state.

        Positions are (n_positions,), rates (n,). A ``load`` returns generalised forces (n,) beside those of the scene:
        ``Jᵀ f`` of a torque or force f and the `joint_jacobian` or `marker_jacobian` of where it acts. Python calls it
        each time, which takes many times as long as the compiled equations; a formula in the scene is compiled.

        Raises
        ------
        ValueError
            One of these has another shape.
        """
        q, v = _sized("q", q, self.n_positions), _sized("v", v, self.n)
        forces = None if load is None else _sized("load(t, q, v)", load(t, q, v), self.n)
        return self.compiled.constrained_accelerations(t, q, v, forces)[0]

    def state_rates(self, t: float, state: Array, load: OwnLoad | None = None) -> Array:
        """Return the derivative of a state ``(q, v)``, as ``scipy.integrate.solve_ivp`` takes it; load as above."""
        q, v = np.split(_sized("state", state, self.n_positions + self.n), [self.n_positions])
        return np.concatenate([self.position_rates(q, v), self.accelerations(t, q, v, load)])


def _sized(name: str, given: Any, size: int) -> Array:
    """Return numbers as an array (size,) that machine code may read; ``ValueError`` where there are more or fewer."""
    found = np.ascontiguousarray(given, dtype=float)
    if np.shape(given) != (size,):
        raise ValueError(f"{name} has shape {np.shape(given)}, expected ({size},)")
    return found


@kernel
def _find_position_rates(p: Any, q: Array, v: Array, rates: Array) -> None:
    velocities(p, q, v, rates)
