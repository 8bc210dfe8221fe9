"""Stress that the files of a scene hold beside the largest of each body: components at named elements and nodes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from fmd.accuracy.error_estimates import Quantity
from fmd.accuracy.ply_stress import has_plies, ply_quantities
from fmd.accuracy.quantities import modal_coordinates
from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError
from fmd.recovery.envelope import stress_envelope
from fmd.recovery.plies import StressOfPlies, modal_ply_stress
from fmd.recovery.stress import StressHistory, modal_stress, point_stress, smooth_stress, stress_measure
from fmd.scene import histories
from fmd.scene.outputs import Chart
from fmd.scene.stress_outputs import Envelope, Plies

if TYPE_CHECKING:
    from fmd.accuracy.quantities import Quantities
    from fmd.recovery.motion import Motion
    from fmd.scene.scene import Scene
    from fmd.stages.part import FlexiblePart
    from fmd.stages.pipeline import Pipeline

EXTREMES = {
    "von Mises": "largest von Mises stress",
    "principal 1": "largest principal stress",
    "principal 3": "smallest principal stress",
}
"""What an envelope's measure is called in the error budget, behind its body."""


@dataclass(frozen=True)
class StressPlace:
    """A place of a body whose stress a file holds: the middle of a named element, or a node."""

    part: str  # body, or the piece of one, that has it
    point: Array  # (3,): place in the part's mesh [m]
    modal: Array  # (6, n): stress of each modal coordinate there [Pa]
    at_node: bool  # it is an average at a node, and not of one element

    def of_shapes(self, part: FlexiblePart, shapes: Array) -> Array:
        """Return the stress of shapes (n_nodes, 3, n) at the same place of a part of any shapes, (6, n) [Pa]."""
        at = smooth_stress if self.at_node else point_stress
        return np.asarray(at(part.space, part.material, shapes, self.point[None])[0])

    def over(self, run: Pipeline, motion: Motion) -> Array:
        """Return the stress over a motion of the run, shape (6, n_times) [Pa]."""
        tensors = self.modal @ motion.modal(self.part).T
        if (own := run.contact_deformation(self.part, motion)) is not None:
            tensors = tensors + self.of_shapes(own.part, own.fields.shapes) @ own.fields.sizes.T
        return np.asarray(tensors)


def stress_at_elements(run: Pipeline, names: Sequence[str]) -> dict[str, StressPlace]:
    """Return the middles of named elements, ``"body.element"`` each; of all of them without names."""
    known = {
        f"{body}.{element}": (part, number)
        for body in run.wholes
        for part in run.pieces_of(body)
        if part.has_mesh
        for number, element in enumerate(part.elements)
    }
    chosen = {name: known[name] for name in names or known}
    return {
        name: StressPlace(part.name, part.element_places[k], part.element_stress[k], at_node=False)
        for name, (part, k) in chosen.items()
    }


def stress_at_nodes(run: Pipeline, names: Sequence[str]) -> dict[str, StressPlace]:
    """Return nodes by their bodies and numbers, ``"body.112"`` each.

    Raises
    ------
    InputError
        A node's number is beyond those of its body.
    """
    found = {}
    for name in names:
        body, _, number = name.partition(".")
        part, node = run.wholes[body], int(number)
        if node >= (n_nodes := len(part.space.x)):
            problem = f"{body} has the nodes 0 to {n_nodes - 1}"
            raise InputError(run.scene.file, "output.nodes", name, problem)
        if body in run.division.divided:
            part, node = run.division.divided[body].find_node(node)
        shapes = run.bodies[part.name].shapes
        modal = modal_stress(part.space, part.material, shapes, np.array([node]))[0]
        found[name] = StressPlace(part.name, part.space.x[node], modal, at_node=True)
    return found


