"""Stated against true errors, and energy, of random scenes with contacts, written to contact.csv.

Run from the project's root: ``python benchmarks/contact.py``; ``--scenes 40`` takes the first forty seeds, ``--seed 7``
one. Bars of random sizes, materials, modes and elements fall onto planes, strike each other, or swing against stops on
hinges, slides and in loops, with friction and damping. A figure of a contact is *wrong* if its true error, that from a
march with a quarter of the step, is more than three times what is stated. Energy with what friction and damping took
may grow by 1 % of the largest kinetic energy at most, since bodies meet with no more. Rows that the table holds aren't
made again.
"""

from __future__ import annotations

import argparse
import csv
import time
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from fmd import Pipeline, load_scene
from fmd.accuracy.contact_errors import step_errors
from fmd.core.cache import Cache
from fmd.core.errors import AccuracyError, InputError, StabilityError

TABLE = Path(__file__).parent / "contact.csv"
SCENES = 60
WRONG = 3.0  # times the stated error
ROUND_OFF = 1e-9  # of a figure
KINDS = ("drop", "hinge", "slide", "pair", "loop")


@dataclass
class Row:
    """Outcome of a scene: compared, refused or failed, with its worst figure and the growth of its energy."""

    seed: int
    kind: str
    method: str
    outcome: str = "compared"
    figures: int = 0
    wrong: int = 0
    worst: str = ""
    stated: float = 0.0
    true: float = 0.0
    growth: float = 0.0
    contacts: int = 0
    seconds: float = 0.0
    said: str = ""


def random_scene(seed: int) -> tuple[str, str, dict[str, Any]]:
    """Return the kind, the method and the scene of a seed."""
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    method = "generalized-alpha" if rng.random() < 0.2 else "central-difference"
    joint: dict[str, Any] = {"parent": "ground", "child": "one.end"}
    speed = f"{rng.uniform(-2.0, -0.2)} m/s"
    law: dict[str, Any] = {"friction": float(rng.choice([0.0, 0.2, 0.6]))}
    if rng.random() < 0.4:
        law["damping"] = f"{10 ** rng.uniform(-6, -4)} s"
    bodies = {"one": _bar(rng)}
    high = 0.5 * float(bodies["one"]["depth"].split()[0])
    if kind in ("drop", "pair"):
        turn = [f"{x} deg" for x in rng.uniform(-15, 15, 3)]
        spin = [f"{x} rad/s" for x in rng.uniform(-10, 10, 3)]
        flight = {"type": "free", "velocity": ["0 m/s", speed, "0 m/s"], "spin": spin, "rotate": turn}
        joints = {"flight": joint | flight | {"position": ["0 m", f"{high + rng.uniform(80, 120)} mm", "0 m"]}}
    elif kind == "slide":
        joints = {
            "slide": joint | {"type": "prismatic", "axis": [0, 1, 0], "position": f"{high + 1} mm", "rate": speed}
        }
    else:
        hinge = joint | {
            "type": "revolute",
            "axis": [0, 0, 1],
            "angle": f"{rng.uniform(1, 3)} deg",
            "rate": "-8 rad/s",
        }
        joints = {"hinge": hinge}
        law["clearance"] = f"{high} mm"
        if kind == "loop":
            spin = ["0 rad/s", "0 rad/s", "-8 rad/s"]
            joints = {
                "flight": joint | {"type": "free", "spin": spin},
                "hinge": {"axis": [0, 0, 1], **joint, "type": "revolute"},
            }
    contact: dict[str, Any] = {"between": ["ground", "one.under"], "normal": [0, 1, 0], **law}
    if kind == "pair":
        bodies["other"] = _bar(rng, bodies["one"]["length"])
        low = 0.5 * float(bodies["other"]["depth"].split()[0])
        joints["rest"] = joint | {"type": "free", "child": "other.end", "position": ["0 m", f"{-low} mm", "0 m"]}
        contact = {"between": ["other.above", "one.under"], **law}
    simulation = {
        "duration": f"{rng.uniform(2.0, 8.0) if kind in ('hinge', 'loop', 'slide') else rng.uniform(60, 120)} ms",
        "output_step": "50 us" if kind in ("hinge", "loop", "slide") else "0.5 ms",
        "step": "auto",
        "tip": "one.end",
        "gravity": ["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"],
        "run": [{"integrator": method} | ({"rho": 1.0} if method == "generalized-alpha" else {})],
    }
    title = f"Contact {seed}"
    scene = {"title": title, "body": bodies, "joint": joints, "contact": {"touch": contact}, "simulation": simulation}
    return kind, method, scene


def _bar(rng: np.random.Generator, length: str = "") -> dict[str, Any]:
    long = float(length.split(maxsplit=1)[0]) if length else rng.uniform(100, 300)
    depth, width = rng.uniform(0.1, 0.4, 2) * long
    divisions = [int(n) for n in (rng.integers(3, 8), rng.integers(1, 4), rng.integers(1, 4))]
    E, rho = ((70, 2700), (210, 7850), (3, 1200))[int(rng.integers(3))]
    return {
        "shape": "bar",
        "length": f"{long} mm",
        "depth": f"{depth} mm",
        "width": f"{width} mm",
        "E": f"{E} GPa",
        "nu": 0.3,
        "rho": f"{rho} kg/m^3",
        "mesh": {"divisions": divisions, "order": 1},
        "modes": {"count": int(rng.integers(1, 9)), "enrich": "none", "damping": float(rng.choice([0.0, 0.01]))},
        "marker": {"end": {"face": "x-"}, "under": {"face": "y-"}, "above": {"face": "y+"}},
    }


def judge(seed: int) -> Row:
    """Run the scene of a seed, and compare its figures with those of a march with a quarter of the step."""
    kind, method, scene = random_scene(seed)
    row, begun = Row(seed, kind, method), time.process_time()
    try:
        run = Pipeline(load_scene(scene), Cache(None))
        _compare(row, run)
    except (InputError, AccuracyError, StabilityError) as error:
        row.outcome, row.said = "refused", str(error)
    row.seconds = round(time.process_time() - begun, 2)
    return row


def _compare(row: Row, run: Pipeline) -> None:
    stated, plan = step_errors(run)["touch"], next(iter(run.plans.values()))
    method: Any = plan.integrator
    finer = replace(plan, integrator=replace(method, step=0.25 * method.step))
    own = run.motion.contacts["touch"].figures
    exact = run.motion_by(finer, finer.march(run.output_times)).contacts["touch"].figures
    row.contacts = int(own["begin_s"] is not None)
    kinetic, potential = run.motion.energies
    for key, error in stated.items():
        true = float(np.linalg.norm(np.subtract(own[key], exact[key])))
        size = float(kinetic.max() if key.endswith("_j") else np.linalg.norm(exact[key]))
        row.figures += 1
        row.wrong += true > WRONG * error + ROUND_OFF * size
        if true > ROUND_OFF * size and true * row.stated >= row.true * error:
            row.worst, row.stated, row.true = key, error, true
    history = run.motion.contacts["touch"]
    whole = kinetic + potential + history.energy + history.friction_work + history.damping_work
    apart = np.append(
        np.flatnonzero(history.area == 0.0), len(whole) - 1
    )  # steps through a contact swing about its energy
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
