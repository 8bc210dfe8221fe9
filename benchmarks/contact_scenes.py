"""Random scenes whose bodies touch: flexible bars and rigid balls, boxes and pins, each about to strike."""

from dataclasses import dataclass
from typing import Any

import numpy as np

FLEXIBLE = ("drop", "pair", "hinge", "slide", "loop", "striker")
RIGID = ("ball", "balls", "box", "boxes", "pin", "bore")
KINDS = tuple(kind for both in zip(FLEXIBLE, RIGID, strict=True) for kind in both)
MATERIALS = ((70e9, 2700.0), (210e9, 7850.0), (3e9, 1200.0))
NU, GAP, AXLE = 0.3, 1e-6, [0, 0, 1]
GRAVITY = [0.0, -9.81, 0.0]


@dataclass(frozen=True)
class ContactCase:
    """A scene with one contact, ``touch``, and what kind it is."""

    seed: int
    kind: str
    method: str
    scene: dict[str, Any]


def random_case(seed: int) -> ContactCase:
    """Return the case of a seed; kinds take turns."""
    rng, kind = np.random.default_rng(seed), KINDS[seed % len(KINDS)]
    law: dict[str, Any] = {"friction": float(rng.choice([0.0, 0.2, 0.6]))}
    methods = {"central-difference": {}, "generalized-alpha": {"rho": 1.0}}
    if kind in FLEXIBLE:
        methods["sub-cycling"] = {"substeps": int(rng.choice([4, 8, 16]))}
        if rng.random() < 0.4:
            law["damping"] = float(10 ** rng.uniform(-6, -4))
    elif rng.random() < 0.5:
        law["restitution"] = float(rng.uniform(0.5, 0.95))
    method = str(rng.choice(list(methods), p=(0.7, 0.3) if kind in RIGID else (0.4, 0.2, 0.4)))
    made = _MAKERS[kind](rng)
    made["contact"] = {"touch": made["contact"] | law}
    simulation = {
        "duration": made.pop("duration"),
        "step": "auto",
        "gravity": GRAVITY,
        "run": [{"integrator": method} | methods[method]],
    }
    simulation |= {"output_step": simulation["duration"] / 100, "tip": next(iter(made["joint"].values()))["child"]}
    return ContactCase(seed, kind, method, {"title": f"Contact {seed}", "simulation": simulation, **made})


def _free(child: str, place: Any, velocity: Any = (0, 0, 0), **more: Any) -> dict[str, Any]:
    place, velocity = [float(x) for x in place], [float(x) for x in velocity]
    return {"type": "free", "parent": "ground", "child": child, "position": place, "velocity": velocity, **more}


def _onto_ground(face: str) -> dict[str, Any]:
    return {"between": ["ground", face], "normal": [0, 1, 0]}


def _bar(rng: np.random.Generator, length: float = 0.0) -> dict[str, Any]:
    length = length or float(rng.uniform(0.1, 0.3))
    depth, width = (float(x) for x in rng.uniform(0.1, 0.4, 2) * length)
    divisions = [int(n) for n in (rng.integers(3, 8), rng.integers(1, 4), rng.integers(1, 4))]
    E, rho = MATERIALS[int(rng.integers(3))]
    damping = float(rng.choice([0.0, 0.01]))
    return {
        "shape": "bar",
        "length": length,
        "depth": depth,
        "width": width,
        "E": E,
        "nu": NU,
        "rho": rho,
        "mesh": {"divisions": divisions, "order": 1},
        "modes": {"count": int(rng.integers(1, 9)), "enrich": "none", "damping": damping},
        "marker": {"end": {"face": "x-"}, "under": {"face": "y-"}, "above": {"face": "y+"}},
    }


def _lowest(bar: dict[str, Any], turn: np.ndarray) -> float:
    """Return how far below the middle of a bar's end its lowest corner is as it is turned."""
    x, y, z = bar["length"], 0.5 * bar["depth"], 0.5 * bar["width"]
    corners = np.array([(a, b, c) for a in (0, x) for b in (-y, y) for c in (-z, z)])
    return float(-(corners @ rotation(turn).T)[:, 1].min())


