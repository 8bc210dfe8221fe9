"""Pictures, films and charts, drawn in another process while this one computes and kept as they were drawn."""

import signal
import subprocess
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

from fmd.core.cache import stage_key
from fmd.core.encoding import decode, encode
from fmd.core.errors import InputError
from fmd.core.files import whole_file
from fmd.core.processes import describe_end, start_child
from fmd.output.output_kinds import OutputKind, kind_of
from fmd.render.rendering_check import MEND, TIMEOUT, describe_failure
from fmd.stages.pipeline import Pipeline
from fmd.stages.visual_files import find_visual_files


class DrawingProcess:
    """Makes the calls that it is given one after the other in a process of its own, which ends with the context."""

    def __init__(self, scene_file: str) -> None:
        self._scene_file = scene_file
        self._process: subprocess.Popen[str] | None = None
        self._is_ready = False
        self._calls: list[Path] = []
        self._n_calls = 0

    def __enter__(self) -> Self:
        self._folder = tempfile.TemporaryDirectory(prefix="fmd-")
        self._errors: IO[str] = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
        self._errors.close()
        self._folder.cleanup()

    @property
    def folder(self) -> Path:
        """Temporary folder for calls and pictures."""
        return Path(self._folder.name)

    def start(self) -> None:
        """Start the process, unless it runs; it loads its libraries and draws something for a start."""
        if self._process is None:
            pipes: dict[str, Any] = {
                "stdin": subprocess.PIPE,
                "stdout": subprocess.PIPE,
                "stderr": self._errors.fileno(),
            }
            self._process = start_child("fmd.render.drawing_server:serve", **pipes)

    def require_ready(self) -> None:
        """Wait until the process has drawn something.

        Raises
        ------
        InputError
            This machine can't draw; the message names the remedy.
        """
        if self._process is not None and not self._is_ready:
            timer = threading.Timer(TIMEOUT, self._process.kill)
            timer.start()
            try:
                self._is_ready = self._answer() == "ready"
            finally:
                timer.cancel()

    def __call__(self, function: str, *arguments: Any, **settings: Any) -> None:
        """Take the call of a function of `fmd.render`, named as for `draw_here`."""
        self.start()
        self.require_ready()
        assert self._process is not None
        assert self._process.stdin is not None
        self._n_calls += 1
        path = self.folder / f"{self._n_calls}.call"
        path.write_bytes(encode((function, arguments, settings)))
        try:
            self._process.stdin.write(f"{path}\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            raise self._ended() from None
        self._calls.append(path)

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Hold the process up, so that it takes no time from what is timed here."""
        stops = self._process is not None and self._process.poll() is None and hasattr(signal, "SIGSTOP")
        if not stops:  # as on Windows
            self.finish()
            yield
            return
        assert self._process is not None
        self._process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self._process.send_signal(signal.SIGCONT)

    def finish(self) -> None:
        """Wait until all calls have been made.

        Raises
        ------
        Exception
            The error of a call that failed.
        InputError
            The process has died.
        """
        while self._calls:
            answer, path = self._answer(), self._calls.pop(0)
            if answer != "done":
                kind, said = decode(path.read_bytes())
                raise {"OSError": OSError, "ValueError": ValueError}.get(kind, RuntimeError)(said)
            path.unlink()

    def _answer(self) -> str:
        assert self._process is not None
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise self._ended()
        return line.strip()

    def _ended(self) -> InputError:
        """Make the error of a process that has ended by itself."""
        assert self._process is not None
        status = self._process.wait()
        self._errors.seek(0)
        reason = f"{describe_failure(describe_end(status, self._errors.read())[0])}; {MEND} (or run with --no-pictures)"
        return InputError(self._scene_file, "output", None, f"this machine can't draw: {reason}")


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


class Pictures(DrawingProcess):
    """Outputs of a scene, but its exports, that another process draws while the run goes on, unless they are kept."""

    def __init__(self, outputs: Sequence[Any], scene_file: str) -> None:
        super().__init__(scene_file)
        self._outputs = outputs
        self._drawn: dict[str, list[str]] = {}  # names of files by the name in the output
        self._kept: dict[str, dict[str, bytes]] = {}

    def prepare(self, run: Pipeline) -> None:
        """Start the process if something will have to be drawn."""
        if not all(run.store.cache.holds(picture_key(run, output)) for output in self._outputs):
            self.start()

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
        make = kind_of(output).make
        self._drawn[output.file] = run.store.compute(_STAGE, lambda: make(run, output, self.folder, self))

    def write(self, run: Pipeline, folder: Path) -> list[str]:
        """Wait until everything is drawn, and write the files into a folder; return their names.

        Raises
        ------
        InputError
            The process that draws has died.
        """
        if self._drawn:
            run.store.compute(_STAGE, self.finish)
        if self._kept:
            run.log.add(_STAGE, 0.0, run.log.cached)
        names: list[str] = []
        for output in self._outputs:
            files = self._kept.get(output.file)
            if files is None:
                files = {name: (self.folder / name).read_bytes() for name in self._drawn[output.file]}
                run.store.cache.save(picture_key(run, output), files)
            for name, content in files.items():
                with whole_file(folder / name) as part:
                    part.write_bytes(content)
            names += files
        return names
