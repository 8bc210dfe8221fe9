"""Assembly of mechanisms with loops: positions and rates at the start that every joint allows."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import InputError
from fmd.core.joint_kinds import ACROSS, AXIS, SPACE, JointKind
from fmd.core.limits import newton as limits
from fmd.core.limits.mechanism import ALONG_AXIS
from fmd.core.limits.newton import AWAY, DRIVEN_MOMENTS, SPREAD, TRIED
from fmd.core.limits.rank import IDLE, RANK
from fmd.core.newton import largest
from fmd.dynamics.closures import Closure
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.compiler.closures import ConstraintRow, OpenConstraintError
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.state_functions import StateFunction
from fmd.integrators.protocol import move_positions
from fmd.scene.joints.any_joint import Joint, kinds_that
from fmd.scene.scene import Scene
from fmd.stages.closing_ways import describe_ways
from fmd.stages.loop_closing import (
    close_by,
    close_loops,
    flexibility,
    given_joints,
    joint_rates,
    loose_rates,
    open_residual,
    residuals,
)
from fmd.stages.run_checks import require_inertia


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
        groups = [columns for columns in (loose_rates(scene, rigid, "position"), np.arange(rigid.n)) if len(columns)]
        q = close_loops(system, q, groups)
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
    joints = joint_rates(mechanism)
    q = close_loops(system, q, [loose_rates(scene, mechanism, "position"), joints, np.arange(mechanism.n)])
    _require_closed(scene, system, q)
    v = _allow(system, q, v, [loose_rates(scene, mechanism, "rate"), joints, np.arange(mechanism.n)])
    _, rates = system.compiled.residuals(0.0, q, v)
    worst = int(np.abs(rates).argmax()) if len(rates) else 0
    if len(rates) and np.abs(rates[worst]) > limits.OPEN * max(1.0, largest(v)):
        row = system.compiled.rows[worst]
        unit = "rad/s" if row.rotational else "m/s"
        mend = f"opens at {abs(rates[worst]):.3g} {unit} at the start: the prescribed motions work against each other"
        raise InputError(scene.file, f"joint.{row.name}", None, mend)
    _require_freedom(scene, system, q)
    return q, v


def following_joints(scene: Scene, mechanism: Mechanism) -> list[IntArray]:
    """Rates of the joints whose position the scene leaves open, if there are such, and those of all joints."""
    loose, every = loose_rates(scene, mechanism, "position"), joint_rates(mechanism)
    return [loose, every] if 0 < len(loose) < len(every) else [every]


def free_directions(system: CompiledSystem, q: Array) -> Array:
    """Return an orthonormal basis of the rates that keep all loops closed, shape (n, n_free)."""
    _, _, vectors = np.linalg.svd(system.compiled.constraint_jacobian(0.0, q))
    return np.asarray(vectors[constraint_rank(system, q) :].T)


def _allow(system: CompiledSystem, q: Array, v: Array, groups: Sequence[IntArray]) -> Array:
    """Change the rates of the first group that can let all residuals stay closed."""
    J, weights = system.compiled.constraint_jacobian(0.0, q), flexibility(system)
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
    g = residuals(system, q)
    worst = int(np.abs(g).argmax()) if len(g) else 0
    if len(g) and abs(g[worst]) > limits.OPEN:
        row = system.compiled.rows[worst]
        size = f"{np.degrees(abs(g[worst])):.4g} degrees" if row.rotational else f"{abs(g[worst]):.4g} m"
        if ways := describe_ways(scene, replace(system.mechanism, assembled={})):
            mend = f"can't close its loop from where its joints start; it closes with {ways}: give one of them"
        else:
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
    if open_residual(rigid, q) > limits.OPEN or rank == rigid.n:
        return
    for direction in free_directions(rigid, q).T:
        near = close_by(
            rigid, move_positions(rigid.parameters, q, AWAY * direction), np.arange(rigid.n), np.ones(rigid.n)
        )
        if open_residual(rigid, near) <= limits.OPEN and (others := constraint_rank(rigid, near)) > rank:
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
        moved = close_by(rigid, moved, np.arange(rigid.n), np.ones(rigid.n))
        states += [moved] if open_residual(rigid, moved) <= limits.OPEN else []
    system = CompiledSystem(mechanism)
    places = np.array([undeformed_positions(mechanism, rigid.mechanism, state) for state in states])
    largest = (system.compiled.compliances(places).diagonal(axis1=1, axis2=2) / system.constraint_scales).max(axis=0)
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

    S = system.compiled.compliances(rigid.rest_positions[None])[0]
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
    S = system.compiled.compliances(q[None])[0]
    if not len(S):
        return 0
    scale = np.sqrt(system.constraint_scales)
    sizes = np.linalg.eigvalsh(S / np.outer(scale, scale))
    return int((sizes > RANK * sizes.max()).sum())
