"""Other programs beside ours, by turns in one process: least times for an error, written to peers.csv.

Run from the project's root: ``python benchmarks/peers.py``, or with the names of some rows, after ``pip install
exudyn==1.13.6 heyoka==7.13.2 pin==4.1.0 mujoco==4.0.0``. Each program's methods are refined until the tip is as exact
as wanted; the fastest setting of each then takes turns with ours.

- Exudyn's twins are those of `exudyn_peer`, `exudyn_chains` and `exudyn_loops`, heyoka's equations those of
  `heyoka_peer`, with our meshes and modes; arm and robot are without geometric stiffening.
- Rigid chains have hinges about z and y in turns; the seven-joint arm has the lengths and, nearly, the masses of a KUKA
  LBR iiwa. Ours is a whole step of central differences, MuJoCo's one of its semi-implicit Euler method (``mj_step`` of
  many steps at a time), without contacts and constraints. Pinocchio's ``aba`` finds accelerations alone, and is called
  from Python: what it takes of a model without joints is subtracted.
- Sweeps are of the rod and slider over its spring, a point of each, in one process: ours with one result by name, by
  `fmd.sweep.work.compute_points`; Exudyn's ``ParameterVariation`` over a function that builds and marches a mechanism.
"""

import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import exudyn_chains
import exudyn_loops
import exudyn_peer
import heyoka_peer
import numpy as np
from exudyn_march import IMPLICIT, STAGES, import_exudyn, marches, relative_error, sample_times, samples_of
from exudyn_march import march as march_peer
from few_modes import few_modes
from table_format import HERE, machine, renew_rows

from fmd import Pipeline, load_scene
from fmd.core.errors import AccuracyError
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.exponential import Exponential
from fmd.integrators.generalized_alpha import GeneralizedAlpha
from fmd.integrators.rosenbrock import ExponentialRosenbrock
from fmd.integrators.runge_kutta import RungeKutta
from fmd.sweep.points import combine, make_points, parse_variations
from fmd.sweep.record import Wanted
from fmd.sweep.work import compute_points

TABLE = HERE / "peers.csv"
ERRORS = (1e-3, 1e-6)
MOST_SECONDS, TURNS, ALL_TURNS = 2.0, 15, 10.0  # of a march; turns, and their seconds in all, after three
TOLERANCES = tuple(10.0**-k for k in np.arange(2.0, 11.0, 0.5))
COUNTS = tuple(round(20 * 2 ** (k / 2)) for k in range(24))  # of steps
SWEPT, POINTS = "joint.slide.spring", 64


@dataclass
class Attempt:
    """A method at a setting, its error, and what marches once more and returns its seconds."""

    method: str
    error: float
    march: Callable[[], float]


@dataclass
class Row:
    """What two programs take for the same."""

    what: str
    error: str
    method: str
    seconds: float
    peer: str
    peer_seconds: float
    ratio: float


def own_attempts(run: Pipeline, error_of: Callable[[Any], float], exact: Any) -> Iterator[Iterator[Attempt]]:
    """March by each of our methods, coarse to fine; a method that doesn't suit the mechanism has no attempts."""
    system, start, duration = run.system, run.start, run.scene.simulation.duration
    times, ends = sample_times(duration), np.array([0.0, duration])

    def attempts(kind: Any, settings: Iterable[float]) -> Iterator[Attempt]:
        for setting in settings:
            method = kind(float(setting))
            if not method.suits(system) or (kind in fixed and not method.step < method.largest_step(system)):
                continue
            try:
                error = error_of(method.march(system, *start, times))
            except (AccuracyError, ValueError):  # diverged, or of no use for this mechanism
                continue
            yield Attempt(method.name, error, lambda method=method: method.march(system, *start, ends).seconds)

    steps = [duration / count for count in COUNTS]
    longest = CentralDifference(1.0).largest_step(system)
    stable = [longest * 0.95 * 2.0 ** (-k / 2) for k in range(24)] if np.isfinite(longest) else steps
    fixed = {CentralDifference: stable, Exponential: steps, GeneralizedAlpha: steps}
    for kind in (RungeKutta, ExponentialRosenbrock):
        yield attempts(kind, TOLERANCES)
    for kind, tried in fixed.items():
        yield attempts(kind, tried)


