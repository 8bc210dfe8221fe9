"""Pictures, films and charts kept as they were drawn: of a run with nothing new, drawing them took most of the time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.core.cache import stage_key
from pipeline.core.files import whole_file
from pipeline.output.pictures import DRAWINGS

if TYPE_CHECKING:
    from pipeline.stages.pipeline import Pipeline

_STILL = ("mesh", "modes", "mode sheet")  # they show a part, and nothing of its motion
_PACKAGES = ("numpy", "pyvista", "vtk", "matplotlib", "imageio-ffmpeg")


def picture_key(run: Pipeline, output: Any) -> str:
    """Key that an output's files are kept under: what it shows, how, and all that draws it."""
    shown = {"output": output.model_dump(mode="json"), "title": run.scene.title}
    if output.type in _STILL:
        part = run.parts[output.body]
        return stage_key(
            "picture", shown | {"part": part.body_key}, ("pipeline/render", "pipeline/output/pictures.py"), _PACKAGES
        )
    shown |= {"scene": run.inputs, "all modes": run.keep_all}
    return stage_key("picture", shown, ("pipeline", "meshes"), (*_PACKAGES, "scipy", "scikit-fem", "gmsh"))


def draw(run: Pipeline, output: Any, folder: Path) -> list[str]:
    """Draw an output into a folder, or write there what was drawn of it before; return the names of its files."""
    drawn: list[str] = []

    def make() -> dict[str, bytes]:
        drawn.extend(DRAWINGS[output.type](run, output, folder))
        return {name: (folder / name).read_bytes() for name in drawn}

    files = run.keeper.kept("pictures", picture_key(run, output), make)
    if not drawn:
        for name, content in files.items():
            with whole_file(folder / name) as part:
                part.write_bytes(content)
    return list(files)
