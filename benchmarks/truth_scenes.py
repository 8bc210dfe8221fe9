"""Random scenes from a seed, as a user might write them: bars and rigid bodies, joints, loads and speeds.

Five kinds. *Planar* scenes are one or two slender bars in the plane of x and y, clamped, hinged, sliding or driven,
with or without a mass at the end: what an elastica is a reference of. *Trees* are one to four bodies in
space, some of them bars, on joints of every type. *Rigid* scenes are trees without a bar.
*Mixed* scenes, from seed `MIXED` on, are trees or a four-bar linkage with some of the features of `truth_features`.
*Arms*, from seed `ARMS` on, are double pendulums of two bars in the plane that swing far, which geometrically exact
beams are a reference of.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt
from typing import Any

import numpy as np
from truth_features import add_features, loop_scene

Table = dict[str, Any]
KINDS = {"planar": 0.45, "tree": 0.35, "rigid": 0.2}  # with their shares
MATERIALS = ((210e9, 0.3, 7850.0), (70e9, 0.33, 2700.0), (3e9, 0.35, 1200.0))  # E, ν, ρ
GRAVITY = 9.81
MIXED = 1000  # seed from which on scenes are mixed
ARMS = 2000  # seed from which on they are arms
ROLLED = 30.0  # times as stiff as the other: what an arm's stiffer bar may count, lest a load rolls the other up
LOOPS = 0.25  # share of them with a loop
JUMPS = 0.04  # share of prescribed motions that jump, which nothing can follow


@dataclass(frozen=True)
class Case:
    """A scene by its seed.

    Attributes
    ----------
    kind : str
        One of `KINDS`, ``"mixed"`` or ``"arm"``.
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


def quantity(value: float, unit: str) -> str:
    """Return a number of five digits with its unit."""
    return f"{float(f'{value:.5g}')!r} {unit}"


def random_case(seed: int) -> Case:
    """Return the scene of a seed."""
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


@dataclass(frozen=True)
class Bar:
    """A bar that bends about z: its sizes [m] and material, with what follows from beam theory."""

    length: float
    depth: float
    width: float
    E: float
    nu: float
    rho: float

    @property
    def bending(self) -> float:
        """E I [N m²]."""
        return self.E * self.width * self.depth**3 / 12

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        return self.rho * self.length * self.depth * self.width

    def first_frequency(self, tip: float) -> float:
        """Angular frequency of the clamped bar with a mass at its end, by Rayleigh's quotient [rad/s]."""
        return sqrt(3 * self.bending / (self.length**3 * (tip + 0.2427 * self.mass)))

    def table(self, rng: np.random.Generator) -> Table:
        """Return the body of a scene, meshed coarsely."""
        along = int(rng.integers(10, 21))
        element: Table = {"order": 2, "divisions": [along, 1, 1]}
        if rng.random() < 0.25:
            element = {"order": 1, "divisions": [2 * along, 2, 2]}
        modes: Table = {"count": int(rng.integers(3, 9)), "boundary": "joint"}
        modes["enrich"] = "inertia" if rng.random() < 0.6 else "none"
        return {
            "shape": "bar",
            "length": quantity(self.length, "m"),
            "depth": quantity(self.depth, "m"),
            "width": quantity(self.width, "m"),
            "E": quantity(self.E, "Pa"),
            "nu": self.nu,
            "rho": quantity(self.rho, "kg/m^3"),
            "mesh": element,
            "modes": modes,
            "marker": {"root": {"face": "x-"}, "tip": {"face": "x+"}},
        }


def random_bar(rng: np.random.Generator, slender: tuple[float, float]) -> Bar:
    """Return a bar whose length over its depth lies between two bounds, evenly in its logarithm."""
    E, nu, rho = MATERIALS[int(rng.integers(len(MATERIALS)))]
    length = round(float(rng.uniform(0.2, 1.2)), 3)
    depth = round(length / float(np.exp(rng.uniform(*np.log(slender)))), 5)
    return Bar(length, depth, round(depth * float(rng.uniform(1.0, 3.0)), 5), E, nu, rho)


