"""Random mechanisms: steps that live or diverge, and what a motion must not depend on."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from threadpoolctl import threadpool_limits

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.core.cache import Cache
from fmd.core.errors import StabilityError
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.subcycling import Subcycling

SI = {"kg": 1.0, "m": 1.0, "s": 1.0}
MILLIMETRES = {"t": 1e3, "mm": 1e-3, "ms": 1e-3}
SEEDS = st.integers(0, 10**6)


class Writer:
    """Quantities as text in a system of units of mass, length and time: how many SI units each of them is."""

    def __init__(self, units: dict[str, float]) -> None:
        self.names, self.sizes = list(units), list(units.values())

    def __call__(self, value: float, mass: int = 0, length: int = 0, time: int = 0) -> str:
        number, unit = value, []
        for name, size, power in zip(self.names, self.sizes, (mass, length, time), strict=True):
            number /= size**power
            unit += [f"{name}^{power}"] if power else []
        return f"{float(number)!r} {' '.join(unit)}"


def random_scene(seed: int, units: dict[str, float], order: Sequence[int] = ()) -> dict[str, Any]:
    """A tree of one to four bodies, rigid and flexible, on random joints with springs and dampers, in gravity.

    ``order`` is that in which bodies and joints are named.
    """
    rng, write = np.random.default_rng(seed), Writer(units)
    n = int(rng.integers(1, 5))
    bodies, joints, ends = [], [], ["ground"]
    for k in range(n):
        name, flexible = f"part{k}", bool(rng.random() < 0.3)
        places = rng.uniform(-0.3, 0.3, (3, 3)).round(3)
        if flexible:
            bar: dict[str, Any] = {"shape": "bar", "nu": 0.3, "E": write(2e9, 1, -1, -2), "rho": write(1200, 1, -3)}
            bar |= {"length": write(0.3, 0, 1), "depth": write(0.02, 0, 1), "width": write(0.03, 0, 1)}
            bar |= {"mesh": {"element": "hexahedron", "order": 2, "divisions": [8, 1, 1]}}
            bar |= {"modes": {"count": 2, "family": "in-plane bending", "boundary": "joint", "enrich": "none"}}
            bodies.append((name, bar | {"marker": {"inner": {"face": "x-"}, "outer": {"face": "x+"}}}))
        else:
            moments = rng.uniform(0.01, 0.02, 3).round(4)
            rigid = {"shape": "rigid", "mass": write(round(rng.uniform(0.5, 2.0), 3), 1)}
            rigid |= {"centre": [write(x, 0, 1) for x in places[0]], "inertia": [write(x, 1, 2) for x in moments]}
            markers = {"inner": {"at": [write(0.0, 0, 1)] * 3}, "outer": {"at": [write(x, 0, 1) for x in places[1]]}}
            bodies.append((name, rigid | {"marker": markers}))
        kind = "revolute" if flexible else str(rng.choice(["revolute", "prismatic", "spherical", "free", "fixed"]))
        kind = "revolute" if k == 0 and kind == "fixed" else kind
        joint: dict[str, Any] = {"type": kind, "parent": str(rng.choice(ends)), "child": f"{name}.inner"}
        if kind in ("revolute", "prismatic"):
            turns = 0 if kind == "prismatic" else 2  # N m against N/m: two lengths more
            joint |= {"axis": [0, 0, 1] if flexible else rng.normal(size=3).round(2).tolist()}
            joint |= {"spring": write(round(rng.uniform(5, 20), 2), 1, turns, -2)}
            joint |= {"damper": write(round(rng.uniform(0.01, 0.05), 4), 1, turns, -1)}
            joint |= {"rate": f"{rng.normal():.3f} rad/s" if turns else write(round(rng.normal(), 3), 0, 1, -1)}
        joints.append((f"joint{k}", joint))
        ends.append(f"{name}.outer")
    order = order or range(n)
    return {
        "title": "random",
        "body": dict(bodies[k] for k in order),
        "joint": dict(joints[k] for k in order),
        "simulation": {
            "duration": write(0.2, 0, 0, 1),
            "step": write(1e-4, 0, 0, 1),
            "output_step": write(0.01, 0, 0, 1),
            "gravity": [write(x, 0, 1, -2) for x in (0.0, -9.81, 0.0)],
            "tip": f"part{n - 1}.outer",
            "run": [{"integrator": "central-difference"}],
        },
    }


def written(table: dict[str, Any]) -> str:
    """Inline TOML of a table."""

    def value(x: Any) -> str:
        if isinstance(x, dict):
            return "{ " + ", ".join(f"{key} = {value(item)}" for key, item in x.items()) + " }"
        return "[" + ", ".join(value(item) for item in x) + "]" if isinstance(x, list) else repr(x).replace("'", '"')

    return "\n".join(f"{key} = {value(x)}" for key, x in table.items()) + "\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("random")


def load(folder: Path, seed: int, units: dict[str, float] = SI, order: Sequence[int] = (), **kept: Any) -> Pipeline:
    path = folder / "random.toml"
    path.write_text(written(random_scene(seed, units, order)))
    return Pipeline(load_scene(path), **kept)


def tip(run: Pipeline) -> Array:
    motion: Any = run.motion
    return np.asarray(motion.tip_position)


@pytest.mark.slow
@settings(max_examples=6)
@given(seed=SEEDS, m=st.integers(1, 8), share=st.floats(0.02, 3.0))
def test_a_march_ends_in_numbers_or_says_when_and_where_it_diverged(
    folder: Path, seed: int, m: int, share: float
) -> None:
    run = load(folder, seed)
    limit = min(2.0 / run.system.highest_frequency, 0.05)
    method = CentralDifference(share * limit) if m == 1 else Subcycling(share * limit / m, m)
    times = np.linspace(0.0, 400 * share * limit, 9)
    try:
        found = method.march(run.system, *run.start, times)
    except StabilityError as error:
        told = re.search(r"diverged at t = (\S+) s, most in coordinate (\d+)", str(error))
        assert told
        assert 0 < float(told[1]) <= times[-1] + m * method.step * 1.001
        assert int(told[2]) < run.mechanism.n
        return
    assert np.isfinite(found.q).all()
    assert np.isfinite(found.v).all()


@pytest.mark.long
@settings(max_examples=20)
@given(seed=SEEDS, m=st.integers(1, 8))
def test_a_motion_does_not_depend_on_the_times_asked_for(folder: Path, seed: int, m: int) -> None:
    run, method = load(folder, seed), Subcycling(1e-4, m)
    coarse = np.linspace(0.0, 0.05, 6)
    fine = np.sort(np.r_[coarse, np.random.default_rng(seed).uniform(0.0, 0.05, 40)])
    try:
        one = method.march(run.system, *run.start, coarse)
    except StabilityError as error:  # flexible bodies on joints couple: then it is told alike, at the same time;
        # an output within a major cycle may see the rates earlier on their way to infinity
        when = str(error).partition(",")[0]
        with pytest.raises(StabilityError, match=re.escape(when)):
            method.march(run.system, *run.start, fine)
        return
    other = method.march(run.system, *run.start, fine)
    rows = np.searchsorted(fine, coarse)
    assert np.array_equal(other.q[rows], one.q)
    assert np.array_equal(other.v[rows], one.v)


@pytest.mark.slow
@settings(max_examples=3)
@given(seed=SEEDS)
def test_a_motion_does_not_depend_on_units(folder: Path, seed: int) -> None:
    metres, millimetres = (tip(load(folder, seed, units)) for units in (SI, MILLIMETRES))
    assert millimetres == pytest.approx(metres, abs=1e-10)


@pytest.mark.long
@settings(max_examples=20)
@given(seed=SEEDS)
def test_a_motion_does_not_depend_on_the_order_in_which_bodies_are_named(folder: Path, seed: int) -> None:
    n = len(random_scene(seed, SI)["body"])
    turned = np.random.default_rng(seed + 1).permutation(n).tolist()
    assert tip(load(folder, seed, order=turned)) == pytest.approx(tip(load(folder, seed)), abs=1e-10)


def test_a_motion_does_not_depend_on_the_number_of_threads(folder: Path) -> None:
    """From the mesh on, nothing kept: BLAS sums in other orders, the kernels of a march use one thread each."""
    seed = next(k for k in range(100) if any(b["shape"] == "bar" for b in random_scene(k, SI)["body"].values()))
    found = []
    for threads in (1, 2):
        with threadpool_limits(threads):
            run = load(folder, seed, cache=Cache(None))
            found.append((tip(run), np.concatenate([body.omega for body in run.bodies.values()])))
    assert found[1][0] == pytest.approx(found[0][0], abs=1e-9)
    assert found[1][1] == pytest.approx(found[0][1], rel=1e-9)