def rotation(turn: Any) -> np.ndarray:
    """Return the matrix of a rotation vector (3,), by Rodrigues."""
    a, b, c = turn
    K, angle = np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]]), float(np.linalg.norm(turn))
    if angle == 0.0:
        return np.eye(3)
    return np.eye(3) + np.sin(angle) / angle * K + (1 - np.cos(angle)) / angle**2 * K @ K


def _turned(rng: np.random.Generator, most: float) -> tuple[np.ndarray, dict[str, Any]]:
    turn = rng.uniform(-most, most, 3)
    return turn, {"rotate": turn.tolist(), "spin": rng.uniform(-10, 10, 3).tolist()}


def _drop(rng: np.random.Generator) -> dict[str, Any]:
    bar, (turn, pose) = _bar(rng), _turned(rng, 0.25)
    flight = _free("one.end", [0, _lowest(bar, turn) + 1e-5, 0], [0, rng.uniform(-2.0, -0.2), 0], **pose)
    contact = _onto_ground("one.under")
    return {"body": {"one": bar}, "joint": {"flight": flight}, "contact": contact, "duration": 2e-3}


def _pair(rng: np.random.Generator) -> dict[str, Any]:
    one, (turn, pose) = _bar(rng), _turned(rng, 0.1)
    other = _bar(rng, one["length"])
    joints = {
        "flight": _free("one.end", [0, _lowest(one, turn) + 1e-5, 0], [0, rng.uniform(-2.0, -0.2), 0], **pose),
        "rest": _free("other.end", [0, -0.5 * other["depth"], 0]),
    }
    contact = {"between": ["other.above", "one.under"]}
    return {"body": {"one": one, "other": other}, "joint": joints, "contact": contact, "duration": 2e-3}


def _hinge(rng: np.random.Generator) -> dict[str, Any]:
    bar, angle, rate = _bar(rng), float(rng.uniform(0.002, 0.01)), -float(rng.uniform(2.0, 8.0))
    joint = {"type": "revolute", "parent": "ground", "child": "one.end", "axis": AXLE, "angle": angle, "rate": rate}
    contact = _onto_ground("one.under") | {"clearance": 0.5 * bar["depth"] + 2e-5}
    return {"body": {"one": bar}, "joint": {"hinge": joint}, "contact": contact, "duration": 1e-3 - 1.3 * angle / rate}


def _slide(rng: np.random.Generator) -> dict[str, Any]:
    bar, speed = _bar(rng), float(rng.uniform(-2.0, -0.2))
    joint = {"type": "prismatic", "parent": "ground", "child": "one.end", "axis": [0, 1, 0], "rate": speed}
    joint["position"] = 0.5 * bar["depth"] + 1e-5
    contact = _onto_ground("one.under")
    return {"body": {"one": bar}, "joint": {"slide": joint}, "contact": contact, "duration": 1.5e-3}


def _loop(rng: np.random.Generator) -> dict[str, Any]:
    """A bar on a hinge that closes a loop over a free joint."""
    made = _hinge(rng)
    hinge = made["joint"]["hinge"]
    pose = {"rotate": [0, 0, hinge.pop("angle")], "spin": [0, 0, hinge.pop("rate")]}
    made["joint"] = {"flight": _free("one.end", [0, 0, 0], **pose), "hinge": hinge}
    return made


def _striker(rng: np.random.Generator) -> dict[str, Any]:
    """A rigid ball, box or pin that falls onto a free flexible bar."""
    bar, radius, speed = _bar(rng), float(rng.uniform(5e-3, 2e-2)), float(rng.uniform(-1.0, -0.1))
    kind = str(rng.choice(["ball", "box", "pin"]))
    turn, pose = _turned(rng, 0.1)
    keys: dict[str, Any] = {"radius": radius}
    low = radius
    if kind == "box":
        keys = {"size": [2 * radius] * 3}
        low = box_low(keys["size"], turn)
    elif kind == "pin":
        keys |= {"start": [-radius, 0, 0], "end": [radius, 0, 0]}
        low = radius + radius * abs(float(rotation(turn)[1, 0]))
    body = rigid(kind, keys, 0.3, [0.4 * 0.3 * radius**2] * 3, MATERIALS[1][0])
    (along, _, across) = bar["mesh"]["divisions"]  # nodes alone touch: one is below
    x, z = bar["length"] * rng.integers(1, along) / along, bar["width"] * (rng.integers(0, across + 1) / across - 0.5)
    place = [x, 0.5 * bar["depth"] + low + GAP, z]
    joints = {"flight": _free("two.middle", place, [0, speed, 0], **pose), "rest": _free("one.end", [0, 0, 0])}
    contact = {"between": ["one.above", "two.skin"]}
    return {"body": {"one": bar, "two": body}, "joint": joints, "contact": contact, "duration": 1e-3}


