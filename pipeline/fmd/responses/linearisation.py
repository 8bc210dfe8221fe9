"""A mechanism's equations linearised at a state, as a state-space model.

Small motions δη of the coordinates follow the exact derivatives of the equations of motion (see
`fmd.dynamics.compiler.linearised`). Joints whose motion is prescribed move as an input says, or not at all; of the
coordinates that loops tie together an independent set is chosen. With all coordinates δη = T ξ + G γ, T of the
independent ones and G of the prescribed ones γ, and ``δη̇ = δv − Ω δη`` where rates are those of a turning body::

    ξ̇ = ζ − S Ω (T ξ + G γ)          Tᵀ (M δa + C δv + K δη − b u) = 0

Positions in a free joint are taken along the axes of the turning body, in which a rotor on round bearings has constant
coefficients. A frozen state that isn't at rest or in steady rotation is one instant of a varying system.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.linalg import qr

from fmd.core.arrays import Array, IntArray
from fmd.core.formula import parse_formula
from fmd.core.limits.rank import DEPENDENT_CONSTRAINT
from fmd.dynamics.compiler.linearised import LinearisedMechanism, Tangents
from fmd.dynamics.excited_modes import find_places
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.links import PointLoad
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import Signal, constant, formula
from fmd.responses.moving_axes import position_map, turning_axes
from fmd.responses.ports import GroundPort, JointPort, LoadPort, MarkerPort, ModalPort, MotionPort, Port
from fmd.responses.state_space import Channel, StateSpace
from fmd.stability.tangent import OperatingPoint

Motions = Mapping[int, tuple[float, float, float]]
"""Position, rate and acceleration of each prescribed joint, by the number of the body that it carries."""


class Linearisation:
    """Linearisation of a mechanism for given inputs and outputs, at any of its states; it may have loops."""

    def __init__(self, mechanism: Mechanism, inputs: Sequence[Port], outputs: Sequence[Port]) -> None:
        self.mechanism, self.inputs, self.outputs = mechanism, tuple(inputs), tuple(outputs)
        ports = [port for port in dict.fromkeys((*inputs, *outputs)) if isinstance(port, JointPort | MarkerPort)]
        loads = [port for port in inputs if isinstance(port, LoadPort)]
        self._probes = {port: _numbered_signal(k) for k, port in enumerate((*ports, *loads))}
        bodies = {port.body: self._probes[port] for port in ports if isinstance(port, JointPort)}
        self._probes |= {port: bodies[port.body] for port in ports if isinstance(port, JointPort)}  # one for each joint
        self._released = self._release()
        self._given = np.array(
            [self._released.layout.rate[k] for k, link in enumerate(mechanism.links) if link.motion is not None],
            dtype=np.int64,
        )

    @cached_property
    def _equations(self) -> LinearisedMechanism:
        return LinearisedMechanism(self._released, self._given)

    def _release(self) -> Mechanism:
        """Return the mechanism with a signal of its own for each port, and a coordinate for each prescribed joint."""
        links = []
        for k, link in enumerate(self.mechanism.links):
            probe = next((self._probes[at] for at in self._probes if isinstance(at, JointPort) and at.body == k), None)
            links.append(replace(link, motion=None, load=probe if probe and not link.motion else link.load))
        sizes = {port.number: self._probes[port] for port in self._probes if isinstance(port, LoadPort)}
        loads = [replace(load, size=sizes.get(k, load.size)) for k, load in enumerate(self.mechanism.loads)]
        for port, probe in self._probes.items():
            if isinstance(port, MarkerPort):
                body = self.mechanism.links[port.body].name
                loads.append(PointLoad(body, np.array(port.direction), probe, port.turns, marker=port.marker))
        return replace(self.mechanism, links=links, loads=loads, horizon=0.0)

    def at(self, state: OperatingPoint, motions: Motions | None = None) -> StateSpace:
        """Linearise at a state; with motions of the prescribed joints, at one of steady rotation.

        There forces that don't vary hold what isn't in balance, as the unbalance of a rotor, unless there are loops.
        """
        q, v, given = self._released_state(state, motions)
        held = None
        if motions is not None:
            W, _, sliding = turning_axes(self._released, q, v)
            held = W @ sliding @ W.T @ v
            held[self._given] = given
        tangents = self._equations.tangents(q, v, self._signals(state.time), given, held)
        return _Assembly(self, tangents, q, v).model()

    def mass_matrix(self, state: OperatingPoint, motions: Motions | None = None) -> Array:
        """Return the mass matrix of a model's independent coordinates at a state, without motions as inputs, (k, k)."""
        q, v, given = self._released_state(state, motions)
        tangents = self._equations.tangents(q, v, self._signals(state.time), given)
        return _Assembly(self, tangents, q, v).own_mass()

    def accelerations(self, state: OperatingPoint, motions: Motions | None = None) -> Array:
        """Return the accelerations of the coordinates at a state, shape (n,), in the mechanism's order."""
        q, v, given = self._released_state(state, motions)
        a, _ = self._equations.accelerations(q, v, self._signals(state.time), given)
        _, rates = find_places(self._released, self.mechanism)
        return np.asarray(a[rates])

    def _released_state(self, state: OperatingPoint, motions: Motions | None) -> tuple[Array, Array, Array]:
        """Return positions and rates of the released mechanism, and the accelerations that are given."""
        to_q, to_v = find_places(self._released, self.mechanism)
        q, v, given = self._released.rest_positions, np.zeros(self._released.n), []
        q[to_q], v[to_v] = state.q, state.v
        for k, link in enumerate(self.mechanism.links):
            if link.motion is not None:
                position, rate, acceleration = link.motion.value(state.time) if motions is None else motions[k]
                q[self._released.layout.position[k]] = position
                v[self._released.layout.rate[k]] = rate
                given.append(acceleration)
        return q, v, np.array(given)

    def _signals(self, time: float) -> dict[Signal, tuple[float, float, float]]:
        """Return the values, rates and accelerations of all signals at a time [s]; those of added loads are 0."""
        return {
            signal: (self._signal_behind(signal) or constant(0.0)).value(time) for signal in self._equations.signals
        }

    def _signal_behind(self, signal: Signal) -> Signal | None:
        """Return the mechanism's own signal in whose place one is; none for an added load's."""
        port = next((port for port, probe in self._probes.items() if probe == signal), None)
        if port is None:
            return signal
        if isinstance(port, JointPort):
            return self.mechanism.links[port.body].load
        return self.mechanism.loads[port.number].size if isinstance(port, LoadPort) else None

    def rate_names(self) -> list[str]:
        """Return the names of the mechanism's own coordinates, by their rates' order."""
        names = self.state_names()
        return [names[k].name for k in find_places(self._released, self.mechanism)[1]]

    def state_names(self) -> list[Channel]:
        """Return the coordinates of the released mechanism, by their rates' order."""
        return [Channel(*coordinate) for coordinate in self._released.coordinates]