class RequestedStress:
    """Stress that the files of a run hold, as quantities of the error budget."""

    def __init__(self, run: Pipeline) -> None:
        self._run = run
        self._places: dict[tuple[str, str], StressPlace] = {}  # by name and component
        for names, components, at_node in _requests(run.scene):
            places = stress_at_nodes(run, names) if at_node else stress_at_elements(run, names)
            self._places |= {(name, each): place for name, place in places.items() for each in components}
        self._bodies = [name for name in _bodies_of(run.scene, Envelope) if name in run.parts]
        self._plied = [
            name for name in _bodies_of(run.scene, Plies) if name in run.parts and has_plies(run.parts[name])
        ]

    def quantities(
        self, run: Pipeline, motion: Motion, frames: IntArray, as_if: Mapping[str, Array] | None = None
    ) -> Quantities:
        """Compute the stress of a motion of the run, or of a variant of it.

        All nodes are searched for the largest and smallest at the output times of numbers ``frames``; ``as_if`` takes
        each body's modal coordinates to those that its stress is made of, (n, n).
        """
        q = modal_coordinates(run, motion, as_if)
        found: Quantities = {each.name: each for each in self.of_places(run, q)}
        for name in self._bodies:
            free = ~run.limitless_of(name)
            part = run.parts[name]
            stress = StressHistory(
                part.surface.nodes[free], part.surface_stress[free], motion.times[frames], q[name][frames]
            )
            extremes = stress_envelope(stress)
            for component in ("principal 1", "principal 3"):
                values, _ = extremes.measure(component)
                worst = values.max() if component == "principal 1" else values.min()
                label = f"{name}, {EXTREMES[component]}"
                found[label] = Quantity(label, "Pa", np.array([worst]), largest=True, kind="stress")
        return found | self.of_plies(run, q, frames)

    def of_places(self, run: Pipeline, q: Mapping[str, Array]) -> Iterator[Quantity]:
        """Yield the stress at places by each body's modal coordinates (n_times, n)."""
        for (name, component), place in self._places.items():
            part = run.parts[place.part]
            modal = place.modal if part is self._run.parts[place.part] else place.of_shapes(part, part.body.shapes)
            values = stress_measure(component)((modal @ q[place.part].T)[None])[0]
            yield Quantity(f"{name}.{component}", "Pa", values, kind="stress" if place.at_node else "spot stress")

    def of_plies(
        self, run: Pipeline, q: Mapping[str, Array], frames: IntArray, stress: StressOfPlies = modal_ply_stress
    ) -> Quantities:
        """Compute the stress of plies by each body's modal coordinates (n_times, n) at some output times."""
        found: Quantities = {}
        for name in self._plied:
            found |= ply_quantities(run.parts[name], q[name][frames], stress)
        return found


def request_key(scene: Scene) -> dict[str, list[str]]:
    """Return what a budget depends on beside the scene's results: the stress that files hold; empty without any."""
    asked = [f"{[*names]} {[*components]} {at_node}" for names, components, at_node in _requests(scene)]
    asked += _bodies_of(scene, Envelope)
    for body in _bodies_of(scene, Plies):
        lamina = getattr(scene.flexible[body], "lamina", {})
        asked.append(f"plies of {body} {[(name, own.strength) for name, own in lamina.items()]}")
    return {"stress in files": asked} if asked else {}


def _bodies_of(scene: Scene, kind: type[Envelope | Plies]) -> list[str]:
    """Return the bodies that outputs of a kind are of."""
    return list(dict.fromkeys(output.body for output in scene.output if isinstance(output, kind)))


def _requests(scene: Scene) -> Iterator[tuple[Sequence[str], Sequence[str], bool]]:
    for output in scene.output:
        if isinstance(output, histories.Quantities):
            if "element_stress" in output.quantities:
                yield output.elements, output.components, False
            if "node_stress" in output.quantities:
                yield output.nodes, output.components, True
        elif isinstance(output, Chart) and output.element is not None:
            yield [output.element], [output.component], False
