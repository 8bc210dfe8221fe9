"""Types of outputs: how each is made, what it reads, and where the summary and the report have it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from fmd.core.data_classes import dataclass
from fmd.scene.outputs import OUTPUT_MODELS

if TYPE_CHECKING:
    from fmd.render.calls import Drawer
    from fmd.scene.scene import Scene
    from fmd.stages.pipeline import Pipeline

Reads = Callable[["Pipeline", Any], Iterator[tuple[str, str]]]

_DRAWN = (".png", ".pdf", ".svg", ".mp4", ".gif")
_MODULES = {
    "chart": "pictures",
    "mesh": "pictures",
    "modes": "pictures",
    "mode sheet": "pictures",
    "stress": "pictures",
    "mechanism": "pictures",
    "film": "pictures",
    "envelope": "stress_fields",
    "fatigue": "stress_fields",
    "history": "histories",
    "table": "histories",
    "export": "exports",
    "frf": "responses",
    "gear-mesh": "gear_mesh",
}
"""Files of this folder whose ``KINDS`` hold types that share them; another type has a file of its own name."""


def key_of(run: Pipeline, output: Any, key: str) -> str:
    """Return where a key of an output stands in the scene; one that was made beside it counts as the first."""
    outputs = run.scene.output
    return f"output.{outputs.index(output) if output in outputs else 0}.{key}"


def read_nothing(_run: Pipeline, _output: Any) -> Iterator[tuple[str, str]]:
    """Iterate over no stages: the motion has all that an output takes."""
    return iter(())


def read_body(*stages: str) -> Reads:
    """Return what iterates over these stages of an output's body, or of its pieces."""
    return lambda run, output: ((name, part.name) for part in run.pieces_of(output.body) for name in stages)


class ResponseKind(NamedTuple):
    """How an output is made that takes no motion, and is computed before anything is integrated."""

    compute: Callable[[Pipeline, Any], Any]  # computes what an output of a run shows
    # Writes it into a folder, with or without its chart, and returns its summary with its files and warnings.
    write: Callable[[Pipeline, Any, Any, Path, bool], dict[str, Any]]
    tabulate: Callable[[dict[str, Any]], dict[str, Any]]  # returns the table that the report has of a summary
    describe: Callable[[dict[str, Any]], list[str]]  # returns the lines that ``fmd run`` writes of a summary


@dataclass(frozen=True)
class OutputKind:
    """How one type of output is made."""

    # Has an output of a run drawn into a folder by a `Drawer`. It returns the names of its files, or ``None`` if its
    # own file is all.
    draw: Callable[..., list[str] | None] | None = None
    write: Callable[..., list[str] | None] | None = None  # writes an output of a run into a folder, and returns as much
    response: ResponseKind | None = None  # how it is made if it takes no motion
    # Iterates over the stages of bodies that an output takes, with the names of the bodies or pieces.
    reads: Reads = read_nothing
    still: bool = False  # it shows a part, and nothing of its motion
    # Returns what the summary has of a run's output: under a key, values by the file or the body.
    summarise: Callable[[Pipeline, Any], dict[str, dict[str, Any]]] | None = None
    # Returns the stated errors that a picture shows, as plain numbers; it is drawn when they are known.
    shown_errors: Callable[[Pipeline, Any], Any] | None = None
    # Section of the report that has it; the view in motion has what films show.
    section: Literal["outputs", "charts", "modes", "motion"] = "outputs"
    charted: bool = False  # the report shows its chart, whatever its file
    gives_view: tuple[str, ...] = ()  # what the first such output gives the report's view: ``scale``, ``camera``

    def make(self, run: Pipeline, output: Any, folder: Path, *drawer: Drawer) -> list[str]:
        """Draw or write an output that takes the motion, as its file's suffix wants; return the files' names."""
        make = self.draw if output.file.endswith(_DRAWN) else self.write
        assert make is not None  # a suffix that it can't have is a fault of the scene
        files = make(run, output, folder, *drawer)
        return [output.file] if files is None else files


def kind_named(type: str) -> OutputKind:
    """Return the type of output of a name, loaded on first use."""
    found: OutputKind = import_module(f"fmd.output.{_MODULES.get(type, type)}").KINDS[type]
    return found


def kind_of(output: Any) -> OutputKind:
    """Return the type of an output."""
    return kind_named(output.type)


def stage_of(output: Any) -> str:
    """Return the stage that makes an output: ``"responses"``, ``"pictures"`` or ``"files"``."""
    if kind_of(output).response is not None:
        return "responses"
    return "pictures" if output.file.endswith(_DRAWN) else "files"


def outputs_of(scene: Scene, stage: str) -> list[Any]:
    """List the outputs of a scene that a stage makes."""
    return [output for output in scene.output if stage_of(output) == stage]


def kinds_that(test: Callable[[OutputKind], bool]) -> tuple[str, ...]:
    """Return the names of all types that pass a test."""
    return tuple(type for type in OUTPUT_MODELS if test(kind_named(type)))
