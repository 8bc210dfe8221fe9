"""Stress tests of stability: long marches at steps below and above the limits, against the prediction by tangents."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from fmd.bench.stress_cases import StressCase, case_builders
from fmd.core.arrays import Array
from fmd.core.cache import Cache, stage_key
from fmd.core.errors import AccuracyError
from fmd.core.files import whole_file
from fmd.core.paths import cache_folder
from fmd.core.progress import Advance
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.exponential import Exponential
from fmd.integrators.generalized_alpha import GeneralizedAlpha
from fmd.integrators.protocol import Integrator, ResumableIntegrator
from fmd.integrators.reversible import ReversibleSubcycling
from fmd.integrators.rosenbrock import ExponentialRosenbrock
from fmd.integrators.runge_kutta import RungeKutta
from fmd.integrators.scipy_ivp import ScipyIvp
from fmd.integrators.subcycling import Subcycling
from fmd.stability.limits import find_sudden_step
from fmd.stability.tangent import scheme_growth_rates, scheme_tangent, system_growth_rates

RATIOS = (1, 2, 3, 5, 10, 20)
SHARES = (0.1, 0.5, 0.9, 0.98, 1.02, 1.05)  # of the explicit limit
LONG_SHARES = (0.5, 1.5, 20.0, 1000.0)  # of the same, for methods without one
CYCLES = 1_000_000
_PERIODS = 1e4  # of the lowest frequency, if those are fewer cycles
_MANY = 30  # coordinates from on which methods that solve for all of them at once take long steps only
_SCIPYS = 200  # explicit steps that SciPy's methods march over
_START = 1e-6
_SPINNING = 1e-4  # of that where a vibration that grows takes the spin away and so comes to an end
_GROWN = np.log(1e4)  # e-folds of the largest vibration from which on a march counts as diverged
_UNSURE = np.log(300.0)  # by which a start that is no eigenvector, or an end of an oscillation, may shift that
_NEUTRAL = 1e-5
_LOOKS = 201  # at a march
_NO_CACHE = Cache(None)


@dataclass(frozen=True)
class StressTestRow:
    """Prediction and outcome of one long march.

    Attributes
    ----------
    family, case, integrator : str
        Family and name of the case, and the method.
    substeps : int
        Fast steps to a slow one.
    share : float
        Fast step over the largest stable explicit one.
    cycles : int
        Major cycles, 0 for a method that chooses its steps.
    predicted, found : str
        ``lives`` or ``diverges``; the prediction may be ``either``.
    drift : float
        Change of the vibrations' energy, summed over the scheme's own modes, over that of the start; NaN where
        the march diverges.
    """

    family: str
    case: str
    integrator: str
    substeps: int
    share: float
    cycles: int
    predicted: str
    found: str
    drift: float

    @property
    def wrong(self) -> bool:
        """True if the prediction failed."""
        return self.predicted not in ("either", self.found)


def stress_test(folder: Path, advance: Advance) -> list[dict[str, Any]]:
    """March every case, write the table ``stability.csv`` into a folder, and return its summary."""
    rows = march_all(keep=Cache(cache_folder()), advance=advance)
    folder.mkdir(parents=True, exist_ok=True)
    write_rows(rows, folder / "stability.csv")
    return summarise_rows(rows)


def march_all(
    cycles: int = CYCLES, only: tuple[str, ...] = (), keep: Cache = _NO_CACHE, advance: Advance = lambda done: None
) -> list[StressTestRow]:
    """March every case by every method in two processes; marches in the cache aren't repeated."""
    from joblib import Parallel, delayed

    marches = [(name, k) for name in only or case_builders() for k in range(len(_marches(name, cycles)))]
    # The longest first, so that none is waited for in the end.
    longest = sorted(marches, key=lambda march: (march[0] != "arm", -len(_case(march[0]).M)))
    tasks = (delayed(_kept_row)(*march, cycles, keep) for march in longest)
    rows: dict[tuple[str, int], StressTestRow] = {}
    for march, row in zip(longest, Parallel(n_jobs=2, return_as="generator")(tasks), strict=True):
        rows[march] = row
        advance(len(rows) / len(marches))
    return [rows[march] for march in marches]


def march_case(name: str, cycles: int = CYCLES) -> list[StressTestRow]:
    """March one case by every method."""
    return [_row(name, k, cycles) for k in range(len(_marches(name, cycles)))]


