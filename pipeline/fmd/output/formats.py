"""Formats of other programs: a flexible body, or the whole mechanism, as files that they read.

`fmd.scene.outputs` has the formats' names and suffixes; this page has what writes each.
"""

from __future__ import annotations

import importlib
from pathlib import Path

from fmd.core.errors import InputError
from fmd.reduction.body_file import save_body
from fmd.scene.outputs import MECHANISM_FORMATS
from fmd.stages.pipeline import Pipeline

# Module and function of each format: ``function(run, body or None, path)`` writes the files and returns their paths.
# A module is loaded when its format is written.
_WRITERS = {
    "fmu": "fmd.output.fmu.write:write_fmu",
    "python": "fmd.output.formats:write_python",
    "sid": "fmd.output.body_formats:write_sid",
    "exudyn": "fmd.output.body_formats:write_exudyn",
    "mbdyn": "fmd.output.body_formats:write_mbdyn",
    "simscape": "fmd.output.body_formats:write_simscape",
    "openfast": "fmd.output.body_formats:write_openfast",
    "full": "fmd.output.body_formats:write_full",
}


def write_format(run: Pipeline, name: str, body: str | None, path: Path) -> list[Path]:
    """Write a scene's body, or its mechanism, in the format of a name; return the files, the first of them ``path``.

    Parameters
    ----------
    run : Pipeline
        The scene's pipeline.
    name : str
        One of `fmd.scene.outputs.EXPORT_FORMATS`.
    body : str, optional
        Flexible body that the file holds; None for formats of the whole mechanism.
    path : Path
        Where the file goes; its folder exists.

    Raises
    ------
    InputError
        The format can't hold what the scene has.
    """
    for own, count in run.scene.pieces.items():
        if name not in MECHANISM_FORMATS and body in (None, own):
            mend = f"format {name} holds a body in one piece; --set body.{own}.pieces=1 exports it"
            raise InputError(run.scene.file, f"body.{own}.pieces", count, mend)
    module, _, function = _WRITERS[name].partition(":")
    files: list[Path] = getattr(importlib.import_module(module), function)(run, body, path)
    return files


def write_python(run: Pipeline, body: str | None, path: Path) -> list[Path]:
    """Write a reduced body as NetCDF, for Python."""
    assert body is not None
    write_body(run, body, path)
    return [path]


def write_body(run: Pipeline, body: str, path: Path) -> None:
    """Write modes, mass, stiffness, inertia integrals and the stress of each mode of a body as NetCDF."""
    part = run.parts[body]
    if run.scene.moves:
        reduced = part.for_any_motion(run.bodies[body])
        stress = part.surface_stress if part.has_stress else None
    else:
        from fmd.stages.spatial_body import spatial_body, surface_stress

        reduced = spatial_body(part, stiffened=False)
        stress = surface_stress(part, reduced)
    surface = part.surface if part.has_stress else None
    save_body(path, reduced, surface, stress, part.modes.frequencies_hz)