def exudyn_attempts(name: str, run: Pipeline) -> Iterator[Iterator[Attempt]]:
    """March by each of Exudyn's solvers, coarse to fine."""

    def attempts(twin: Any, solver: str, error: Callable[[Any], float], counts: Any) -> Iterator[Attempt]:
        for _, _, found, march in marches(twin, run.scene.simulation.duration, solver, counts, error):
            yield Attempt(f"Exudyn {solver}", found, march)

    if name in exudyn_peer.CASES:
        case = exudyn_peer.CASES[name]()
        for solver in (IMPLICIT[0], *STAGES):
            yield attempts(case.build(solver in STAGES), solver, case.error, exudyn_peer.COUNTS)
    elif name in exudyn_chains.CASES:
        _, error = exudyn_chains.prepare(name)
        for solver in IMPLICIT:
            yield attempts(exudyn_chains.CASES[name][1](run), solver, error, exudyn_chains.COUNTS)
    else:
        loop = exudyn_loops.CASES[name]
        counts = [exudyn_loops.COARSEST * 2**k for k in range(exudyn_loops.HALVINGS)]
        for solver in IMPLICIT:
            yield attempts(loop.build(run), solver, relative_error(loop.exact(run)), counts)


def reached(series: Iterable[Iterator[Attempt]]) -> dict[float, Attempt]:
    """Return the fastest attempt for each error; each series ends where all are reached, or a march takes too long."""
    found: dict[float, list[Attempt]] = {error: [] for error in ERRORS}
    for attempts in series:
        left = set(ERRORS)
        for attempt in attempts:
            for error in [error for error in left if attempt.error <= error]:
                found[error].append(attempt)
                left.remove(error)
            if not left or attempt.march() > MOST_SECONDS:
                break
    return {error: min(each, key=lambda x: min(x.march() for _ in range(3))) for error, each in found.items() if each}


def by_turns(*marched: Callable[[], float]) -> list[float]:
    """Return the least seconds of each, which take turns, or processor seconds: long marches are interrupted."""
    least, begin = [np.inf] * len(marched), time.perf_counter()
    for turn in range(TURNS):
        for k, march in enumerate(marched):
            tick = time.process_time()
            least[k] = min(least[k], march())
            least[k] = min(least[k], time.process_time() - tick)
        if turn >= 2 and time.perf_counter() - begin > ALL_TURNS:
            break
    return least


def compare_marches(name: str) -> Iterator[Row]:
    """Compare the marches of a scene."""
    scene, overrides = SCENES[name]
    run = Pipeline(load_scene(scene, list(overrides)))
    exact = RungeKutta(1e-13).march(run.system, *run.start, sample_times(run.scene.simulation.duration))
    if name in exudyn_loops.CASES:
        from fmd.recovery.motion import Motion

        loop = exudyn_loops.CASES[name]
        off, tip = relative_error(loop.exact(run)), run.scene.simulation.tip
        ours = reached(own_attempts(run, lambda found: off(loop.figures(Motion(run.mechanism, found, tip))), exact))
    else:
        errors = heyoka_peer.errors_of(run)
        ours = reached(own_attempts(run, lambda found: errors(found, exact).tip, exact))
    peers = {"Exudyn": reached(exudyn_attempts(name, run))}
    if name in heyoka_peer.CASES:
        taylor = (Attempt("heyoka", error.tip, march) for error, _, march in heyoka_peer.taylor_marches(run))
        peers["heyoka"] = reached([taylor])
    for peer, found in peers.items():
        for error in ERRORS:
            own, other = ours[error], found.get(error)
            if other is None:
                yield Row(name, f"{error:g}", own.method, by_turns(own.march)[0], peer, np.nan, np.nan)
                continue
            seconds, others = by_turns(own.march, other.march)
            yield Row(name, f"{error:g}", own.method, seconds, other.method, others, others / seconds)


def chain(count: int) -> list[tuple[str, list[float], float, list[float], list[float]]]:
    """Return axis, place, mass, centre and moments of each link of a chain."""
    return [
        ("zy"[k % 2], [0.2 * (k > 0), 0.0, 0.0], 0.5, [0.1, 0.01, 0.005], [1e-3, 2e-3, 1.5e-3]) for k in range(count)
    ]