def load_over_time(rng: np.random.Generator, size: float, unit: str, duration: float) -> Any:
    """Return a quantity over time: constant, a wave, a pulse, a jump, a table or a bell.

    What jumps does so at a hundredth part of the duration, where a fixed step of the reference can meet it.
    """
    tick = duration / 100
    start = float(rng.integers(0, 40)) * tick
    long = float(rng.integers(2, 50)) * tick
    course = str(rng.choice(["constant", "wave", "pulse", "short pulse", "jump", "table", "bell"]))
    if course == "constant":
        return quantity(size, unit)
    if course == "table":
        times = np.unique(np.r_[0.0, np.sort(rng.integers(1, 100, 5)) * tick])
        values = [float(f"{size * x:.4g}") for x in rng.uniform(-1, 1, len(times))]
        return {"times": [quantity(t, "s") for t in times], "values": values, "unit": unit, "beyond": "hold"}
    F, t0, T = (f"{float(f'{x:.6g}')!r}" for x in (size, start, long))
    end = f"{float(f'{start + long:.6g}')!r}"
    formulas = {
        "wave": f"{F}*sin(2*pi*t/{T})",
        "pulse": f"{F}*sin(pi*t/{T})**2 if t < {T} else 0",
        "short pulse": f"20*{F}*sin(pi*t/{tick:.6g}) if t < {tick:.6g} else 0",
        "jump": f"0 if t < {t0} else {F} if t < {end} else {F}/3",
        "bell": f"{F}*exp(-((t-{end})/({T}/4))**2)",
    }
    return {"formula": formulas[course], "unit": unit}


def spin_up(rate: float, over: float) -> str:
    """Return the angle of a smooth spin-up (Kane, Ryan & Banerjee, 1987) to a rate within a time."""
    W, T = f"{float(f'{rate:.6g}')!r}", f"{float(f'{over:.6g}')!r}"
    return f"{W}/{T}*(t**2/2 + ({T}/(2*pi))**2*(cos(2*pi*t/{T}) - 1)) if t < {T} else {W}*(t - {T}/2)"


def prescribed(rng: np.random.Generator, rate: float, duration: float) -> Table:
    """Return an angle over time whose rate reaches a value: spun up, swinging, or, seldom, jumping."""
    if rng.random() < JUMPS:
        return {"formula": f"0.1 if t < {duration / 2:.6g} else 0.2", "unit": "rad"}
    if rng.random() < 0.6:
        return {"formula": spin_up(rate, int(rng.integers(20, 90)) * duration / 100), "unit": "rad"}
    wave = 2 * pi / duration * float(rng.uniform(0.5, 2))
    return {"formula": f"{rate / wave:.6g}*sin({wave:.6g}*t)", "unit": "rad"}


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


def swell(size: float, over: float, unit: str = "N m") -> Table:
    """Return a torque or a force that grows and falls once, smoothly."""
    T = f"{float(f'{over:.6g}')!r}"
    return {"formula": f"{float(f'{size:.6g}')!r}*sin(pi*t/{T})**2 if t < {T} else 0", "unit": unit}


def simulation(duration: float, tip: str, gravity: list[float]) -> Table:
    """Return the simulation as a user starts it: all defaults, and ``auto``."""
    return {
        "duration": quantity(duration, "s"),
        "output_step": quantity(duration / 100, "s"),
        "tip": tip,
        "gravity": [quantity(x, "m/s^2") for x in gravity],
        "run": [{"integrator": "auto"}],
    }


def rigid_body(rng: np.random.Generator) -> Table:
    """Return a rigid body of some kind with an inner and an outer marker."""
    mass = float(np.exp(rng.uniform(np.log(0.1), np.log(5))))
    if rng.random() < 0.2:
        length = quantity(rng.uniform(0.2, 1), "m")
        marker = {"inner": {"at": ["0 m"] * 3}, "outer": {"at": [length, "0 m", "0 m"]}}
        return {"shape": "rod", "mass": quantity(mass, "kg"), "length": length, "marker": marker}
    sides = rng.uniform(0.05, 0.4, 3)
    moments = mass / 12 * (np.sum(sides**2) - sides**2)
    outer = [quantity(x, "m") for x in rng.uniform(-0.4, 0.4, 3)]
    return {
        "shape": "rigid",
        "mass": quantity(mass, "kg"),
        "centre": [quantity(x, "m") for x in rng.uniform(-0.2, 0.2, 3)],
        "inertia": [quantity(x, "kg m^2") for x in moments],
        "marker": {"inner": {"at": ["0 m"] * 3}, "outer": {"at": outer}},
    }


def thick_rod(rod: Table) -> Table:
    """Return a rod with a tenth of its length for its diameter, which has inertia against turning about its axis."""
    mass, length = (float(rod[key].split()[0]) for key in ("mass", "length"))
    across = mass * length**2 / 12
    return {
        "shape": "rigid",
        "mass": rod["mass"],
        "centre": [quantity(length / 2, "m"), "0 m", "0 m"],
        "inertia": [quantity(x, "kg m^2") for x in (mass * (length / 20) ** 2 / 2, across, across)],
        "marker": rod["marker"],
    }


def tree_scene(rng: np.random.Generator, flexible: float) -> Table:
    """Return one to four bodies in space, each a bar with a given probability, at least one if it isn't 0."""
    return tree_with_bars(rng, flexible)[0]


