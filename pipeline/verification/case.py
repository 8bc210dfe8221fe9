"""A case of the verification suite: figures of ours beside published ones, each with its tolerance."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from importlib.resources import as_file, files

from pipeline.core.cache import Cache
from pipeline.scene.scene import load_scene
from pipeline.stages.pipeline import Pipeline


@dataclass(frozen=True)
class Figure:
    """One number of ours and what it should be.

    Parameters
    ----------
    quantity : str
        What it is, with its unit.
    ours, published : float
        In that unit.
    tolerance : float
        Largest difference allowed, relative to ``published``.
    """

    quantity: str
    ours: float
    published: float
    tolerance: float

    @property
    def difference(self) -> float:
        """Relative to what is published."""
        return float(self.ours / self.published - 1)

    @property
    def holds(self) -> bool:
        """Whether the difference is within the tolerance; never for what isn't a number."""
        return abs(self.difference) <= self.tolerance


@dataclass(frozen=True)
class VerificationCase:
    """Figures from one source.

    Parameters
    ----------
    name, title, source : str
        For the command line and for the table; where the numbers or formulas were published.
    measure : callable
        Computes the figures; takes the cache where stages are kept, ``None`` for the user's.
    """

    name: str
    title: str
    source: str
    measure: Callable[[Cache | None], list[Figure]]


def scene_run(name: str, cache: Cache | None, overrides: Sequence[str] = ()) -> Pipeline:
    """Run a ready scene, or one of the suite's own, e.g. ``"verification/rod"``."""
    folder, _, scene = name.rpartition("/")
    if not folder:
        return Pipeline(load_scene(scene, overrides), cache)
    with as_file(files("models") / folder / f"{scene}.toml") as path:
        return Pipeline(load_scene(path, overrides), cache)


def listed(
    quantities: Iterable[str], ours: Iterable[float], published: Iterable[float], tolerance: float
) -> list[Figure]:
    """Figures with one tolerance, as many as there are names."""
    rows = zip(quantities, ours, published, strict=False)
    return [Figure(quantity, float(own), float(other), tolerance) for quantity, own, other in rows]