def _kept_row(name: str, k: int, cycles: int, keep: Cache) -> StressTestRow:
    from joblib import hash as digest

    case = _case(name)
    inputs = [name, k, cycles, digest((case.M, case.K, case.at))]
    key = stage_key("stress-march", inputs, ("fmd",), ("numba", "numpy", "scipy"))
    row: StressTestRow | None = keep.load(key)
    if row is None:
        row = _row(name, k, cycles)
        keep.save(key, row)
    return row


def _row(name: str, k: int, cycles: int) -> StressTestRow:
    return _marches(name, cycles)[k]()


@cache
def _case(name: str) -> StressCase:
    return case_builders()[name]()


@cache
def _marches(name: str, cycles: int) -> list[Callable[[], StressTestRow]]:
    """Return the marches of one case by every method, as functions."""
    case = _case(name)
    return [
        *(partial(_march, case, *chosen, cycles) for chosen in _fixed(case)),
        *(partial(_march_adaptively, case, *chosen) for chosen in _adaptive(cycles)),
    ]


def _fixed(case: StressCase) -> Iterator[tuple[ResumableIntegrator, int, float]]:
    """Yield the methods with a step, their ratios, and the step over the explicit limit."""
    spins = bool(case.at.v.any())
    for m in (1, 5) if spins else RATIOS:
        limit = find_sudden_step(case.M, case.K, case.system.n_slow, m)[0]
        for share in (0.5, 0.9) if spins else SHARES:
            if m == 1:
                yield CentralDifference(share * limit), 1, share
            else:
                yield Subcycling(share * limit, m), m, share
    for m in (5,) if spins or case.family == "arm" else (2, 5, 20):
        limit = ReversibleSubcycling(1.0, m).largest_step(case.system)
        for share in (0.5, 0.9) if spins else SHARES:
            yield ReversibleSubcycling(share * limit, m), m, share
    plain = 2.0 / case.system.highest_frequency
    long = LONG_SHARES[2:] if len(case.M) >= _MANY else (0.5,) if spins else LONG_SHARES
    for rho in (0.8, 1.0):
        for share in long:
            yield GeneralizedAlpha(share * plain, rho), 1, share
    exact = (50.0,) if len(case.M) >= _MANY else (0.5,) if spins else (0.5, 5.0, 50.0)
    for share in (0.5, 0.98) if case.system.coupled else exact:
        yield Exponential(share * plain), 1, share


