"""A run and its scene on a coarser mesh: the gain in accuracy from one to the other, and the shapes that match."""

import numpy as np
from numpy.typing import NDArray

from fmd.accuracy.changed_bodies import retune_body, soften_body
from fmd.accuracy.error_estimates import refinement_gain
from fmd.accuracy.quantities import find_counterparts, likeness_of, match_modes
from fmd.accuracy.time_limit import FAULTS
from fmd.core.arrays import Array, IntArray
from fmd.core.cache import Cache
from fmd.core.data_classes import dataclass
from fmd.core.limits.errors import ALIKE, ALIKE_MODES, MIXED_MODE, MORE_COARSE_MODES
from fmd.core.limits.round_off import SOLVED
from fmd.reduction.body import FlexibleBody
from fmd.scene.any_body import Flexible
from fmd.scene.scene import Scene
from fmd.scene.variants import (
    COARSENING_FACTORS,
    change_modes,
    coarsen_meshes,
    compare_element_sizes,
    divide_few_elements,
    halve_elements,
)
from fmd.stages.part import FlexiblePart
from fmd.stages.pipeline import Pipeline

KINDS = ("displacement", "stress", "spot stress", "geometry")  # of quantities, by their convergence

NO_COARSER_MESH = "not estimated: the mesh can't be coarser or halved; of a file a run with a second, coarser one tells"
"""Why nothing is compared with a coarser mesh where the scene's can't be coarser."""


@dataclass(frozen=True)
class Pair:
    """A run and the same scene on a coarser mesh, or on a finer one where the file's can't be coarser."""

    run: Pipeline  # the run itself
    coarse: Pipeline  # the scene on the coarser mesh; its modes are those most like the run's, in its order
    # Factor by which the error falls from the coarse mesh to the run's, less one, by kind of quantity; below 0 of a
    # finer mesh.
    gains: dict[str, float]

    @property
    def is_coarser(self) -> bool:
        """True if the other mesh is the coarser one."""
        return self.gains["displacement"] > 0.0

    def divides(self, name: str) -> bool:
        """Return true if a body's meshes differ."""
        return self.coarse.parts[name].mesh.n_cells != self.run.parts[name].mesh.n_cells

    def is_finer_each_way(self, name: str) -> bool:
        """Return true if the other mesh of a body divides it more in all directions: of tetrahedra."""
        own, other = self.run.parts[name].mesh, self.coarse.parts[name].mesh
        return own.cell_type.startswith("tetra") and other.n_cells > own.n_cells

    def excess_of_modes(self, name: str) -> tuple[Array, NDArray[np.bool_]]:
        """Return the relative excess of the squares of a part's frequencies, and which modes have a match, (n,) each.

        Few elements have no such shape as a high mode is, and what is least unlike it may have any frequency. Modes of
        nearly the same frequency are turned into each other where that of one is off: of all that a mode is mixed from,
        the farthest counts.
        """
        own, other, m = self.run.parts[name], self.coarse.parts[name], self.coarse.parts[name].fe.m
        likeness = likeness_of(own.fe.x, own.modes.shapes, other.fe.x, m, other.modes.shapes)
        mixed = likeness > MIXED_MODE
        excess = np.where(mixed, (other.modes.omega / own.modes.omega[:, None]) ** 2 - 1, 0.0)
        farthest = np.take_along_axis(excess, np.abs(excess).argmax(axis=1)[:, None], axis=1)[:, 0]
        return farthest / self.gains["displacement"], (likeness * mixed).sum(axis=1) > ALIKE_MODES

    def excess_of_shapes(self, name: str) -> tuple[Array, NDArray[np.bool_]]:
        """Return the relative excess of a body's squared frequencies, and which shapes have a match, (n,) each."""
        numbers, alike = self.counterparts(name)
        theirs, own = self.coarse.bodies[name].omega[numbers], self.run.bodies[name].omega
        return np.asarray(((theirs / own) ** 2 - 1) / self.gains["displacement"]), alike

    def at_the_same_frequencies(self) -> tuple[Pipeline, dict[str, Array]]:
        """Return the coarse run at the run's frequencies, and each body's factors from coordinates to stress."""
        retuned_bodies = {}
        for name, body in self.run.bodies.items():
            other, (numbers, alike) = self.coarse.bodies[name], self.counterparts(name)
            omega = other.omega.copy()
            omega[numbers[alike]] = body.omega[alike]
            retuned_bodies[name] = retune_body(other, omega)
        ringing = self.coarse.with_bodies({name: body for name, (body, _) in retuned_bodies.items()})
        return ringing, {name: scale for name, (_, scale) in retuned_bodies.items()}

    def soften(self, name: str) -> tuple[FlexibleBody, Array]:
        """Return a body of the run at the other mesh's frequencies, and its factors from coordinates to stress."""
        numbers, alike = self.counterparts(name)
        body = self.run.bodies[name]
        lost = 1 - (self.coarse.bodies[name].omega[numbers] / body.omega) ** 2
        return soften_body(body, np.diag(np.where(alike, lost, 0.0)))

    def counterparts(self, name: str) -> tuple[IntArray, NDArray[np.bool_]]:
        """Return the numbers of the shapes on the coarse mesh that are most like a body's, and which of them match."""
        own, other, m = self.run.bodies[name], self.coarse.bodies[name], self.coarse.parts[name].fe.m
        numbers, alike = find_counterparts(own.x, own.shapes, other.x, m, other.shapes, other.omega)
        return numbers, alike > ALIKE