def rigid(kind: str, keys: dict[str, Any], mass: float, inertia: list[float], E: float) -> dict[str, Any]:
    """Return a rigid body with a surface about its centre of mass."""
    surface = {"skin": {"type": kind, "E": E, "nu": NU, **keys}}
    marker = {"middle": {"at": [0, 0, 0]}}
    return {"shape": "rigid", "mass": mass, "inertia": inertia, "marker": marker, "surface": surface}


def box_low(size: list[float], turn: np.ndarray) -> float:
    """Return how far a turned box, rounded by a twentieth of its least extent, goes below its middle."""
    rounding = 0.05 * min(size)
    return float(np.abs(rotation(turn)[1]) @ (0.5 * np.array(size) - rounding)) + rounding


def _lasts(mass: float, radius: float, E: float, speed: float) -> float:
    """Return about how long a ball of a radius, of a mass, touches a plane (Johnson, Contact Mechanics, 11.1)."""
    approach = (15 / 16 * mass * speed**2 * (1 - NU**2) / (E * np.sqrt(radius))) ** 0.4
    return float(2.9432 * approach / speed)


def _a_ball(rng: np.random.Generator) -> tuple[dict[str, Any], float, float, float]:
    radius, (E, rho) = float(rng.uniform(5e-3, 3e-2)), MATERIALS[int(rng.integers(3))]
    mass = 4 / 3 * np.pi * radius**3 * rho
    return rigid("ball", {"radius": radius}, mass, [0.4 * mass * radius**2] * 3, E), radius, mass, E


def _ball(rng: np.random.Generator) -> dict[str, Any]:
    body, radius, mass, E = _a_ball(rng)
    speed, aside, spin = float(rng.uniform(0.05, 1.0)), rng.uniform(-1, 1, 2), rng.uniform(-30, 30, 3)
    joint = _free("one.middle", [0, radius + GAP, 0], [aside[0], -speed, aside[1]], spin=spin.tolist())
    lasts = 2 * _lasts(mass, radius, E, speed)
    return {"body": {"one": body}, "joint": {"flight": joint}, "contact": _onto_ground("one.skin"), "duration": lasts}


def _balls(rng: np.random.Generator) -> dict[str, Any]:
    (one, radius, mass, E), (two, other, mass2, E2) = _a_ball(rng), _a_ball(rng)
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    speed = float(rng.uniform(0.1, 1.0))
    joints = {
        "one": _free("one.middle", [0, 0, 0], rng.uniform(-0.1, 0.1, 3), spin=rng.uniform(-30, 30, 3).tolist()),
        "two": _free("two.middle", way * (radius + other + GAP), -speed * way + 0.5 * rng.uniform(-1, 1, 3) * speed),
    }
    lasts = 4 * _lasts(max(mass, mass2), min(radius, other), min(E, E2), 0.5 * speed)
    contact = {"between": ["one.skin", "two.skin"]}
    return {"body": {"one": one, "two": two}, "joint": joints, "contact": contact, "duration": lasts}


def _a_box(rng: np.random.Generator) -> tuple[dict[str, Any], list[float], float, float]:
    size, (E, rho) = rng.uniform(0.03, 0.1, 3), MATERIALS[int(rng.integers(3))]
    mass = float(size.prod() * rho)
    inertia = mass / 12 * ((size**2).sum() - size**2)
    return rigid("box", {"size": size.tolist()}, mass, inertia.tolist(), E), size.tolist(), mass, E


