"""Cases of the verification suite: figures of ours beside published ones, each with its tolerance."""

from collections.abc import Callable, Iterable, Sequence
from importlib.resources import as_file, files

from fmd.accuracy.solved_scene import SolvedScene
from fmd.core.cache import Cache
from fmd.core.data_classes import dataclass
from fmd.scene.scene import load_scene
from fmd.stages.pipeline import Pipeline


@dataclass(frozen=True)
class Figure:
    """One number of ours beside the published one."""

    quantity: str  # name of the quantity, with its unit
    ours: float  # values in that unit
    published: float  # values in that unit
    tolerance: float  # largest difference allowed, relative to ``published``

    @property
    def difference(self) -> float:
        """Difference of ours from the published number, relative to the latter."""
        return float(self.ours / self.published - 1)

    @property
    def holds(self) -> bool:
        """True if the difference is within the tolerance, which NaN never is."""
        return bool(abs(self.difference) <= self.tolerance)  # JSON takes no truth of NumPy's


class CaseSkipped(Exception):  # noqa: N818 - no error: what a case needs isn't there
    """A case needs a program that isn't installed; the message says which, and how it comes there."""


@dataclass(frozen=True)
class VerificationCase:
    """A case: figures of ours beside those of one publication."""

    name: str  # name on the command line
    title: str  # title in the table
    source: str  # publication of the numbers or formulas
    # Function that computes the figures; takes the cache of the stages, ``None`` for the user's.
    measure: Callable[[Cache | None], list[Figure]]


def open_scene(name: str, cache: Cache | None, overrides: Sequence[str] = ()) -> Pipeline:
    """Make the pipeline of a ready scene, or of one of the suite's own, e.g. ``"verification/rod"``."""
    folder, _, scene = name.rpartition("/")
    if not folder:
        return SolvedScene(load_scene(scene, overrides), cache).run
    with as_file(files("fmd.models") / folder / f"{scene}.toml") as path:
        return SolvedScene(load_scene(path, overrides), cache).run


def make_figures(
    quantities: Iterable[str], ours: Iterable[float], published: Iterable[float], tolerance: float
) -> list[Figure]:
    """Pair quantities, our values and published ones as figures of one tolerance, as many as there are names."""
    rows = zip(quantities, ours, published, strict=False)
    return [Figure(quantity, float(own), float(other), tolerance) for quantity, own, other in rows]
