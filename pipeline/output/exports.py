"""Files of a scene for other tools: the mesh, the motion with stress, the reduced body."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.output.histories import write_extremes, write_history
from pipeline.output.stress_fields import write_envelope, write_fatigue
from pipeline.recovery.stress import choose_frames, von_mises
from pipeline.reduction.body_file import save_body
from pipeline.scene.outputs import Export
from pipeline.stages.pipeline import Pipeline


def write_file(run: Pipeline, output: Any, folder: Path) -> list[str]:
    """Write the file of an output that isn't drawn into a folder and return its name."""
    return FILES[output.type](run, output, folder)


def write_export(run: Pipeline, output: Export, folder: Path) -> list[str]:
    """Write the file of an export into a folder and return its name."""
    path = folder / output.file
    EXPORTS[path.suffix].write(run, output, path)
    return [output.file]


def _write_mesh(run: Pipeline, output: Export, path: Path) -> None:
    from pipeline.fem.formats.export import write_mesh

    write_mesh(run.parts[output.body].mesh, path)


def _write_body(run: Pipeline, output: Export, path: Path) -> None:
    part = run.parts[output.body]
    body = part.for_any_motion(run.bodies[output.body])
    surface, stress = (part.surface, part.surface_stress) if part.has_mesh else (None, None)
    save_body(path, body, surface, stress, part.modes.frequencies_hz)


def _write_motion(run: Pipeline, output: Export, path: Path) -> None:
    """Write displacement from the undeformed body at rest, deformation and stress at all nodes."""
    from pipeline.fem.formats.vtkhdf import write_series

    part, motion, body = run.parts[output.body], run.motion, run.bodies[output.body]
    chosen = choose_frames(len(motion.times), output.frames)
    q, stress = motion.modal(output.body), part.nodal_stress

    def fields() -> Iterator[dict[str, NDArray[np.floating]]]:
        for k in chosen:
            tensor, deformation = stress @ q[k].astype(np.float32), body.shapes @ q[k]
            yield {
                "displacement": motion.placed(output.body, body.x + deformation, k) + body.origin - part.space.x,
                "deformation": deformation,
                "stress": tensor,
                "von_mises": von_mises(tensor),
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

FILES: dict[str, Callable[[Pipeline, Any, Path], list[str]]] = {
    "export": write_export,
    "history": write_history,
    "table": write_extremes,
    "envelope": write_envelope,
    "fatigue": write_fatigue,
}
"""Writers of outputs that aren't drawn, by their types."""
