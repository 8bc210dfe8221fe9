"""The arm's fit by exact derivatives, and by SciPy's differences of two and three points, written to a table.

Run from the project's root: ``python benchmarks/fit_differences.py``. Eight tangents count as one motion; seconds are
those of the processor after a first fit that compiles.
"""

import csv
import time
from collections.abc import Sequence

import numpy as np
from calibration import NOISE, SETTINGS
from few_modes import few_modes
from scipy.optimize import least_squares
from table_format import HERE

import fmd
from fmd.fitting.experiments import HistoryExperiment
from fmd.fitting.fit import fit_scene
from fmd.fitting.measurements import MeasuredChannel, Measurements
from fmd.fitting.varied import read_varied
from fmd.output.channels import find_all_channels

TRUTH = {"joint.elbow.spring": 1.1, "joint.elbow.damper": 0.85, "drive.swing.torque": 0.96, "body.gripper.mass": 1.1}
NAMES, SEEDS = ("elbow.position", "forearm.wrist.position.y", "shoulder.position"), 4


def main() -> None:
    """Fit the arm to noise of some seeds by each way."""
    run = fmd.load("arm", *few_modes("arm"), *SETTINGS).run
    varied = read_varied(run, [*TRUTH])
    truth = {each.parameter: each.parameter.value * share for each, share in zip(varied, TRUTH.values(), strict=True)}
    channels, times = find_all_channels(run, NAMES), run.output_times

    def measure(histories: Sequence[np.ndarray], sigmas: Sequence[float]) -> HistoryExperiment:
        named = zip(channels, histories, sigmas, strict=True)
        measured = (MeasuredChannel(each.name, each.unit, values, sigma, True) for each, values, sigma in named)
        return HistoryExperiment(run, Measurements(times, tuple(measured), tuple(channels)))

    def differ(shares: np.ndarray, measured: HistoryExperiment, noisy: np.ndarray) -> np.ndarray:
        values = {each.parameter: each.from_share(share) for each, share in zip(varied, shares, strict=True)}
        return ((measured.predict(values) - noisy) / np.array(sigmas)[:, None]).ravel()

    clean = np.array(measure([np.zeros(len(times))] * len(channels), [1.0] * len(channels)).predict(truth))
    sigmas, rows = list(NOISE * np.std(clean, axis=1)), []
    for seed in [0, *range(SEEDS)]:  # the first compiles
        noisy = clean + np.array(sigmas)[:, None] * np.random.default_rng(seed).normal(size=clean.shape)
        for way in ("exact", "2-point", "3-point"):
            measured, begin = measure(list(noisy), sigmas), time.process_time()
            if way == "exact":
                chi2 = fit_scene((measured,), varied).chi2
            else:
                chi2 = 2.0 * least_squares(differ, np.zeros(len(varied)), jac=way, args=(measured, noisy)).cost
            rows.append([seed, way, measured.solved, f"{time.process_time() - begin:.2f}", f"{chi2:.8g}"])
    with (HERE / "fit_differences.csv").open("w", newline="") as file:
        csv.writer(file).writerows([["seed", "derivatives", "motions", "seconds", "chi2"], *rows[3:]])


if __name__ == "__main__":
    main()
