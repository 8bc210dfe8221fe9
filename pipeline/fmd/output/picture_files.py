"""Pictures, films and charts kept as they were drawn, since drawing takes most of a run with nothing new."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from types import TracebackType
from typing import Any

from fmd.core.cache import stage_key
from fmd.core.files import whole_file
from fmd.output.drawing_process import DrawingProcess
from fmd.output.output_kinds import OutputKind, kind_of
from fmd.stages.pipeline import Pipeline
from fmd.stages.visual_files import find_visual_files

_STAGE = "pictures"
_PACKAGES = ("numpy", "pyvista", "vtk", "matplotlib", "imageio-ffmpeg")


def picture_key(run: Pipeline, output: Any) -> str:
    """Return the key that an output's files are kept under, from everything that it shows and is drawn by."""
    shown = {"output": output.model_dump(mode="json"), "title": run.scene.title}
    kind = kind_of(output)
    if kind.shown_errors is not None:
        shown["errors"] = kind.shown_errors(run, output)
    if kind.still:
        sources = ("fmd/render", "fmd/output/pictures.py")
        return stage_key(_STAGE, shown | {"part": run.wholes[output.body].key("body")}, sources, _PACKAGES)
    shapes = {name: body.model_dump(mode="json", include={"visual"}) for name, body in run.scene.body.items()}
    shown |= {"scene": run.inputs, "all modes": run.keep_all, "shapes": shapes, "files": find_visual_files(run.scene)}
    return stage_key(_STAGE, shown, ("fmd", "fmd/meshes"), (*_PACKAGES, "scipy", "scikit-fem", "gmsh"))


class Pictures:
    """Outputs of a scene that are drawn in another process while the run goes on, unless they are kept.

    Parameters
    ----------
    outputs : sequence of output models
        The scene's, without exports.
    """

    def __init__(self, outputs: Sequence[Any], scene_file: str) -> None:
        self._outputs = outputs
        self._process = DrawingProcess(scene_file)
        self._drawn: dict[str, list[str]] = {}  # names of files by the name in the output
        self._kept: dict[str, dict[str, bytes]] = {}

    def __enter__(self) -> Pictures:
        self._process.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.__exit__(kind, error, trace)

    def start(self, run: Pipeline) -> None:
        """Start the process if something will have to be drawn."""
        if not all(run.store.cache.holds(picture_key(run, output)) for output in self._outputs):
            self._process.start()

    def require_ready(self) -> None:
        """Raise ``InputError`` if this machine can't draw what will have to be drawn."""
        self._process.require_ready()

    def paused(self) -> AbstractContextManager[None]:
        """Make a context in which nothing is drawn, so that other work can be timed."""
        return self._process.paused()

    def begin(self, run: Pipeline, still: bool) -> None:
        """Begin to draw the outputs that show a part alone, or those that show its motion."""
        self._begin(run, lambda kind: kind.still is still and kind.shown_errors is None)

    def begin_stated(self, run: Pipeline) -> None:
        """Begin to draw the outputs that show a motion with its stated errors."""
        self._begin(run, lambda kind: kind.shown_errors is not None)

    def _begin(self, run: Pipeline, chosen: Callable[[OutputKind], bool]) -> None:
        for output in (output for output in self._outputs if chosen(kind_of(output))):
            kept = run.store.cache.load(picture_key(run, output), "dict[str, bytes]")
            if kept is None:
                self._draw(run, output)
            else:
                self._kept[output.file] = kept

    def _draw(self, run: Pipeline, output: Any) -> None:
        draw, folder = kind_of(output).draw, self._process.folder
        assert draw is not None
        self._drawn[output.file] = run.store.compute(_STAGE, lambda: draw(run, output, folder, self._process))

    def write(self, run: Pipeline, folder: Path) -> list[str]:
        """Wait until everything is drawn, and write the files into a folder; return their names.

        Raises
        ------
        InputError
            The process that draws has died.
        """
        if self._drawn:
            run.store.compute(_STAGE, self._process.finish)
        if self._kept:
            run.log.add(_STAGE, 0.0, run.log.cached)
        names: list[str] = []
        for output in self._outputs:
            files = self._kept.get(output.file)
            if files is None:
                files = {name: (self._process.folder / name).read_bytes() for name in self._drawn[output.file]}
                run.store.cache.save(picture_key(run, output), files)
            for name, content in files.items():
                with whole_file(folder / name) as part:
                    part.write_bytes(content)
            names += files
        return names
