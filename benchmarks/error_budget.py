"""The error budget against true errors: each scene against a much finer run of it, written to error_budget.csv.

The finer runs have smaller and quadratic elements, several times the modes with load-dependent vectors, and a time
integration refined until two marches agree.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

from pipeline import Pipeline, load_scene
from pipeline.budget import true_errors

_AUTO = ('simulation.run=[{integrator="auto"}]', "simulation.error=1e-6")
_PROPELLER = ("body.propeller.mesh.order=2", "body.propeller.modes.count=48", "body.propeller.modes.enrich=ritz")
_FINE = ('simulation.run=[{integrator="central-difference", step="0.5 us"}]',)
# Name, scene, its overrides, and those of the finer run.
CASES = (
    ("rod-slider", "rod-slider", (), _AUTO),
    *(
        (
            name,
            "beam",
            own,
            (
                "body.beam.mesh.divisions=[96, 8, 2]",
                "body.beam.modes.count=16",
                "body.beam.modes.enrich=ritz",
                *_AUTO,
            ),
        )
        for name, own in (("beam", ()), ("beam, enriched", ("body.beam.modes.enrich=inertia",)))
    ),
    ("propeller", "propeller", (), (*_PROPELLER, *_FINE)),
)
_ROUND_OFF = 1e-9


def compare(scene: str, own: tuple[str, ...], finer: tuple[str, ...]) -> list[tuple[str, float, float]]:
    """Stated and true relative error of each quantity of a scene."""
    run = Pipeline(load_scene(scene, own))
    true = true_errors(run, Pipeline(load_scene(scene, finer)))
    return [(row.name, row.total, true[row.name]) for row in run.budget.rows]


def main(names: list[str]) -> None:
    """Compare all cases, or those that are named, and print how many quantities are covered."""
    rows = []
    for name, scene, own, finer in CASES:
        if names and name not in names:
            continue
        found = compare(scene, own, finer)
        rows += [(name, *row) for row in found]
        real = [stated / true for _, stated, true in found if true > _ROUND_OFF]
        covered = sum(ratio >= 1 for ratio in real) / len(real)
        near = sum(1 <= ratio <= 5 for ratio in real) / len(real)
        print(f"{name}: {len(real)} quantities, covered {covered:.0%}, within a factor of 5 {near:.0%}", flush=True)
        for quantity, stated, true in found:
            print(f"  {quantity:45s} stated {stated:.1e} true {true:.1e} ratio {stated / max(true, 1e-300):.2f}")
    if not names:
        with (Path(__file__).parent / "error_budget.csv").open("w", newline="") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(["scene", "quantity", "stated", "true"])
            table.writerows([case, quantity, f"{stated:.3g}", f"{true:.3g}"] for case, quantity, stated, true in rows)


if __name__ == "__main__":
    main(sys.argv[1:])
