"""A scene's files for other tools: mesh, motion with stress, reduced body."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pipeline.scene.outputs import Export
    from pipeline.stages.pipeline import Pipeline


def write_export(run: Pipeline, output: Export, folder: Path) -> list[str]:
    """Write one file of an export."""
    path, part = folder / output.file, run.parts[output.body]
    match path.suffix:
        case ".vtkhdf":
            _write_motion(run, output, path)
        case ".nc":
            from pipeline.reduction.body_file import save_body

            body = part.for_any_motion(run.bodies[output.body])
            surface, stress = (part.surface, part.surface_stress) if part.has_mesh else (None, None)
            save_body(path, body, surface, stress, part.modes.frequencies_hz)
        case _:
            from pipeline.fem.formats.export import write_mesh

            write_mesh(part.mesh, path)
    return [output.file]


def _write_motion(run: Pipeline, output: Export, path: Path) -> None:
    """Displacement from the undeformed body at rest, and stress, at all nodes."""
    from pipeline.fem.formats.vtkhdf import write_series
    from pipeline.recovery.stress import spread, von_mises

    part, motion, shapes = run.parts[output.body], run.first_motion, run.bodies[output.body].shapes
    chosen = spread(len(motion.times), output.frames)
    x, q, stress = run.bodies[output.body].x, motion.modal(output.body), part.nodal_stress
    origin = part.space.x[0] - x[0]

    def fields() -> Iterator[dict[str, NDArray[np.floating]]]:
        for k in chosen:
            tensor, deformation = stress @ q[k].astype(np.float32), shapes @ q[k]
            yield {
                "displacement": motion.placed(output.body, x + deformation, k) + origin - part.space.x,
                "deformation": deformation,
                "stress": tensor,
                "von_mises": von_mises(tensor),
            }

    write_series(part.space, motion.times[chosen], fields(), path)
