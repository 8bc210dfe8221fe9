"""Random scenes from a seed, as a user might write them: bars and rigid bodies, joints, loads and speeds.

Five kinds. *Planar* scenes are one or two slender bars in the plane of x and y, clamped, hinged, sliding or driven,
with or without a mass at the end: what an elastica is a reference of. *Trees* are one to four bodies in
space, some of them bars, on joints of every type. *Rigid* scenes are trees without a bar.
*Mixed* scenes, from seed `MIXED` on, are trees or a four-bar linkage with some of the features of `truth_features`.
*Arms*, from seed `ARMS` on, are double pendulums of two bars in the plane that swing far, from `SPACE` on in space;
geometrically exact beams are a reference of both, and of trees.
"""

from dataclasses import dataclass
from math import pi, sqrt
from typing import Any

import numpy as np
from truth_features import add_features, loop_scene
from truth_parts import (
    GRAVITY,
    Table,
    load_over_time,
    prescribed,
    quantity,
    random_bar,
    simulation,
    spin_up,
    swell,
)
from truth_trees import tree_scene, tree_with_bars

KINDS = {"planar": 0.45, "tree": 0.35, "rigid": 0.2}  # with their shares
MIXED = 1000  # seed from which on scenes are mixed
ARMS, SPACE = 2000, 3000  # seeds from which on they are arms, in the plane and in space
ROLLED = 30.0  # times as stiff as the other: what an arm's stiffer bar may count, lest a load rolls the other up
LOOPS = 0.25  # share of them with a loop


@dataclass(frozen=True)
class Case:
    """A scene by its seed.

    Attributes
    ----------
    kind : str
        One of `KINDS`, ``"mixed"``, ``"arm"`` or ``"arm in space"``.
    table : dict
        The scene, as TOML describes it.
    bars : tuple of str
        Names of its flexible bodies.
    periods : float
        Duration over the period of the first vibration, of a planar scene.
    features : tuple of str
        What a mixed scene has beside bodies, joints and loads.
    """

    seed: int
    kind: str
    table: Table
    bars: tuple[str, ...]
    periods: float = 0.0
    features: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """The scene's file."""
        return "\n".join(f"{key} = {write_value(value)}" for key, value in self.table.items()) + "\n"


