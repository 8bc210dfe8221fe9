"""A mechanism of rigid and flexible bodies: the one description from which its equations and results are made.

Bodies form a tree of joints. The coordinates are those of the joints and of the modes alone, the independent
coordinates of eq. (4) of Miao et al. (2008): nothing else appears, so no constraint of the tree can drift. Joints
between bodies that both hang on others close loops: constraints between these coordinates.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.dynamics.closures import GROUND, Closure, Constraint, Coupler
from fmd.dynamics.controllers import SampledController
from fmd.dynamics.elements import Element
from fmd.dynamics.links import Link, PointLoad
from fmd.dynamics.signals.activity import Activity, find_activity
from fmd.dynamics.signals.signal import Signal
from fmd.dynamics.state_functions import HeldValue, Quantity, StateFunction
from fmd.reduction.body import MarkerShapes

if TYPE_CHECKING:
    from fmd.contact.touching_body import TouchingBody


class Layout(NamedTuple):
    """Where the coordinates are: slow joints, slow modes, fast joints, fast modes."""

    rate: IntArray  # first rate of each joint
    position: IntArray  # first position of each joint
    mode: IntArray  # (n_bodies, most modes): rate of each modal coordinate
    n_slow: int  # number of slow rates
    n: int  # number of rates
    n_positions: int  # number of positions


def layout_of(links: Sequence[Link], fast_joints: Sequence[str], slow_modes: Sequence[int]) -> Layout:
    """Number the coordinates; rotations in space are slow, so every rate after them has the same shift to its position.

    Fast are the joints of the links ``fast_joints`` and, of each link's modes, all but the lowest ``slow_modes``.
    """
    rate, position = np.zeros(len(links), dtype=np.int64), np.zeros(len(links), dtype=np.int64)
    mode = np.zeros((len(links), max(len(link.omega) for link in links)), dtype=np.int64)
    at = at_position = n_slow = 0
    for fast in (False, True):
        for k, link in enumerate(links):
            if (link.name in fast_joints) is fast:
                rate[k], position[k] = at, at_position
                at += link.n_rates
                at_position += link.n_positions
        for k, link in enumerate(links):
            first, last = (slow_modes[k], len(link.omega)) if fast else (0, slow_modes[k])
            mode[k, first:last] = np.arange(at, at + last - first)
            at += last - first
            at_position += last - first
        n_slow = n_slow if fast else at
    return Layout(rate, position, mode, n_slow, at, at_position)


_OF_STRUCTURE = {"layout", "groups", "position_of_rates", "states", "breakpoints", "activities", "acting"}
"""What mechanisms have in common that differ in springs, rests and dampers of joints alone."""


@dataclass(frozen=True, eq=False)
class Mechanism:
    """Bodies with the joints that carry them, and what acts on them.

    Rates are ordered by what is slow: slow joints, slow modes, fast joints, fast modes.

    Raises
    ------
    ValueError
        Names are missing or not unique, a link doesn't fit its parent, or a fast joint is not a revolute or prismatic
        one with a coordinate.
    """

    links: Sequence[Link]  # each after its parent
    fast_joints: Sequence[str] = ()  # bodies whose scalar joint coordinate is fast
    gravity: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [m/s²]
    loads: Sequence[PointLoad] = ()  # forces and torques at points
    # How many modes of a body, the lowest, are slow; none by default
    slow_modes: Mapping[str, int] = field(default_factory=dict)
    # Time [s] up to which loads are searched for short actions that adaptive steps must not miss; 0 searches none.
    horizon: float = 0.0
    closures: Sequence[Constraint] = ()  # joints that close loops, and relations between joint coordinates
    # Positions of links' joints, by the links' names, with which the loops of the undeformed mechanism close; those of
    # others are 0.
    assembled: Mapping[str, Sequence[float]] = field(default_factory=dict)
    elements: Sequence[Element] = ()  # force elements between two places
    # Controllers that measure now and then, each after those whose outputs it takes.
    controllers: Sequence[SampledController] = ()
    contacts: Sequence[TouchingBody] = ()  # bodies that touch planes or one another, each once
    # True if inertia of rigid bodies, modal damping and gravity are numbers that the equations take, as springs are,
    # and no part of their code.
    lifted: bool = False

    def __post_init__(self) -> None:
        links = {link.name: link for link in self.links}
        if not links or len(links) < len(self.links):
            raise ValueError(f"links need names of their own, and one link at least: {list(links)}")
        frozen = {body for closure in self.closures for body in closure.bodies}
        frozen |= {end.body for element in self.elements for end in element.ends if end.body != GROUND}
        frozen |= {body for function in self.functions for body in function.bodies}
        frozen |= {contact.body for contact in self.contacts}
        named = {*self.fast_joints, *self.slow_modes, *(at.body for at in self.loads), *frozen}
        if unknown := named - set(links):
            raise ValueError(f"no link is named {', '.join(sorted(unknown))}")
        for k, link in enumerate(self.links):
            link.require_valid(k, len(self.links[link.parent].omega) if 0 <= link.parent < k else 0)
            if link.name in self.fast_joints and link.n_rates != 1:
                raise ValueError(f"the joint of {link.name} can't be fast: it has no one coordinate")
            if not 0 <= self.slow_modes.get(link.name, 0) <= len(link.omega):
                raise ValueError(f"{link.name} has {len(link.omega)} modes, fewer than are to be slow")
        for closure in self.closures:
            closure.require_valid()
            for body in closure.bodies if isinstance(closure, Coupler) else ():
                if not links[body].unit:
                    raise ValueError(f"coupler {closure.name} takes revolute and prismatic joints, not that of {body}")

    @cached_property
    def layout(self) -> Layout:
        """Where each joint's and each body's coordinates are."""
        return layout_of(self.links, self.fast_joints, [self.slow_modes.get(link.name, 0) for link in self.links])

    def share_structure(self, like: Mechanism) -> None:
        """Take what has been found of a mechanism that differs in springs, rests and dampers of joints alone."""
        vars(self).update({name: vars(like)[name] for name in _OF_STRUCTURE & vars(like).keys()})

    def first_piece(self, body: int) -> int:
        """Return the number of the piece at the joint of the part that a body is a piece of; its own if it is whole."""
        part, parent = self.links[body].part, self.links[body].parent
        return self.first_piece(parent) if part and parent >= 0 and self.links[parent].part == part else body

    @property
    def n_slow(self) -> int:
        """Number of slow rates."""
        return self.layout.n_slow

    @property
    def n(self) -> int:
        """Number of rates."""
        return self.layout.n

    @property
    def n_positions(self) -> int:
        """Number of position coordinates."""
        return self.layout.n_positions

    @property
    def rest_positions(self) -> Array:
        """Positions of the undeformed mechanism with all joints at 0, or where loops close, shape (n_positions,)."""
        q = np.zeros(self.n_positions)
        for link, first in zip(self.links, self.layout.position, strict=True):
            if link.joint.turns_in_space:
                q[first + link.n_positions - 1] = 1.0  # a unit quaternion, its scalar part last
            if link.name in self.assembled:
                q[first : first + link.n_positions] = self.assembled[link.name]
        return q

    @cached_property
    def groups(self) -> tuple[IntArray, IntArray]:
        """Group of like coordinates that each position and each rate belongs to: one for each joint and each body.

        Joints of a mechanism with loops move each other: all angles are one group, and all displacements.
        """
        positions, rates = np.zeros(self.n_positions, dtype=np.int64), np.zeros(self.n, dtype=np.int64)
        for k, link in enumerate(self.links):
            at, first = self.layout.rate[k], self.layout.position[k]
            moves = link.n_slides if link.n_rates else 0  # translations aren't like rotations
            joint = 0 if self.closures and link.state is None else k
            rates[at : at + link.n_rates], positions[first : first + link.n_positions] = 3 * joint, 3 * joint
            rates[at : at + moves], positions[first : first + moves] = 3 * joint + 1, 3 * joint + 1
            rates[self.modes_of(k)], positions[self.modal_positions_of(k)] = 3 * k + 2, 3 * k + 2
        return positions, rates

    def describe_coordinate(self, number: int, is_rate: bool) -> str:
        """Return the joint or the body that a position, or a rate, belongs to."""
        for k, link in enumerate(self.links):
            first, n = (self.layout.rate[k], link.n_rates) if is_rate else (self.layout.position[k], link.n_positions)
            if first <= number < first + n:
                return f"the {'rate' if is_rate else 'motion'} of joint '{link.joint_name or link.name}'"
            if number in (self.modes_of(k) if is_rate else self.modal_positions_of(k)):
                return f"the {'vibration' if is_rate else 'deformation'} of body '{link.part or link.name}'"
        raise ValueError(f"no joint or body has coordinate {number}")

    @property
    def mass(self) -> float:
        """Mass of all bodies [kg]."""
        return float(sum(link.integrals.mass for link in self.links))

    @property
    def reach(self) -> float:
        """Largest distance of a marker from the origin of its body's frame [m]."""
        places = [marker.position for link in self.links for marker in link.markers.values()]
        return float(np.linalg.norm(places, axis=1).max()) if places else 0.0

    def number_of(self, body: str) -> int:
        """Number of the body of a name; of the first piece if it is the name of a part in pieces."""
        found = next((k for k, link in enumerate(self.links) if link.name == body), None)
        return next(k for k, link in enumerate(self.links) if link.part == body) if found is None else found

    def find_marker(self, body: int, marker: str) -> int:
        """Return the number of the piece that has a marker of a part, any of whose pieces is given; of a whole its own.

        Raises
        ------
        ValueError
            There is no such marker.
        """
        own = self.links[body]
        pieces = [body, *(k for k, link in enumerate(self.links) if own.part and link.part == own.part)]
        for k in pieces:
            if marker in self.links[k].markers:
                return k
        raise ValueError(f"{own.part or own.name} has no marker {marker}")

    @property
    def closing_joints(self) -> tuple[Closure, ...]:
        """Joints that close loops, without couplers."""
        return tuple(closure for closure in self.closures if isinstance(closure, Closure))

    @property
    def joint_children(self) -> dict[str, str]:
        """Name of the body that each joint holds at its child's place, by the joints' names; empty for the ground."""
        children = {link.joint_name: link.name for link in self.links}
        return children | {joint.name: joint.second.body for joint in self.closing_joints}

    def closed_places(self, body: str) -> list[MarkerShapes]:
        """Places of a body that joints which close loops constrain."""
        ends = [place for joint in self.closing_joints for place in (joint.first, joint.second)]
        return [place.marker for place in ends if place.body == body]

    def modes_of(self, body: int) -> IntArray:
        """Rates of a body's modal coordinates, lowest mode first."""
        return np.asarray(self.layout.mode[body, : len(self.links[body].omega)])

    @property
    def position_shift(self) -> int:
        """How much later modal coordinates stand among the positions than their rates do among the rates."""
        return self.n_positions - self.n

    def modal_positions_of(self, body: int) -> IntArray:
        """Positions of a body's modal coordinates, lowest mode first."""
        return self.modes_of(body) + self.position_shift

    @cached_property
    def position_of_rates(self) -> IntArray:
        """Position that each rate moves, shape (n,); -1 for a rotation in space."""
        position = np.full(self.n, -1, dtype=np.int64)
        for k, link in enumerate(self.links):
            rate, first, scalars = int(self.layout.rate[k]), int(self.layout.position[k]), link.n_scalars
            position[rate : rate + scalars] = np.arange(first, first + scalars)
            position[self.modes_of(k)] = self.modal_positions_of(k)
        return position

    @property
    def coordinates(self) -> tuple[tuple[str, str], ...]:
        """Name and SI unit of each coordinate, in the order of the rates."""
        found: dict[int, tuple[str, str]] = {}
        for k, link in enumerate(self.links):
            first, slides = int(self.layout.rate[k]), link.n_slides
            for j in range(link.n_rates):
                if link.joint.turns_in_space:
                    name = f"{link.joint_name}.{'' if j < slides else 'r'}{'xyz'[j % 3]}"
                else:
                    name = f"{link.joint_name}.position" + (f" {j + 1}" if link.n_rates > 1 else "")
                found[first + j] = name, "m" if j < slides else "rad"
            for j, rate in enumerate(self.modes_of(k)):
                found[int(rate)] = f"{link.name}.mode {j + 1}", "kg^(1/2) m"
        return tuple(found[k] for k in range(self.n))

    @property
    def signals(self) -> tuple[Signal, ...]:
        """All loads and motions."""
        motions = [link.motion for link in self.links if link.motion is not None]
        of_time = (signal for function in self.functions for signal in function.signals)
        return (*motions, *(link.load for link in self.links), *(load.size for load in self.loads), *of_time)

    @property
    def efforts(self) -> tuple[StateFunction, ...]:
        """Forces and torques by the mechanism's own state, along joints first."""
        both = (*(link.effort for link in self.links), *(load.effort for load in self.loads))
        return tuple(effort for effort in both if effort is not None)

    @property
    def functions(self) -> tuple[StateFunction, ...]:
        """All functions of the state: forces and torques, then what sampled controllers measure."""
        return (*self.efforts, *(function for controller in self.controllers for function in controller.measured))

    @property
    def held(self) -> tuple[HeldValue, ...]:
        """All values that are held between samples, by their numbers."""
        found = {value for function in self.functions for value in function.held}
        found |= {controller.output for controller in self.controllers}
        return tuple(sorted(found, key=lambda value: value.number))

    @cached_property
    def states(self) -> tuple[tuple[str, int, int], ...]:
        """Name, rate and position of each state of a controller."""
        at = zip(self.links, self.layout.rate.tolist(), self.layout.position.tolist(), strict=True)
        return tuple((link.name, rate, position) for link, rate, position in at if link.state is not None)

    def with_known(self, known: Callable[[Quantity], Quantity]) -> Mechanism:
        """Return the mechanism without sampling, whose controllers' outputs are known as functions of time.

        ``known`` returns that of a value that is held or a state's, and any other quantity as it is.
        """
        return replace(
            self,
            links=[replace(link, effort=link.effort and link.effort.with_variables(known)) for link in self.links],
            loads=[replace(load, effort=load.effort and load.effort.with_variables(known)) for load in self.loads],
            controllers=(),
        )

    @cached_property
    def breakpoints(self) -> tuple[float, ...]:
        """Times at which a load or a motion jumps, has a kink or begins to vary much faster [s], ascending."""
        known = {time for signal in self.signals for time in signal.breakpoints}
        return tuple(sorted(known.union(*(activity.events for activity in self.activities))))

    @cached_property
    def activities(self) -> tuple[Activity, ...]:
        """When each load and each motion that isn't constant acts, up to the horizon."""
        return tuple(find_activity(signal, self.horizon, derivative) for signal, derivative in self.acting)

    @cached_property
    def acting(self) -> tuple[tuple[Signal, int], ...]:
        """Each load and each motion that isn't constant, with the derivative by which it acts; none without horizon."""
        if not self.horizon > 0.0:
            return ()
        loads = [*(link.load for link in self.links), *(load.size for load in self.loads)]
        motions = [link.motion for link in self.links if link.motion is not None]
        both = [(signal, 0) for signal in loads] + [(signal, 2) for signal in motions]
        both += [pair for effort in self.efforts for pair in effort.signals.items()]
        return tuple((signal, derivative) for signal, derivative in both if not signal.is_constant)

    def with_modes(self, kept: Mapping[str, IntArray]) -> Mechanism:
        """Return the mechanism whose bodies have some of their modes alone, by name; without markers or contacts."""
        own = [kept[link.name] for link in self.links]
        links = [link.with_modes(own[k], own[link.parent]) for k, link in enumerate(self.links)]
        loads = [load.with_modes(kept[load.body]) for load in self.loads]
        return replace(
            self,
            links=[replace(link, effort=link.effort and link.effort.with_modes(kept)) for link in links],
            loads=[replace(load, effort=load.effort and load.effort.with_modes(kept)) for load in loads],
            slow_modes={name: int((kept[name] < count).sum()) for name, count in self.slow_modes.items()},
            closures=[closure.with_modes(kept) for closure in self.closures],
            elements=[element.with_modes(kept) for element in self.elements],
            controllers=[controller.with_modes(kept) for controller in self.controllers],
            contacts=(),
        )

    @cached_property
    def rigid(self) -> Mechanism:
        """Mechanism in which no body deforms; its coordinates are those of the joints alone."""
        bare = self.with_modes({link.name: np.zeros(0, dtype=np.int64) for link in self.links})
        links = [replace(link, integrals=replace(link.integrals, normal=-1, whole=False)) for link in bare.links]
        return replace(bare, links=links, slow_modes={})
