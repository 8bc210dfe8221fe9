"""A mechanism's graph as its motion is reported from: evaluated by NumPy at many states at once.

The constants keep what the march takes for round-off.
"""

from functools import cached_property, lru_cache

from fmd.core.data_classes import dataclass
from fmd.core.limits.memory import MOST_SHARED
from fmd.core.recently_used import RecentlyUsed
from fmd.dynamics.closures import Place
from fmd.dynamics.compiler.algebra import subtract, times
from fmd.dynamics.compiler.closures import ConstraintRow, trace_all_rows
from fmd.dynamics.compiler.coordinates import ExactCoordinates
from fmd.dynamics.compiler.digest import digest_mechanism, names_of
from fmd.dynamics.compiler.elements import trace_pair, trace_strain
from fmd.dynamics.compiler.forces import ActingForces, trace_effort
from fmd.dynamics.compiler.frames import MovingFrame, trace_frames
from fmd.dynamics.compiler.graph import Graph, Scalar
from fmd.dynamics.compiler.interpret import Evaluation, evaluation_of
from fmd.dynamics.compiler.joint_motion import joint_elongation
from fmd.dynamics.compiler.places import trace_place
from fmd.dynamics.compiler.quantities import body_momenta, trace_kinetic_energy, trace_potential_energy
from fmd.dynamics.compiler.residual import trace_motion
from fmd.dynamics.elements import Element
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.state_functions import StateFunction


@dataclass(frozen=True)
class RecordedMechanism:
    """Quantities of a mechanism's motion by its state: arguments ``inputs``, ``q`` and ``v``, as in `programs`."""

    inputs: ExactCoordinates
    frames: list[MovingFrame]

    @cached_property
    def of_frames(self) -> Evaluation:
        """Origin, rotation by rows, velocity and angular velocity of each body in space, 18 values a body."""
        values: list[Scalar] = []
        for frame in self.frames:
            origin, R = frame.world
            values += [*origin, *(x for row in R for x in row), *times(R, frame.velocity), *times(R, frame.spin)]
        return evaluation_of(values)

    @cached_property
    def of_momenta(self) -> Evaluation:
        """First moment, momentum and angular momentum of each body in its axes, 9 values a body."""
        values: list[Scalar] = []
        for frame in self.frames:
            moment, push, turn = body_momenta(self.inputs, frame)
            values += [*moment, *push, *turn]
        return evaluation_of(values)

    @cached_property
    def of_energies(self) -> Evaluation:
        """Kinetic and potential energy [J]."""
        kinetic = trace_kinetic_energy(self.inputs, self.frames)
        return evaluation_of([kinetic, trace_potential_energy(self.inputs, self.frames)])

    @cached_property
    def rows(self) -> list[ConstraintRow]:
        """Scalar constraints, those that hold in every state among them: those of joints, then those of couplers."""
        return sorted(trace_all_rows(self.inputs, self.frames), key=lambda row: not row.wrenches)

    @cached_property
    def of_rows(self) -> Evaluation:
        """Residual and rate of each of these, and force and moment of a unit multiplier on both places of a joint's."""
        values = [x for row in self.rows for x in (row.residual, row.rate(self.inputs))]
        return evaluation_of([*values, *(x for row in self.rows for _, f, m in row.wrenches for x in (*f, *m))])

    def of_placement(self, body: int) -> Evaluation:
        """Origin and rotation by rows of a body's frame in space, 12 values, without what the others' take."""
        if body not in self._of_placements:
            origin, R = self.frames[body].world
            self._of_placements[body] = evaluation_of([*origin, *(x for row in R for x in row)])
        return self._of_placements[body]

    @cached_property
    def _of_placements(self) -> dict[int, Evaluation]:
        return {}

    def of_joint(self, body: int) -> Evaluation:
        """Position and rate of a joint with one axis, of a revolute one of the section that it grips."""
        if body not in self._of_joints:
            self._of_joints[body] = evaluation_of([*joint_elongation(self.inputs, self.frames[body])])
        return self._of_joints[body]

    @cached_property
    def _of_joints(self) -> dict[int, Evaluation]:
        return {}

    def of_strain(self, element: Element) -> Evaluation:
        """Strain of a force element, its rate, and that of the vector from its first place to its second one."""
        return evaluation_of([x for part in trace_strain(self.inputs, self.frames, element) for x in part])

    def of_wrenches(self, element: Element) -> Evaluation:
        """Force and moment in space on the first and on the second place of a force element."""
        second, first = trace_pair(self.inputs, self.frames, element)
        return evaluation_of([x for side in (first, second) for x in (*side.force, *side.moment)])

    def of_effort(self, effort: StateFunction) -> Evaluation:
        """Value of a function of the state."""
        return evaluation_of([trace_effort(self.inputs, self.frames, effort)])

    def of_place(self, place: Place) -> Evaluation:
        """Position, axes by rows, velocity and angular velocity in space of a place's section, 18 values."""
        at = trace_place(self.inputs, self.frames, place)
        return evaluation_of([*at.x, *(x for row in at.A for x in row), *at.v, *at.w])

    def of_acceleration(self, place: Place) -> Evaluation:
        """Acceleration in space of a place on a body for accelerations of the coordinates, the argument ``a``."""
        body = self.inputs.mechanism.number_of(place.body)
        falling = ActingForces(self.inputs, self.frames)
        x = trace_motion(self.inputs, self.frames, falling)[body]
        eta = self.inputs.inputs_of_modes(body, "a")
        at = trace_place(self.inputs, self.frames, place).acceleration(x, eta)[0]
        return evaluation_of(subtract(at, self.inputs.fall))


_shared: RecentlyUsed[RecordedMechanism] = RecentlyUsed(MOST_SHARED)


@lru_cache(maxsize=MOST_SHARED)
def record_mechanism(mechanism: Mechanism) -> RecordedMechanism:
    """Trace a mechanism's bodies as their motion is reported, once for all that differ in numbers or signals alone.

    These are in the argument ``inputs``, `ExactCoordinates.columns` of each mechanism; functions name their signals.
    """
    inputs = ExactCoordinates(Graph(), mechanism)
    signals = inputs.signals if mechanism.functions else len(inputs.signals)
    key = (digest_mechanism(inputs), signals, names_of(mechanism))
    return _shared.get(key, lambda: RecordedMechanism(inputs, trace_frames(inputs)))
