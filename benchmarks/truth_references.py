"""References of random scenes by a path of their own: planar bars as elasticae.

A planar bar is Euler's elastica in motion: a line that doesn't stretch and bends by any angle, ``θ(s)`` being a
polynomial of Legendre's on each bar. Positions are the integrals of ``(cos θ, sin θ)`` by Gauss's quadrature, so that
kinetic energy, gravity and loads are exact for any rotation, and no floating frame, finite element or mode is in it.
Shear and stretch are left out, which is an error of the order of the depth's square over the length's.
"""

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import eigh
from truth_parts import Table
from truth_scenes import Case

from fmd.accuracy.error_estimates import Quantity
from fmd.core.arrays import Array

SAMPLES = 8  # of the elastica in an output step: where the largest deflection is looked for
DEGREES = ((12, 9), (9, 7))  # of one bar, and of each of two: of the reference, and of what measures its error
ANGLE = 1.0  # radians of the highest frequency in a step of the elastica's
INPUTS = 9  # angle, rate, acceleration; torque at the root, couple at the tip, force in space, following force
SHEAR = 0.8  # part of the deflection by shear over (depth / length)²
OF_MATH: Table = {name: getattr(math, name) for name in ("sin", "cos", "tan", "exp", "log", "sqrt", "tanh", "pi")}
OF_MATH |= {"abs": abs, "min": min, "max": max}
SMALL = 1e-4  # of the duration: the step of differences of a prescribed motion


def number(text: str) -> float:
    """Return the value of a quantity that is written in SI units."""
    return float(text.split(maxsplit=1)[0])


def course_of(value: Any) -> Callable[[float], float]:
    """Return a quantity of a scene as a function of time, in SI units."""
    if isinstance(value, str):
        constant = number(value)
        return lambda t: constant
    if "formula" in value:
        code = compile(value["formula"], "formula", "eval")
        return lambda t: float(eval(code, {"__builtins__": {}}, OF_MATH | {"t": t}))
    times, values = [number(t) for t in value["times"]], value["values"]
    return lambda t: float(np.interp(t, times, values))


def breaks_of(value: Any) -> list[float]:
    """Return the times at which a quantity or its slope jumps."""
    if isinstance(value, str):
        return []
    if "formula" in value:
        return [float(text) for text in re.findall(r"t < ([-+.\de]+)", value["formula"])]
    return [number(t) for t in value["times"]]


def equations(arrays, numbers, c, v, inputs):
    """Return mass (n, n) and force (n,) of the elastica; ``inputs`` are those of `Elastica.inputs_at`."""
    B, b, W, tip, mu, J, K, tip_angle, pull = arrays
    base, root, m, gx, gy, b_tip = numbers
    theta, rates = B @ c + b * inputs[0], B @ v + b * inputs[1]
    cos, sin = np.cos(theta), np.sin(theta)
    along, across = -(rates**2), b * inputs[2]
    Nx, Ny = -np.expand_dims(sin, 1) * B, np.expand_dims(cos, 1) * B
    Jx, Jy, tx, ty = W @ Nx, W @ Ny, Nx.T @ tip, Ny.T @ tip
    ax, ay = cos * along - sin * across, sin * along + cos * across
    if base >= 0:
        Jy[:, base] += 1.0
        ty[base] += 1.0
    M = Jx.T @ (np.expand_dims(mu, 1) * Jx) + Jy.T @ (np.expand_dims(mu, 1) * Jy) + B.T @ (np.expand_dims(J, 1) * B)
    M += m * (np.outer(tx, tx) + np.outer(ty, ty))
    f = -Jx.T @ (mu * (W @ ax - gx)) - Jy.T @ (mu * (W @ ay - gy)) - B.T @ (J * across)
    f -= m * (tx * (tip @ ax - gx) + ty * (tip @ ay - gy)) + K @ c + pull * inputs[0]
    if root >= 0:
        f[root] += inputs[3]
    turned = tip_angle @ c + b_tip * inputs[0]
    Fx = inputs[5] + np.cos(turned) * inputs[7] - np.sin(turned) * inputs[8]
    Fy = inputs[6] + np.sin(turned) * inputs[7] + np.cos(turned) * inputs[8]
    return M, f + inputs[4] * tip_angle + Fx * tx + Fy * ty


