"""Random trees of rigid bodies and bars in space, on joints of every type."""

from math import pi
from typing import Any

import numpy as np
from truth_parts import GRAVITY, Bar, Table, load_over_time, prescribed, quantity, random_bar, simulation


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
