"""Mechanisms about a state, whose marches `stability.py` compares with what tangents predict."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.few_modes import few_modes
from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.stability.operating_points import settle
from fmd.stability.tangent import OperatingPoint
from tests.linear_system import LinearSystem

_BEAM_AT_REST = "drive.spin_up.speed=0 rad/s"
SCENES = {
    "rod-slider": ("rod-slider", ("drive.motor.torque=0 N m",)),
    "beam": ("beam-paper", (_BEAM_AT_REST,)),
    "beam, free frame": ("beam-paper", (_BEAM_AT_REST, 'simulation.frame="free"')),
    "arm": ("arm", (*few_modes("arm"), 'drive.swing.torque="0 N m"')),
}
SPEEDS = (0.0, 0.5, 0.9, 1.1, 1.5, 2.0, 3.0)  # over the first frequency


@dataclass(frozen=True)
class StressCase:
    """Mechanism about a state that it keeps but for small vibrations; M and K at rest, slow coordinates first."""

    family: str
    name: str
    system: Any
    at: OperatingPoint
    M: Array
    K: Array

    @property
    def lowest(self) -> float:
        """Lowest angular frequency that isn't 0 [rad/s]."""
        squares = np.sort(np.linalg.eigvals(np.linalg.solve(self.M, self.K)).real)
        return float(np.sqrt(squares[len(squares) - np.linalg.matrix_rank(self.K)]))


Builder = Callable[[], StressCase]


def case_builders() -> dict[str, Builder]:
    """Return the functions that build the cases, by name."""
    cases: dict[str, Builder] = {name: _of_scene(name) for name in SCENES}
    for stiffened in (False, True):
        for speed in SPEEDS:
            cases[f"beam at {speed:g} ω₁, {'stiffened' if stiffened else 'linear'}"] = _spinning(speed, stiffened)
    for exponent in (-6, -3, 0, 3, 6):
        for beta in (0.0, 0.3):
            cases[f"mass ratio 1e{exponent}, β = {beta}"] = _of_masses(exponent, beta)
    for n in (1, 20, 200):
        modes = np.diag(np.r_[0.0, np.linspace(1.0, 30.0, n) ** 2])
        cases[f"{n} modes"] = _linear("1 to 200 modes", f"{n} modes", np.eye(n + 1), modes)
    spread = np.diag(np.r_[1e-2, 10.0 ** np.linspace(0, 12, 5)])
    cases["stiffness from 1 to 1e12"] = _linear("stiffness from 1 to 1e12", "", np.eye(6), spread)
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((4, 4)))[0]
    M = np.eye(5)
    M[1:, 1:] = turn @ np.diag([1e-10, 1.0, 1.0, 1.0]) @ turn.T
    cases["M_SS nearly singular, 1e-10"] = _linear(
        "M_SS nearly singular, 1e-10", "", M, np.diag([0.01, 1.0, 4.0, 9.0, 16.0])
    )
    return cases


def _linear(family: str, name: str, M: Array, K: Array) -> Builder:
    rest = OperatingPoint(0.0, np.zeros(len(M)), np.zeros(len(M)))
    return lambda: StressCase(family, name or family, LinearSystem(M, K, 1), rest, M, K)


def _of_masses(exponent: int, beta: float) -> Builder:
    scale = np.diag([1.0, 10.0 ** (exponent / 2)])
    M = scale @ np.array([[1.0, beta], [beta, 1.0]]) @ scale
    K = scale @ np.diag([0.01, 1.0]) @ scale
    return _linear(f"mass ratio 1e-6 … 1e6, β = {beta}", f"mass ratio 1e{exponent}, β = {beta}", M, K)


def _of_scene(name: str) -> Builder:
    def build() -> StressCase:
        scene, overrides = SCENES[name]
        run = Pipeline(load_scene(scene, list(overrides)))
        q0, _ = run.start
        q0 = q0 if name == "arm" else np.zeros_like(q0)  # the arm hangs
        return StressCase(
            name, name, run.system, OperatingPoint(0.0, q0, np.zeros(run.system.n)), *run.reference_matrices
        )

    return build


def _spinning(speed: float, stiffened: bool) -> Builder:
    """Return the builder of the beam that turns freely at a rate given over its first frequency."""

    def build() -> StressCase:
        run = Pipeline(
            load_scene("beam-paper", ["drive={}", f"simulation.stiffening='{'on' if stiffened else 'off'}'"])
        )
        system = run.system
        rates = np.r_[speed * run.body.omega[0], np.zeros(system.n - 1)]
        (at,) = settle(system, [OperatingPoint(0.0, np.zeros(system.n), rates)], np.arange(1, system.n))
        family = f"beam, 0 … 3 ω₁, {'stiffened' if stiffened else 'without geometric stiffening'}"
        name = f"beam at {speed:g} ω₁, {'stiffened' if stiffened else 'linear'}"
        return StressCase(family, name, system, at, *run.reference_matrices)

    return build
