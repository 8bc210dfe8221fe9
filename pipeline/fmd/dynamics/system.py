"""Interface between integrators and the systems that they march.

A system is its parameters, a `Table` of flat arrays, and compiled functions of them. What the functions here do is
registered for a type of parameters, so that one integrator kernel serves every mechanism; those of loops and contacts
do nothing for a type that knows of none.
"""

from collections.abc import Sequence
from functools import singledispatch
from typing import Any, Protocol

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import StabilityError
from fmd.core.limits.stepping import COST_OF_COORDINATE
from fmd.dynamics.step_bounds import StepBounds, no_bounds
from fmd.kernels.kernel import inlined


@singledispatch
def accelerations(p: Any, t: float, q: Array, v: Array, a: Array) -> None:
    """Solve ``M̂ a = Q̂`` (eq. 4 of Miao et al. 2008) at time t [s] for coordinates q and rates v, into a."""
    raise NotImplementedError


@singledispatch
@inlined
def project(p: Any, t: float, q: Array, v: Array) -> None:
    """Bring positions and rates at time t [s] back onto the constraints of loops, the shortest way by the mass matrix.

    Which constraints are independent is found at the next state whose accelerations are asked for, and then kept until
    the next projection: stages of one step take the same ones.
    """


@singledispatch
@inlined
def note_held(p: Any, groups: IntArray, largest: Array, held: Array) -> None:
    """Raise ``held`` to how much constraints changed the accelerations that were evaluated last, by groups of rates.

    Those count that haven't moved: ``largest``, (n_groups,), is no more than `STILL_GROUP`. ``groups``, (n,), has the
    group of each rate, -1 of none.
    """


@singledispatch
@inlined
def project_onto_constraints(p: Any, t: float, h: float, q: Array, v: Array, a: Array) -> None:
    """Close the residuals of loops at the end of a leapfrog step h, at time t [s], by forces along Jᵀ at its begin.

    That is SHAKE (Ryckaert, Ciccotti & Berendsen, J Comput Phys 23, 1977): positions move as the rates over the step
    change, and so do these and the accelerations.
    """


@singledispatch
@inlined
def choose_constraints_anew(p: Any) -> None:
    """Let the next state whose accelerations are asked for decide which constraints are independent."""


@singledispatch
def leapfrog_step(p: Any, leapfrog: Any, t: float, h: float, q: Array, v: Array, a: Array) -> None:
    """Take a step h of the leapfrog method: ``a = M̂⁻¹ Q̂(t, q, v + ½ h a)``, ``v += h a``, ``q += h v``."""
    raise NotImplementedError


@singledispatch
@inlined
def note_contacts(p: Any, t: float, q: Array, v: Array, values: Array) -> None:
    """Fill the values of a mechanism's contacts at a state of a march within or after its last step."""


@singledispatch
@inlined
def answer_contacts(ahead: Any, p: Any, t: float, q: Array, v: Array, answer: Array) -> bool:
    """Find what contacts add to the accelerations of a step's end, at which q and v are without that; false without."""
    return False


@singledispatch
@inlined
def answer_remembered(ahead: Any, p: Any, answer: Array) -> None:
    """Find what contacts add to the accelerations of the state that they remember; nothing without."""


@singledispatch
@inlined
def accelerate_answered(ahead: Any, p: Any, t: float, q: Array, v: Array, a: Array) -> None:
    """Evaluate `accelerations` at a step's end, with the forces of contacts that `answer_contacts` has found last."""
    accelerations(p, t, q, v, a)


@singledispatch
@inlined
def remember_answered(ahead: Any, p: Any, t: float, q: Array, v: Array) -> None:
    """Let contacts remember a step's end as `remember_contacts` does, with the forces found by `answer_contacts`."""
    remember_contacts(p, t, q, v)


@singledispatch
@inlined
def remember_contacts(p: Any, t: float, q: Array, v: Array) -> None:
    """Let a mechanism's contacts remember the end of a step, from which friction and damping go on."""


@singledispatch
@inlined
def remember_found(p: Any, t: float) -> None:
    """Let a mechanism's contacts remember the state whose accelerations were evaluated last."""


@singledispatch
@inlined
def contact_forces(p: Any, forces: Array) -> None:
    """Fill the forces of contacts, three each, at the state whose accelerations were evaluated last."""


@singledispatch
@inlined
def set_impulses(p: Any, impulses: Array) -> None:
    """Let contacts remember impulses, three each, at the end of the last step."""


@singledispatch
def may_touch(p: Any, t: float, ahead: float, q: Array, v: Array) -> bool:
    """Tell if surfaces touch at time t [s], or may within a time ahead [s]; if not, contacts remember a step's end."""
    raise NotImplementedError


