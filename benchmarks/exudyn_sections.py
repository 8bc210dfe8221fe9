"""What keeps Exudyn's spatial robot from ours: how its marker on a section hands torques on to the modes.

Run from the project's root: ``python benchmarks/exudyn_sections.py``; it needs ``pip install exudyn==1.13.6``.

A section of a deformed body is turned by ``exp(θ̃)`` with θ = Φ q. The rate of that rotation is
``T(θ) Φ q̇`` with ``T = 1 + ½ θ̃ + …`` in the frame's axes, so a torque M along these axes acts on the modes by
``(T Φ)ᵀ M``. The first table reads the forces on the modes that a torque on Exudyn's ``MarkerSuperElementRigid`` makes,
for all its ways to take a rotation (``rotationsExponentialMap``), and compares them with Φ, with T and with ``Tᵀ = 1 −
½ θ̃ + …``, which belongs to the section's own axes. The second table marches the robot, with links of several
stiffnesses and with its elbow's axis along the shoulder's, where sections turn about one axis and T changes nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from exudyn_chains import CASES, flexible, robot
from exudyn_march import import_exudyn, march, relative_error, sample_times, samples_of

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.integrators.runge_kutta import RungeKutta
from fmd.recovery.motion import Motion

TURN = np.array([-0.017, -0.010, -0.001])  # of the section [rad]
STEPS = (6400, 12800)  # whose errors of second order are extrapolated away


def tangent(theta: Array, sign: float) -> Array:
    """Return the matrix that takes the rate of a rotation vector to the angular velocity in the frame's axes (+1)."""
    size, cross = np.linalg.norm(theta), np.cross(np.eye(3), theta)
    return np.eye(3) + sign * (1 - np.cos(size)) / size**2 * cross + (size - np.sin(size)) / size**3 * (cross @ cross)


def forces_on_modes(run: Pipeline, way: int, q: Array, torque: Array) -> Array:
    """Return the generalised forces that Exudyn assembles for a torque on the section at a body's end, (n_modes,)."""
    exu = import_exudyn()
    ii, container = exu.itemInterface, exu.SystemContainer()
    mbs = container.AddSystem()
    body = run.bodies["one"]
    made = flexible(mbs, run.parts["one"].fe, body, 0.0, ["end"], [0, 0, 0], np.eye(3))
    section: dict[str, Any] = {"bodyNumber": made["object"], "meshNodeNumbers": made["end"]}
    section |= {"weightingFactors": [0.25] * 4, "useAlternativeApproach": True, "rotationsExponentialMap": way}
    marker = mbs.AddMarker(ii.MarkerSuperElementRigid(**section))
    mbs.AddLoad(ii.LoadTorqueVector(markerNumber=marker, loadVector=list(torque)))
    mbs.Assemble()
    state = np.array(mbs.systemData.GetODE2Coordinates())
    state[-len(q) :] = q
    for configuration in (exu.ConfigurationType.Current, exu.ConfigurationType.Initial):
        mbs.systemData.SetODE2Coordinates(state, configuration)
    solver, settings = exu.MainSolverImplicitSecondOrder(), exu.SimulationSettings()
    settings.solution.file.write = False
    solver.InitializeSolver(mbs, settings)
    solver.ComputeODE2RHS(mbs)
    return np.array(solver.GetSystemResidual())[len(state) - len(q) : len(state)]


def compare_jacobians(run: Pipeline) -> None:
    """Print how far the marker's way from torques to modes is from Φ, T Φ and Tᵀ Φ."""
    shapes = run.bodies["one"].markers["end"].rotation
    q, *_ = np.linalg.lstsq(shapes, TURN, rcond=None)
    print(f"{'exponential map':<18}{'of Φ':>10}{'of T Φ':>10}{'of Tᵀ Φ':>10}")
    for way in range(3):
        still = forces_on_modes(run, way, q, np.zeros(3))
        found = np.array([forces_on_modes(run, way, q, axis) - still for axis in np.eye(3)])
        found *= np.sign(np.sum(found * shapes))
        wanted = (shapes, tangent(TURN, 1.0) @ shapes, tangent(TURN, -1.0) @ shapes)
        far = [np.abs(found - J).max() / np.abs(shapes).max() for J in wanted]
        print(f"{way:<18}" + "".join(f"{x:>10.2g}" for x in far), flush=True)


def compare_motion(label: str, overrides: list[str], axis: tuple[float, float, float]) -> None:
    """Print how far Exudyn's robot, extrapolated to no step, is from ours."""
    run = Pipeline(load_scene(CASES["robot"][0], [*overrides, f"joint.elbow.axis={list(axis)}"]))
    duration, (q0, v0) = run.scene.simulation.duration, run.start
    exact = RungeKutta(1e-12).march(run.system, q0, v0, sample_times(duration))
    wanted = Motion(run.mechanism, exact, run.scene.simulation.tip).tip_position
    chain, tips = robot(run, axis), []
    for n_steps in STEPS:
        march(chain, duration, "GeneralizedAlpha", n_steps, output=True)
        tips.append(chain.figures(samples_of(chain)))
    far = relative_error(wanted)((4 * tips[1] - tips[0]) / 3)
    print(f"{label:<44}{far:>10.2g}", flush=True)


if __name__ == "__main__":
    compare_jacobians(Pipeline(load_scene(CASES["robot"][0])))
    print(f"\n{'robot':<44}{'tip':>10}")
    for factor in (1, 4, 16):
        stiffer = [f"body.{name}.E={70 * factor} GPa" for name in ("one", "two")]
        compare_motion(f"elbow across, {factor} times as stiff", stiffer, (0.0, 0.8, 0.6))
    still = ['simulation.gravity=["0 m/s^2", "0 m/s^2", "0 m/s^2"]']
    compare_motion("elbow across, no weight", still, (0.0, 0.8, 0.6))
    compare_motion("elbow along the shoulder, no weight", still, (0.0, 0.0, 1.0))
