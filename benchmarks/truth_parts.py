"""What random scenes are made of: quantities, bars, loads and motions over time, the simulation."""

from dataclasses import dataclass
from math import pi, sqrt
from typing import Any

import numpy as np

Table = dict[str, Any]
MATERIALS = ((210e9, 0.3, 7850.0), (70e9, 0.33, 2700.0), (3e9, 0.35, 1200.0))  # E, ν, ρ
GRAVITY = 9.81
JUMPS = 0.04  # share of prescribed motions that jump, which nothing can follow


def quantity(value: float, unit: str) -> str:
    """Return a number of five digits with its unit."""
    return f"{float(f'{value:.5g}')!r} {unit}"


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
