"""Stress tests of stability: long marches at steps below and above the limits, against what the matrix predicts."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.checks import Array, StabilityError
from pipeline.dynamics.linear import LinearSystem
from pipeline.files import whole_file
from pipeline.integrators.central_difference import CentralDifference
from pipeline.integrators.subcycling import Subcycling
from pipeline.stability import find_limit
from pipeline.stages import Pipeline
from pipeline.studies.amplification import growth

RATIOS = (1, 2, 3, 5, 10, 20)
SHARES = (0.1, 0.3, 0.5, 0.7, 0.9, 0.98, 1.02, 1.05)
CYCLES = 1_000_000
_WORK = 3e9  # multiplications that a march may take
_START = 1e-6
_DIVERGED = np.log(1e30 / _START)  # e-folds until a march counts as diverged
_UNSURE = 8.0  # e-folds by which the start and the shape of a mode may shift that
_LARGE = 5.0  # e-folds after which a mechanism's motion may be too large for a linear prediction
SCENES = (
    ("rod-slider", ("drive.motor.torque=0 N m",)),
    ("beam", ("drive.spin_up.speed=0 rad/s",)),
    ("beam, free frame", ("drive.spin_up.speed=0 rad/s", 'simulation.frame="free"')),
)


@dataclass(frozen=True)
class Case:
    """A system at rest that is marched.

    Attributes
    ----------
    name : str
        What is told of it.
    system : System
        It.
    M, K : ndarray, shape (n, n)
        Its mass and stiffness at rest, slow coordinates first.
    """

    name: str
    system: Any
    M: Array
    K: Array


@dataclass(frozen=True)
class Row:
    """One march.

    Attributes
    ----------
    case : str
        What was marched.
    substeps : int
        m.
    share : float
        Step over the largest stable one.
    cycles : int
        Major cycles.
    predicted, found : str
        ``lives`` or ``diverges``; the prediction may be ``either``.
    largest : float
        Largest coordinate at the end of a march that lives, over that of the start.
    """

    case: str
    substeps: int
    share: float
    cycles: int
    predicted: str
    found: str
    largest: float

    @property
    def wrong(self) -> bool:
        """Whether the prediction failed."""
        return self.predicted not in ("either", self.found)


def cases(load: Any) -> Iterator[Case]:
    """Yield scenes at rest and linear systems that are hard on purpose; ``load(name, overrides)`` makes a pipeline."""
    for name, overrides in SCENES:
        run: Pipeline = load(name.partition(",")[0], overrides)
        yield Case(name, run.mechanism, *run.reference_matrices)
    for exponent in (-6, -3, 0, 3, 6):
        scale = np.diag([1.0, 10.0 ** (exponent / 2)])
        for beta in (0.0, 0.3):
            M = scale @ np.array([[1.0, beta], [beta, 1.0]]) @ scale
            yield _linear(f"mass ratio 1e{exponent}, β = {beta}", M, scale @ np.diag([0.01, 1.0]) @ scale, 1)
    for n in (1, 20, 200):
        yield _linear(f"{n} modes", np.eye(n + 1), np.diag(np.r_[0.0, np.linspace(1.0, 30.0, n) ** 2]), 1)
    yield _linear("stiffness from 1 to 1e12", np.eye(6), np.diag(np.r_[1e-2, 10.0 ** np.linspace(0, 12, 5)]), 1)
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((4, 4)))[0]
    M = np.eye(5)
    M[1:, 1:] = turn @ np.diag([1e-10, 1.0, 1.0, 1.0]) @ turn.T
    K = np.diag([0.01, 1.0, 4.0, 9.0, 16.0])
    yield _linear("M_SS nearly singular, 1e-10", M, K, 1)


def _linear(name: str, M: Array, K: Array, n_slow: int) -> Case:
    return Case(name, LinearSystem(M, K, n_slow), M, K)


def march_all(found: Iterator[Case], cycles: int = CYCLES) -> Iterator[Row]:
    """March every case at every ratio and share of its limit."""
    for case in found:
        n = len(case.M)
        for m in RATIOS:
            limit = find_limit(case.M, case.K, case.system.n_slow, m).critical_step
            for share in SHARES:
                long = max(2000, int(min(cycles, _WORK / (n * n * m))))
                yield _march(case, m, share, share * limit, long)


def _march(case: Case, m: int, share: float, step: float, cycles: int) -> Row:
    n = len(case.M)
    folds = cycles * np.log(max(growth(case.M, case.K, case.system.n_slow, step, m), 1e-300))
    safe = _DIVERGED - _UNSURE if isinstance(case.system, LinearSystem) else _LARGE
    predicted = "lives" if folds < safe else ("diverges" if folds > _DIVERGED + _UNSURE else "either")
    method = CentralDifference(step) if m == 1 else Subcycling(step, m)
    try:
        end = method.march(case.system, np.full(n, _START), np.zeros(n), np.array([(cycles * m - 1) * step])).end
    except StabilityError:
        return Row(case.name, m, share, cycles, predicted, "diverges", np.inf)
    held = case.K.any(axis=1)  # nothing holds a free angle back
    return Row(case.name, m, share, cycles, predicted, "lives", float(np.abs(end.q[held]).max(initial=0.0) / _START))


def write_rows(rows: list[Row], path: Path) -> None:
    """Write the table as CSV."""
    with whole_file(path) as part, part.open("w", newline="") as file:
        table = csv.DictWriter(file, [*asdict(rows[0]), "wrong"], lineterminator="\n")
        table.writeheader()
        for row in rows:
            table.writerow(asdict(row) | {"largest": f"{row.largest:.4g}", "wrong": int(row.wrong)})


def summary_of_rows(rows: list[Row]) -> list[dict[str, Any]]:
    """Count, for each case, the marches, those that lived and diverged, and the predictions that failed."""
    names = list(dict.fromkeys(row.case for row in rows))
    return [
        {
            "case": name,
            "marches": len(mine := [row for row in rows if row.case == name]),
            "cycles": max(row.cycles for row in mine),
            "lived": sum(row.found == "lives" for row in mine),
            "diverged": sum(row.found == "diverges" for row in mine),
            "undecided": sum(row.predicted == "either" for row in mine),
            "wrong": sum(row.wrong for row in mine),
            "largest": max((row.largest for row in mine if row.found == "lives"), default=0.0),
        }
        for name in names
    ]
