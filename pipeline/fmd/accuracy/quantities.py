"""Quantities that a run reports, of its own motion and of variants of its scene, and pairs of shapes of two meshes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.accuracy.error_estimates import OrientationQuantity, Quantity
from fmd.core.arrays import Array, IntArray
from fmd.core.limits.errors import SAME_FREQUENCY_OF_MESHES
from fmd.core.limits.round_off import EXACT, SUMMED
from fmd.core.limits.stepping import STILL_GROUP
from fmd.core.rotations import quaternion_of_matrix
from fmd.recovery.stress import StressHistory, von_mises
from fmd.stages.division import part_of

if TYPE_CHECKING:
    from fmd.recovery.motion import Motion
    from fmd.reduction.modes import Modes
    from fmd.stages.part import FlexiblePart
    from fmd.stages.pipeline import Pipeline

Quantities = dict[str, Quantity]


def mesh_quantities(run: Pipeline, like: Pipeline | None = None) -> Quantities:
    """Frequencies and masses of the flexible bodies; those of the modes that look ``like`` another run's, if given."""
    found = []
    for name, part in run.parts.items():
        modes = part.modes if like is None else match_modes(like.parts[name], part)
        for k, frequency in enumerate(modes.frequencies_hz):
            found.append(Quantity(f"{name}, frequency {k + 1}", "Hz", np.array([frequency])))
        found.append(Quantity(f"{name}, mass", "kg", np.array([run.bodies[name].integrals.mass]), kind="geometry"))
    return _by_name(found)


def match_modes(part: FlexiblePart, other: FlexiblePart) -> Modes:
    """Return the modes of another mesh's part that are most like a part's, in its order."""
    modes = other.modes
    numbers, _ = find_counterparts(part.fe.x, part.modes.shapes, other.fe.x, other.fe.m, modes.shapes, modes.omega)
    places = tuple(modes.numbers[k] for k in numbers)
    return replace(modes, omega=modes.omega[numbers], shapes=modes.shapes[:, :, numbers], numbers=places)


def motion_quantities(motion: Motion, fine: Motion) -> Quantities:
    """Compute joints, tip and energies over time; a joint whose motion is given has no result.

    Of joints with several coordinates it is how the body that they carry lies in space. ``fine`` has many more times
    than the output times, among which the tip's largest deflection is looked for.
    """
    kinetic, potential = (_above_round_off(energy, motion.energies) for energy in motion.energies)
    found = [Quantity("kinetic energy", "J", kinetic), Quantity("potential energy", "J", potential)]
    for name, number in motion.joints.items():
        if motion.mechanism.links[number].motion is not None:
            continue
        unit = motion.joint_unit(name)
        what = "angle" if unit == "rad" else "position"
        position, rate = motion.joint_position(name), motion.joint_rate(name)
        if np.abs(position).max() <= STILL_GROUP:  # a coupler or a loop holds it at 0: the rest is round-off
            position, rate = np.zeros_like(position), np.zeros_like(rate)
        found.append(Quantity(f"{name}, {what}", unit, position))
        found.append(Quantity(f"{name}, rate", f"{unit}/s", rate))
    found += _lies_in_space(motion)
    if len(motion.tip_link.omega):
        found.append(Quantity("tip, deflection", "m", motion.tip_deflection))
        found.append(Quantity("tip, largest deflection", "m", fine.tip_size, largest=True))
    return _by_name(sorted(found, key=lambda quantity: quantity.name))


def _lies_in_space(motion: Motion) -> list[Quantity]:
    found: list[Quantity] = []
    for number, link in enumerate(motion.mechanism.links):
        if link.n_rates < 2:
            continue
        frame = motion.kinematics.frames[number]
        turned = OrientationQuantity(f"{link.joint_name}, orientation", "rad", quaternion_of_matrix(frame.rotation))
        if turned.scale > SUMMED:
            found.append(turned)
        place = Quantity(f"{link.joint_name}, position", "m", frame.origin)
        if link.joint.slides and place.scale > SUMMED * motion.mechanism.reach:
            found.append(place)
    return found


def _above_round_off(energy: Array, energies: tuple[Array, Array]) -> Array:
    """Return an energy, or zeros if it is round-off beside the larger one: of a body at rest, or without weight."""
    largest = max(float(np.abs(each).max()) for each in energies)
    return energy if np.abs(energy).max() > EXACT * largest else np.zeros_like(energy)


