"""Eight tangents of a motion beside the motion itself: run times of their marches.

Run from the project's root, ``python benchmarks/tangents.py``; it writes ``tangents.csv`` beside itself. All marches of
a scene are taken in turn in one process, and the smallest of several counts. Eight numbers that are inputs of the
equations cost the same whatever they are; of numbers that change the equations one and eight are measured.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from table_format import machine, write_rows

import fmd
from fmd.dynamics.compiled_system.tangents import Direction, TangentSystem
from fmd.fitting.frozen_run import FrozenRun
from fmd.fitting.parameters import find_parameter

HERE = Path(__file__).parent
REPETITIONS = 7
SCENES = {
    "arm": ("central-difference", "joint.elbow.spring", "body.gripper.mass"),
    "beam": ("central-difference", "drive.spin_up.speed", "body.beam.E"),
    "robot": ("central-difference", "simulation.gravity.2", "body.forearm.E"),
    "four-bar": ("runge-kutta", "drive.crank.angle", "body.BC.E"),
    "propeller": ("runge-kutta", "drive.spin_up.speed", "body.propeller.E"),
}


def measure(name: str) -> dict[str, str]:
    """Return the row of one scene."""
    method, number, constant = SCENES[name]
    result = fmd.load(name, f"simulation.run=[{{integrator='{method}'}}]")
    frozen = FrozenRun(result.run)
    motion = frozen.at({})
    assert motion.plan is not None
    plan, (system, q0, v0) = motion.plan, motion.plan.marched
    directions = {key: frozen._direction(motion, find_parameter(result.scene, key)) for key in (number, constant)}
    kinds: dict[str, list[Direction]] = {}
    for key, count in ((number, 8), (constant, 1), (constant, 8)):
        direction = directions[key]
        assert direction is not None, key
        kinds[f"{count} {'constants' if direction.variants else 'inputs'}"] = [direction] * count
    best: dict[str, float] = {}
    for _ in range(REPETITIONS):
        seconds = {"motion": plan.integrator.march(system, q0, v0, frozen.times).seconds}
        for kind, chosen in kinds.items():
            both = TangentSystem(system, chosen)
            seconds[kind] = plan.integrator.march(both, *both.join(q0, v0), frozen.times).seconds  # type: ignore[arg-type]
        best = {kind: min(spent, best.get(kind, np.inf)) for kind, spent in seconds.items()}
    row = {"scene": name, "method": method, "coordinates": str(system.n), "motion s": f"{best.pop('motion'):.3g}"}
    return row | {kind: f"{spent / float(row['motion s']):.3g}" for kind, spent in best.items()}


def main() -> None:
    """Measure the scenes that are named, or all."""
    rows = [measure(name) for name in sys.argv[1:] or SCENES]
    for row in rows:
        print(row)
    if len(rows) == len(SCENES):
        write_rows(HERE / "tangents.csv", rows, machine())


if __name__ == "__main__":
    main()
