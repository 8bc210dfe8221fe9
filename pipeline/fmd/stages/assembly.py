"""Assembly of mechanisms with loops: positions and rates at the start that every joint allows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import InputError
from fmd.core.joint_kinds import ACROSS, AXIS, SPACE, JointKind
from fmd.core.limits import newton as limits
from fmd.core.limits.mechanism import ALONG_AXIS
from fmd.core.limits.newton import AWAY, DRIVEN_MOMENTS, SPREAD, TRIED
from fmd.core.limits.rank import IDLE, RANK
from fmd.core.newton import Tolerance, largest, solve
from fmd.dynamics.closures import Closure
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.compiler.closures import ConstraintRow, OpenConstraintError
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.linear_forces import gather_linear_forces
from fmd.dynamics.state_functions import StateFunction
from fmd.integrators.protocol import move_positions
from fmd.scene.joints.any_joint import Joint, kinds_that
from fmd.scene.joints.joint import POSITION_KEYS, RATE_KEYS
from fmd.stages.parent_joint import joint_axes
from fmd.stages.run_checks import require_inertia

if TYPE_CHECKING:
    from fmd.dynamics.mechanism import Mechanism
    from fmd.scene.scene import Scene

_CLOSING = Tolerance(limits.CLOSING_CORRECTIONS, residual=limits.CLOSED, stalled=limits.OPEN)


def assemble(scene: Scene, mechanism: Mechanism) -> Mechanism:
    """Find joint positions with which all loops of the undeformed mechanism close, from those of the scene.

    Joints that the scene gives no position move first; those that it does only if the others can't close the loops.

    Raises
    ------
    InputError
        The loops can't be closed; the message has the joint and its residual. Or a joint moves without any inertia.
    """
    rigid = mechanism.rigid
    q, _ = given_joints(scene, rigid)
    try:
        system = CompiledSystem(rigid)
        require_inertia(scene, system)
        groups = [columns for columns in (_loose(scene, rigid, "position"), np.arange(rigid.n)) if len(columns)]
        q = _close(system, q, groups)
    except OpenConstraintError as error:
        advice = _advise(scene.joint[error.joint], error.number)
        raise InputError(scene.file, f"joint.{error.joint}", None, f"{error}; {advice}") from error
    positions = {
        link.name: tuple(q[at : at + link.n_positions])
        for link, at in zip(rigid.links, rigid.layout.position, strict=True)
        if link.n_positions
    }
    _require_one_way(scene, system, q)
    return _without_idle_rows(replace(mechanism, assembled=positions), system, q)


def _advise(joint: Joint, number: int) -> str:
    """Return what could be done about one of a joint's scalar constraints that can't hold, by its number."""
    kind = joint.kind
    constraint = [*kind.points, *kind.squares, ""][number]
    if constraint in SPACE:
        along = abs(joint.direction(AXIS)[SPACE.index(constraint)]) > ALONG_AXIS
        constraint = AXIS if along else ACROSS[0]

    def leaves_free(other: JointKind) -> bool:
        points = {AXIS, *ACROSS} if other.points == SPACE else {*other.points}
        return {*other.squares} <= {*kind.squares} and constraint not in {*points, *other.squares}

    freer = ", ".join(kinds_that(lambda other: bool(other.points) and leaves_free(other)))
    advice = "check places and axes of the loop"
    return f"{advice}, or take a joint that leaves this free: {freer}" if freer and constraint else advice


def given_joints(scene: Scene, mechanism: Mechanism) -> tuple[Array, Array]:
    """Return positions (n_positions,) and rates (n,) of the undeformed mechanism, its joints as the scene has them."""
    q0, v0 = mechanism.rest_positions, np.zeros(mechanism.n)
    for k, link in enumerate(mechanism.links):
        at, first = mechanism.layout.position[k], mechanism.layout.rate[k]
        if isinstance(link.state, float):
            v0[first] = link.state
        elif link.motion is None and link.state is None:
            joint = scene.joint[link.joint_name]
            positions, rates = joint.start(joint_axes(scene, joint).in_child)
            q0[at : at + len(positions)] = positions
            v0[first : first + len(rates)] = rates
    return q0, v0


def start_controllers(mechanism: Mechanism, q: Array, v: Array) -> Array:
    """Return the rates (n,) of a start with the controllers' states as the bodies' motion asks for."""
    v = v.copy()
    for link, rate in zip(mechanism.links, mechanism.layout.rate, strict=True):
        if isinstance(link.state, StateFunction):
            v[rate] = Kinematics(mechanism, np.zeros(1), q[None], v[None]).effort(link.state)[0]
    return v


def close_start(scene: Scene, system: CompiledSystem, q: Array, v: Array) -> tuple[Array, Array]:
    """Bring positions and rates at the start onto the constraints; bodies deform only where joints alone can't do it.

    Raises
    ------
    InputError
        The loops can't be closed, prescribed motions work against each other, or nothing can move.
    """
    mechanism, q = system.mechanism, q.copy()
    for link, at in zip(mechanism.links, mechanism.layout.position, strict=True):
        if link.name in mechanism.assembled:
            q[at : at + link.n_positions] = mechanism.assembled[link.name]
    joints = _joint_rates(mechanism)
    q = _close(system, q, [_loose(scene, mechanism, "position"), joints, np.arange(mechanism.n)])
    _require_closed(scene, system, q)
    v = _allow(system, q, v, [_loose(scene, mechanism, "rate"), joints, np.arange(mechanism.n)])
    _, rates = system.compiled.residuals(0.0, q, v)
    worst = int(np.abs(rates).argmax()) if len(rates) else 0
    if len(rates) and np.abs(rates[worst]) > limits.OPEN * max(1.0, largest(v)):
        row = system.compiled.rows[worst]
        unit = "rad/s" if row.rotational else "m/s"
        mend = f"opens at {abs(rates[worst]):.3g} {unit} at the start: the prescribed motions work against each other"
        raise InputError(scene.file, f"joint.{row.name}", None, mend)
    _require_freedom(scene, system, q)
    return q, v


def _joint_rates(mechanism: Mechanism) -> IntArray:
    """Rates of all joints."""
    parts = [np.arange(at, at + link.n_rates) for link, at in zip(mechanism.links, mechanism.layout.rate, strict=True)]
    return np.concatenate([np.zeros(0, dtype=np.int64), *parts])


def _loose(scene: Scene, mechanism: Mechanism, what: str) -> IntArray:
    """Rates of the joints whose ``position`` or ``rate`` the scene leaves open."""
    keys = POSITION_KEYS if what == "position" else {*RATE_KEYS}
    parts = [
        np.arange(at, at + link.n_rates)
        for link, at in zip(mechanism.links, mechanism.layout.rate, strict=True)
        if link.state is None and not keys & scene.joint[link.joint_name].given_keys
    ]
    return np.concatenate([np.zeros(0, dtype=np.int64), *parts])


def following_joints(scene: Scene, mechanism: Mechanism) -> list[IntArray]:
    """Rates of the joints whose position the scene leaves open, if there are such, and those of all joints."""
    loose, every = _loose(scene, mechanism, "position"), _joint_rates(mechanism)
    return [loose, every] if 0 < len(loose) < len(every) else [every]


def free_directions(system: CompiledSystem, q: Array) -> Array:
    """Return an orthonormal basis of the rates that keep all loops closed, shape (n, n_free)."""
    _, _, vectors = np.linalg.svd(system.compiled.constraint_jacobian(0.0, q))
    return np.asarray(vectors[constraint_rank(system, q) :].T)


def _close(system: CompiledSystem, q: Array, groups: Sequence[IntArray], t: float = 0.0) -> Array:
    """Close the residuals by the first group of coordinates that can; else return where the last one leaves them."""
    closed, weights = q, _flexibility(system)
    for columns in groups:
        closed = _close_by(system, q, columns, weights, t)
        if _residual(system, closed, t) <= limits.OPEN:
            return closed
    return closed


def _flexibility(system: CompiledSystem) -> Array:
    """Return how readily coordinates move to close residuals: joints at once, modes by their static compliance."""
    stiffness = np.maximum(gather_linear_forces(system.mechanism.links, system.mechanism.layout).own, 0.0)
    weights = np.ones(system.n)
    for k, link in enumerate(system.mechanism.links):
        modes = system.mechanism.modes_of(k)
        weights[modes] = link.omega.min(initial=np.inf) / np.sqrt(np.maximum(stiffness[modes], 1e-300))
    return weights


def _residuals(system: CompiledSystem, q: Array, t: float = 0.0) -> Array:
    return system.compiled.residuals(t, q, np.zeros(system.n))[0]


def _residual(system: CompiledSystem, q: Array, t: float = 0.0) -> float:
    return largest(_residuals(system, q, t))


def close_pose(system: CompiledSystem, t: float, q: Array, kept: int | None = None) -> Array | None:
    """Return positions near q (n_positions,) at which all loops are closed at a time [s]; ``None`` if there are none.

    Bodies deform only where joints alone can't do it. The coordinate of the rate ``kept`` stays as it is.
    """
    if not system.mechanism.closures:
        return q
    fixed = [] if kept is None else [kept]
    groups = [np.setdiff1d(columns, fixed) for columns in (_joint_rates(system.mechanism), np.arange(system.n))]
    closed = _close(system, q, groups, t)
    return closed if _residual(system, closed, t) <= limits.OPEN else None


def _close_by(system: CompiledSystem, q: Array, columns: IntArray, weights: Array, t: float = 0.0) -> Array:
    """Move some coordinates by Newton's method, the least motion first, in halved steps where a residual would grow."""

    def correction(q: Array, left: Array) -> Array:
        J = system.compiled.constraint_jacobian(t, q)[:, columns] * weights[columns]
        change = np.zeros(system.n)
        change[columns] = -weights[columns] * np.linalg.lstsq(J, left, rcond=limits.DEPENDENT_DIRECTION)[0]
        return change

    return solve(
        q,
        lambda q: _residuals(system, q, t),
        correction,
        lambda q, change: move_positions(system.parameters, q, change),
        _CLOSING,
        accepts=lambda trial: largest(trial.after) < largest(trial.before),
    ).state


