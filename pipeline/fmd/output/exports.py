"""Files of a scene for other tools: the mesh, the motion with stress, the reduced body."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fmd.core.data_classes import dataclass
from fmd.output.formats import write_format
from fmd.output.instants import choose_instants
from fmd.output.output_kinds import OutputKind, read_body
from fmd.output.variable_errors import VariableErrors
from fmd.recovery.stress import von_mises
from fmd.scene.outputs import Export
from fmd.stages.pipeline import Pipeline


def write_export(run: Pipeline, output: Export, folder: Path) -> list[str]:
    """Write the files of an export into a folder and return their names."""
    path = folder / output.file
    if output.format is not None:
        return [file.name for file in write_format(run, output.format, output.body, path)]
    assert output.body is not None
    EXPORTS[path.suffix].write(run, output.body, output.frames, path)
    return [output.file]


def _write_mesh(run: Pipeline, body: str, _frames: int, path: Path) -> None:
    from fmd.fem.formats.export import write_mesh

    write_mesh(run.wholes[body].mesh, path)


def _write_body(run: Pipeline, body: str, _frames: int, path: Path) -> None:
    write_format(run, "python", body, path)


def nodal_stress_at(run: Pipeline, body: str, frame: int) -> NDArray[np.float32]:
    """Return the stress at all nodes of one of the scene's bodies at an output time, shape (n_nodes, 6) [Pa]."""
    if body in run.division.divided:
        return run.division.divided[body].nodal_stress_at(run.motion, frame)
    own, q = run.contact_deformation(body, run.motion), run.motion.modal(body)[frame].astype(np.float32)
    return np.asarray(run.parts[body].nodal_stress @ q + (0 if own is None else own.nodal_stress(frame)))


def _write_motion(run: Pipeline, body: str, frames: int, path: Path) -> None:
    """Write displacement from the undeformed body at rest, deformation and stress at all nodes."""
    from fmd.fem.formats.vtkhdf import write_series

    part, chosen = run.wholes[body], choose_instants(run, frames, [body])
    run = run.at_instants
    motion, nodes = run.motion, np.arange(len(part.space.x))
    x, origin = run.node_positions(body)[: len(nodes)], run.bodies[run.frame_of(body)].origin

    def fields() -> Iterator[dict[str, NDArray[np.floating]]]:
        for k in chosen:
            tensor, deformation = nodal_stress_at(run, body, k), run.deform(body, [k], nodes)[0]
            yield {
                "displacement": motion.placed(body, x + deformation, k) + origin - part.space.x,
                "deformation": deformation,
                "stress": tensor,
                "von_mises": von_mises(np.asarray(tensor, dtype=float)),
            }

    errors = VariableErrors(run)
    stated = dict.fromkeys(("displacement", "deformation", "stress"), errors.of_quantity(f"{body}, at its nodes"))
    stated["von_mises"] = errors.of_quantity(f"{body}, largest von Mises stress")
    write_series(part.space, motion.times[chosen], fields(), path, stated)


@dataclass(frozen=True)
class FileFormat:
    """How an export of one suffix is written."""

    write: Callable[[Pipeline, str, int, Path], None]  # writes what a run has of a body, with so many frames, to a path
    reads: tuple[str, ...]  # stages of the body that it holds


EXPORTS: dict[str, FileFormat] = {
    ".msh": FileFormat(_write_mesh, ("mesh",)),
    ".vtu": FileFormat(_write_mesh, ("mesh",)),
    ".vtkhdf": FileFormat(_write_motion, ("mesh", "body", "nodal stress")),
    ".nc": FileFormat(_write_body, ("modes", "body", "surface", "stress", "inertia")),
}


def _read_export(run: Pipeline, output: Export) -> Iterator[tuple[str, str]]:
    """Iterate over the stages of the body that an export holds; the whole mechanism is in the motion anyway."""
    if output.body is not None:
        suffix = Path(output.file).suffix
        yield from read_body(*(EXPORTS[suffix].reads if suffix in EXPORTS else ("modes", "body")))(run, output)


KINDS = {"export": OutputKind(write=write_export, reads=_read_export)}