def write_value(value: Any) -> str:
    """Return a value as inline TOML."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {write_value(item)}" for key, item in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(write_value(item) for item in value) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else repr(value)


def random_case(seed: int) -> Case:
    """Return the scene of a seed."""
    if seed >= SPACE:
        return Case(seed, "arm in space", space_scene(np.random.default_rng([seed, 19]), seed), ("bar0", "bar1"))
    if seed >= ARMS:
        return Case(seed, "arm", arm_scene(np.random.default_rng([seed, 18]), seed), ("bar0", "bar1"))
    if seed >= MIXED:
        return mixed_case(seed)
    rng = np.random.default_rng([seed, 16])
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    periods = 0.0
    if kind == "planar":
        periods = float(rng.uniform(0.7, 2.5))
        table = planar_scene(rng, periods)
    else:
        table = tree_scene(rng, 0.6 if kind == "tree" else 0.0)
    table["title"] = f"truth {seed}"
    bars = tuple(name for name, body in table["body"].items() if body["shape"] == "bar")
    return Case(seed, kind, table, bars, periods)


def mixed_case(seed: int) -> Case:
    """Return a tree or a loop with some features."""
    rng = np.random.default_rng([seed, 17])
    loop = rng.random() < LOOPS
    if loop:
        bars = {"part0": random_bar(rng, (12.0, 50.0))}
        table = loop_scene(rng, bars["part0"], bars["part0"].table(rng))
    else:
        table, numbered = tree_with_bars(rng, 0.6)
        bars = {f"part{k}": bar for k, bar in numbered.items()}
    features = add_features(rng, table, bars)
    table["title"] = f"truth {seed}"
    return Case(seed, "mixed", table, tuple(bars), features=(*features, *["loop"] * loop))


def planar_scene(rng: np.random.Generator, periods: float) -> Table:
    """Return one or two bars in the plane of x and y, over some periods of the first vibration."""
    n = 1 if rng.random() < 0.7 else 2
    bars = [random_bar(rng, (50.0, 180.0)) for _ in range(n)]
    tip = float(rng.choice([0.0, 0.0, 0.2, 1.0, 3.0])) * bars[-1].mass
    beyond = tip + sum(bar.mass for bar in bars[1:])
    omega = min(bar.first_frequency(beyond if k == 0 else tip) for k, bar in enumerate(bars))
    period = 2 * pi / omega
    duration = float(f"{period * periods:.3g}")
    body: Table = {f"bar{k}": bar.table(rng) for k, bar in enumerate(bars)}
    joint: Table = {}
    drive: Table = {}
    speed = omega * float(np.exp(rng.uniform(np.log(0.05), np.log(1.2))))
    hub = str(rng.choice(["fixed", "revolute", "driven", "prismatic"], p=[0.3, 0.3, 0.3, 0.1]))
    kind = {"driven": "revolute"}.get(hub, hub)
    root: Table = {"type": kind, "parent": "ground", "child": "bar0.root"}
    if kind == "revolute":
        root["axis"] = [0, 0, 1]
    if hub == "driven":
        drive["turn"] = {"type": "motion", "joint": "hub", "angle": prescribed(rng, speed, duration)}
    elif hub == "revolute":
        root["rate"] = quantity(speed * float(rng.choice([0, 0.3, 1])), "rad/s")
        inertia = sum(bar.mass for bar in bars) * sum(bar.length for bar in bars) ** 2 / 3
        if rng.random() < 0.6:
            torque = load_over_time(rng, 0.3 * inertia * speed / duration, "N m", duration)
            drive["twist"] = {"type": "torque", "joint": "hub", "torque": torque}
        if rng.random() < 0.4:
            root["spring"] = quantity(bars[0].bending / bars[0].length * float(rng.uniform(0.2, 2)), "N m/rad")
    elif hub == "prismatic":
        root |= {"axis": [0, 1, 0], "spring": quantity(3 * bars[0].bending / bars[0].length ** 3, "N/m")}
    joint["hub"] = root
    if n == 2:
        between = str(rng.choice(["fixed", "revolute"]))
        joint["elbow"] = {"type": between, "parent": "bar0.tip", "child": "bar1.root"}
        if between == "revolute":
            joint["elbow"] |= {"axis": [0, 0, 1], "spring": quantity(bars[0].bending / bars[0].length, "N m/rad")}
    last = f"bar{n - 1}"
    if tip:
        body["load"] = {"shape": "point", "mass": quantity(tip, "kg"), "marker": {"at": {"at": ["0 m"] * 3}}}
        joint["weld"] = {"type": "fixed", "parent": f"{last}.tip", "child": "load.at"}
    bent = float(np.exp(rng.uniform(np.log(0.003), np.log(0.2))))  # of the length, by a steady load
    stiff = 3 * bars[-1].bending / bars[-1].length ** 3 / n**3
    if rng.random() < 0.6 or not drive:
        force = load_over_time(rng, bent * bars[-1].length * stiff, "N", duration)
        way = [[0, 1, 0], [0.6, 0.8, 0]][int(rng.integers(2))]
        following = bool(rng.random() < 0.2)
        drive["push"] = {"type": "point force", "marker": f"{last}.tip", "direction": way, "force": force}
        drive["push"]["following"] = following
    if rng.random() < 0.2:
        moment = 2 * bars[-1].bending / bars[-1].length * bent * 0.5
        couple = load_over_time(rng, moment, "N m", duration)
        drive["couple"] = {"type": "point torque", "marker": f"{last}.tip", "direction": [0, 0, 1], "torque": couple}
    weight = sum(bar.mass for bar in bars) / 3 + tip
    droop = weight * GRAVITY / stiff / bars[-1].length
    pull = GRAVITY if rng.random() < 0.6 and droop < 0.25 else 0.0
    return {
        "title": "",
        "body": body,
        "joint": joint,
        "drive": drive,
        "simulation": simulation(duration, f"{last}.tip", [0.0, -pull, 0.0]),
    }


def arm_scene(rng: np.random.Generator, seed: int) -> Table:
    """Return two bars on hinges, straight and at rest at first, that smooth drives swing over some vibrations."""
    bars = [random_bar(rng, (20.0, 60.0)) for _ in range(2)]
    tip = float(rng.choice([0.0, 0.0, 0.3, 1.0])) * bars[1].mass
    omega = min(pi**2 * sqrt(bar.bending / (bar.mass * bar.length**3)) for bar in bars)  # between two hinges
    duration = float(f"{2 * pi / omega * rng.uniform(3, 6):.3g}")
    body: Table = {}
    for k, bar in enumerate(bars):
        along = int(rng.integers(10, 17))
        body[f"bar{k}"] = bar.table(rng)
        body[f"bar{k}"]["mesh"] = {"order": 2, "divisions": [along, 2, 1]}
        spot = [bar.length * (int(rng.integers(along // 4, along // 2)) + 0.5) / along, bar.depth / 4]
        body[f"bar{k}"]["element"] = {"spot": {"at": [*(f"{x!r} m" for x in spot), "0 m"]}}
    joint: Table = {
        "hub": {"type": "revolute", "parent": "ground", "child": "bar0.root", "axis": [0, 0, 1]},
        "elbow": {"type": "revolute", "parent": "bar0.tip", "child": "bar1.root", "axis": [0, 0, 1]},
    }
    if tip:
        body["load"] = {"shape": "point", "mass": quantity(tip, "kg"), "marker": {"at": {"at": ["0 m"] * 3}}}
        joint["weld"] = {"type": "fixed", "parent": "bar1.tip", "child": "load.at"}
    angle, over = float(rng.uniform(0.2, 1.0)), duration * float(rng.uniform(0.5, 0.9))
    inertia = [bar.mass * bar.length**2 / 3 for bar in bars]
    inertia[1] += tip * bars[1].length ** 2
    inertia[0] += (bars[1].mass + tip) * bars[0].length ** 2
    stiffness = [bar.bending / bar.length for bar in bars]
    stiffness = [min(own, ROLLED * min(stiffness)) for own in stiffness]  # torques and forces bend the other bar, too
    torques = [min(4 * angle * own / over**2, 0.2 * bending)
               for own, bending in zip(inertia, stiffness, strict=True)]  # fmt: skip
    drive: Table = {}
    if rng.random() < 0.5:
        turn = {"formula": spin_up(2 * angle / duration, over), "unit": "rad"}
        drive["turn"] = {"type": "motion", "joint": "hub", "angle": turn}
    else:
        drive["twist"] = {"type": "torque", "joint": "hub", "torque": swell(torques[0], over)}
    if rng.random() < 0.5:
        size = torques[1] * float(rng.choice([-1.0, 1.0]))
        drive["bend"] = {"type": "torque", "joint": "elbow", "torque": swell(size, over)}
    if rng.random() < 0.4:
        joint["elbow"]["spring"] = quantity(bars[1].bending / bars[1].length * float(rng.uniform(0.02, 0.5)), "N m/rad")
    if rng.random() < 0.4:
        force, way = 0.1 * stiffness[1] / bars[1].length * float(rng.uniform(0.1, 1)), rng.normal(size=2)
        drive["push"] = {"type": "point force", "marker": "bar1.tip", "direction": [*map(float, way.round(2)), 0.0]}
        drive["push"]["force"] = swell(force, over, "N")
    return {
        "title": f"truth {seed}",
        "body": body,
        "joint": joint,
        "drive": drive,
        "simulation": simulation(duration, "bar1.tip", [0.0, 0.0, 0.0]),
    }


def space_scene(rng: np.random.Generator, seed: int) -> Table:
    """Return an arm whose axes and forces point anywhere, so that its bars twist and bend two ways."""
    table = arm_scene(rng, seed)
    for joint in (table["joint"]["hub"], table["joint"]["elbow"]):
        joint["axis"] = [float(x) for x in rng.normal(size=3).round(2)]
    elbow = table["joint"]["elbow"]
    if "bend" not in table["drive"] and "spring" not in elbow and rng.random() < 0.5:
        del elbow["axis"]
        elbow["type"] = "spherical"
    if "push" in table["drive"]:
        table["drive"]["push"]["direction"] = [float(x) for x in rng.normal(size=3).round(2)]
    return table