def _box(rng: np.random.Generator) -> dict[str, Any]:
    (body, size, mass, E), (turn, pose), speed = _a_box(rng), _turned(rng, 0.3), float(rng.uniform(0.1, 1.0))
    velocity = [rng.uniform(-1, 1), -speed, rng.uniform(-1, 1)]
    joint = _free("one.middle", [0, box_low(size, turn) + GAP, 0], velocity, **pose)
    lasts = 3 * _lasts(mass, 0.05 * min(size), E, speed)
    return {"body": {"one": body}, "joint": {"flight": joint}, "contact": _onto_ground("one.skin"), "duration": lasts}


def _boxes(rng: np.random.Generator) -> dict[str, Any]:
    """A box that falls aslant on a free one that is larger, or beside its middle."""
    (one, size, mass, E), (turn, pose), speed = _a_box(rng), _turned(rng, 0.2), float(rng.uniform(0.1, 0.5))
    (two, other, _, E2) = _a_box(rng)
    beside = rng.uniform(-0.4, 0.4, 2) * other[::2]
    place = [beside[0], 0.5 * other[1] + box_low(size, turn) + GAP, beside[1]]
    joints = {
        "flight": _free("one.middle", place, [rng.uniform(-0.3, 0.3), -speed, rng.uniform(-0.3, 0.3)], **pose),
        "rest": _free("two.middle", [0, 0, 0]),
    }
    lasts = 3 * _lasts(mass, 0.05 * min(size), min(E, E2), speed)
    contact = {"between": ["two.skin", "one.skin"]}
    return {"body": {"one": one, "two": two}, "joint": joints, "contact": contact, "duration": lasts}


def _a_pin(rng: np.random.Generator) -> tuple[dict[str, Any], float, float]:
    radius, (E, rho) = float(rng.uniform(5e-3, 2e-2)), MATERIALS[int(rng.integers(2))]
    length = float(rng.uniform(2, 4)) * radius
    mass = np.pi * radius**2 * length * rho
    across = mass * (radius**2 / 4 + length**2 / 12)
    keys = {"radius": radius, "start": [0, 0, -0.5 * length], "end": [0, 0, 0.5 * length]}
    return rigid("pin", keys, mass, [across, across, 0.5 * mass * radius**2], E), radius, length


def _pin(rng: np.random.Generator) -> dict[str, Any]:
    (body, radius, length), tilt = _a_pin(rng), float(rng.uniform(-2e-4, 2e-4))
    speed, spin = float(rng.uniform(0.05, 0.5)), float(rng.uniform(-30, 30))
    place = [0, radius + 0.4 * length * abs(tilt) + GAP, 0]
    joint = _free("one.middle", place, [rng.uniform(-0.5, 0.5), -speed, 0], rotate=[tilt, 0, 0], spin=[0, 0, spin])
    made = {"body": {"one": body}, "joint": {"flight": joint}, "contact": _onto_ground("one.skin")}
    return made | {"duration": 3e-4}


def _bore(rng: np.random.Generator) -> dict[str, Any]:
    """A pin that strikes the bore that it is in, held or free."""
    (body, radius, length), wide = _a_pin(rng), float(rng.uniform(0.005, 0.05))
    keys = {"radius": (1 + wide) * radius, "start": [0, 0, -0.5 * length], "end": [0, 0, 0.5 * length]}
    bore = rigid("bore", keys, 2 * body["mass"], [2 * x for x in body["inertia"]], MATERIALS[1][0])
    speed, spin = float(rng.uniform(0.05, 0.5)), float(rng.uniform(-30, 30))
    rest = _free("two.middle", [0, 0, 0])
    if rng.random() < 0.5:
        rest = {"type": "fixed", "parent": "ground", "child": "two.middle"}
    flight = _free("one.middle", [0, GAP - wide * radius, 0], [rng.uniform(-0.1, 0.1), -speed, 0], spin=[0, 0, spin])
    contact = {"between": ["two.skin", "one.skin"]}
    made = {"body": {"one": body, "two": bore}, "joint": {"flight": flight, "rest": rest}, "contact": contact}
    return made | {"duration": 5e-4}


_MAKERS = {
    **dict(zip(FLEXIBLE, (_drop, _pair, _hinge, _slide, _loop, _striker), strict=True)),
    **dict(zip(RIGID, (_ball, _balls, _box, _boxes, _pin, _bore), strict=True)),
}