def arm() -> list[tuple[str, list[float], float, list[float], list[float]]]:
    """Return the links of an arm with seven joints."""
    lengths, masses = (0.34, 0.0, 0.4, 0.0, 0.4, 0.0, 0.126), (3.5, 3.5, 4.0, 3.5, 3.5, 3.5, 1.2)
    return [
        ("zy"[k % 2], [0.0, 0.0, length], mass, [0.0, 0.03, 0.1], [0.02 * mass, 0.018 * mass, 0.005 * mass])
        for k, (length, mass) in enumerate(zip(lengths, masses, strict=True))
    ]


CHAINS = {"rigid chain of 10": chain(10), "rigid chain of 50": chain(50), "seven-joint arm": arm()}
AXES = {"z": [0, 0, 1], "y": [0, 1, 0]}
STEP, STEPS, PULL = 1e-5, 400, [0.0, -9.81, 0.0]


def rigid_scene(links: list[Any]) -> dict[str, Any]:
    """Return the scene of rigid links on hinges."""
    bodies, joints, parent = {}, {}, "ground"
    for k, (axis, _, mass, centre, moments) in enumerate(links):
        ahead = links[k + 1][1] if k + 1 < len(links) else [0.0, 0.0, 0.0]
        markers = {"base": {"at": 3 * ["0 m"]}, "end": {"at": [f"{x} m" for x in ahead]}}
        bodies[f"link{k}"] = {
            "shape": "rigid",
            "mass": f"{mass} kg",
            "centre": [f"{x} m" for x in centre],
            "inertia": [f"{x} kg m^2" for x in moments],
            "marker": markers,
        }
        hinge = {"type": "revolute", "parent": parent, "child": f"link{k}.base", "axis": AXES[axis]}
        joints[f"hinge{k}"] = hinge | {"angle": "0.1 rad", "rate": "0.1 rad/s"}
        parent = f"link{k}.end"
    simulation = {
        "duration": f"{STEP * STEPS} s",
        "step": f"{STEP} s",
        "output_step": f"{STEP * STEPS} s",
        "gravity": [f"{x} m/s^2" for x in PULL],
        "tip": parent,
        "run": [{"integrator": "central-difference"}],
    }
    return {"title": "Rigid links", "body": bodies, "joint": joints, "simulation": simulation}


def pinocchio_model(links: list[Any]) -> Any:
    import pinocchio as pin

    model, parent = pin.Model(), 0
    for k, (axis, place, mass, centre, moments) in enumerate(links):
        joint = pin.JointModelRZ() if axis == "z" else pin.JointModelRY()
        parent = model.addJoint(parent, joint, pin.SE3(np.eye(3), np.array(place)), f"hinge{k}")
        model.appendBodyToJoint(parent, pin.Inertia(mass, np.array(centre), np.diag(moments)), pin.SE3.Identity())
    model.gravity.linear = np.array(PULL)
    return model


def mujoco_model(links: list[Any]) -> Any:
    import mujoco

    pull = " ".join(map(str, PULL))
    text = f'<mujoco><option timestep="{STEP}" integrator="Euler" gravity="{pull}">'
    text += '<flag contact="disable" constraint="disable"/></option><worldbody>'
    for axis, place, mass, centre, moments in links:
        turned, (at, com, inertia) = AXES[axis], (" ".join(map(str, x)) for x in (place, centre, moments))
        text += f'<body pos="{at}"><joint type="hinge" axis="{turned[0]} {turned[1]} {turned[2]}"/>'
        text += f'<inertial mass="{mass}" pos="{com}" diaginertia="{inertia}"/>'
    return mujoco.MjModel.from_xml_string(text + len(links) * "</body>" + "</worldbody></mujoco>")


