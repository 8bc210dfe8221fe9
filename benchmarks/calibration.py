"""Whole fits of the arm to 400 noises, and how often their intervals hold the truth, written to calibration.csv.

Run from the project's root: ``python benchmarks/calibration.py``; seeds that the table has are not fitted again.
Histories of the scene with other numbers have 5 % noise; each fit starts from the scene's own numbers.
"""

import csv
from collections.abc import Sequence

import numpy as np
from few_modes import few_modes
from table_format import HERE

import fmd
from fmd.fitting.experiments import HistoryExperiment
from fmd.fitting.fit import fit_scene
from fmd.fitting.measurements import MeasuredChannel, Measurements
from fmd.fitting.varied import read_varied
from fmd.output.channels import find_all_channels

TABLE = HERE / "calibration.csv"
SEEDS, NOISE = 400, 0.05
SETTINGS = (
    "simulation.run=[{integrator='central-difference'}]",
    "simulation.duration=0.5 s",
    "body.forearm.modes.count=3",
)
TRUTH = {"joint.elbow.spring": 1.1, "joint.elbow.damper": 0.85, "drive.swing.torque": 0.96}  # of the scene's numbers
NAMES = ("elbow.position", "forearm.wrist.position.y")


def main() -> None:
    """Fit what the table doesn't have."""
    run = fmd.load("arm", *few_modes("arm"), *SETTINGS).run
    varied = read_varied(run, [*TRUTH])
    truth = {each.parameter: each.parameter.value * share for each, share in zip(varied, TRUTH.values(), strict=True)}
    channels, times = find_all_channels(run, NAMES), run.output_times

    def experiment(histories: Sequence[np.ndarray], sigmas: Sequence[float]) -> HistoryExperiment:
        measured = zip(channels, histories, sigmas, strict=True)
        named = (MeasuredChannel(each.name, each.unit, values, sigma, True) for each, values, sigma in measured)
        return HistoryExperiment(run, Measurements(times, tuple(named), tuple(channels)))

    clean = experiment([np.zeros(len(times))] * len(channels), [1.0] * len(channels)).predict(truth)
    sigmas = [NOISE * float(np.std(values)) for values in clean]
    done = {row["seed"] for row in csv.DictReader(TABLE.open())} if TABLE.exists() else set()
    with TABLE.open("a", newline="") as file:
        writer = csv.writer(file)
        if not done:
            writer.writerow(["seed", "chi2", "evaluations", *TRUTH])
        for seed in range(SEEDS):
            if str(seed) in done:
                continue
            rng = np.random.default_rng(seed)
            noisy = [values + sigma * rng.normal(size=len(times)) for values, sigma in zip(clean, sigmas, strict=True)]
            measured = experiment(noisy, sigmas)
            fit = fit_scene((measured,), varied)
            inside = [low <= true <= high for (low, high), true in zip(fit.intervals, truth.values(), strict=True)]
            writer.writerow([seed, f"{fit.chi2:.5g}", measured.solved, *(int(each) for each in inside)])
            file.flush()


if __name__ == "__main__":
    main()
