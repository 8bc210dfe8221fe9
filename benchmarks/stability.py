"""March mechanisms long at steps below and above the limits of stability, against the prediction by tangents.

Run from the project's root: ``python benchmarks/stability.py [INTEGRATOR …]``. The cases are scenes about their rest,
spinning bodies, and systems hard on purpose. Rows go to ``stability.csv``; those of other integrators stay.
"""

import sys
from collections.abc import Collection, Iterator
from dataclasses import asdict, dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed

sys.path.append(str(Path(__file__).parents[1]))
from benchmarks.stability_cases import StressCase, case_builders
from benchmarks.table_format import renew_rows
from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError
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
from fmd.stability.tangent import (
    scheme_growth_rates,
    scheme_tangents,
    slope_growth_rates,
    system_slopes,
)

RATIOS = (1, 2, 3, 5, 10, 20)
SHARES = (0.1, 0.5, 0.9, 0.98, 1.02, 1.05)  # of the explicit limit
LONG_SHARES = (0.5, 1.5, 20.0, 1000.0)  # of the same, for methods without one
CYCLES = 1_000_000
_PERIODS = 1e4  # of the lowest frequency, if those are fewer cycles
# Coordinates from on which methods that solve for all at once take long steps only, and reversible sub-cycling none.
_MANY = 30
_SCIPYS = 200  # explicit steps that SciPy's methods march over
_START = 1e-6
_SPINNING = 1e-4  # of that where a vibration that grows takes the spin away and so comes to an end
_GROWN = np.log(1e4)  # e-folds of the largest vibration from which on a march counts as diverged
_UNSURE = np.log(300.0)  # by which a start that is no eigenvector, or an end of an oscillation, may shift that
_NEUTRAL = 1e-5
_LOOKS = 201  # at a march


@dataclass(frozen=True)
class StressTestRow:
    """Prediction (lives, diverges or either) and outcome of one long march.

    ``share`` is the fast step over the largest stable explicit one, ``cycles`` is 0 for a method that chooses its
    steps, ``drift`` the change of the vibrations' energy over that of the start, summed over the scheme's own modes.
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


def march_all(integrators: Collection[str] = ()) -> list[StressTestRow]:
    """March every case by these integrators, or by all, in two processes."""
    marches = [
        (name, k)
        for name in case_builders()
        for k, march in enumerate(_marches(name))
        if not integrators or march.args[1].name in integrators
    ]
    # The longest first, so that none is waited for in the end.
    longest = sorted(marches, key=lambda march: (march[0] != "arm", -len(_case(march[0]).M)))
    rows = Parallel(n_jobs=2)(delayed(_row)(*march) for march in longest)
    found = dict(zip(longest, rows, strict=True))
    return [found[march] for march in marches]


def march_case(
    name: str, cycles: int = CYCLES, ratios: tuple[int, ...] = RATIOS, shares: tuple[float, ...] = SHARES
) -> list[StressTestRow]:
    """March one case by every method, those with an explicit limit at these ratios and shares of it."""
    return [march() for march in _marches(name, cycles, ratios, shares)]


def _row(name: str, k: int) -> StressTestRow:
    return _marches(name)[k]()


@cache
def _case(name: str) -> StressCase:
    return case_builders()[name]()


@cache
def _marches(
    name: str, cycles: int = CYCLES, ratios: tuple[int, ...] = RATIOS, shares: tuple[float, ...] = SHARES
) -> list[partial[StressTestRow]]:
    """Return the marches of one case by every method, as functions; the method is the second argument."""
    case = _case(name)
    return [
        *(partial(_march, case, *chosen, cycles) for chosen in _fixed(case, ratios, shares)),
        *(partial(_march_adaptively, case, *chosen) for chosen in _adaptive(cycles)),
    ]


def _fixed(
    case: StressCase, ratios: tuple[int, ...], shares: tuple[float, ...]
) -> Iterator[tuple[ResumableIntegrator, int, float]]:
    """Yield the methods with a step, their ratios, and the step over the explicit limit."""
    spins = bool(case.at.v.any())
    for m in (1, 5) if spins else ratios:
        limit = find_sudden_step(case.M, case.K, case.system.n_slow, m)[0]
        for share in (0.5, 0.9) if spins else shares:
            if m == 1:
                yield CentralDifference(share * limit), 1, share
            else:
                yield Subcycling(share * limit, m), m, share
    for m in () if len(case.M) >= _MANY else (5,) if spins or case.family == "arm" else (2, 5, 20):
        limit = ReversibleSubcycling(1.0, m).largest_step(case.system)
        for share in (0.5, 0.9) if spins else shares:
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
        left, energies = _modes(scheme_tangents(method, case.system, [case.at], 0.0)[0][0], case)
        folds = float(scheme_growth_rates(method, case.system, [case.at], span)[0, 0]) * cycles * m * h
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
    kept = method.history_size(first)
    sizes = [
        np.concatenate([x.q - y.q, x.v - y.v, x.a - y.a, (x.memory - y.memory)[:kept]])
        for x, y in ((first, base), (there, still))
    ]
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
    folds = float(slope_growth_rates(system_slopes(case.system, [case.at]))[0, 0]) * duration
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


def main() -> None:
    """March by the integrators that are named, or by all, and write ``stability.csv`` beside this file."""
    from benchmarks.stability import march_all  # the processes that march know this module by its name

    rows = [asdict(row) | {"wrong": int(row.wrong)} for row in march_all(sys.argv[1:])]
    rows = [row | {"share": f"{row['share']:g}", "drift": f"{row['drift']:.2e}"} for row in rows]
    cases, methods = [*case_builders()], [*dict.fromkeys(march.args[1].name for march in _marches("beam"))]
    path = Path(__file__).with_suffix(".csv")
    renew_rows(
        path,
        rows,
        ("case", "integrator"),
        lambda row: (cases.index(row["case"]), methods.index(row["integrator"])),
    )


if __name__ == "__main__":
    main()
