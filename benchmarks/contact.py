"""Stated against true errors, and energy, of random scenes with contacts, written to contact.csv.

Run from the project's root: ``python benchmarks/contact.py``; ``--scenes 40`` takes the first forty seeds, ``--seed 7``
one. The scenes are those of `contact_scenes`. A figure of a contact is *wrong* if its true error is more than three
times what is stated. It is that from a march with a quarter of the step and, of balls and of boxes on the ground, from
the model of `contact_reference`, whichever is larger. Energy with what friction and damping took may grow by 1 % of the
largest kinetic energy at most, since bodies meet with no more. Rows that the table holds aren't made again.
"""

import argparse
import csv
import time
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from contact_reference import exact_figures, is_known
from contact_scenes import ContactCase, random_case

from fmd import Pipeline, load_scene
from fmd.accuracy.contact_errors import step_differences
from fmd.core.cache import Cache
from fmd.core.errors import AccuracyError, InputError, StabilityError
from fmd.core.limits.errors import SAFETY

TABLE = Path(__file__).parent / "contact.csv"
SCENES = 100
WRONG = 3.0  # times the stated error
ROUND_OFF = 1e-9  # of a figure


@dataclass
class Row:
    """Outcome of a scene: compared or refused, with its worst figure and the growth of its energy."""

    seed: int
    kind: str
    method: str
    outcome: str = "compared"
    figures: int = 0
    wrong: int = 0
    worst: str = ""
    stated: float = 0.0
    true: float = 0.0
    size: float = 0.0
    unstated: int = 0
    reference: str = ""
    growth: float = 0.0
    contacts: int = 0
    seconds: float = 0.0
    said: str = ""


def judge(seed: int) -> Row:
    """Run the scene of a seed, and compare its figures with those of its references."""
    case = random_case(seed)
    row, begun = Row(seed, case.kind, case.method), time.process_time()
    try:
        _compare(row, case, Pipeline(load_scene(case.scene), Cache(None)))
    except (InputError, AccuracyError, StabilityError) as error:
        row.outcome, row.said = "refused", str(error)
    row.seconds = round(time.process_time() - begun, 2)
    return row


def _compare(row: Row, case: ContactCase, run: Pipeline) -> None:
    stated, plan = step_differences(run)["touch"], next(iter(run.plans.values()))
    method: Any = plan.integrator
    finer = replace(plan, integrator=replace(method, step=0.25 * method.step))
    history, (kinetic, potential) = run.motion.contacts["touch"], run.motion.energies
    own, exact = history.figures, run.motion_by(finer, finer.march(run.output_times)).contacts["touch"].figures
    independent = exact_figures(case) if is_known(case) else {}
    row.contacts, row.reference = int(own["begin_s"] is not None), "own model" if independent else "finer step"
    for key, part in stated.items():
        if isinstance(part, str):
            row.unstated += key != "energy_error_j"
            continue
        error = SAFETY * part
        true = float(np.linalg.norm(np.subtract(own[key], exact[key])))
        if key in independent:
            value, off = independent[key]
            true = max(true, float(np.linalg.norm(np.subtract(own[key], value))) - off)
        size = float(kinetic.max() if key.endswith("_j") else np.linalg.norm(exact[key]))
        row.figures += 1
        row.wrong += true > WRONG * error + ROUND_OFF * size
        if true > ROUND_OFF * size and true * row.stated >= row.true * error:
            row.worst, row.stated, row.true, row.size = key, error, true, size
    whole = kinetic + potential + history.energy + history.friction_work + history.damping_work
    apart = np.append(np.flatnonzero(history.area == 0.0), len(whole) - 1)  # within a shock it swings about its energy
    row.growth = float((whole - whole[0])[apart].max() / kinetic.max())


def main() -> None:
    """Judge the scenes that are asked for, and write their table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--scenes", type=int, default=SCENES)
    parser.add_argument("--seed", type=int)
    asked = parser.parse_args()
    if asked.seed is not None:
        print(judge(asked.seed))
        return
    names = [field.name for field in fields(Row)]
    if not TABLE.exists():
        TABLE.write_text(",".join(names) + "\n")
    with TABLE.open(newline="") as file:
        known = {int(row["seed"]) for row in csv.DictReader(file)}
    for seed in sorted({*range(asked.scenes)} - known):
        row = judge(seed)
        print(row, flush=True)
        with TABLE.open("a", newline="") as file:
            csv.writer(file, lineterminator="\n").writerow(getattr(row, name) for name in names)


if __name__ == "__main__":
    main()