@singledispatch
@inlined
def is_pressed(p: Any, t: float, q: Array, v: Array) -> bool:
    """Tell if surfaces press one another in a state, of which nothing is remembered."""
    return False


@singledispatch
def freeze_slow(p: Any, t: float, q: Array, v: Array, a: Array, frozen: Any) -> None:
    """Freeze M̂, the slow accelerations and the coefficients of the velocity-dependent terms over a major cycle."""
    raise NotImplementedError


@singledispatch
def fast_steps(p: Any, frozen: Any, first: int, h: float, count: int, q: Array, v: Array, a: Array) -> None:
    """Take ``count`` leapfrog steps h with the fast coordinates alone, from time ``first · h``.

    Each solves ``M_SS a_S = Q_S − K_S q_S − M_SL a_L`` (eq. 11) with what `freeze_slow` holds, into a; then
    ``v += h a``, ``q += h v``. The first call after `freeze_slow` is for a time h after its own, the next goes on where
    that ends: into how many calls a cycle's steps are divided changes no bit.
    """
    raise NotImplementedError


@singledispatch
def begin_whole_cycles(p: Any, cycle: Any, first: int, h: float, count: int) -> int:
    """Evaluate the loads of a major cycle from step number ``first`` on, for `cross_cycle`.

    Return through how many cycles of ``count`` they serve: one, or more where none changes.
    """
    raise NotImplementedError


@singledispatch
def cross_cycle(p: Any, cycle: Any, count: int, q: Array, v: Array, a: Array, begin: Array) -> bool:
    """Take a slow step over a major cycle and ``count`` of its fast steps: all of them, or those up to a sample.

    That is what `freeze_slow` and `fast_steps` do, in one; true if the rates are then beyond bounds or not finite.
    ``a`` holds the accelerations of the cycle before and, afterwards, of the slow coordinates at the begin and of
    the fast ones at the last step; ``begin`` is filled with all accelerations at the begin.
    """
    raise NotImplementedError


@singledispatch
def cross_by_carried_forces(
    p: Any, carried: Any, t: float, maps: Array, q: Array, v: Array, a: Array, memory: Array, begin: Array
) -> bool:
    """Take a major cycle by carried forces from time t [s]; true if the rates are then beyond bounds or not finite.

    ``maps`` (17, n) are those of `fmd.dynamics.compiler.carried_cycle`, ``memory`` begins with the forces of the two
    cycles before, and of this one and the last afterwards. ``begin`` is filled with the accelerations at the begin.
    """
    raise NotImplementedError


@singledispatch
def find_responses(p: Any, responses: Any, t: float, q: Array, v: Array, a: Array, X: Array) -> None:
    """Solve ``M̂ a = Q̂`` as `accelerations` does, and for unit forces: X, (n_blocks, n, 8), is M̂⁻¹.

    ``X[b, j, k]`` is the answer of rate 8 b + k to a unit force along rate j, as constraints of loops allow it.
    """
    raise NotImplementedError


@singledispatch
def advance(p: Any, q: Array, v: Array, h: float, first: int, last: int) -> None:
    """Move the coordinates that the rates ``first … last - 1`` belong to by ``h v``; unit quaternions stay unit."""
    raise NotImplementedError


@singledispatch
def velocities(p: Any, q: Array, v: Array, dq: Array) -> None:
    """Time derivatives of the position coordinates, into dq: the rates, but for quaternions."""
    raise NotImplementedError