def make_coarse_pair(run: Pipeline) -> Pair | str:
    """Return a run and its scene on a coarser mesh, or on a finer one of a file's; or the reason why there is none.

    Few curved elements may be inverted: then a mesh that is less coarse is tried. Where the faces' own size, not that
    which is asked for, decides how many elements there are, all meshes are alike and tell nothing.
    """
    from fmd.fem.joined import JoinedMesh

    why = NO_COARSER_MESH
    joined = any(isinstance(part.mesh, JoinedMesh) for part in run.parts.values())  # shells alone are divided
    halved = None if joined else halve_elements(run.scene)
    for scene in filter(None, [*(coarsen_meshes(run.scene, times) for times in COARSENING_FACTORS), halved]):
        try:
            pair = _pair(run, scene)
        except FAULTS as fault:  # the latter where it has fewer modes than required
            why = f"not estimated: on another mesh, {fault}"
        else:
            alike = "not estimated: of larger elements the mesh has as many, since its faces decide their size"
            return pair if pair.is_coarser or scene is halved else alike
    return why


def make_pair_across(run: Pipeline) -> Pair | None:
    """Return a run and its scene with more elements where it has few from side to side; ``None`` if it has enough.

    A coarser mesh shows nothing there, and stress that is recovered from these elements lacks what they lack: the
    warping of a section in torsion, for one. The gains are negative, since the other mesh is the finer one.
    """
    scene = divide_few_elements(run.scene)
    if scene is None:
        return None
    order = min(part.order for part in run.parts.values())
    gains = {kind: -1.0 / (1.0 + 1.0 / refinement_gain(2.0, order, order, kind)) for kind in KINDS}
    return Pair(run, _matching_run(run, scene), gains)


def _matching_run(run: Pipeline, scene: Scene) -> Pipeline:
    """Return the run of a scene on another mesh, whose modes are those most like a run's, in its order.

    They are looked for among more. Of fixed-interface modes and static responses it is their space that counts: more
    modes turn all its shapes, and some of these span another one, which is stiffer.
    """
    beyond = max(part.modes.n_completing for part in run.parts.values())

    def count(body: Flexible) -> int:
        spanned = body.modes.boundary == "interface" or getattr(body, "pieces", 1) != 1
        return body.modes.count + beyond if spanned else int(MORE_COARSE_MODES * body.modes.count) + 1 + beyond

    more = change_modes(scene, lambda body: {"count": count(body)})
    base, parts = Pipeline(more, Cache(None)), {}
    for name, own in run.parts.items():
        other = base.parts[name]
        matched = match_modes(own, other)
        parts[name] = FlexiblePart(base.divided_scene, name, base.store, other, matched, other.piece)
    division, loads = base.division.with_parts(parts), run.stiffening_loads
    matching = Pipeline(more, base.store.cache, division=division, stiffening_loads=loads)
    matching.whole_energy = run.whole_energy
    return matching


def _pair(run: Pipeline, scene: Scene) -> Pair:
    coarse = _matching_run(run, scene)
    pairs = [(own, coarse.parts[name]) for name, own in run.parts.items()]
    ratio = min(compare_element_sizes(own.shape, own.mesh.n_cells, other.mesh.n_cells) for own, other in pairs)
    order, edges = min(own.order for own in run.parts.values()), min(own.mesh.order for own in run.parts.values())
    gains = {kind: refinement_gain(ratio, order, edges, kind) for kind in KINDS}
    # Where the volume changes with the mesh so does the shape, and nothing converges faster than that does.
    exact = all(
        abs(coarse.bodies[name].integrals.mass / body.integrals.mass - 1) < SOLVED for name, body in run.bodies.items()
    )
    return Pair(
        run, coarse, gains if exact else {kind: min(gain, gains["geometry"], key=abs) for kind, gain in gains.items()}
    )