class _Assembly:
    """Matrices of one linearisation, in the order of the released mechanism's rates."""

    def __init__(self, of: Linearisation, tangents: Tangents, q: Array, v: Array) -> None:
        self.of, self.mechanism, self.tangents = of, of._released, tangents
        self.q, self.v = q, v
        self.W, self.turning, self.sliding = turning_axes(self.mechanism, q, v)
        G = position_map(self.mechanism, q) @ self.W
        W, t = self.W, tangents
        self.M, self.C, self.K = W.T @ t.M @ W, W.T @ t.by_v @ W, W.T @ t.by_q @ G
        self.J, self.rates_by = t.J @ W, t.rates_by_q @ G
        self.second_by, self.second_by_v = t.accelerations_by_q @ G, t.accelerations_by_v @ W

    def _columns(self) -> dict[Port, Array]:
        """Generalised force of each port's unit, or displacement of what it observes, (n,)."""
        order = list(self.of._equations.signals)
        found: dict[Port, Array] = {}
        for port, probe in self.of._probes.items():
            if probe in order:
                found[port] = -self.W.T @ self.tangents.by_signals[:, order.index(probe)]
            else:  # it moves nothing
                found[port] = np.zeros(self.mechanism.n)
            if isinstance(port, JointPort) and self.of.mechanism.links[port.body].motion is not None:
                found[port] = np.eye(self.mechanism.n)[self.mechanism.layout.rate[port.body]]
        return found

    def _ground_force(self, direction: Array) -> Array:
        """Generalised force by a unit acceleration of the ground: less the momentum that unit rates have."""
        n, q = self.mechanism.n, np.tile(self.q, (self.mechanism.n + 1, 1))
        rates = np.concatenate([np.eye(n), np.zeros((1, n))])
        momentum = Kinematics(self.mechanism, np.zeros(n + 1), q, rates).momentum @ direction
        return np.asarray(-self.W.T @ (momentum[:-1] - momentum[-1]))

    def own_mass(self) -> Array:
        """Return the mass matrix of the independent coordinates."""
        n = self.mechanism.n
        independent, P = self._partition(np.setdiff1d(np.arange(n), self.of._given))
        S = np.eye(n)[independent]
        T = S.T - P @ (self.J @ S.T)
        return np.asarray(T.T @ self.M @ T)

    def model(self) -> StateSpace:
        n, given = self.mechanism.n, self.of._given
        moved = [port for port in dict.fromkeys(self.of.inputs) if isinstance(port, MotionPort)]
        driven = np.array([self.mechanism.layout.rate[port.body] for port in moved], dtype=np.int64)
        independent, P = self._partition(np.setdiff1d(np.arange(n), given))
        S = np.eye(n)[independent]
        T = S.T - P @ (self.J @ S.T)
        G = np.eye(n)[:, driven] - P @ self.J[:, driven]
        columns = self._columns()
        forces = np.zeros((n, len(self.of.inputs)))
        for k, port in enumerate(self.of.inputs):
            if isinstance(port, GroundPort):
                forces[:, k] = self._ground_force(np.array(port.direction))
            elif not isinstance(port, MotionPort):
                forces[:, k] = columns[port]
        # All small motions by (ξ, γ), (ζ, γ̇) and (α, γ̈).
        E = np.concatenate([T, G], axis=1)
        X = -P @ self.rates_by @ E  # δv = E (ζ, γ̇) + X (ξ, γ)
        by_eta = -P @ (self.second_by @ E + self.second_by_v @ X)  # of δa
        by_rates = -P @ (self.second_by_v @ E)
        own = T.T @ self.M @ T
        inverse = np.linalg.inv(own) if len(own) else own
        to_eta = -inverse @ T.T @ (self.K @ E + self.C @ X + self.M @ by_eta)
        to_rates = -inverse @ T.T @ (self.C @ E + self.M @ by_rates)
        to_inputs = inverse @ T.T @ forces
        of_motion = -inverse @ T.T @ self.M @ G
        k, g = len(independent), len(driven)
        first = np.concatenate([np.eye(k), np.zeros((g, k))], axis=0)
        A = np.zeros((2 * (k + g), 2 * (k + g)))
        position, rate = slice(0, k + g), slice(k + g, 2 * (k + g))
        A[position, rate] = np.eye(k + g)
        A[position, position] = -first @ S @ self.turning @ E
        A[rate, position] = first @ to_eta
        A[rate, rate] = first @ (to_rates - S @ self.sliding @ E)
        A[rate, position] -= first @ S @ self.sliding @ X
        B = np.zeros((2 * (k + g), len(self.of.inputs)))
        B[rate] = first @ to_inputs
        for number, port in enumerate(self.of.inputs):
            if isinstance(port, MotionPort):
                j = moved.index(port)
                B[rate, number] = first @ of_motion[:, j] + np.eye(k + g)[k + j]
        C, D = self._outputs(columns, E, A, B)
        names = self.of.state_names()
        kept = [names[at] for at in (*independent, *driven)]
        states = (*kept, *(Channel(f"{name}.rate", f"{unit}/s") for name, unit in kept))
        states, A, B, C = self._without_integrals(np.array([*independent, *driven]), states, A, B, C)
        inputs = tuple(Channel(port.name, port.unit) for port in self.of.inputs)
        return StateSpace(A, B, C, D, states, inputs, tuple(Channel(p.name, p.unit) for p in self.of.outputs))

    def _without_integrals(
        self, rates: IntArray, states: tuple[Channel, ...], A: Array, B: Array, C: Array
    ) -> tuple[tuple[Channel, ...], Array, Array, Array]:
        """Leave out the integrals of controllers' states, which are their links' positions; name the states.

        They are those of ``rates`` (k,): positions (k,), then rates (k,).
        """
        own = {rate: Channel(name, "SI") for name, rate, _ in self.mechanism.states}
        if not own:
            return states, A, B, C
        named = [
            *states[: len(rates)],
            *(own.get(rate, at) for rate, at in zip(rates, states[len(rates) :], strict=True)),
        ]
        kept = np.array([k for k in range(2 * len(rates)) if k >= len(rates) or rates[k] not in own])
        return tuple(named[k] for k in kept), A[np.ix_(kept, kept)], B[kept], C[:, kept]

    def _partition(self, free: IntArray) -> tuple[IntArray, Array]:
        """Choose independent coordinates; P (n, n_rows) moves the dependent ones, so that ``J P = 1`` on what J does.

        Pivots go to the coordinates that a constraint holds best, measured by their inertia.
        """
        n, rows = self.mechanism.n, len(self.J)
        P = np.zeros((n, rows))
        if not rows:
            return free, P
        J = self.J[:, free] / np.sqrt(self.M.diagonal()[free])
        size = np.linalg.norm(J, axis=1)
        J = J / np.maximum(size, 1e-300)[:, None]
        _, R, order = qr(J, mode="economic", pivoting=True)
        pivots = np.abs(R.diagonal())
        rank = int((pivots > DEPENDENT_CONSTRAINT * pivots.max(initial=0.0)).sum())
        dependent = free[np.sort(order[:rank])]
        P[dependent] = np.linalg.pinv(self.J[:, dependent] / size[:, None], rcond=DEPENDENT_CONSTRAINT) / size
        return np.setdiff1d(free, dependent), P

    def _outputs(self, columns: Mapping[Port, Array], E: Array, A: Array, B: Array) -> tuple[Array, Array]:
        """Return C and D; velocities and accelerations are the derivatives of the displacements along their axes."""
        C, D = [], []
        for port in self.of.outputs:
            if isinstance(port, ModalPort):
                row = np.zeros(self.mechanism.n)
                row[self.mechanism.modes_of(port.body)] = port.row
            else:
                row = columns[port]
            c, d = np.concatenate([row @ E, np.zeros(E.shape[1])]), np.zeros(B.shape[1])
            for _ in range(port.order):
                c, d = c @ A, c @ B
            C.append(c)
            D.append(d)
        shape = len(self.of.outputs)
        return np.array(C).reshape(shape, len(A)), np.array(D).reshape(shape, B.shape[1])


def _numbered_signal(number: int) -> Signal:
    """Return a signal that varies, unlike those of other numbers; its own values are never taken."""
    return formula(parse_formula("t"), float(number + 1))