def compare_links(name: str) -> Iterator[Row]:
    """Compare a step of rigid links, whose accelerations are to be the same."""
    import mujoco
    import pinocchio as pin

    links, n = CHAINS[name], len(CHAINS[name])
    run = Pipeline(load_scene(rigid_scene(links)))
    (q, v), method, ends = run.start, CentralDifference(STEP), np.array([0.0, STEP * STEPS])
    model, empty, physics = pinocchio_model(links), pin.Model(), mujoco_model(links)
    data, nothing, state = model.createData(), empty.createData(), mujoco.MjData(physics)
    none, torque = np.zeros(0), np.zeros(n)
    state.qpos[:], state.qvel[:] = q, v
    mujoco.mj_forward(physics, state)
    wanted = run.system.accelerations(0.0, q, v)
    for found in (pin.aba(model, data, q, v, torque), state.qacc):
        if not np.abs(found - wanted).max() < 1e-9 * np.abs(wanted).max():
            raise AccuracyError(f"{name}: accelerations differ by {np.abs(found - wanted).max():.1e}")

    def own() -> float:
        return float(method.march(run.system, q, v, ends).seconds) / STEPS

    def articulated(model: Any = model, data: Any = data, x: Any = q, rate: Any = v, load: Any = torque) -> float:
        tick = time.perf_counter()
        for _ in range(STEPS):
            pin.aba(model, data, x, rate, load)
        return (time.perf_counter() - tick) / STEPS

    def stepped() -> float:
        mujoco.mj_resetData(physics, state)
        state.qpos[:], state.qvel[:] = q, v
        tick = time.perf_counter()
        mujoco.mj_step(physics, state, STEPS)
        return (time.perf_counter() - tick) / STEPS

    seconds, aba, called, euler = np.min(
        [by_turns(own, articulated, lambda: articulated(empty, nothing, none, none, none), stepped) for _ in range(4)],
        0,
    )
    for peer, others in ((f"Pinocchio {pin.__version__}", aba - called), (f"MuJoCo {mujoco.__version__}", euler)):
        yield Row(name, "", "central-difference", seconds, peer, others, others / seconds)


def compare_sweeps(name: str) -> Iterator[Row]:
    """Compare a point of a sweep of the rod and slider over its spring; Exudyn's error is 1e-3 at most."""
    from exudyn.processing import ParameterVariation

    import_exudyn()
    case, run = exudyn_peer.rod_slider(), Pipeline(load_scene("rod-slider"))
    best, settings = np.inf, ("", 0)
    for solver in (IMPLICIT[0], *STAGES):
        for count, _, error, march in marches(case.build(False), case.duration, solver, exudyn_peer.COUNTS, case.error):
            if error < ERRORS[0]:
                if (seconds := min(march() for _ in range(TURNS))) < best:
                    best, settings = seconds, (solver, count)
                break

    def build_and_march(parameters: dict[str, float]) -> float:
        twin = exudyn_peer.rod_slider_twin(run, parameters["spring"])
        march_peer(twin, case.duration, *settings, output=True)
        return float(samples_of(twin)[0][-1, 1])

    def vary() -> float:
        tick = time.process_time()
        ParameterVariation(build_and_march, {"spring": (900.0, 1100.0, POINTS)}, showProgress=False)
        return (time.process_time() - tick) / POINTS

    variations = parse_variations([f"{SWEPT}=900..1100:{POINTS} N/m"])
    points = {p.key: p.scene for p in make_points("rod-slider", variations, (), combine(variations), all_runs=False)}
    wanted = Wanted(results=("slider.centre.position.x",))

    def own() -> float:
        tick = time.process_time()
        records = [record for _, record in compute_points(points, wanted)]
        assert all(record.status == "ok" for record in records)
        return (time.process_time() - tick) / POINTS

    own()
    seconds, others = by_turns(own, vary)
    peer = f"Exudyn {settings[0]}"
    yield Row(name, f"{ERRORS[0]:g}", "as the scene has it", seconds, peer, others, others / seconds)


SCENES: dict[str, tuple[str, tuple[str, ...]]] = {
    "rod-slider": ("rod-slider", ()),
    "beam": ("beam-paper", ()),
    "arm": ("arm", (*few_modes("arm"), "simulation.stiffening=off")),
    "robot": (str(HERE / "scenes" / "robot.toml"), ("simulation.stiffening=off",)),
    "double-four-bar": (str(HERE / "scenes" / "double-four-bar.toml"), ()),
}
COMPARED: dict[str, Callable[[str], Iterator[Row]]] = {
    **dict.fromkeys(SCENES, compare_marches),
    **dict.fromkeys(CHAINS, compare_links),
    "sweep of the rod-slider, a point": compare_sweeps,
}


def main() -> None:
    """Compare all, or what the command names."""
    order = list(COMPARED)
    for name in sys.argv[1:] or order:
        rows = []
        for row in COMPARED[name](name):
            print(row, flush=True)
            rows.append(row)
        renew_rows(TABLE, rows, ("what",), lambda row: order.index(str(row["what"])), machine())


if __name__ == "__main__":
    main()
