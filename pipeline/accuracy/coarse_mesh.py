"""A run beside the same on a coarser mesh: what the error falls by from one to the other, and what is alike in both."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipeline.accuracy.error_estimates import refinement_gain, retuned
from pipeline.accuracy.matching import counterparts
from pipeline.accuracy.quantities import modes_like
from pipeline.core.arrays import Array, IntArray
from pipeline.core.cache import Cache
from pipeline.core.errors import AccuracyError
from pipeline.scene.variants import COARSENING_FACTORS, change_modes, coarsen_meshes, compare_element_sizes
from pipeline.stages.pipeline import Pipeline

if TYPE_CHECKING:
    from pipeline.scene.scene import Scene

_SAME = 1e-9
_ALIKE = 0.5  # modal assurance criterion above which a shape of the coarse mesh is the run's own
_MORE = 1.5  # modes of the coarse mesh to find the run's among


@dataclass(frozen=True)
class Pair:
    """A run and the same on a coarser mesh.

    Attributes
    ----------
    run, coarse : Pipeline
        The coarse one's modes are those that are most like the run's, in its order.
    gains : dict of str to float
        What the error falls by from the coarse mesh to the run's, less one, by kind of quantity.
    """

    run: Pipeline
    coarse: Pipeline
    gains: dict[str, float]

    def excess_of_modes(self, name: str) -> Array:
        """What the squares of a part's frequencies are too high by, relative, shape (n,)."""
        theirs, own = self.coarse.parts[name].modes.omega, self.run.parts[name].modes.omega
        return np.asarray(((theirs / own) ** 2 - 1) / self.gains["displacement"])

    def excess_of_shapes(self, name: str) -> tuple[Array, NDArray[np.bool_]]:
        """The same of its reduced body, and for which shapes the coarse mesh has one that is alike, (n,) each."""
        numbers, alike = self._counterparts(name)
        theirs, own = self.coarse.bodies[name].omega[numbers], self.run.bodies[name].omega
        return np.asarray(((theirs / own) ** 2 - 1) / self.gains["displacement"]), alike

    def at_the_same_frequencies(self) -> tuple[Pipeline, dict[str, Array]]:
        """The coarse one, ringing at the run's frequencies; from each body's coordinates to those of its stress."""
        found = {}
        for name, body in self.run.bodies.items():
            other, (numbers, alike) = self.coarse.bodies[name], self._counterparts(name)
            omega = other.omega.copy()
            omega[numbers[alike]] = body.omega[alike]
            found[name] = retuned(other, omega)
        ringing = self.coarse.with_bodies({name: body for name, (body, _) in found.items()})
        return ringing, {name: scale for name, (_, scale) in found.items()}

    def _counterparts(self, name: str) -> tuple[IntArray, NDArray[np.bool_]]:
        """Numbers of the shapes on the coarse mesh that are most like a body's, and which of them are alike."""
        own, other, m = self.run.bodies[name], self.coarse.bodies[name], self.coarse.parts[name].fe.m
        numbers, alike = counterparts(own.x, own.shapes, other.x, m, other.shapes, other.omega)
        return numbers, alike > _ALIKE


def coarse_pair(run: Pipeline) -> Pair | str:
    """A run and the same on a coarser mesh; or why there is none. Of few curved elements some may be inverted."""
    why = "not estimated: there is no coarser mesh"
    for times in COARSENING_FACTORS:
        scene = coarsen_meshes(run.scene, times)
        if scene is None:
            break
        try:
            return _pair(run, scene)
        except AccuracyError as fault:
            why = f"not estimated: on a coarser mesh, {fault}"
    return why


def _pair(run: Pipeline, scene: Scene) -> Pair:
    more = change_modes(scene, lambda body: {"count": int(_MORE * body.modes.count) + 1})
    coarse = Pipeline(more, Cache(None))
    coarse.spin = run.spin
    for name, part in coarse.parts.items():
        part.modes = modes_like(run.parts[name], part)
    parts = [(part, coarse.parts[name]) for name, part in run.parts.items()]
    ratio = min(compare_element_sizes(own.shape, len(own.mesh.cells), len(other.mesh.cells)) for own, other in parts)
    order, edges = min(own.order for own, _ in parts), min(own.mesh.order for own, _ in parts)
    gains = {kind: refinement_gain(ratio, order, edges, kind) for kind in ("displacement", "stress", "geometry")}
    # Where the volume changes with the mesh so does the shape, and nothing converges faster than that does.
    exact = all(abs(coarse.bodies[name].gram.mass / body.gram.mass - 1) < _SAME for name, body in run.bodies.items())
    return Pair(run, coarse, gains if exact else {kind: min(gain, gains["geometry"]) for kind, gain in gains.items()})