def _allow(system: CompiledSystem, q: Array, v: Array, groups: Sequence[IntArray]) -> Array:
    """Change the rates of the first group that can let all residuals stay closed."""
    J, weights = system.compiled.constraint_jacobian(0.0, q), _flexibility(system)
    for columns in groups:
        changed = v.copy()
        for _ in range(2):
            _, rates = system.compiled.residuals(0.0, q, changed)
            part = J[:, columns] * weights[columns]
            changed[columns] -= weights[columns] * np.linalg.lstsq(part, rates, rcond=limits.DEPENDENT_DIRECTION)[0]
        _, rates = system.compiled.residuals(0.0, q, changed)
        if largest(rates) <= limits.OPEN * max(1.0, largest(changed)):
            return changed
    return changed


def _require_closed(scene: Scene, system: CompiledSystem, q: Array) -> None:
    g = _residuals(system, q)
    worst = int(np.abs(g).argmax()) if len(g) else 0
    if len(g) and abs(g[worst]) > limits.OPEN:
        row = system.compiled.rows[worst]
        size = f"{np.degrees(abs(g[worst])):.4g} degrees" if row.rotational else f"{abs(g[worst]):.4g} m"
        mend = (
            f"can't close its loop: a residual of {size} is left; check lengths, places and axes of the loop, "
            "or give joints a position nearer to the closed one"
        )
        raise InputError(scene.file, f"joint.{row.name}", None, mend)


