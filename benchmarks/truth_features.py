"""Features of the scene language that are drawn into random scenes beside bodies, joints and loads, and their pairs."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterable
from math import cos, pi, sin
from typing import TYPE_CHECKING

import numpy as np
from truth_parts import Bar, Table, quantity

if TYPE_CHECKING:
    from truth_scenes import Case

SHARE = 0.3  # of the scenes that could have a feature
LEAST_SLENDER = 25.0  # length over depth up to which a bar is meshed by tetrahedra

Feature = Callable[[np.random.Generator, Table, dict[str, Bar]], bool]
"""Puts a feature into a scene and returns true, or returns false if that has no place for it."""


def _seconds(table: Table) -> float:
    return float(table["simulation"]["duration"].split()[0])


def _undriven(table: Table, *kinds: str) -> list[str]:
    """Return the names of joints of some types whose motion isn't given, and which carry a body."""
    driven = {each.get("joint") for each in table.get("drive", {}).values()}
    return [
        name
        for name, joint in table["joint"].items()
        if joint["type"] in kinds and name not in driven and name != "closing"
    ]


def _some(rng: np.random.Generator, names: Iterable[str]) -> str:
    return str(rng.choice(list(names)))


def _stiffness(bar: Bar) -> float:
    return 3 * bar.bending / bar.length**3


def damping(rng: np.random.Generator, table: Table, bars: dict[str, Bar]) -> bool:
    """Damp all modes of a bar by one ratio, or by Rayleigh's factors."""
    name = _some(rng, bars)
    rate = bars[name].first_frequency(0.0)
    rayleigh = {"alpha": quantity(0.01 * rate, "1/s"), "beta": quantity(0.01 / rate, "s")}
    table["body"][name]["modes"]["damping"] = rayleigh if rng.random() < 0.3 else round(float(rng.uniform(0, 0.1)), 3)
    return True


def rigid_attachment(rng: np.random.Generator, table: Table, bars: dict[str, Bar]) -> bool:
    """Attach a bar's root as a rigid face."""
    table["body"][_some(rng, bars)]["marker"]["root"]["attachment"] = "rigid"
    return True


def tetrahedra(rng: np.random.Generator, table: Table, bars: dict[str, Bar]) -> bool:
    """Mesh a thick bar by quadratic tetrahedra."""
    thick = [name for name, bar in bars.items() if bar.length < LEAST_SLENDER * bar.depth]
    if not thick:
        return False
    name = _some(rng, thick)
    size = quantity(1.2 * bars[name].depth, "m")
    table["body"][name]["mesh"] = {"element": "tetrahedron", "order": 2, "size": size}
    return True


def load_off_the_ends(rng: np.random.Generator, table: Table, bars: dict[str, Bar]) -> bool:
    """Push a bar's side, evenly."""
    name = _some(rng, bars)
    bar, duration = bars[name], _seconds(table)
    table["body"][name]["marker"]["side"] = {"face": "y+"}
    force = 0.02 * 8 * bar.bending / bar.length**2 * float(np.exp(rng.uniform(-3, 1)))
    wave = {"formula": f"{force:.5g}*sin({rng.uniform(2, 20) / duration:.5g}*t)", "unit": "N"}
    push = {"type": "point force", "marker": f"{name}.side", "direction": [0, 1, 0.2], "force": wave}
    table.setdefault("drive", {})["side"] = push
    return True


def spring(rng: np.random.Generator, table: Table, bars: dict[str, Bar]) -> bool:
    """Tie a bar's end to the ground by a spring with a damper, straight or nonlinear."""
    name = _some(rng, bars)
    k = _stiffness(bars[name]) * float(rng.uniform(0.1, 1))
    own: Table = {"between": ["ground.post", f"{name}.tip"]}
    if rng.random() < 0.3:
        own["force"] = {"formula": f"{k:.5g}*x + {10 * k / bars[name].length ** 2:.5g}*x**3", "unit": "N"}
    else:
        own |= {
            "stiffness": quantity(k, "N/m"),
            "damper": quantity(0.05 * k / bars[name].first_frequency(0.0), "N s/m"),
        }
    table.setdefault("ground", {})["post"] = {"at": ["0.3 m", "1.7 m", "-0.9 m"]}
    table.setdefault("spring", {})["tie"] = own
    return True


def bushing(rng: np.random.Generator, table: Table, bars: dict[str, Bar]) -> bool:
    """Hold a bar's end by a bushing on the ground."""
    name = _some(rng, bars)
    k = _stiffness(bars[name]) * float(rng.uniform(0.05, 0.5))
    along = [quantity(k * x, "N/m") for x in rng.uniform(0.2, 1, 3)]
    about = [quantity(k * bars[name].length ** 2 * x, "N m/rad") for x in rng.uniform(0.01, 0.05, 3)]
    table.setdefault("bushing", {})["mount"] = {"between": ["ground", f"{name}.tip"], "stiffness": along + about}
    return True


