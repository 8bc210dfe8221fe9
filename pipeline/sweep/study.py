"""A sweep from its points to its table, and on from where an earlier one was stopped."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.core.progress import Monitor, silent
from pipeline.scene.scene import Scene
from pipeline.sweep.points import Point, Varied
from pipeline.sweep.record import STATUSES, Record, read_record, write_record

Work = Callable[[Mapping[str, Scene]], Iterator[tuple[str, Record]]]
"""Computes scenes by their keys; yields key and record of each as it is done."""


@dataclass(frozen=True)
class Sweep:
    """A scene at many values.

    Attributes
    ----------
    varied : tuple of Varied
        What was varied.
    points : tuple of Point
        All combinations, the last key varying fastest.
    records : tuple of Record
        What became of each point.
    computed : int
        How many scenes were computed; the others were kept from before, refused at once, or equal to one of these.
    """

    varied: tuple[Varied, ...]
    points: tuple[Point, ...]
    records: tuple[Record, ...]
    computed: int

    @property
    def counts(self) -> dict[str, int]:
        """How many points have which status."""
        return {status: sum(record.status == status for record in self.records) for status in STATUSES}


def sweep(
    varied: Sequence[Varied], points: Sequence[Point], folder: Path, work: Work, monitor: Monitor = silent
) -> Sweep:
    """Compute what isn't known yet of the points, keeping each as soon as it is done.

    Parameters
    ----------
    varied, points
        As `pipeline.sweep.points` makes them.
    folder : Path
        Where records are kept, one file a scene; made if it is missing.
    work : callable
        `pipeline.sweep.local.on_this_machine` or `pipeline.sweep.cluster.on_cluster`, with its workers given.

    Raises
    ------
    OSError
        The folder can't be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    scenes = {point.key: point.scene for point in points if point.scene is not None}
    known = {key: record for key in scenes if (record := read_record(folder / f"{key}.json")) is not None}
    wanted = {key: scene for key, scene in scenes.items() if key not in known}
    with monitor(f"{len(wanted)} points") as advance:
        for number, (key, record) in enumerate(work(wanted) if wanted else (), start=1):
            if record.lasting:
                write_record(record, folder / f"{key}.json")
            known[key] = record
            advance(number / len(wanted))
    records = [known[point.key] if point.key else Record("refused", point.refusal) for point in points]
    return Sweep(tuple(varied), tuple(points), tuple(records), len(wanted))