def _adaptive(cycles: int) -> Iterator[tuple[Integrator, int]]:
    """Yield the methods that choose their steps, and the number of explicit steps that they march over."""
    steps = max(cycles // 50, 1000)
    yield RungeKutta(1e-9), steps
    yield ExponentialRosenbrock(1e-6), steps
    for name in ("Radau", "LSODA"):
        yield ScipyIvp(name, 1e-6), _SCIPYS


def _march(case: StressCase, method: ResumableIntegrator, m: int, share: float, most: int) -> StressTestRow:
    h, n = method.step, len(case.M)
    cycles = int(min(most, _PERIODS * 2 * np.pi / (case.lowest * m * h) + 1))
    cycles = max(cycles, 1000)
    start, span = _disturbed(case), 1e-3 * cycles * m * h
    try:
        left, energies = _modes(scheme_tangent(method, case.system, case.at, 0.0)[0], case)
        folds = float(scheme_growth_rates(method, case.system, case.at, span)[0]) * cycles * m * h
    except AccuracyError:
        folds = np.inf
    predicted = "lives" if folds < _GROWN - _UNSURE else "diverges" if folds > _GROWN + _UNSURE else "either"
    label = (case.family, case.name, method.name, m, share, cycles, predicted)
    # A vibration that has taken the spin away may be small again in the end: those marches are watched on their way.
    looks = _LOOKS if case.at.v.any() else 1
    times, before = (cycles * m - 1) * h * np.linspace(1.0 / looks, 1.0, looks), np.zeros(1)
    try:
        first = method.march(case.system, *start, before).end
        base = still = method.march(case.system, case.at.q, case.at.v, before).end
        moved = method.resume(case.system, first, times)
        there, on_its_way = moved.end, np.zeros((0, 2 * n))
        if looks > 1:
            spinning = method.resume(case.system, base, times)
            still, on_its_way = spinning.end, np.concatenate([moved.q - spinning.q, moved.v - spinning.v], axis=1)
    except AccuracyError:
        return StressTestRow(*label, "diverges", np.nan)
    sizes = [np.concatenate([x.q - y.q, x.v - y.v, x.a - y.a]) for x, y in ((first, base), (there, still))]
    scale = np.r_[np.full(n, case.lowest), np.ones(n)]
    held = np.tile(case.K.any(axis=1), 2)  # nothing holds a free angle back
    was, now = (np.abs(scale * x[: 2 * n])[held].max() for x in sizes)
    now = max(now, np.abs(scale * on_its_way)[:, held].max(initial=0.0))
    if not now < was * np.exp(_GROWN):
        return StressTestRow(*label, "diverges", np.nan)
    if np.isinf(folds):
        return StressTestRow(*label, "lives", np.nan)  # against the prediction: there are no modes to sum energies over
    earlier, later = (float(np.abs(left @ x) ** 2 @ energies) for x in sizes)
    return StressTestRow(*label, "lives", later / earlier - 1 if earlier else -1.0)  # nothing is left that vibrates


def _modes(A: Array, case: StressCase) -> tuple[Array, Array]:
    """Return the left eigenvectors of one cycle's vibrations, and their energies by the right ones."""
    n = len(case.M)
    values, right = np.linalg.eig(A)
    left = np.linalg.pinv(right)
    chosen = (np.abs(values - 1) > _NEUTRAL) & (np.abs(values) > 1e-3)
    q, v = right[:n], right[n : 2 * n]
    energy = np.einsum("ik,ij,jk->k", v.conj(), case.M, v) + np.einsum("ik,ij,jk->k", q.conj(), case.K, q)
    return left[chosen], energy.real[chosen]


def _disturbed(case: StressCase) -> tuple[Array, Array]:
    """Return a start of the case with small random deflections."""
    rng = np.random.default_rng(0)
    size = (_SPINNING if case.at.v.any() else 1.0) * _START / np.sqrt(np.maximum(case.M.diagonal(), 1e-12))
    return case.at.q + size * rng.uniform(0.5, 1.0, len(case.M)), case.at.v.copy()


def _march_adaptively(case: StressCase, method: Integrator, steps: int) -> StressTestRow:
    """March over many periods, within a number of explicit steps; predicted by the equations of motion."""
    duration = min(1e3 * 2 * np.pi / case.lowest, steps * 2 / case.system.highest_frequency)
    folds = float(system_growth_rates(case.system, case.at)[0]) * duration
    predicted = "lives" if folds < _GROWN - _UNSURE else "diverges" if folds > _GROWN + _UNSURE else "either"
    label = (case.family, case.name, method.name, 1, 0.0, 0, predicted)
    times = np.linspace(0.0, duration, _LOOKS)
    try:
        moved, base = (method.march(case.system, *of, times) for of in (_disturbed(case), (case.at.q, case.at.v)))
    except AccuracyError:
        return StressTestRow(*label, "diverges", np.nan)
    q, v = moved.q - base.q, moved.v - base.v
    energies = [x @ case.K @ x + y @ case.M @ y for x, y in zip(q, v, strict=True)]
    if not max(energies) < energies[0] * np.exp(2 * _GROWN):
        return StressTestRow(*label, "diverges", np.nan)
    return StressTestRow(*label, "lives", float(energies[-1] / energies[0] - 1))


def write_rows(rows: list[StressTestRow], path: Path) -> None:
    """Write the marches as a CSV table."""
    with whole_file(path) as part, part.open("w", newline="") as file:
        table = csv.DictWriter(file, [*asdict(rows[0]), "wrong"], lineterminator="\n")
        table.writeheader()
        for row in rows:
            figures = {"share": f"{row.share:g}", "drift": f"{row.drift:.2e}", "wrong": int(row.wrong)}
            table.writerow(asdict(row) | figures)


def summarise_rows(rows: list[StressTestRow]) -> list[dict[str, Any]]:
    """Count, for each family, the marches, those that lived and diverged, and the predictions that failed."""
    return [
        {
            "family": name,
            "marches": len(mine := [row for row in rows if row.family == name]),
            "cycles": max(row.cycles for row in mine),
            "lived": sum(row.found == "lives" for row in mine),
            "diverged": sum(row.found == "diverges" for row in mine),
            "undecided": sum(row.predicted == "either" for row in mine),
            "wrong": sum(row.wrong for row in mine),
            "drift": max((row.drift for row in mine if row.found == "lives"), default=0.0),
        }
        for name in dict.fromkeys(row.family for row in rows)
    ]