def bearing(rng: np.random.Generator, table: Table, bars: dict[str, Bar]) -> bool:
    """Hold a bar's end across an axis by a bearing on the ground."""
    name = _some(rng, bars)
    k = _stiffness(bars[name])
    own = {"between": ["ground", f"{name}.tip"], "axis": [1, 0, 0], "radial": quantity(0.3 * k, "N/m")}
    damper = quantity(0.03 * k / bars[name].first_frequency(0.0), "N s/m")
    table.setdefault("bearing", {})["far"] = own | {"axial": quantity(0.1 * k, "N/m"), "radial_damper": damper}
    return True


def stop(rng: np.random.Generator, table: Table, bars: dict[str, Bar]) -> bool:
    """Stop a hinge or a slide softly, to both sides of where it starts."""
    names = _undriven(table, "revolute", "prismatic")
    if not names:
        return False
    joint = table["joint"][_some(rng, names)]
    turns = joint["type"] == "revolute"
    unit, high = ("rad", 0.05) if turns else ("m", 0.02)
    stiff = quantity(float(rng.uniform(20, 200)) / _seconds(table) ** 2, "N m/rad" if turns else "N/m")
    joint["stop"] = {"width": quantity(0.1 * high, unit), "stiffness": stiff} | _ends_about(joint, high, unit)
    return True


def _ends_about(joint: Table, high: float, unit: str) -> Table:
    """Return the ends of a stop to both sides of where a joint starts."""
    start = float(joint.get("angle", joint.get("position", "0")).split()[0])
    return {"low": quantity(start - high, unit), "high": quantity(start + high, unit)}


def friction(rng: np.random.Generator, table: Table, bars: dict[str, Bar]) -> bool:
    """Rub in a hinge or a slide."""
    names = _undriven(table, "revolute", "prismatic")
    if not names:
        return False
    joint, rate = table["joint"][_some(rng, names)], 1 / _seconds(table)
    turns = joint["type"] == "revolute"
    joint["friction"] = quantity(0.02 * rate**2, "N m" if turns else "N")
    joint["friction_rate"] = quantity(0.05 * rate, "rad/s" if turns else "m/s")
    return True


def gear(rng: np.random.Generator, table: Table, bars: dict[str, Bar]) -> bool:
    """Couple two hinges by a gear, with rates at the start that fit."""
    names = _undriven(table, "revolute")
    if len(names) < 2 or any("angle" in table["joint"][name] for name in names):
        return False
    driver, driven = names[:2]
    ratio = round(float(rng.choice([-1, 1]) * rng.uniform(0.3, 2)), 3)
    rate = float(table["joint"][driver].get("rate", "0").split()[0])
    table["joint"][driven]["rate"] = f"{ratio * rate!r} rad/s"
    table["coupler"] = {"gears": {"type": "gear", "joint": driven, "driver": driver, "ratio": ratio}}
    return True


def start(rng: np.random.Generator, table: Table, bars: dict[str, Bar]) -> bool:
    """Start a hinge or a slide away from where it is unstretched."""
    names = [name for name in _undriven(table, "revolute", "prismatic") if "coupler" not in table]
    if not names or "closing" in table["joint"]:
        return False
    joint = table["joint"][_some(rng, names)]
    turns = joint["type"] == "revolute"
    unit = "rad" if turns else "m"
    joint["angle" if turns else "position"] = quantity(float(rng.normal()) * (0.5 if turns else 0.05), unit)
    if "stop" in joint:
        joint["stop"] |= _ends_about(joint, float(joint["stop"]["high"].split()[0]), unit)
    return True


def support(rng: np.random.Generator, table: Table, bars: dict[str, Bar]) -> bool:
    """Clamp a bar's root, in its joint's axes, by a support."""
    name = _some(rng, bars)
    if any(
        each["child"] == f"{name}.root" and each["type"] in ("free", "spherical") for each in table["joint"].values()
    ):
        return False
    table["body"][name]["support"] = [{"face": "x-"}]
    table["body"][name]["modes"].pop("boundary", None)
    return True


def pieces(rng: np.random.Generator, table: Table, bars: dict[str, Bar]) -> bool:
    """Cut a bar of hexahedra into two pieces."""
    body = table["body"][_some(rng, bars)]
    if "support" in body or "element" in body["mesh"] or "link" in body:
        return False
    body["pieces"] = 2
    body["modes"] = {"count": min(body["modes"]["count"], 4)}
    body["mesh"]["divisions"] = [2 * round(body["mesh"]["divisions"][0] / 2), *body["mesh"]["divisions"][1:]]
    return True


