"""Files of a scene for other tools: the mesh, the motion with stress, the reduced body."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.recovery.stress import choose_frames, von_mises
from pipeline.reduction.body_file import save_body
from pipeline.scene.outputs import Export
from pipeline.stages.pipeline import Pipeline


def write_export(run: Pipeline, output: Export, folder: Path) -> list[str]:
    """Write the file of an export into a folder and return its name."""
    path = folder / output.file
    EXPORTS[path.suffix].write(run, output, path)
    return [output.file]


def _write_mesh(run: Pipeline, output: Export, path: Path) -> None:
    from pipeline.fem.formats.export import write_mesh

    write_mesh(run.wholes[output.body].mesh, path)


def _write_body(run: Pipeline, output: Export, path: Path) -> None:
    if len(run.pieces_of(output.body)) > 1:
        problem = f"'{output.body}' is in pieces; a reduced body is in one, so take pieces = 1 for this file"
        raise InputError(run.scene.file, "output.file", output.file, problem)
    part = run.parts[output.body]
    body = part.for_any_motion(run.bodies[output.body])
    surface, stress = (part.surface, part.surface_stress) if part.has_mesh else (None, None)
    save_body(path, body, surface, stress, part.modes.frequencies_hz)


def _write_motion(run: Pipeline, output: Export, path: Path) -> None:
    """Write displacement from the undeformed body at rest, deformation and stress at all nodes."""
    from pipeline.fem.formats.vtkhdf import write_series

    part, motion = run.wholes[output.body], run.motion
    chosen, first = choose_frames(len(motion.times), output.frames), run.frame_of(output.body)
    x, origin, nodes = run.node_positions(output.body), run.bodies[first].origin, np.arange(len(part.space.x))

    def fields() -> Iterator[dict[str, NDArray[np.floating]]]:
        for k in chosen:
            tensor, deformation = run.nodal_stress_at(output.body, k), run.deform(output.body, [k], nodes)[0]
            yield {
                "displacement": motion.placed(first, x + deformation, k) + origin - part.space.x,
                "deformation": deformation,
                "stress": tensor,
                "von_mises": von_mises(np.asarray(tensor, dtype=float)),
            }

    write_series(part.space, motion.times[chosen], fields(), path)


@dataclass(frozen=True)
class FileFormat:
    """How an export of one suffix is written.

    Attributes
    ----------
    write : callable
        Writes an export of a run to a path.
    reads : tuple of str
        Stages of the body that it holds.
    """

    write: Callable[[Pipeline, Export, Path], None]
    reads: tuple[str, ...]


EXPORTS: dict[str, FileFormat] = {
    ".msh": FileFormat(_write_mesh, ("mesh",)),
    ".vtu": FileFormat(_write_mesh, ("mesh",)),
    ".vtkhdf": FileFormat(_write_motion, ("mesh", "body", "nodal stress")),
    ".nc": FileFormat(_write_body, ("modes", "body", "surface", "stress")),
}