def modal_coordinates(run: Pipeline, motion: Motion, as_if: Mapping[str, Array] | None = None) -> dict[str, Array]:
    """Return each body's modal coordinates over a motion, (n_times, n), or what ``as_if`` (n, n) leads to from them."""
    q = {name: motion.modal(name) for name in run.parts}
    return q if as_if is None else {name: values @ as_if[name].T for name, values in q.items()}


def stress_quantities(
    run: Pipeline,
    motion: Motion,
    frames: IntArray,
    nodes: dict[str, IntArray] | None = None,
    places: dict[str, Array] | None = None,
    as_if: dict[str, Array] | None = None,
) -> Quantities:
    """Von Mises stress: the largest on each body at some output times, and in each named element.

    ``frames`` (n_frames,) are numbers of output times, ``nodes`` the places among each body's surface nodes to look at,
    all by default. ``places`` are the middles of named elements (n_elements, 3) [m] if they aren't in this run's mesh,
    and ``as_if`` (n, n) leads from modal coordinates to those that the body's stress is made of.
    """
    found, q = [], modal_coordinates(run, motion, as_if)
    for name, part in run.parts.items():
        if not part.has_stress:
            continue
        chosen = slice(None) if nodes is None else nodes[name]
        nodes_of, limitless = part.surface.nodes[chosen], run.limitless_of(name)[chosen]
        history = StressHistory(nodes_of, part.surface_stress[chosen], motion.times, q[name], limitless)
        worst = history.limited_von_mises(frames).max(axis=1)
        found.append(Quantity(f"{name}, largest von Mises stress", "Pa", worst, largest=True, kind="stress"))
    return _by_name([*found, *element_stresses(run, q, places)])


def element_stresses(
    run: Pipeline, q: Mapping[str, Array], places: dict[str, Array] | None = None
) -> Iterator[Quantity]:
    """Yield the von Mises stress in the middle of each named element by modal coordinates, over time and its largest.

    ``places`` are as of `stress_quantities`.
    """
    for name, part in run.parts.items():
        if not (part.has_stress and part.elements):
            continue
        modal = part.element_stress if places is None else part.stress_at(places[name])
        for element, stress in zip(part.elements, modal, strict=True):
            values = von_mises((stress @ q[name].T)[None])[0]
            label = f"{name}.{element}, von Mises stress"
            yield Quantity(label, "Pa", values, kind="spot stress")
            yield Quantity(f"{label}, largest", "Pa", values, largest=True, kind="spot stress")


def name_of_whole(name: str) -> str:
    """Return the name of a quantity under that of the part, where its body is a piece of one."""
    body = name.replace(".", ",").partition(",")[0]
    return (part_of(body) or body) + name.removeprefix(body)


def _by_name(found: list[Quantity]) -> Quantities:
    return {quantity.name: quantity for quantity in found}


def find_counterparts(
    x: Array, shapes: Array, other_x: Array, other_m: Any, other_shapes: Array, other_omega: Array
) -> tuple[IntArray, Array]:
    """Return the most similar shapes of the other mesh, all different, and their likeness, 0 … 1, (n,) each.

    Likeness is the modal assurance criterion. The other's shapes (n_nodes', 3, n') may be fewer, and are
    mass-normalised; ``other_m`` is its scalar mass matrix. Shapes of one frequency may be turned into each other: the
    likeness to any of them counts. A shape without a counterpart has likeness 0.
    """
    from scipy.optimize import linear_sum_assignment

    likeness = likeness_of(x, shapes, other_x, other_m, other_shapes)
    rows, columns = linear_sum_assignment(likeness, maximize=True)
    numbers, alike = np.zeros(len(likeness), dtype=np.int64), np.zeros(len(likeness))
    numbers[rows] = columns
    same = np.abs(other_omega / other_omega[columns, None] - 1) < SAME_FREQUENCY_OF_MESHES
    alike[rows] = (likeness[rows] * same).sum(axis=1)
    return numbers, alike


def likeness_of(x: Array, shapes: Array, other_x: Array, other_m: Any, other_shapes: Array) -> Array:
    """Return the modal assurance criterion of each shape (n_nodes, 3, n) with each of the other mesh's, (n, n').

    Shapes are sampled at the nearest node x to each of the other's.
    """
    from scipy.spatial import cKDTree

    seen = shapes[cKDTree(x).query(other_x)[1]]
    mseen = (other_m @ seen.reshape(len(seen), -1)).reshape(seen.shape)
    likeness = np.tensordot(mseen, other_shapes, ((0, 1), (0, 1))) ** 2
    return np.asarray(likeness / np.einsum("iak,iak->k", seen, mseen)[:, None])