def mass_on_a_link(rng: np.random.Generator, table: Table, bars: dict[str, Bar]) -> bool:
    """Put a lumped mass with inertia on a bar's end."""
    name = _some(rng, bars)
    body, mass = table["body"][name], 0.2 * bars[name].mass
    if "pieces" in body:
        return False
    body["link"] = {"end": {"face": "x+", "type": _some(rng, ["rigid", "average"])}}
    inertia = [quantity(mass * bars[name].depth ** 2 * x, "kg m^2") for x in (0.4, 0.3, 0.5)]
    body["mass"] = {"lump": {"at": "end", "mass": quantity(mass, "kg"), "inertia": inertia}}
    return True


def formula_of_the_motion(rng: np.random.Generator, table: Table, bars: dict[str, Bar]) -> bool:
    """Hold a hinge by a torque that follows its angle and rate."""
    names = _undriven(table, "revolute")
    if not names or "coupler" in table:
        return False
    name, rate = _some(rng, names), 1 / _seconds(table)
    torque = {"formula": f"-{5 * rate**2:.5g}*q - {0.5 * rate:.5g}*rate", "unit": "N m"}
    table.setdefault("drive", {})["servo"] = {"type": "torque", "joint": name, "torque": torque}
    return True


FEATURES: dict[str, Feature] = {
    each.__name__.replace("_", " "): each
    for each in (damping, rigid_attachment, tetrahedra, load_off_the_ends, spring, bushing, bearing, stop, friction,
                 gear, start, support, pieces, mass_on_a_link, formula_of_the_motion)
}  # fmt: skip


def add_features(rng: np.random.Generator, table: Table, bars: dict[str, Bar]) -> tuple[str, ...]:
    """Put some features into a scene, and return their names."""
    return tuple(name for name, add in FEATURES.items() if rng.random() < SHARE and add(rng, table, bars))


def loop_scene(rng: np.random.Generator, bar: Bar, body: Table) -> Table:
    """Return a four-bar linkage with a rigid crank and rocker and a flexible coupler, which closes at the start.

    The crank is driven, or swings from where it starts.
    """
    crank, rocker = bar.length * rng.uniform(0.2, 0.35), bar.length * rng.uniform(0.7, 0.9)
    at_crank, at_bar, at_rocker = pi / 2 * rng.uniform(0.6, 1.2), rng.uniform(0.1, 0.4), -pi / 2 * rng.uniform(0.8, 1.0)
    lengths, angles = (crank, bar.length, rocker), (at_crank, at_bar, at_rocker)
    foot = [sum(n * turn(a) for n, a in zip(lengths, angles, strict=True)) for turn in (cos, sin)]
    duration = float(f"{2 * pi / bar.first_frequency(0.0) * rng.uniform(2, 5):.3g}")

    def rod(length: float) -> Table:
        ends = {"inner": {"at": ["0 m"] * 3}, "outer": {"at": [f"{length!r} m", "0 m", "0 m"]}}
        return {"shape": "rod", "mass": quantity(bar.mass * length / bar.length, "kg"), "length": f"{length!r} m"} | {
            "marker": ends
        }

    def hinge(parent: str, child: str, angle: float | None) -> Table:
        start = {} if angle is None else {"angle": f"{angle!r} rad"}
        return {"type": "revolute", "parent": parent, "child": child, "axis": [0, 0, 1]} | start

    joint = {
        "hub": hinge("ground", "crank.inner", None if (driven := rng.random() < 0.5) else at_crank),
        "elbow": hinge("crank.outer", "part0.root", at_bar - at_crank),
        "pin": hinge("part0.tip", "rocker.inner", at_rocker - at_bar),
        "closing": hinge("ground.foot", "rocker.outer", None),
    }
    turn = f"{at_crank!r} + {rng.uniform(0.2, 0.5):.4g}*(1 - cos({2 * pi / duration:.8g}*t))"
    drive = {"turn": {"type": "motion", "joint": "hub", "angle": {"formula": turn, "unit": "rad"}}} if driven else {}
    return {
        "title": "",
        "body": {"crank": rod(float(crank)), "part0": body, "rocker": rod(float(rocker))},
        "ground": {"foot": {"at": [f"{x!r} m" for x in foot] + ["0 m"]}},
        "joint": joint,
        **({"drive": drive} if drive else {}),
        "simulation": {
            "duration": quantity(duration, "s"),
            "output_step": quantity(duration / 100, "s"),
            "tip": "part0.tip",
            "gravity": ["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"],
            "run": [{"integrator": "auto"}],
        },
    }


def pairwise_coverage(cases: Iterable[Case]) -> tuple[int, int, list[tuple[str, str]]]:
    """Return how many pairs of features scenes have at least once, of how many, and those that none has."""
    seen = Counter(pair for case in cases for pair in itertools.combinations(sorted(case.features), 2))
    pairs = list(itertools.combinations(sorted((*FEATURES, "loop")), 2))
    return sum(pair in seen for pair in pairs), len(pairs), [pair for pair in pairs if pair not in seen]