def tree_with_bars(rng: np.random.Generator, flexible: float) -> tuple[Table, dict[int, Bar]]:
    """Return a tree and the bars among its bodies, by their numbers."""
    n = int(rng.integers(1, 5))
    bars = {k: random_bar(rng, (12.0, 70.0)) for k in range(n) if rng.random() < flexible}
    if flexible and not bars:
        bars[n - 1] = random_bar(rng, (12.0, 70.0))
    duration = 0.0
    for bar in bars.values():
        duration = max(duration, 2 * pi / bar.first_frequency(0.5 * bar.mass) * float(rng.uniform(1, 3)))
    duration = float(f"{duration or rng.uniform(0.3, 2):.3g}")
    rate = 2.0 / duration
    body: Table = {}
    joint: Table = {}
    drive: Table = {}
    ends = ["ground"]
    for k in range(n):
        name, inner = f"part{k}", "root" if k in bars else "inner"
        body[name] = bars[k].table(rng) if k in bars else rigid_body(rng)
        own, moves = tree_joint(rng, rate, duration, ends, f"{name}.{inner}", k == n - 1 == 0 and k not in bars)
        joint[f"joint{k}"] = own
        if own["type"] in ("spherical", "free") and body[name]["shape"] == "rod":
            body[name] = thick_rod(body[name])
        drive |= {f"motion{k}": {"joint": f"joint{k}"} | moves} if moves else {}
        ends.append(f"{name}.tip" if k in bars else f"{name}.outer")
        if k in bars:
            bar = bars[k]
            force = 3 * bar.bending / bar.length**2 * float(np.exp(rng.uniform(np.log(1e-3), np.log(0.05))))
            if rng.random() < 0.5:
                drive[f"push{k}"] = push(rng, f"{name}.tip", load_over_time(rng, force, "N", duration))
        elif rng.random() < 0.4:
            force = 0.5 * rate / duration
            drive[f"push{k}"] = push(rng, f"{name}.outer", load_over_time(rng, force, "N", duration))
    down = [0.0, 0.0, -GRAVITY] if rng.random() < 0.7 else [0.0, 0.0, 0.0]
    found: Table = {"title": "", "body": body, "joint": joint}
    found |= {"drive": drive} if drive else {}
    return found | {"simulation": simulation(duration, ends[-1], down)}, bars


def push(rng: np.random.Generator, marker: str, force: Any) -> Table:
    """Return a point force in some direction."""
    way = [round(float(x), 2) for x in rng.normal(size=3)]
    following = bool(rng.random() < 0.3)
    return {"type": "point force", "marker": marker, "direction": way, "force": force, "following": following}


def tree_joint(
    rng: np.random.Generator, rate: float, duration: float, ends: list[str], child: str, movable: bool
) -> tuple[Table, Table]:
    """Return a joint of some type, and the motion or torque that drives it."""
    kinds = ["revolute", "revolute", "prismatic", "spherical", "free", "fixed", "driven", "torque"]
    kind = str(rng.choice([each for each in kinds if not (movable and each == "fixed")]))
    parent = str(rng.choice(ends)) if rng.random() < 0.3 else ends[-1]
    joint: Table = {"type": kind, "parent": parent, "child": child}
    spin = [quantity(rate * x, "rad/s") for x in rng.normal(size=3)]
    drive: Table = {}
    if kind in ("driven", "torque"):
        joint["type"] = "revolute"
    if joint["type"] in ("revolute", "prismatic"):
        joint["axis"] = [round(float(x), 2) for x in rng.normal(size=3)]
        turns = joint["type"] == "revolute"
        if kind != "driven":
            joint["rate"] = quantity(rate * float(rng.normal()) * (1 if turns else 0.1), "rad/s" if turns else "m/s")
            joint["spring"] = quantity(float(rng.uniform(0.5, 20)) * (1 if turns else 10) * rate**2 / 10,
                                       "N m/rad" if turns else "N/m")  # fmt: skip
            if rng.random() < 0.5:
                joint["damper"] = quantity(0.02 * rate, "N m s/rad" if turns else "N s/m")
    if kind == "driven":
        drive = {"type": "motion", "angle": prescribed(rng, rate * float(rng.uniform(0.5, 5)), duration)}
    elif kind == "torque":
        drive = {"type": "torque", "torque": load_over_time(rng, 0.05 * rate / duration, "N m", duration)}
    elif kind == "spherical":
        joint["spin"] = spin
    elif kind == "free":
        joint |= {"spin": spin, "velocity": [quantity(x, "m/s") for x in rng.normal(size=3)]}
    return joint, drive
