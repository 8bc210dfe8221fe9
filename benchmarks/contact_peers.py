"""Shocks of rigid bodies beside MuJoCo and Exudyn, error and run time side by side, written to contact_peers.csv.

Run from the project's root: ``python benchmarks/contact_peers.py``, after ``pip install mujoco==4.0.0
exudyn==1.13.6``. A steel ball and a box that fall on a plane, and a pendulum whose ball strikes a stop, all without a
loss. Exact are the speed after and Hertz's largest force. Exudyn is given Hertz's law by its own keys; MuJoCo has
springs that are linear in the depth, as stiff as gives Hertz's contact time. Steps are the same shares of the contact
time; times are minima of marches alone, in one process.
"""

import csv
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from contact_scenes import rigid
from exudyn_march import import_exudyn

from fmd import Pipeline, load_scene
from fmd.core.cache import Cache

TABLE = Path(__file__).parent / "contact_peers.csv"
E, NU, RADIUS, MASS, SPEED, ARM = 210e9, 0.3, 0.01, 0.03266, 0.05, 0.2
SIZE, ROUNDING, BOX_MASS = 0.04, 0.002, 0.5
STEPS = (16, 32, 64)  # in a contact
REPEATS = 5
CASES = {"ball": (MASS, RADIUS, 1), "box": (BOX_MASS, ROUNDING, 4), "pendulum": (MASS, RADIUS, 1)}
"""Mass, radius and number of what touches."""
Outcome = tuple[float, float, float]  # speed after, largest force, seconds


def hertz(case: str) -> tuple[float, float, float]:
    """Return the law's factor of each point, the largest force and the contact time of a shock."""
    mass, radius, points = CASES[case]
    if case == "pendulum":
        mass *= 1.0 + 0.4 * (radius / ARM) ** 2  # moment of inertia about the hinge over the arm's square
    factor = 4 / 3 * E / (1 - NU**2) * np.sqrt(radius)
    approach = (1.25 * mass * SPEED**2 / (points * factor)) ** 0.4
    return factor, points * factor * approach**1.5, 2.9432 * approach / SPEED


def ours(case: str, step: float, duration: float) -> Outcome:
    """March the scene by central differences."""
    mass, radius, _ = CASES[case]
    keys: dict[str, Any] = {"radius": radius}
    inertia = [0.4 * mass * radius**2] * 3
    if case == "box":
        keys, inertia = {"size": [SIZE] * 3, "rounding": radius}, [mass * SIZE**2 / 6] * 3
    body = rigid("box" if case == "box" else "ball", keys, mass, inertia, E)
    half = 0.5 * SIZE if case == "box" else radius
    joint = {"type": "free", "parent": "ground", "child": "one.middle", "position": [0, half, 0]}
    joint["velocity"] = [0, -SPEED, 0]
    if case == "pendulum":
        body["marker"]["hinge"] = {"at": [ARM, 0, 0]}
        joint = {"type": "revolute", "parent": "ground.pivot", "child": "one.hinge", "axis": [0, 0, 1]}
        joint["rate"] = SPEED / ARM
    contact = {"between": ["ground", "one.skin"], "normal": [0, 1, 0]}
    simulation = {"duration": duration, "output_step": duration, "step": step, "tip": "one.middle"}
    simulation |= {"gravity": [0, 0, 0], "run": [{"integrator": "central-difference"}]}
    ground = {"pivot": {"at": [ARM, half, 0]}}
    scene = {"title": case, "body": {"one": body}, "joint": {"j": joint}, "contact": {"touch": contact}}
    run = Pipeline(load_scene(scene | {"ground": ground, "simulation": simulation}), Cache(None))
    plan = next(iter(run.plans.values()))
    plan.march(run.output_times)
    marches = [plan.march(run.output_times) for _ in range(REPEATS)]
    after = abs(float(marches[0].v[-1, 0 if case == "pendulum" else 1])) * (ARM if case == "pendulum" else 1.0)
    force = run.motion_by(replace(plan), marches[0]).contacts["touch"].figures["largest_force_n"]
    return after, force, min(march.seconds for march in marches)