def _require_freedom(scene: Scene, system: CompiledSystem, q: Array) -> None:
    """Raise ``InputError`` if nothing can move, neither by itself nor by a prescribed motion."""
    links = system.mechanism.links
    moves = any(link.motion is not None for link in links)
    deforms = bool(scene.flexible) and not any(len(link.omega) for link in links)  # but these are left out here
    if not moves and not deforms and constraint_rank(system, q) == system.n:
        names = ", ".join(closure.name for closure in system.mechanism.closures)
        mend = f"nothing can move: {names} leave no freedom to the {system.n} coordinates of the other joints and modes"
        raise InputError(scene.file, "joint", None, mend)


def _require_one_way(scene: Scene, rigid: CompiledSystem, q: Array) -> None:
    """Raise ``InputError`` if more constraints are independent close by than at the positions of the start."""
    rank = constraint_rank(rigid, q)
    if _residual(rigid, q) > limits.OPEN or rank == rigid.n:
        return
    for direction in free_directions(rigid, q).T:
        near = _close_by(
            rigid, move_positions(rigid.parameters, q, AWAY * direction), np.arange(rigid.n), np.ones(rigid.n)
        )
        if _residual(rigid, near) <= limits.OPEN and (others := constraint_rank(rigid, near)) > rank:
            mend = (
                f"the start is a singular position: {rank} constraints are independent there and {others} close by, so "
                "that it isn't known which way the mechanism goes; start it a little off"
            )
            raise InputError(scene.file, "joint", None, mend)


