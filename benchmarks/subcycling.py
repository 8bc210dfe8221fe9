"""Sub-cycling against plain central difference on whole scenes with their drives: run time side by side, and error.

Run from the project's root: ``python benchmarks/subcycling.py [SCENE …]``; it prints the table and writes it beside
itself. Methods of a scene march by turns in one process until each has marched for some time; the table has the least
time of each and, as spread, how far its median is above that. Errors are the largest of all coordinates over the output
times, relative to the largest value of their kind, against the Runge–Kutta method at a tolerance of 1e-12.
"""

import sys
from dataclasses import replace
from pathlib import Path
from statistics import median

import numpy as np
from few_modes import few_modes
from table_format import machine, renew_rows

from fmd import Pipeline, load_scene
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.reversible import ReversibleSubcycling
from fmd.integrators.runge_kutta import RungeKutta
from fmd.integrators.subcycling import Subcycling

SECONDS = 0.2  # in which a method's marches are repeated
MOST, LEAST = 201, 15  # marches of a method
RATIOS = (5, 10)
PLAIN = 'simulation.run=[{integrator="central-difference"}]'  # beside which the reversible kind is measured
SHORTER = ("drive.spin_up.duration=4ms", "simulation.duration=20ms")
SCENES = {
    "beam": ("beam-paper", ()),
    "beam, 20 modes": ("beam-paper", ("body.beam.modes.count=20", "simulation.step=1us", *SHORTER)),
    "beam, 60 modes": ("beam-paper", ("body.beam.modes.count=60", "simulation.step=0.1us", *SHORTER)),
    "rod-slider": ("rod-slider", ()),
    "propeller": ("propeller", ()),
    "propeller, all modes": ("propeller", ()),
    "propeller-torque": ("propeller-torque", ()),
    "propeller-gust": ("propeller-gust", ()),
    "arm": ("arm", (*few_modes("arm"), "simulation.step=10us")),
    "beam, by forces": ("beam-paper", (PLAIN,)),
    "beam, free frame": ("beam-paper", (PLAIN, 'simulation.frame="free"')),
}


def plan_of(name):
    """Return the plan of a scene's run, sub-cycled if it has such a one."""
    scene, overrides = SCENES[name]
    pipeline = Pipeline(load_scene(scene, list(overrides)), keep_all=name.endswith("all modes"))
    sub_cycled = [plan for label, plan in pipeline.plans.items() if label.startswith("sub-cycling")]
    return (sub_cycled or list(pipeline.plans.values()))[0], pipeline.output_times


def methods_of(method):
    """Return the methods that are compared on a scene, the plain one first; sub-cycling as the scene's run does it."""
    sub_cycled = ReversibleSubcycling(method.step, 1)
    if isinstance(method, Subcycling):
        sub_cycled = method
    return [CentralDifference(method.step), *(replace(sub_cycled, substeps=m) for m in RATIOS)]


def error_of(system, found, exact):
    """Return the largest error of coordinates, relative to the largest value of their kind."""
    groups, _ = system.groups
    sizes = [np.abs(exact[:, groups == k]).max() for k in np.unique(groups)]
    errors = [np.abs((found - exact)[:, groups == k]).max() for k in np.unique(groups)]
    return max(error / size for error, size in zip(errors, sizes, strict=True) if size > 0)


def measure(name):
    """Measure one scene: a row for each method."""
    plan, times = plan_of(name)
    step = plan.integrator.step
    exact = replace(plan, integrator=RungeKutta(1e-12)).march(times).q
    plans = [replace(plan, integrator=method) for method in methods_of(plan.integrator)]
    first = [each.march(times) for each in plans]
    seconds = [[march.seconds] for march in first]
    count = int(np.clip(SECONDS / max(march.seconds for march in first), LEAST, MOST))
    for _ in range(count):
        for each, spent in zip(plans, seconds, strict=True):
            spent.append(each.march(times).seconds)
    rows = []
    for each, march, spent in zip(plans, first, seconds, strict=True):
        m, forces = each.integrator.substeps, getattr(each.integrator, "forces", "tangents")
        rows.append(
            {
                "scene": name,
                "method": f"{each.integrator.name} {m}:1" + ", carried forces" * (forces == "carried")
                if m > 1
                else each.integrator.name,
                "step": step,
                "seconds": min(spent),
                "spread": median(spent) / min(spent) - 1.0,
                "ratio": min(spent) / min(seconds[0]),
                "error": error_of(plan.system, march.q, exact),
                "coordinates": plan.system.n if plan.excited_system is None else plan.excited_system.n,
            }
        )
        print(*(f"{x:.3g}" if isinstance(x, float) else x for x in rows[-1].values()), flush=True)
    return rows


def main():
    """Measure the scenes that are named, or all."""
    rows = [row for name in sys.argv[1:] or SCENES for row in measure(name)]
    path, order = Path(__file__).with_suffix(".csv"), list(SCENES)
    renew_rows(path, rows, ("scene",), lambda row: order.index(row["scene"]), machine())


if __name__ == "__main__":
    main()
