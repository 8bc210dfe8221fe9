"""Export of a flexible body, or of the whole mechanism, in the format of another program.

`fmd.scene.outputs` has the formats' names and suffixes, `fmd.reduction.formats` a file for each format of bodies.
"""

from __future__ import annotations

from pathlib import Path

from fmd.core.errors import InputError
from fmd.reduction.formats.body_format import body_format
from fmd.scene.outputs import MECHANISM_FORMATS
from fmd.stages.pipeline import Pipeline


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
    if name in MECHANISM_FORMATS:
        from fmd.output.fmu.write import write_fmu

        return write_fmu(run, body, path)
    assert body is not None
    if body in run.scene.pieces:
        mend = f"format {name} holds a body in one piece; --set body.{body}.pieces=1 exports it"
        raise InputError(run.scene.file, f"body.{body}.pieces", run.scene.pieces[body], mend)
    from fmd.output.exported_body import PipelineBody

    return body_format(name).write(PipelineBody(run, body), path)
