"""Pictures, films and charts kept as they were drawn, since drawing takes most of a run with nothing new."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pipeline.core.cache import stage_key
from pipeline.core.files import whole_file
from pipeline.output.pictures import DRAWINGS
from pipeline.stages.pipeline import Pipeline

_PACKAGES = ("numpy", "pyvista", "vtk", "matplotlib", "imageio-ffmpeg")


def picture_key(run: Pipeline, output: Any) -> str:
    """Return the key that an output's files are kept under, from everything that it shows and is drawn by."""
    shown = {"output": output.model_dump(mode="json"), "title": run.scene.title}
    if DRAWINGS[output.type].still:
        sources = ("pipeline/render", "pipeline/output/pictures.py")
        return stage_key("pictures", shown | {"part": run.parts[output.body].key("body")}, sources, _PACKAGES)
    shown |= {"scene": run.inputs, "all modes": run.keep_all}
    return stage_key("pictures", shown, ("pipeline", "meshes"), (*_PACKAGES, "scipy", "scikit-fem", "gmsh"))


def draw(run: Pipeline, output: Any, folder: Path) -> list[str]:
    """Draw an output into a folder, or copy the files of an earlier drawing there; return the names of the files."""
    drawn: list[str] = []

    def make() -> dict[str, bytes]:
        drawn.extend(DRAWINGS[output.type].draw(run, output, folder))
        return {name: (folder / name).read_bytes() for name in drawn}

    files = run.store.read_or_compute("pictures", picture_key(run, output), make)
    if not drawn:
        for name, content in files.items():
            with whole_file(folder / name) as part:
                part.write_bytes(content)
    return list(files)