class PlainSystem(Protocol):
    """Answers of a system without loops, contacts, controllers, force laws, groups and tangents."""

    @property
    def leap_in_lanes(self) -> int:
        """Address of a leapfrog step of eight states at once, each with numbers of its own; 0 if there is none."""
        return 0

    @property
    def has_loops(self) -> bool:
        """True if constraints close loops."""
        return False

    @property
    def is_sampled(self) -> bool:
        """True if controllers sample."""
        return False

    def sampling(self) -> Any:
        """Return the sampling of a march's controllers, or none."""
        return None

    @property
    def n_contact_values(self) -> int:
        """How many values `note_contacts` fills; 0 if nothing touches."""
        return 0

    @property
    def n_contacts(self) -> int:
        """Number of contacts."""
        return 0

    @property
    def has_lossy_contacts(self) -> bool:
        """True if contacts have friction, or lose energy otherwise."""
        return False

    @property
    def shock_step(self) -> float:
        """2/ω of what a shock of contacts is resolved by [s]; 0 without contacts."""
        return 0.0

    @property
    def answers_to_contact(self: Any) -> Array:
        """Largest acceleration of each rate by a unit force on a point of a contact, (n,); none without contacts."""
        return np.zeros(0)

    def contacts_ahead(self, p: Any, step: float, to_position: float, to_rate: float) -> Any:
        """Return contacts whose points give way by what forces move over a step, by `answer_contacts`; 0 without.

        An acceleration at the step's end moves positions by ``to_position`` [s²] and rates by ``to_rate`` [s].
        """
        return 0

    @property
    def settles(self: Any) -> bool:
        """True if a step's end is changed after it, by loops or by quaternions that become unit ones."""
        return bool(self.n_positions != self.n)

    @property
    def groups(self) -> tuple[IntArray, IntArray] | None:
        """Group of each position, (n_positions,), and of each rate, (n,), or none where each coordinate is one.

        Those of like kind, such as all modes of a body, are one group, whose largest value errors are relative to. A
        group's number modulo 3 is its kind: rotations, translations, modes.
        """
        return None

    def describe_coordinate(self, number: int, is_rate: bool) -> str:
        """Return what a position, or a rate, belongs to, for messages."""
        return f"{'rate' if is_rate else 'coordinate'} {number}"

    @property
    def evaluation_cost(self: Any) -> float:
        """Operations of an evaluation of the accelerations, by which methods are weighed."""
        return float(COST_OF_COORDINATE * self.n)

    @property
    def piecewise_laws(self) -> Sequence[Any]:
        """Force laws with short pieces."""
        return ()

    @property
    def step_bounds(self) -> StepBounds:
        """Bounds of steps by these laws, with room of their own."""
        return no_bounds()

    @property
    def fast_places(self: Any) -> IntArray:
        """Position that each fast rate moves, shape (n,); -1 for slow rates."""
        places: IntArray = np.arange(self.n) + self.n_positions - self.n
        places[: self.n_slow] = -1
        return places

    @property
    def stiffest_matrices(self: Any) -> tuple[Array, Array, Array]:
        """Mass, stiffness and damping with all end stops closed, (n, n) each."""
        M, K, C = self.linear_matrices
        return M, K, C

    @property
    def motion(self) -> Any:
        """The system of the motion beside which tangents are marched: this one itself without any."""
        return self

    def cycle(self, h: float, count: int) -> Any:
        """Return fresh storage for `cross_cycle` over so many fast steps h, or none where `freeze_slow` serves."""
        return None

    def carried_cycle(self) -> Any:
        """Return fresh storage for `cross_by_carried_forces`, or none where cycles aren't compiled as a whole."""
        return None

    def explain_failure(self, failure: StabilityError) -> None:
        """Raise why a march failed, where that is known."""
        return


class System(PlainSystem, Protocol):
    """A mechanism ready to be integrated; its first ``n_slow`` rates are the slow ones."""

    @property
    def n(self) -> int:
        """Number of rates, and of accelerations."""

    @property
    def n_positions(self) -> int:
        """Number of position coordinates: more than rates where a rotation in space is a quaternion."""

    @property
    def stiffness(self) -> Array:
        """Linear part of each acceleration, ``a_j = −stiffness_j q_j + …`` [1/s²], shape (n,); 0 for most joints."""

    @property
    def n_slow(self) -> int:
        """Number of slow coordinates."""

    @property
    def parameters(self) -> Any:
        """Flat arrays for the compiled functions."""

    @property
    def linear_matrices(self) -> tuple[Array, Array, Array]:
        """Mass, stiffness and damping in the reference state, (n, n) each."""

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Times at which a load or its rate jumps [s], ascending."""

    @property
    def shortest_action(self) -> float:
        """Shortest time for which a load acts between two times without it [s]; infinity if none does."""

    def resolving_step(self, step: float) -> tuple[float, float]:
        """Return the longest step up to a given one that steps over no load, and how long the shortest one acts [s]."""

    @property
    def coupled(self) -> bool:
        """True if coordinates couple through the mass matrix in some state."""

    @property
    def highest_frequency(self) -> float:
        """Highest coupled angular frequency [rad/s]."""

    @property
    def highest_fast_frequency(self) -> float:
        """Highest angular frequency of the fast coordinates with the slow ones frozen [rad/s]."""

    @property
    def highest_slow_frequency(self) -> float:
        """Highest angular frequency of the slow coordinates with the fast ones frozen [rad/s]."""

    @property
    def largest_step(self) -> float:
        """Longest stable step of the leapfrog method with its dampers [s]."""

    @property
    def largest_fast_step(self) -> float:
        """Longest stable step of the fast coordinates with the slow ones frozen [s]."""

    @property
    def largest_slow_step(self) -> float:
        """Longest stable step of the slow coordinates with the fast ones frozen [s]."""

    def leapfrog(self) -> Any:
        """Fresh storage for `leapfrog_step`."""

    def frozen(self, cycle: float) -> Any:
        """Fresh storage for the coefficients that `freeze_slow` holds over a major cycle of a duration [s]."""

    def responses(self) -> Any:
        """Storage for `find_responses`."""