def _without_idle_rows(mechanism: Mechanism, rigid: CompiledSystem, q: Array) -> Mechanism:
    """Leave out idle scalar constraints: neither joints, modes nor prescribed motions move them.

    They would constrain a body as it bends, by motions of second order, and lock it.
    """
    random, states = np.random.default_rng(0), [q]
    for _ in range(TRIED):
        moved = move_positions(rigid.parameters, q, random.uniform(-SPREAD, SPREAD, rigid.n))
        moved = _close_by(rigid, moved, np.arange(rigid.n), np.ones(rigid.n))
        states += [moved] if _residual(rigid, moved) <= limits.OPEN else []
    system = CompiledSystem(mechanism)
    largest = np.zeros(len(system.compiled.rows))
    for state in states:
        _, S = system.compiled.multipliers(0.0, undeformed_positions(mechanism, rigid.mechanism, state))
        largest = np.maximum(largest, S.diagonal() / system.constraint_scales)
    driven, at_start = np.zeros(len(largest)), undeformed_positions(mechanism, rigid.mechanism, q)
    for t in np.linspace(0.0, mechanism.horizon, DRIVEN_MOMENTS):
        _, rates = system.compiled.residuals(float(t), at_start, np.zeros(mechanism.n))
        driven = np.maximum(driven, np.abs(rates))
    still = (largest <= IDLE) & (driven <= IDLE * driven.max(initial=0.0))
    idle = [row for row, idles in zip(system.compiled.rows, still, strict=True) if idles]
    return _leave_out(mechanism, idle)


def movable_rigid(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism with all bodies rigid; of constraints that would let nothing move, only those that suffice.

    Where bodies have to deform for a mechanism to move, as on hinges that aren't parallel, rigid ones follow the
    constraints that resist the most.
    """
    rigid = mechanism.rigid
    system = CompiledSystem(rigid)
    if rigid.closures and not rigid.n:  # the prescribed motions alone move it, whatever they open
        return _leave_out(rigid, system.compiled.rows)
    if not rigid.closures or constraint_rank(system, rigid.rest_positions) < rigid.n:
        return rigid
    from scipy.linalg import qr

    _, S = system.compiled.multipliers(0.0, rigid.rest_positions)
    scale = np.sqrt(system.constraint_scales)
    _, _, order = qr(S / np.outer(scale, scale), pivoting=True)
    beyond = [system.compiled.rows[k] for k in order[rigid.n :]]
    return _leave_out(rigid, beyond)


def _leave_out(mechanism: Mechanism, rows: Sequence[ConstraintRow]) -> Mechanism:
    """Leave scalar constraints out of a mechanism's closures, beside those that are left out already."""
    closures = [
        replace(closure, left_out=(*closure.left_out, *(row.number for row in rows if row.name == closure.name)))
        if isinstance(closure, Closure)
        else closure
        for closure in mechanism.closures
    ]
    return replace(mechanism, closures=closures)


def undeformed_positions(mechanism: Mechanism, rigid: Mechanism, q: Array) -> Array:
    """Return positions of a mechanism without deformation, its joints as those of the rigid one."""
    out = mechanism.rest_positions
    for link, to, of in zip(mechanism.links, mechanism.layout.position, rigid.layout.position, strict=True):
        out[to : to + link.n_positions] = q[of : of + link.n_positions]
    return out


def constraint_rank(system: CompiledSystem, q: Array) -> int:
    """Return how many constraints are independent at positions q."""
    _, S = system.compiled.multipliers(0.0, q)
    if not len(S):
        return 0
    scale = np.sqrt(system.constraint_scales)
    sizes = np.linalg.eigvalsh(S / np.outer(scale, scale))
    return int((sizes > RANK * sizes.max()).sum())
