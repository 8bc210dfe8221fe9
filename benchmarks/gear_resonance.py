"""Resonance of two spur gears in motion over their speed, written to gear_resonance.csv.

Run from the project's root: ``python benchmarks/gear_resonance.py``. Gears of 20 and 30 teeth turn under 100 N m,
undisturbed but by their own mesh, with backlash. Speeds are by the mesh's frequency over that of one degree of freedom,
``√(c (r_b1²/J1 + r_b2²/J2))`` with the mean stiffness c of the static mesh.
"""

import sys
from math import pi, sqrt
from pathlib import Path
from typing import Any

sys.path.append(str(Path(__file__).parents[1]))
import numpy as np

from benchmarks.table_format import write_rows
from fmd import Pipeline, load_scene
from fmd.core.cache import Cache
from fmd.dynamics.elements import GearTeeth
from fmd.recovery.motion_file import gear_variables

TABLE = Path(__file__).parent / "gear_resonance.csv"
TEETH, TORQUE, DAMPING = (20, 30), 100.0, 2e-6
RATIOS = (0.15, 0.2, 0.25, 0.3, 0.33, 0.36, 0.42, 0.46, 0.5, 0.54, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 1.0, 1.1, 1.3)
APART = 2e-4  # of the axes, farther than without backlash [m]
DURATION, SETTLED = 6e-3, 3e-3  # of a march, and from when on it counts [s]


def driven(rate: float) -> dict[str, Any]:
    """Return the scene of both gears, the first of which turns at a rate [rad/s]."""
    names, ratio = ("pinion", "wheel"), TEETH[0] / TEETH[1]
    gear = {"shape": "spur-gear", "module": 0.003, "width": 0.02, "E": 206e9, "nu": 0.3, "rho": 7850.0}
    gear |= {"mesh": {"along": 1}, "modes": {"count": 1, "enrich": "none"}}
    gear |= {"marker": {"bore": {"face": "bore", "attachment": "averaged"}}}
    rates, torques = (rate, -rate * ratio), (TORQUE, TORQUE / ratio)
    hinge = {"type": "revolute", "axis": [0, 0, 1]}
    return {
        "title": "Two spur gears",
        "body": {
            name: gear | {"teeth": n, "bore": bore} for name, n, bore in zip(names, TEETH, (0.03, 0.04), strict=True)
        },
        "ground": {"pinion": {"at": [0.0, 0.0, 0.0]}, "wheel": {"at": [0.0015 * sum(TEETH) + APART, 0.0, 0.0]}},
        "joint": {
            f"{name}_hinge": {**hinge, "parent": f"ground.{name}", "child": f"{name}.bore", "rate": own}
            for name, own in zip(names, rates, strict=True)
        },
        "drive": {
            name: {"type": "torque", "joint": f"{name}_hinge", "torque": own}
            for name, own in zip(names, torques, strict=True)
        },
        "gear_mesh": {"teeth": {"pinion": "pinion", "wheel": "wheel", "torque": TORQUE, "damping": DAMPING}},
        "simulation": {
            "duration": DURATION,
            "output_step": 2e-6,
            "gravity": [0.0, 0.0, 0.0],
            "tip": "pinion.bore",
            "run": [{"integrator": "central-difference", "step": 2e-7}],
        },
    }


def main() -> None:
    """March both gears at each speed, and write the table."""
    run, rows = Pipeline(load_scene(driven(0.0)), Cache(None)), []
    (teeth,) = run.mechanism.elements
    assert isinstance(teeth, GearTeeth)
    inertia = run.system.linear_matrices[0].diagonal()
    supple = sum(r**2 / J for r, J in zip(teeth.radii, inertia, strict=False))
    natural = sqrt(teeth.energy.mean * supple) / (2 * pi)
    print(f"{natural:.5g} Hz by one degree of freedom, backlash {teeth.backlash:.3g} m", flush=True)
    for ratio in RATIOS:
        rate = 2 * pi * ratio * natural / TEETH[0]
        motion = run.variant(load_scene(driven(rate))).motion
        late = motion.times > SETTLED
        force, error = (variable.values[late] for variable in gear_variables(motion))
        row = {"ratio": ratio, "speed_krpm": 0.03 * rate / pi, "varies_um": 1e6 * float(np.ptp(error))}
        row |= {"force": float(force.max() / force.mean()), "apart": 100 * float(teeth.is_apart(error).mean())}
        rows.append(row)
        print(*row.values(), flush=True)
    write_rows(TABLE, rows, digits=4)


if __name__ == "__main__":
    main()