def march_steps(arrays, numbers, start, inputs, h, within):
    """Integrate by the classical Runge-Kutta method; every ``within`` steps a row is kept."""
    n = len(start) // 2
    found = np.zeros((len(inputs) // within + 1, 2 * n))
    y = start.copy()
    found[0] = y
    slopes = np.zeros((4, 2 * n))
    for k in range(len(inputs)):
        for stage in range(4):
            part = 0.0 if stage == 0 else 1.0 if stage == 3 else 0.5
            at = y + part * h * slopes[stage - 1] if stage else y
            M, f = equations(arrays, numbers, at[:n], at[n:], inputs[k, (stage + 1) // 2])
            slopes[stage, :n] = at[n:]
            slopes[stage, n:] = np.linalg.solve(M, f)
        y = y + h / 6 * (slopes[0] + 2 * slopes[1] + 2 * slopes[2] + slopes[3])
        if (k + 1) % within == 0:
            found[(k + 1) // within] = y
    return found


class Elastica:
    """One or two planar bars end to end, as lines that bend but don't stretch.

    Coordinates are the base's displacement along y, if it slides, the angle of each root that turns, and the
    polynomials of each bar, which vanish at its root. Angles are linear in them: ``θ = B c + b Θ(t)``.
    """

    def __init__(self, case: Case, degree: int) -> None:
        table = case.table
        joints, drives = table["joint"], list(table.get("drive", {}).values())
        bodies = [table["body"][name] for name in case.bars]
        self.gravity = np.array([number(x) for x in table["simulation"]["gravity"]])[:2]
        self.duration = number(table["simulation"]["duration"])
        self.lengths = [number(body["length"]) for body in bodies]
        self.turn = next((course_of(each["angle"]) for each in drives if each["type"] == "motion"), None)
        hub, elbow = joints["hub"], joints.get("elbow", {})
        slides, turns = hub["type"] == "prismatic", hub["type"] == "revolute" and self.turn is None
        hinged = elbow.get("type") == "revolute"
        n_bars = len(bodies)
        self.base = 0 if slides else None
        self.root = int(slides) if turns else None
        self.hinge = int(slides) + int(turns) if hinged else None
        first = int(slides) + int(turns) + int(hinged)
        self.n = first + degree * n_bars
        s, w = legendre.leggauss(degree + 6)
        s, w = (s + 1) / 2, w / 2
        # Integrals from the root to each point, of the polynomial through all of them.
        powers = legendre.legvander(2 * s - 1, len(s) - 1)
        integral = np.stack([legendre.legval(2 * s - 1, legendre.legint(row, lbnd=-1)) / 2 for row in np.eye(len(s))])
        inner = integral.T @ np.linalg.inv(powers)
        shapes = [legendre.Legendre.basis(k, domain=[0, 1]) for k in range(1, degree + 1)]
        Q = len(s)
        self.B, self.D = np.zeros((Q * n_bars, self.n)), np.zeros((Q * n_bars, self.n))
        self.W, self.to_ends = np.zeros((Q * n_bars, Q * n_bars)), np.zeros((n_bars + 1, Q * n_bars))
        self.mu, self.J, self.K = (np.zeros(Q * n_bars) for _ in range(3))
        self.ends = np.zeros((2 * n_bars, self.n))  # angles of each bar's root and tip
        for k, body in enumerate(bodies):
            length, depth, width, E, rho = (number(body[key]) for key in ("length", "depth", "width", "E", "rho"))
            rows, columns = slice(Q * k, Q * (k + 1)), slice(first + degree * k, first + degree * (k + 1))
            before = np.zeros(self.n)
            if k == 0 and self.root is not None:
                before[self.root] = 1.0
            elif k and self.hinge is not None:
                before[self.hinge] = 1.0
            elif k:
                before = self.ends[2 * k - 1]
            self.ends[2 * k] = before
            self.ends[2 * k + 1] = before
            self.ends[2 * k + 1, columns] = [shape(1.0) - shape(0.0) for shape in shapes]
            self.B[rows] = before
            self.B[rows, columns] = np.stack([shape(s) - shape(0.0) for shape in shapes], axis=1)
            self.D[rows, columns] = np.stack([shape.deriv()(s) for shape in shapes], axis=1) / length
            self.W[rows, rows] = inner * length
            self.W[Q * (k + 1) :, rows] = w * length
            self.to_ends[k + 1 :, rows] = w * length
            self.mu[rows] = rho * depth * width * length * w
            self.J[rows] = rho * width * depth**3 / 12 * length * w
            self.K[rows] = E * width * depth**3 / 12 * length * w
        # A prescribed angle turns what hangs on the root: all but the bar beyond a hinge.
        self.b = np.ones(Q * n_bars)
        self.b_ends = np.ones(2 * n_bars)
        if hinged:
            self.b[Q:], self.b_ends[2:] = 0.0, 0.0
        load = table["body"].get("load")
        self.tip_mass = number(load["mass"]) if load else 0.0
        self.stiffness = self.D.T @ (self.K[:, None] * self.D)
        self._add_springs(hub, elbow)
        self.loads = [(each["type"], *self._load(each)) for each in drives if each["type"] != "motion"]
        self.arrays = (self.B, self.b, self.W, self.to_ends[-1].copy(), self.mu, self.J, self.stiffness, self.ends[-1],
                       self.elbow_pull * (self.ends[2] - self.ends[1]) if hinged else np.zeros(self.n))  # fmt: skip
        index = (-1 if self.base is None else self.base, -1 if self.root is None else self.root)
        self.numbers = (*index, self.tip_mass, *self.gravity, float(self.b_ends[-1]))
        values = [each.get("force", each.get("torque", each.get("angle"))) for each in drives]
        jumps = {t for value in values for t in breaks_of(value) if 0 < t < self.duration}
        self.pieces = [0.0, *sorted(jumps), self.duration]
        self.start = np.zeros(2 * self.n)
        if self.root is not None:
            rate = number(hub.get("rate", "0"))
            self.start[self.n + self.root] = rate
            if self.hinge is not None:  # the whole turns as one
                self.start[self.n + self.hinge] = rate
        if self.turn is not None and self.hinge is not None:
            self.start[self.n + self.hinge] = self._prescribed(0.0)[1]

    def _add_springs(self, hub: Table, elbow: Table) -> None:
        self.elbow_pull = 0.0
        if "spring" in hub:
            k = self.base if self.base is not None else self.root
            if k is not None:
                self.stiffness[k, k] += number(hub["spring"])
        if self.hinge is not None:
            apart = self.ends[2] - self.ends[1]
            spring = number(elbow["spring"])
            self.stiffness += spring * np.outer(apart, apart)
            self.elbow_pull = spring * (0.0 if self.turn is None else -1.0)  # its part by the prescribed angle

    def _load(self, drive: Table) -> tuple[Callable[[float], float], Array, bool]:
        way = np.array(drive.get("direction", [0, 0, 1]), dtype=float)
        return course_of(drive.get("force", drive.get("torque"))), way / np.linalg.norm(way), bool(
            drive.get("following", False)
        )  # fmt: skip

    def _prescribed(self, t: float) -> tuple[float, float, float]:
        """Return the prescribed angle, its rate and its acceleration, by differences within a smooth piece."""
        if self.turn is None:
            return 0.0, 0.0, 0.0
        h = SMALL * self.duration
        k = min(max(int(np.searchsorted(self.pieces, t, "right")) - 1, 0), len(self.pieces) - 2)
        middle = min(max(t, self.pieces[k] + h), self.pieces[k + 1] - h)
        low, at, high = (self.turn(middle + x) for x in (-h, 0.0, h))
        rate, acceleration = (high - low) / (2 * h), (high - 2 * at + low) / h**2
        return self.turn(t), rate + (t - middle) * acceleration, acceleration

    def _places(self, c: Array, turn: float) -> tuple[Array, Array]:
        """Return the angles of all points, and the positions of the bars' ends (n_bars + 1, 2)."""
        theta = self.B @ c + self.b * turn
        way = np.stack([np.cos(theta), np.sin(theta)], axis=1)
        return theta, self.to_ends @ way + [0.0, c[self.base] if self.base is not None else 0.0]

    def inputs_at(self, times: Array) -> Array:
        """Return prescribed angle, rate and acceleration, and the loads, at some times (n_times, `INPUTS`)."""
        found = np.zeros((len(times), INPUTS))
        for k, t in enumerate(times):
            found[k, :3] = self._prescribed(t)
            for kind, course, way, following in self.loads:
                size = course(t)
                if kind == "torque":
                    found[k, 3] += size
                elif kind == "point torque":
                    found[k, 4] += size * way[2]
                else:
                    found[k, 5 + 2 * following : 7 + 2 * following] += size * way[:2]
        return found

    def march(self) -> tuple[Array, Array]:
        """Return times, `SAMPLES` in an output step, and coordinates and rates there, (n_times, 2 n)."""
        still = np.zeros(INPUTS)
        M, _ = equations(self.arrays, self.numbers, self.start[: self.n], self.start[self.n :], still)
        fastest = float(np.sqrt(eigh(self.stiffness, M, eigvals_only=True)[-1]))
        n_samples = 100 * SAMPLES
        within = int(np.ceil(max(fastest * self.duration / (ANGLE * n_samples), 1.0)))
        h = self.duration / (n_samples * within)
        begins = h * np.arange(n_samples * within)
        # Just within the step, so that a load that jumps at one of its ends has the step's own value.
        inputs = np.stack([self.inputs_at(begins + part * h) for part in (1e-6, 0.5, 1 - 1e-6)], axis=1)
        motion = march_steps(self.arrays, self.numbers, self.start, inputs, h, within)
        if not np.isfinite(motion).all():
            raise RuntimeError("the elastica's march diverged")
        return h * within * np.arange(n_samples + 1), motion

    def quantities(self, joints: Table) -> dict[str, Quantity]:
        """Return joints, tip and kinetic energy over the output times, under a budget's names."""
        times, motion = self.march()
        chosen = slice(None, None, SAMPLES)
        bent, kinetic = np.zeros((len(times), 3)), np.zeros(len(times))
        angles, rates = np.zeros((len(times), len(self.ends))), np.zeros((len(times), len(self.ends)))
        for k, (t, y) in enumerate(zip(times, motion, strict=True)):
            c, v = y[: self.n], y[self.n :]
            turn, spin, _ = self._prescribed(t)
            theta, ends = self._places(c, turn)
            angles[k], rates[k] = self.ends @ c + self.b_ends * turn, self.ends @ v + self.b_ends * spin
            along, across = ends[-1] - ends[-2]
            co, si = math.cos(angles[k, -2]), math.sin(angles[k, -2])
            bent[k] = co * along + si * across - self.lengths[-1], co * across - si * along, 0.0
            turning = self.B @ v + self.b * spin
            way = np.stack([-np.sin(theta), np.cos(theta)], axis=1) * turning[:, None]
            base = np.array([0.0, v[self.base] if self.base is not None else 0.0])
            speed, tip = self.W @ way + base, self.to_ends[-1] @ way + base
            kinetic[k] = 0.5 * (self.mu @ (speed**2).sum(axis=1) + self.J @ turning**2 + self.tip_mass * tip @ tip)
        found = [
            Quantity("tip, deflection", "m", bent[chosen]),
            Quantity("tip, largest deflection", "m", np.linalg.norm(bent, axis=1), largest=True),
            Quantity("kinetic energy", "J", kinetic[chosen]),
        ]
        if self.root is not None:
            found += [
                Quantity("hub, angle", "rad", angles[chosen, 0]),
                Quantity("hub, rate", "rad/s", rates[chosen, 0]),
            ]
        if self.base is not None:
            found += [Quantity("hub, position", "m", motion[chosen, 0]),
                      Quantity("hub, rate", "m/s", motion[chosen, self.n])]  # fmt: skip
        if self.hinge is not None:
            found += [Quantity("elbow, angle", "rad", (angles[:, 2] - angles[:, 1])[chosen]),
                      Quantity("elbow, rate", "rad/s", (rates[:, 2] - rates[:, 1])[chosen])]  # fmt: skip
        return {each.name: each for each in found}


def elastica_reference(case: Case) -> tuple[dict[str, Quantity], dict[str, float]]:
    """Return the elastica's quantities of a planar scene, and by how much they are off at most."""
    fine, coarse = (Elastica(case, p).quantities(case.table["joint"]) for p in DEGREES[len(case.bars) - 1])
    thick = max(number(body["depth"]) / number(body["length"]) for body in map(case.table["body"].get, case.bars))
    return fine, {name: coarse[name].error(each) + shear_shift(case, thick) for name, each in fine.items()}


def shear_shift(case: Case, thick: float) -> float:
    """Return how much shear changes a vibration by the end: its share of the deflection, and of the phase."""
    return SHEAR * thick**2 * (1 + math.pi * case.periods)
