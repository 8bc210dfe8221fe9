"""Ways in which the loops of a mechanism close from positions that don't close them, such as the two of a crank."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits import newton as limits
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.mechanism import Mechanism
from fmd.integrators.protocol import move_positions
from fmd.scene.scene import Scene
from fmd.stages.loop_closing import close_by, given_joints, loose_rates, open_residual


def describe_ways(scene: Scene, mechanism: Mechanism) -> str:
    """Return what to give joints for each way in which loops close, that of the start first if it is found already.

    Bodies are rigid. The text is empty if the loops close near where the scene has its joints, in one way alone, or in
    infinitely many.
    """
    rigid = mechanism.rigid
    q, _ = given_joints(scene, rigid)
    system, every = CompiledSystem(rigid), _coordinates(scene, rigid, np.arange(rigid.n))
    taken = rigid.rest_positions if mechanism.assembled else None
    slides = [one.position for one in every if one.unit == "m"]
    size = max(mechanism.reach, 2.0 * open_residual(system, q), *np.abs((q if taken is None else taken)[slides]))
    if not every or (taken is not None and _apart(every, size, taken, q) <= limits.SPREAD):
        return ""
    for columns in (loose_rates(scene, rigid, "position"), np.arange(rigid.n)):
        coordinates = _coordinates(scene, rigid, columns)
        ways = _find_ways(system, q, columns, coordinates, size) if coordinates else []
        if ways:
            ways.sort(key=lambda way: _apart(every, size, way, q if taken is None else taken))
            texts = [_write_way(coordinates, way) for way in ways[: limits.SHOWN_WAYS]]
            return ", or ".join(texts) + ", …" * (len(ways) > limits.SHOWN_WAYS) if len(ways) > 1 else ""
    return ""


def _find_ways(
    system: CompiledSystem, q: Array, columns: IntArray, coordinates: Sequence[_Coordinate], size: float
) -> list[Array]:
    """Return positions at which loops close by coordinates that may go anywhere.

    There are none where closed positions aren't single ones.
    """
    rng, reach = np.random.default_rng(0), np.full(system.n, np.pi)
    reach[[one.rate for one in coordinates if one.unit == "m"]] = size
    found: list[Array] = []
    for _ in range(limits.WAYS_TRIED):
        away = np.zeros(system.n)
        away[columns] = reach[columns] * rng.uniform(-1.0, 1.0, len(columns))
        way = close_by(system, move_positions(system.parameters, q, away), columns, np.ones(system.n))
        if open_residual(system, way) > limits.OPEN:
            continue
        J = system.compiled.constraint_jacobian(0.0, way)[:, columns]
        if np.linalg.matrix_rank(J, rtol=limits.DEPENDENT_DIRECTION) < len(columns):
            return []
        if all(_apart(coordinates, size, way, other) > limits.OTHER_WAY for other in found):
            found.append(way)
    return found


@dataclass(frozen=True)
class _Coordinate:
    """A coordinate of a joint that is one number, by the key that gives it."""

    key: str
    unit: str
    rate: int  # its place among the rates
    position: int  # its place among the positions


def _coordinates(scene: Scene, mechanism: Mechanism, columns: IntArray) -> list[_Coordinate]:
    found = []
    for link, rate, at in zip(mechanism.links, mechanism.layout.rate, mechanism.layout.position, strict=True):
        if link.n_rates and link.state is None:
            joint = scene.joint[link.joint_name]
            sizes = {key: np.size(getattr(joint, key)) for key in joint.start_keys[0]}
            keys = [f"{key}[{k}]" if size > 1 else key for key, size in sizes.items() for k in range(size)]
            found += [
                _Coordinate(f"joint.{link.joint_name}.{key}", unit, rate + k, at + k)
                for k, (key, unit) in enumerate(zip(keys, link.joint.units, strict=False))  # a free joint gives none
                if rate + k in columns
            ]
    return found


def _apart(coordinates: Sequence[_Coordinate], size: float, first: Array, second: Array) -> float:
    """Return how far the coordinates of two positions are apart at most, in radians or parts of a size [m]."""
    apart = [first[one.position] - second[one.position] for one in coordinates]
    parts = [x / size if one.unit == "m" else _within_turn(x) for x, one in zip(apart, coordinates, strict=True)]
    return float(np.abs(parts).max())


def _within_turn(x: float) -> float:
    return float((x + np.pi) % (2.0 * np.pi) - np.pi)


def _write_way(coordinates: Sequence[_Coordinate], q: Array) -> str:
    words = []
    for one in coordinates:
        x = q[one.position]
        text = f"{1e3 * x:.4g} mm" if one.unit == "m" else f"{np.degrees(_within_turn(x)):.4g} deg"
        words.append(f"{one.key} = '{text}'")
    return " with ".join(words)
