"""What the tests of integrators share: the beam of the scene, its motion by SciPy, random bodies, measured orders."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.mechanism import Mechanism
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.protocol import evaluate_state
from fmd.integrators.reversible import ReversibleSubcycling
from fmd.integrators.subcycling import Subcycling
from fmd.recovery.motion import Motion
from fmd.reduction.body import FlexibleBody, MarkerShapes
from fmd.reduction.inertia import inertia_integrals
from tests.dynamics.hinged_body import body_of, hinged

Method = Callable[[float], CentralDifference | Subcycling | ReversibleSubcycling]
Spin = tuple[Array, Array]


def random_body(n: int, seed: int, kind: str = "conforming", far: float = 0.0) -> FlexibleBody:
    """Make a body of 10 points with n random shapes, which the spin couples with each other.

    Parameters
    ----------
    kind : str
        ``coupled`` shapes couple with the spin through the mass matrix as well; ``conforming`` ones only once the body
        is deformed; ``uncoupled`` ones never, for they move the points along their arms and along the axis.
    far : float
        Distance from the axis of two more points that no shape moves [m].
    """
    rng = np.random.default_rng(seed)
    e = rng.normal(size=3)
    e /= np.linalg.norm(e)
    x, B, Phi = rng.normal(size=(10, 3)), rng.normal(size=(10, 10)), rng.normal(size=(10, 3, n))
    spin = np.cross(e, x)
    m = np.diag(rng.uniform(0.5, 1.5, 10)) + B @ B.T / 10
    if kind == "uncoupled":
        m = np.diag(m.diagonal())
        Phi = np.cross(spin, e)[:, :, None] * Phi[:, :1] + e[:, None] * Phi[:, 1:2]
    elif kind == "conforming":
        Phi -= spin[:, :, None] * (np.einsum("ia,ij,jak->k", spin, m, Phi) / np.einsum("ia,ij,ja->", spin, m, spin))
    L = np.linalg.cholesky(np.einsum("iak,ij,jal->kl", Phi, m, Phi))
    Phi = np.linalg.solve(L, Phi.reshape(30, n).T).T.reshape(10, 3, n)  # unit modal mass
    if far:
        away = far * np.cross(e, [1.0, 0.0, 0.0])
        x, Phi = np.vstack([x, away, -away]), np.concatenate([Phi, np.zeros((2, 3, n))])
        m = np.pad(m, (0, 2)) + np.diag([0.0] * 10 + [1.0] * 2)
    integrals = inertia_integrals(x, m, Phi)
    H = np.einsum("ia,ij,jak->k", np.cross(e, x), m, Phi)
    J = float(e @ integrals.inertia(np.eye(1, 1 + n)[0]) @ e)
    return FlexibleBody(
        x=x,
        shapes=Phi,
        omega=np.sort(rng.uniform(3.0, 12.0, n)),
        axis=e,
        joint="joint",
        markers={"joint": MarkerShapes(np.zeros(3), np.zeros((3, n)), 0.3 * rng.normal(size=(3, n)))},
        integrals=integrals,
        coupling=float(np.linalg.norm(H) / np.sqrt(J)),
    )


def by_dop853(rotor: CompiledSystem, q0: Array, v0: Array, times: Array) -> tuple[Array, Array]:
    """Integrate by SciPy's DOP853, started afresh where the torque has a kink; coordinates and rates at ``times``."""
    n, state, slope = rotor.n, np.concatenate([q0, v0]), np.empty(2 * rotor.n)
    evaluate = evaluate_state.bind((rotor.parameters, state, slope), n, 0.0)

    def rates(t: float, y: Array) -> Array:
        state[:] = y
        evaluate(n, t)
        return slope.copy()

    last = float(times[-1])
    kinks = [t for t in rotor.breakpoints if 0.0 < t < last]
    y, begin, pieces = np.concatenate([q0, v0]), 0.0, []
    for end in (*kinks, last):
        inside = times[(times >= begin) & (times < end)] if end < last else times[times >= begin]
        wanted = np.union1d(inside, [end])
        solution = solve_ivp(rates, (begin, end), y, method="DOP853", rtol=1e-11, atol=1e-16, t_eval=wanted)
        pieces.append(solution.y[:, np.isin(wanted, inside)])
        y, begin = solution.y[:, -1], end
    both = np.concatenate(pieces, axis=1).T
    return both[:, :n], both[:, n:]


def measured_order(steps: Array, errors: Array) -> float:
    """Slope of error over step in logarithms."""
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


@pytest.fixture(scope="session")
def body() -> Callable[..., FlexibleBody]:
    return random_body


@pytest.fixture(scope="session")
def reference_of() -> Callable[..., tuple[Array, Array]]:
    return by_dop853


@pytest.fixture(scope="session")
def order_of() -> Callable[[Array, Array], float]:
    return measured_order


@pytest.fixture(scope="session")
def rotor() -> CompiledSystem:
    """The beam on its joint, in joint-conforming modes, and its drive."""
    return Pipeline(load_scene("beam-paper")).system


@pytest.fixture(scope="session")
def beam(rotor: CompiledSystem) -> Mechanism:
    """The mechanism that it marches."""
    return rotor.mechanism


@pytest.fixture(scope="session")
def free_rotor() -> CompiledSystem:
    """The same beam in the frame of its free modes."""
    return Pipeline(load_scene("beam-paper", ["simulation.frame=free"])).system


@pytest.fixture(scope="session")
def coasting(rotor: CompiledSystem) -> CompiledSystem:
    """The beam without its drive."""
    return hinged(body_of(rotor))


@pytest.fixture(scope="session")
def exact(rotor: CompiledSystem, beam: Mechanism) -> Motion:
    """The beam's motion over the first 0.2 s, twice its pulse, at the scene's output times, by DOP853."""
    times, rest = np.arange(401) * 5e-4, np.zeros(rotor.n)
    blank = CentralDifference(1e-5).march(rotor, rest, rest, times[:1])
    q, v = by_dop853(rotor, rest, rest, times)
    return Motion(beam, replace(blank, times=times, q=q, v=v), "beam.tip")


def _sub_cycled(m: int) -> Method:
    return lambda step: Subcycling(step, m)


def _reversible(m: int) -> Method:
    return lambda step: ReversibleSubcycling(step, m)


METHODS: dict[str, Method] = {
    "plain": CentralDifference,
    **{f"{m}:1": _sub_cycled(m) for m in (1, 2, 5, 10)},
    **{f"reversible {m}:1": _reversible(m) for m in (2, 5)},
}


@pytest.fixture(scope="session", params=METHODS.values(), ids=METHODS.keys())
def method(request: pytest.FixtureRequest) -> Method:
    """Each method in turn, as a function of its fast step."""
    return request.param
