"""Accelerations of public robots beside Pinocchio and MuJoCo, written to robots.csv.

Run from the project's root: ``python benchmarks/robots.py EXAMPLE_ROBOT_DATA BULLET MJCTRL``, after ``pip install
pin==4.1.0 mujoco==4.0.0``. The three are folders with the robots of `COLLECTIONS`: ``robots`` of example-robot-data,
``data`` of Bullet, and mjctrl, which has some of MuJoCo Menagerie. Each file becomes a scene as by ``fmd new --from``;
dampers, friction, couplers and motors' rotors are left out of it and of the peer. A row has the largest difference of
an acceleration at random positions within the stops and random rates, over the largest acceleration there.
"""

import sys
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from table_format import HERE, write_rows

import fmd
from fmd.cli.cad_scenes import make_name
from fmd.cli.robot_scenes import write_robot_scene
from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError
from fmd.scene.scene import Scene

TABLE = HERE / "robots.csv"
COLLECTIONS = {
    "URDF of example-robot-data 4.3.0": {
        "Franka Panda": "panda_description/urdf/panda.urdf",
        "Universal Robots UR5": "ur_description/urdf/ur5_robot.urdf",
        "Kinova Jaco, `j2s6s200`": "kinova_description/robots/kinova.urdf",
        "Solo 12": "solo_description/robots/solo12.urdf",
        "Talos": "talos_data/robots/talos_reduced.urdf",
    },
    "URDF of Bullet 3.27": {"KUKA LBR iiwa": "kuka_iiwa/model.urdf", "Minitaur": "quadruped/minitaur.urdf"},
    "MJCF of MuJoCo Menagerie, in mjctrl of April 2024": {
        "Franka Panda": "franka_emika_panda/panda.xml",
        "KUKA LBR iiwa 14": "kuka_iiwa_14/iiwa14.xml",
        "Universal Robots UR5e": "universal_robots_ur5e/ur5e.xml",
    },
}
"""Files of robots by collection, relative to its folder."""
STATES, SEED, RATE = 5, 7, 2.0  # rates up to this [rad/s, m/s]
WITHOUT_STOPS, MARGIN = 3.0, 0.05  # range of a joint without stops [rad, m], and a range's share kept from each end
MOVING = ("revolute", "prismatic")
Peer = tuple[str, list[str], Callable[[Array, Array], Array]]
"""Name with version, the joints in its order, and its accelerations of their positions and rates."""


@dataclass
class Row:
    """A robot's largest difference; ``impossible`` counts links whose moments of inertia no body has."""

    robot: str
    source: str
    joints: int
    impossible: int
    off: float
    beside: str


def load_robot(file: Path) -> tuple[Scene, int]:
    """Return the scene of a robot without dampers, friction and couplers, and how many links' moments it had to raise.

    Other than accelerations nothing is asked of it, so that shapes of pictures are left out, too.
    """
    text, notes = write_robot_scene(file, file.with_suffix(".toml"))
    table = tomllib.loads(text)
    for joint in table["joint"].values():
        for key in ("damper", "friction"):
            joint.pop(key, None)
    for body in table["body"].values():
        body.pop("visual", None)
    table.pop("coupler", None)
    return fmd.load_scene(table), sum("no body has moments" in note for note in notes)


def draw_states(scene: Scene, joints: Sequence[str]) -> list[tuple[Array, Array]]:
    """Draw positions within the stops, and rates, in the order of the joints."""
    rng = np.random.default_rng(SEED)
    stops = [scene.joint[name].stop for name in joints]
    low, high = np.array([(stop.low, stop.high) if stop else (-WITHOUT_STOPS, WITHOUT_STOPS) for stop in stops]).T
    margin = MARGIN * (high - low)
    return [(rng.uniform(low + margin, high - margin), rng.uniform(-RATE, RATE, len(joints))) for _ in range(STATES)]


def pinocchio_peer(file: Path) -> Peer:
    """Read a URDF file in Pinocchio, whose joints that turn without end have two positions, cosine and sine."""
    import pinocchio

    model = pinocchio.buildModelFromUrdf(str(file))
    data, joints = model.createData(), list(model.joints)[1:]
    model.armature[:] = 0.0

    def accelerations(q: Array, v: Array) -> Array:
        positions, rates = pinocchio.neutral(model), np.zeros(model.nv)
        for joint, x, rate in zip(joints, q, v, strict=True):
            positions[joint.idx_q : joint.idx_q + joint.nq] = x if joint.nq == 1 else (np.cos(x), np.sin(x))
            rates[joint.idx_v] = rate
        found = pinocchio.aba(model, data, positions, rates, np.zeros(model.nv))
        return np.array([found[joint.idx_v] for joint in joints])

    return f"Pinocchio {pinocchio.__version__}", list(model.names)[1:], accelerations


def mujoco_peer(file: Path) -> Peer:
    """Read an MJCF file in MuJoCo, without meshes, constraints, actuators and losses."""
    import mujoco

    spec = mujoco.MjSpec.from_file(str(file))
    for shape in [geom for geom in spec.geoms if geom.type == mujoco.mjtGeom.mjGEOM_MESH]:
        spec.delete(shape)
    for mesh in [*spec.meshes]:
        spec.delete(mesh)
    model = spec.compile()
    data, flags = mujoco.MjData(model), mujoco.mjtDisableBit
    model.dof_damping[:] = model.dof_armature[:] = model.dof_frictionloss[:] = 0.0
    model.opt.disableflags |= flags.mjDSBL_CONSTRAINT | flags.mjDSBL_ACTUATION

    def accelerations(q: Array, v: Array) -> Array:
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_forward(model, data)
        return np.array(data.qacc)

    return f"MuJoCo {mujoco.__version__}", [model.joint(k).name for k in range(model.njnt)], accelerations


PEERS = {".urdf": pinocchio_peer, ".xml": mujoco_peer}


def compare(robot: str, source: str, file: Path) -> Row:
    """Compare a robot's accelerations with its peer's."""
    scene, impossible = load_robot(file)
    joints = [name for name, joint in scene.joint.items() if joint.type in MOVING]
    system = fmd.Pipeline(scene).system
    beside, names, accelerations = PEERS[file.suffix](file)
    order = [joints.index(make_name(name)) for name in names]
    if sorted(order) != list(range(len(joints))):
        raise AccuracyError(f"{robot}: joints {', '.join(joints)} aren't those of {beside}: {', '.join(names)}")
    off = 0.0
    for q, v in draw_states(scene, joints):
        wanted = accelerations(q[order], v[order])
        off = max(off, float(np.abs(system.accelerations(0.0, q, v)[order] - wanted).max() / np.abs(wanted).max()))
    return Row(robot, source, len(joints), impossible, off, beside)


def main(folders: Sequence[str]) -> None:
    """Compare the robots of all collections and write their table."""
    rows = []
    for (source, robots), folder in zip(COLLECTIONS.items(), folders, strict=True):
        for robot, name in robots.items():
            rows.append(compare(robot, source, Path(folder) / name))
            print(rows[-1], flush=True)
    write_rows(TABLE, rows, digits=1)


if __name__ == "__main__":
    main(sys.argv[1:])