def mujoco_outcome(case: str, step: float, duration: float) -> Outcome:
    """March the case in MuJoCo, by Runge-Kutta's method of order 4, its Newton solver and elliptic cones."""
    import mujoco

    mass, radius, _ = CASES[case]
    omega = np.pi / hertz(case)[2]
    half = 0.5 * SIZE if case == "box" else radius
    inertia = mass * SIZE**2 / 6 if case == "box" else 0.4 * mass * radius**2
    geom = f'type="box" size="{half} {half} {half}"' if case == "box" else f'type="sphere" size="{radius}"'
    joint = '<freejoint name="j"/>'
    if case == "pendulum":
        joint = f'<joint name="j" type="hinge" axis="0 -1 0" pos="{ARM} 0 0"/>'
    soft = f'solref="{-(omega**2)} 0" solimp="0.9999 0.9999 0.001 0.5 2" condim="1"'
    text = f"""<mujoco><option timestep="{step}" gravity="0 0 0" integrator="RK4" cone="elliptic"/>
    <worldbody><geom type="plane" size="1 1 1" {soft}/><body pos="0 0 {half}">{joint}<geom {geom} {soft}/>
    <inertial pos="0 0 0" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    count, seconds, largest = round(duration / step), [], 0.0

    def begin() -> Any:
        data = mujoco.MjData(model)
        data.qvel[0 if case == "pendulum" else 2] = SPEED / ARM if case == "pendulum" else -SPEED
        return data

    for _ in range(REPEATS):
        data, begun = begin(), time.perf_counter()
        mujoco.mj_step(model, data, nstep=count)
        seconds.append(time.perf_counter() - begun)
    after = abs(float(data.qvel[0 if case == "pendulum" else 2])) * (ARM if case == "pendulum" else 1.0)
    data = begin()
    for _ in range(count):
        mujoco.mj_step(model, data)
        largest = max(largest, float(data.efc_force.sum()))
    return after, largest, min(seconds)


def exudyn_outcome(case: str, step: float, duration: float) -> Outcome:
    """March the case in Exudyn, by its implicit trapezoids; the plane is a sphere of 10 km."""
    exu = import_exudyn()
    items = exu.itemInterface
    from exudyn.utilities import InertiaSphere, RigidBodyInertia

    mass, radius, _ = CASES[case]
    half, wide = (0.5 * SIZE if case == "box" else radius), 1e4
    system = exu.SystemContainer()
    mbs = system.AddSystem()
    inertia = InertiaSphere(mass, radius)
    if case == "box":
        inertia = RigidBodyInertia(mass=mass, inertiaTensor=np.eye(3) * mass * SIZE**2 / 6)
    rate = [0, 0, SPEED / ARM] if case == "pendulum" else [0, 0, 0]
    body = mbs.CreateRigidBody(
        inertia=inertia, referencePosition=[0, half, 0], initialVelocity=[0, -SPEED, 0], initialAngularVelocity=rate
    )
    ground = mbs.CreateGround(referencePosition=[0, 0, 0])
    if case == "pendulum":
        mbs.CreateRevoluteJoint(itemNumbers=[ground, body], position=[ARM, half, 0], axis=[0, 0, 1])
    corner = 0.5 * SIZE - ROUNDING
    centres = [[x, -corner, z] for x in (-corner, corner) for z in (-corner, corner)] if case == "box" else [[0, 0, 0]]
    contacts = []
    for x, y, z in centres:
        below = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=ground, localPosition=[x, -wide, z]))
        point = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=body, localPosition=[x, y, z]))
        node = mbs.AddNode(items.NodeGenericData(initialCoordinates=[0, 0, 0, 0], numberOfDataCoordinates=4))
        law = {"contactStiffness": hertz(case)[0], "contactStiffnessExponent": 1.5}
        contact = items.ObjectContactSphereSphere(
            markerNumbers=[below, point], nodeNumber=node, spheresRadii=[wide, radius], **law
        )
        contacts.append(mbs.AddObject(contact))
    forces = [
        mbs.AddSensor(
            items.SensorObject(objectNumber=own, outputVariableType=exu.OutputVariableType.Force, storeInternal=True)
        )
        for own in contacts
    ]
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.timeIntegration.numberOfSteps, settings.timeIntegration.endTime = round(duration / step), duration
    settings.timeIntegration.verboseMode = 0
    settings.timeIntegration.newton.useModifiedNewton = True
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = step
    # Undamped is best, but isn't stable with a joint's constraint.
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.95 if case == "pendulum" else 1.0
    seconds, start = [], mbs.systemData.GetSystemState()
    for _ in range(REPEATS):
        mbs.systemData.SetSystemState(start)
        solver = exu.MainSolverImplicitSecondOrder()
        begun = time.perf_counter()
        solver.SolveSystem(mbs, settings)
        seconds.append(time.perf_counter() - begun)
    velocity = mbs.GetObjectOutputBody(body, exu.OutputVariableType.Velocity, [0, 0, 0])
    found = [mbs.GetSensorStoredData(own) for own in forces]
    largest = np.abs(sum(own[:, 1:4] for own in found)).max()
    return float(np.linalg.norm(velocity)), float(largest), min(seconds)


TOOLS: dict[str, Callable[[str, float, float], Outcome]] = {
    "fmd": ours,
    "Exudyn": exudyn_outcome,
    "MuJoCo": mujoco_outcome,
}


def main() -> None:
    """Measure all cases by all tools and write their table."""
    with TABLE.open("w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["case", "tool", "steps", "speed_error", "force_error", "seconds"])
        for case in CASES:
            _, force, lasts = hertz(case)
            for tool, march in TOOLS.items():
                for steps in STEPS:
                    after, largest, seconds = march(case, lasts / steps, 2.0 * lasts)
                    off = abs(after / SPEED - 1.0)
                    row = [case, tool, steps, f"{off:.3g}", f"{abs(largest / force - 1.0):.3g}", f"{seconds:.3g}"]
                    rows.writerow(row)
                    print(*row, flush=True)


if __name__ == "__main__":
    main()
