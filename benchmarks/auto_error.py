"""Error that ``auto`` tells of random scenes, and the true one, written to auto_error.csv.

Run from the project's root: ``python benchmarks/auto_error.py``; ``--seed 21`` takes one seed of `truth_scenes`. True
errors are by the measure of ``auto``, against a march by the Runge–Kutta method with a tolerance of 1e-10. Scenes that
are refused, and those whose reference takes too long or is made by ``auto`` itself, have no row.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass

from auto_choice import HERE, TooLongError, exact_march, limit, open_scene
from table_format import write_rows

from fmd.core.errors import AccuracyError, InputError

TABLE = HERE / "auto_error.csv"
SCENES = 300
LONGEST = 60.0  # seconds of a march by auto


@dataclass
class Row:
    """Errors of a scene over the largest value of each kind of coordinate: wanted, told by two marches, and true."""

    seed: int
    method: str
    wanted: float
    told: float
    true: float
    evaluations: int


def judge(seed: int) -> Row | None:
    """March a scene by ``auto`` and compare it with its reference; None if it has none."""
    scene = open_scene(str(seed))
    found = scene.auto.march(scene.system, *scene.start, scene.times, limit(LONGEST))
    exact = exact_march(scene)
    if exact.integrator.startswith("auto") or found.error is None:
        return None
    method = found.integrator.removeprefix("auto (").removesuffix(")")
    return Row(seed, method, scene.auto.error, found.error, scene.error(found, exact), found.evaluations)


def main(arguments: list[str]) -> None:
    """Judge scenes and write the table."""
    parser = argparse.ArgumentParser(description="Error that auto tells, and the true one.")
    parser.add_argument("--seed", action="append", type=int)
    seeds, rows = parser.parse_args(arguments).seed, list[Row]()
    for seed in seeds or range(SCENES):
        try:
            row = judge(seed)
        except (AccuracyError, InputError, TooLongError) as error:
            print(f"{seed}: {type(error).__name__} {str(error)[:100]}", flush=True)
            continue
        print(row or f"{seed}: no reference", flush=True)
        rows += [row] if row else []
    if rows and not seeds:
        write_rows(TABLE, rows)


if __name__ == "__main__":
    main(sys.argv[1:])
