"""A sweep over its points, taken up where an earlier one was stopped."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path

from fmd.core.data_classes import dataclass
from fmd.core.files import remove_abandoned
from fmd.core.progress import Monitor, silent
from fmd.scene.scene import Scene
from fmd.sweep.points import Point, Variation
from fmd.sweep.record import STATUSES, SUMMARY, Record, Wanted, read_record, write_record

Compute = Callable[[Mapping[str, Scene]], Iterator[tuple[str, Record]]]
"""A function that computes scenes by their keys, and yields key and record of each as it is done."""


@dataclass(frozen=True)
class Sweep:
    """A scene at many values, with the record of each."""

    variations: tuple[Variation, ...]
    points: tuple[Point, ...]  # all combinations, the last key varying fastest, or those of a design
    records: tuple[Record, ...]  # the result of each point
    # Number of scenes computed now; the others were kept from before, refused at once, or equal to one of these.
    computed: int

    @property
    def is_grid(self) -> bool:
        """True if the points are all combinations of the values, not those of a design."""
        if len(self.points) != math.prod(len(v.values) for v in self.variations):
            return False  # before any combination is made: those of a design's values are far too many
        combinations = product(*(v.values for v in self.variations))
        return all(point.values == values for point, values in zip(self.points, combinations, strict=True))

    @property
    def counts(self) -> dict[str, int]:
        """Number of points of each status."""
        return {status: sum(record.status == status for record in self.records) for status in STATUSES}


def run_sweep(
    variations: Sequence[Variation],
    points: Sequence[Point],
    folder: Path,
    compute: Compute,
    monitor: Monitor = silent,
    wanted: Wanted = SUMMARY,
) -> Sweep:
    """Compute all points that have no record yet, and keep the record of each as soon as it is done.

    The folder of the records, one file a scene, is made if it is missing. ``compute`` is `compute_locally` or
    `compute_on_cluster`, with its workers bound. A record that lacks some of what is wanted is computed anew.

    Raises
    ------
    OSError
        The folder can't be written.
    """
    scenes = {point.key: point.scene for point in points if point.scene is not None}
    there = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    kept = {key: read_record(folder / name) for key in scenes if (name := f"{key}.json") in there}
    known = {key: own for key, own in kept.items() if own is not None and not own.lacks(wanted)}
    missing = {key: scene for key, scene in scenes.items() if key not in known}
    folder.mkdir(parents=True, exist_ok=True)
    remove_abandoned(folder, ".*.*.json")
    had = {key: own for key in missing if (own := kept.get(key)) is not None}
    with monitor(f"{len(missing)} points") as advance:
        for number, (key, computed) in enumerate(compute(missing) if missing else (), start=1):
            record = computed.with_known(had[key]) if key in had else computed
            if record.lasting:
                write_record(record, folder / f"{key}.json")
            known[key] = record
            advance(number / len(missing))
    records = [known[point.key] if point.key else Record("refused", point.refusal) for point in points]
    return Sweep(tuple(variations), tuple(points), tuple(records), len(missing))
