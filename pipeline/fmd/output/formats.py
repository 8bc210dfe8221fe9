"""Export of a flexible body, or of the whole mechanism, in the format of another program.

`fmd.scene.outputs` has the formats' names and suffixes, `fmd.reduction.formats` a file for each format of bodies.
"""

from pathlib import Path

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.files import read_text, require_not_spared, sparing
from fmd.core.units import unit_ratio
from fmd.fem.formats.abaqus import SUFFIXES
from fmd.fem.model import FEModel
from fmd.reduction.craig_bampton import Superelement
from fmd.reduction.formats.body_format import DrawnBody, ExportedBody, LoadCases, body_format
from fmd.reduction.formats.load_cases_file import shape_cases, stiffening_cases
from fmd.reduction.modal_data import ModalData, modal_data
from fmd.reduction.modes import Modes
from fmd.scene.imported_bodies import MatrixPart
from fmd.scene.modes import damping_ratios
from fmd.scene.outputs import MECHANISM_FORMATS
from fmd.scene.source_files import named_files
from fmd.stages.pipeline import Pipeline
from fmd.stages.spatial_body import spatial_body, superelement, surface_stress


class PipelineBody(ExportedBody):
    """A flexible body of a pipeline, computed as far as a format needs it."""

    def __init__(self, run: Pipeline, name: str) -> None:
        moves = run.scene.moves
        self._run, self._part, self.name = run, run.parts[name], name
        self.gravity = np.array(run.scene.simulation.gravity if moves else (0.0, 0.0, 0.0))
        self.stiffened = not moves or run.scene.simulation.stiffening != "off"

    def modal_data(self, stiffened: bool) -> ModalData:
        """Return shapes and inertia integrals in space, without the elements' stiffening unless it is wanted."""
        body, damping = spatial_body(self._part, stiffened), self._part.shape.modes.damping
        return modal_data(body, np.array(damping_ratios(damping, body.omega.tolist())))

    def in_space(self) -> DrawnBody:
        """Return the body reduced for any motion in space, with its surface and stress."""
        body = spatial_body(self._part, stiffened=False)
        if not self._part.has_stress:
            return DrawnBody(body, None, None)
        return DrawnBody(body, self._part.surface, surface_stress(self._part, body))

    def in_scene(self) -> DrawnBody:
        """Return the body as its scene's mechanism has it; without motion, in space."""
        if not self._run.scene.moves:
            return self.in_space()
        body = self._part.for_any_motion(self._run.bodies[self.name])
        if not self._part.has_stress:
            return DrawnBody(body, None, None)
        return DrawnBody(body, self._part.surface, self._part.surface_stress)

    def superelement(self) -> Superelement:
        """Return matrices for the motions of the interface and the fixed-interface modes."""
        return superelement(self._part)

    def full_model(self) -> tuple[FEModel, Modes]:
        """Return the full matrices and modes; a body reduced already has none, and T isn't written."""
        if self._part.is_reduced:
            raise self.fault("body", "is a reduced body, and has no full matrices")
        if self._part.has_mesh and any(own.midsurface is not None for own in self._part.mesh.members):
            raise self.fault(
                "shape", "has shells or beams, whose full matrices aren't written; reduced bodies are, e.g. --to sid"
            )
        if self._part.fe.T is not None:
            raise self.fault("link", "is in no file of full matrices; reduced bodies have it, e.g. --to sid or nastran")
        return self._part.fe, self._part.modes

    def load_cases(self) -> LoadCases:
        """Return the loads for the deck that gives the nodes of the body's matrices, in its units."""
        part = self._part
        if not isinstance(part.shape, MatrixPart):
            raise self.fault("shape", "has its own stress; load cases are for bodies that are given by their matrices")
        given, deck = part.shape.matrices, part.source.paths["nodes"] if part.source else None
        if deck is None or deck.suffix.lower() not in SUFFIXES:
            raise self.fault("matrices.nodes", "load cases are written for a deck of Abaqus or CalculiX (.inp)")
        fe, model = part.fe, part.model
        shapes = part.body.shapes if self._run.scene.moves else part.modes.shapes
        length = unit_ratio(given.unit, "m")
        newton, matrices = unit_ratio(given.stiffness_unit, "N/m") * length, part.given_model
        cases = stiffening_cases(fe, model.solver, model.markers), shape_cases(fe, shapes)
        stiffening, of_shapes = (
            {name: matrices.loads_of_nodes(f, length) / newton for name, f in own.items()} for own in cases
        )
        return LoadCases(read_text(deck), matrices.labels, matrices.rigid_by_node(), stiffening, of_shapes)

    def frequencies_hz(self) -> Array:
        """Return the natural frequencies of the body's modes [Hz]."""
        return self._part.modes.frequencies_hz

    def fault(self, key: str, problem: str) -> InputError:
        """Return the error of a key of the body."""
        return InputError(self._part.file, f"body.{self.name}.{key}", None, problem)


def left_out(run: Pipeline, name: str, body: str | None) -> str | None:
    """Return what a format has no place for in a body, though it never is left out here; ``None`` without."""
    if body is None or body not in run.parts or body_format(name).second_order:
        return None
    if run.parts[body].is_reduced or run.parts[body].fe.arms is None:
        return None
    return (
        f"{body}: as links, lumped masses and sections of beams turn, they are drawn in by ½ θ × (θ × r), for which "
        f"format {name} has no place: discs on a turning shaft are wrong there, take sid or fmu"
    )


def write_format(run: Pipeline, name: str, body: str | None, path: Path) -> list[Path]:
    """Write a scene's body, or its mechanism, in the format of a name; return the files, the first of them ``path``.

    The name is one of `fmd.scene.outputs.EXPORT_FORMATS`; formats of the whole mechanism take no body. The file's
    folder exists.

    Raises
    ------
    InputError
        The format can't hold what the scene has, or a file would be written over one that the scene reads.
    """
    sources = [own for part in run.wholes.values() if part.source is not None for own in part.source.paths.values()]
    with sparing([*sources, *named_files(run.scene)]):
        require_not_spared(path)
        return _write(run, name, body, path)


def _write(run: Pipeline, name: str, body: str | None, path: Path) -> list[Path]:
    if name in MECHANISM_FORMATS:
        from fmd.output.fmu.write import write_fmu

        return write_fmu(run, body, path)
    assert body is not None
    if body in run.scene.pieces:
        mend = f"format {name} holds a body in one piece; --set body.{body}.pieces=1 exports it"
        raise InputError(run.scene.file, f"body.{body}.pieces", run.scene.pieces[body], mend)
    write = body_format(name).write
    assert write is not None
    files = write(PipelineBody(run, body), path)
    return [path] if files is None else files
