"""The lightest connecting rod of docs/fitting.md beside a grid of 1,024 designs, written to design_grid.csv.

Run from the project's root: ``python -m benchmarks.design_grid``. Designs go from the lightest to heavier ones; each
has its frequency solved, and where that is high enough its motion, until the first is within both limits: all lighter
ones are not, so that it is the grid's best.
"""

import itertools
from dataclasses import dataclass

import numpy as np

import fmd
from benchmarks.table_format import HERE, write_rows
from fmd.fitting.optimise import optimise_scene, read_limits
from fmd.fitting.varied import read_varied
from fmd.output.channels import find_channels
from fmd.stages.pipeline import Pipeline

LIFE, FREQUENCY = 12000.0, 98.0
POINTS, SPREAD = 32, 0.16  # of the grid over each number, and how far its logarithm goes to each side
FATIGUE = "{type='fatigue', file='life.csv', body='rod', sn={amplitude='40 MPa', cycles=1e6, slope=5}}"
ROD = (
    "body.rod.depth=12 mm",
    "body.rod.width=12 mm",
    "body.rod.mesh.divisions=[8, 1, 1]",
    "body.rod.modes={count=4, boundary='joint', enrich='none', damping=0.01}",
    "simulation.duration=0.0419 s",
    "simulation.step=auto",
    "simulation.run=[{integrator='central-difference'}]",
    f"output=[{FATIGUE}]",
)


@dataclass
class Row:
    """The optimum, and the grid's lightest design within both limits; ``motions`` is how many designs were marched."""

    design: str
    depth_mm: float
    width_mm: float
    mass_kg: float
    life: float
    frequency_hz: float
    designs: int
    motions: int


def load_rod(depth: float, width: float) -> Pipeline:
    """Return the stages of the rod with so much depth and width [m]."""
    return fmd.load("slider-crank", *ROD, f"body.rod.depth={depth} m", f"body.rod.width={width} m").run


def read(run: Pipeline, name: str) -> float:
    """Return a result."""
    (channel,) = find_channels(run, name)
    return float(channel.read(run))


def search_grid(depth: float, width: float, spread: float, points: int) -> Row:
    """Find the lightest design of a grid about one, in logarithms, that is within both limits."""
    shares = np.linspace(-spread, spread, points)
    pairs = sorted(itertools.product(shares, shares), key=sum)  # the mass goes with the product of both
    motions = 0
    for count, pair in enumerate(pairs, start=1):
        at = depth * float(np.exp(pair[0])), width * float(np.exp(pair[1]))
        run = load_rod(*at)
        frequency = read(run, "frequency.1")
        if frequency >= FREQUENCY:
            motions += 1
            life = read(run, "life")
            if life >= LIFE:
                sizes = (1e3 * at[0], 1e3 * at[1], read(run, "rod.mass"))
                return Row("grid", *sizes, life, frequency, count, motions)
    raise RuntimeError("no design of the grid is within both limits")


def main() -> None:
    """Find the optimum, and the best of the grid about it."""
    run = fmd.load("slider-crank", *ROD).run
    limits = read_limits(run, [f"life >= {LIFE}", f"frequency.1 >= {FREQUENCY} Hz"])
    varied = read_varied(run, ["body.rod.depth=6..30mm", "body.rod.width=6..30mm"])
    found = optimise_scene(run, "rod.mass", limits, varied)
    depth, width = found.design.values.values()
    rows = [Row("optimum", 1e3 * depth, 1e3 * width, *found.design.results.tolist(), *2 * [found.space.solved])]
    print(rows[0], flush=True)
    rows.append(search_grid(depth, width, SPREAD, POINTS))
    print(rows[1], flush=True)
    write_rows(HERE / "design_grid.csv", rows, digits=5)


if __name__ == "__main__":
    main()
