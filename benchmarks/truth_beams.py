"""Reference of arms in a plane: geometrically exact beams, every node in space, without frame, modes or reduction.

Each bar stretches, shears and bends by any amount (Simo & Vu-Quoc, J Appl Mech 53, 1986, the plane case), in elements
of three nodes with positions and an angle, integrated at two points. A hinge is a node that two bars share with an
angle each, so that no joint is an equation. The mass matrix is constant; Newmark's method of average acceleration
marches the whole, and two steps are extrapolated. Nothing is shared with the product: neither mesh, nor shapes, nor
equations of motion, nor method.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from truth_parts import Table
from truth_references import course_of, number
from truth_scenes import Case

from fmd.accuracy.details import PlaceQuantity
from fmd.accuracy.error_estimates import Quantity
from fmd.core.arrays import Array

OUTPUTS = 100
FINE, COARSE = (12, 8), (9, 4)  # elements of a bar, steps in an output step: of the reference, and for its error
POINTS = np.polynomial.legendre.leggauss(2)[0]
CORRECTIONS = 30
SOLVED = 1e-13  # a correction of places, of the arm's length
SMALL = 1e-5  # of the duration: the step of differences of a prescribed angle


def shapes_at(xi: Array) -> tuple[Array, Array]:
    """Return the shape functions of three nodes on −1 … 1 and their derivatives, (n_points, 3) each."""
    N = np.stack([xi * (xi - 1) / 2, 1 - xi**2, xi * (xi + 1) / 2], axis=1)
    return N, np.stack([xi - 0.5, -2 * xi, xi + 0.5], axis=1)


SHAPES, SLOPES = shapes_at(POINTS)


@dataclass(frozen=True)
class Section:
    """A bar's length [m], depth [m], and stiffness and mass of its section."""

    length: float
    depth: float
    stiffness: Array  # against stretch [N], shear [N] and bending [N m²]
    area: float
    inertia: float
    rho: float

    @classmethod
    def of(cls, body: Table) -> Section:
        """Return the section of a body, of Cowper's shear area (J Appl Mech 33, 1966)."""
        length, depth, width, E, rho = (number(body[key]) for key in ("length", "depth", "width", "E", "rho"))
        A, inertia, nu = depth * width, width * depth**3 / 12, body["nu"]
        shear = E / (2 * (1 + nu)) * A * 10 * (1 + nu) / (12 + 11 * nu)
        return cls(length, depth, np.array([E * A, shear, E * inertia]), A, inertia, rho)


def _products(size: Array, one: Array, other: Array) -> Array:
    """Return the integrals of products of shapes with sizes (n_elements, n_points), (n_elements, 3, 3)."""
    pairs = np.einsum("ga,gb->gab", one, other).reshape(len(one), 9)
    return np.asarray((size @ pairs).reshape(-1, 3, 3))


class Arm:
    """Bars end to end, hinged to each other and to the ground, as beams in space.

    Coordinates are x, y and θ of each node; ``dofs`` (n_elements, 9) are those of an element's three nodes.
    """

    def __init__(self, case: Case, n_elements: int) -> None:
        table = case.table
        bodies = [table["body"][name] for name in case.bars]
        self.sections = [Section.of(body) for body in bodies]
        self.duration = number(table["simulation"]["duration"])
        self.n_elements = n_elements
        rows: list[Any] = []
        self.roots: list[Any] = []  # x, y and θ of each bar's ends
        self.tips: list[Any] = []
        places: list[tuple[int, float]] = []
        n_nodes, at, x0 = 2 * n_elements + 1, 0, 0.0
        for section in self.sections:
            own = at + np.arange(3 * n_nodes).reshape(n_nodes, 3)
            if self.tips:  # hinged: its place is the last bar's tip's
                own -= 2
                own[0] = [*self.tips[-1][:2], at]
            places += [(own[k, 0], x0 + section.length * k / (n_nodes - 1)) for k in range(n_nodes)]
            rows += [own[2 * k : 2 * k + 3].ravel() for k in range(n_elements)]
            self.roots.append(own[0])
            self.tips.append(own[-1])
            at, x0 = int(own.max()) + 1, x0 + section.length
        self.n, self.dofs = at, np.array(rows)
        self.start = np.zeros(self.n)
        for number_of_x, x in places:
            self.start[number_of_x] = x
        bar = np.repeat(np.arange(len(bodies)), n_elements)
        self.half = np.array([each.length for each in self.sections])[bar] / (2 * n_elements)
        self.D = np.stack([each.stiffness for each in self.sections])[bar]
        self.bar = bar
        self._add_mass(table)
        self._read_loads(table)

    def _add_mass(self, table: Table) -> None:
        xi, w = np.polynomial.legendre.leggauss(3)
        N, _ = shapes_at(xi)
        of_line = np.einsum("g,ga,gb->ab", w, N, N)
        self.masses = []  # of each bar, with what its tip carries
        for k, section in enumerate(self.sections):
            M = np.zeros((self.n, self.n))
            per = section.rho * np.array([section.area, section.area, section.inertia])
            for dofs in self.dofs[self.bar == k]:
                for axis in range(3):
                    own = dofs[axis::3]
                    M[np.ix_(own, own)] += per[axis] * section.length / (2 * self.n_elements) * of_line
            self.masses.append(M)
        if "load" in table["body"]:
            x, y, _ = self.tips[-1]
            self.masses[-1][[x, y], [x, y]] += number(table["body"]["load"]["mass"])
        self.M = sum(self.masses)

    def _read_loads(self, table: Table) -> None:
        self.along = np.zeros((2, self.n))  # x and y of every node
        for axis in range(2):
            self.along[axis, np.unique(self.dofs[:, axis::3])] = 1.0
        self.turn, self.loads = None, []
        for drive in table["drive"].values():
            if drive["type"] == "motion":
                self.turn = course_of(drive["angle"])
                continue
            way = np.zeros(self.n)
            if drive["type"] == "torque":
                k = list(table["joint"]).index(drive["joint"])
                way[self.roots[k][2]] = 1.0
                if k:
                    way[self.tips[k - 1][2]] = -1.0
            else:
                direction = np.array(drive["direction"], dtype=float)
                way[self.tips[-1][:2]] = (direction / np.linalg.norm(direction))[:2]
            self.loads.append((course_of(drive.get("torque", drive.get("force"))), way))
        self.spring = np.zeros((self.n, self.n))
        if "spring" in table["joint"]["elbow"]:
            apart = np.zeros(self.n)
            apart[self.roots[1][2]], apart[self.tips[0][2]] = 1.0, -1.0
            self.spring = number(table["joint"]["elbow"]["spring"]) * np.outer(apart, apart)
        x, y, theta = self.roots[0]
        self.held = [x, y] if self.turn is None else [x, y, theta]
        self.free = np.setdiff1d(np.arange(self.n), self.held)

    def loads_at(self, t: float) -> Array:
        """Return all forces on the coordinates but those of the material, (n,)."""
        return sum((course(t) * way for course, way in self.loads), np.zeros(self.n))

    def prescribed(self, t: float) -> tuple[float, float, float]:
        """Return the root's angle with its rate and acceleration, by differences."""
        if self.turn is None:
            return 0.0, 0.0, 0.0
        h = SMALL * self.duration
        middle = max(t, h)
        low, at, high = (self.turn(middle + x) for x in (-h, 0.0, h))
        acceleration = (high - 2 * at + low) / h**2
        return self.turn(t), (high - low) / (2 * h) + (t - middle) * acceleration, acceleration

    def strains(self, q: Array) -> tuple[Array, Array, Array, Array]:
        """Return stretch, shear, curvature and angle at the points of all elements, (n_elements, n_points) each."""
        nodes = q[self.dofs]
        x, y, turn = (nodes[:, k::3] @ SLOPES.T / self.half[:, None] for k in range(3))
        theta = nodes[:, 2::3] @ SHAPES.T
        c, s = np.cos(theta), np.sin(theta)
        return c * x + s * y - 1, c * y - s * x, turn, theta

    def forces(self, q: Array) -> tuple[Array, Array]:
        """Return the forces of the material on the coordinates (n,), and their derivatives (n, n)."""
        e, g, k, theta = self.strains(q)
        c, s = np.cos(theta), np.sin(theta)
        EA, GA, EI = self.D.T[:, :, None]
        N, V, w = EA * e, GA * g, self.half[:, None]  # both points have the weight 1
        f = np.zeros((len(e), 3, 3))
        f[:, :, 0], f[:, :, 1] = (N * c - V * s) @ SLOPES, (N * s + V * c) @ SLOPES
        f[:, :, 2] = EI * k @ SLOPES + w * (N * g - V * (1 + e)) @ SHAPES
        K = np.zeros((len(e), 3, 3, 3, 3))
        K[:, :, 0, :, 0] = _products((EA * c * c + GA * s * s) / w, SLOPES, SLOPES)
        K[:, :, 1, :, 1] = _products((EA * s * s + GA * c * c) / w, SLOPES, SLOPES)
        K[:, :, 0, :, 1] = K[:, :, 1, :, 0] = _products((EA - GA) * c * s / w, SLOPES, SLOPES)
        for axis, size in enumerate((EA * c * g + GA * s * (1 + e) - N * s - V * c,
                                     EA * s * g - GA * c * (1 + e) + N * c - V * s)):  # fmt: skip
            mixed = _products(size, SLOPES, SHAPES)
            K[:, :, axis, :, 2], K[:, :, 2, :, axis] = mixed, mixed.swapaxes(1, 2)
        turned = EA * g * g + GA * (1 + e) ** 2 - N * (1 + e) - V * g
        K[:, :, 2, :, 2] = _products(turned * w, SHAPES, SHAPES) + _products(EI / w + 0 * e, SLOPES, SLOPES)
        rows = (self.dofs[:, :, None] * self.n + self.dofs[:, None, :]).ravel()
        tangent = np.bincount(rows, K.ravel(), self.n**2).reshape(self.n, self.n)
        return np.bincount(self.dofs.ravel(), f.ravel(), self.n) + self.spring @ q, tangent + self.spring

    def march(self, substeps: int) -> tuple[Array, Array]:
        """Return positions and velocities at each step, (n_steps + 1, n) each, by Newmark's average acceleration."""
        h, free, root = self.duration / (OUTPUTS * substeps), self.free, self.roots[0][2]
        q, v, a = self.start.copy(), np.zeros(self.n), np.zeros(self.n)
        if self.turn is not None:
            q[root], v[root], a[root] = self.prescribed(0.0)
        M = self.M[np.ix_(free, free)]
        a[free] = np.linalg.solve(M, (self.loads_at(0.0) - self.forces(q)[0] - self.M @ a)[free])
        reach, found = sum(section.length for section in self.sections), [(q, v)]
        for t in h * np.arange(1, OUTPUTS * substeps + 1):
            loads, before, place = self.loads_at(t), v + h / 2 * a, q + h * v + h * h / 4 * a
            a = a.copy()
            if self.turn is not None:
                a[root] = self.prescribed(t)[2]
            for _ in range(CORRECTIONS):
                f, K = self.forces(place + h * h / 4 * a)
                left = (loads - f - self.M @ a)[free]
                change = np.linalg.solve(M + h * h / 4 * K[np.ix_(free, free)], left)
                a[free] += change
                if np.abs(change).max() * h * h / 4 < SOLVED * reach:
                    break
            else:
                raise RuntimeError(f"the beams' step to t = {t:g} s was not found")
            q, v = place + h * h / 4 * a, before + h / 2 * a
            found.append((q, v))
        return np.array([q for q, _ in found]), np.array([v for _, v in found])

    def motion(self, substeps: int) -> tuple[Array, Array, Array]:
        """Return positions, velocities and accelerations at each step, extrapolated from this step and its half.

        Errors of the method fall with the square of the step. Accelerations are slopes of the velocities, since those
        of single steps hold what the method makes of the fastest vibrations.
        """
        rough, fine = self.march(substeps), self.march(2 * substeps)
        q, v = ((4 * each[::2] - other) / 3 for each, other in zip(fine, rough, strict=True))
        times = np.arange(len(v)) * self.duration / (OUTPUTS * substeps)
        return q, v, CubicSpline(times, v)(times, 1)

    def stresses(self, q: Array, bar: int, spot: tuple[float, float]) -> tuple[float, float]:
        """Return the von Mises stress at a place (x, y) of a bar, and the largest at its elements' ends [Pa]."""
        section, mine = self.sections[bar], self.bar == bar
        forces = (np.stack(self.strains(q)[:3], axis=-1) * self.D[:, None])[mine]
        ends = np.linspace(0.0, section.length, self.n_elements + 1)
        points = ends[:-1, None] + (POINTS + 1) / 2 * ends[1]  # where the elements are most accurate
        along = CubicSpline(points.ravel(), forces.reshape(-1, 3))
        normal, _, bending = np.abs(along(ends)).T
        largest = (normal / section.area + bending * section.depth / 2 / section.inertia).max()
        N, V, moment = along(spot[0])
        sigma = N / section.area - moment * spot[1] / section.inertia
        tau = 1.5 * V / section.area * (1 - (2 * spot[1] / section.depth) ** 2)
        return float(np.hypot(sigma, np.sqrt(3) * tau)), float(largest)

    def quantities(self, case: Case, substeps: int) -> dict[str, Quantity]:
        """Return joints, tips, reactions, energy and stress over the output times, under a budget's names."""
        q, v, a = self.motion(substeps)
        bent = self._deflection(q)
        out = slice(None, None, substeps)
        found = [
            Quantity("tip, deflection", "m", bent[out]),
            Quantity("tip, largest deflection", "m", np.linalg.norm(bent, axis=1), largest=True),
            Quantity("kinetic energy", "J", 0.5 * np.einsum("ti,ij,tj->t", v[out], self.M, v[out])),
        ]
        q, v, a = q[out], v[out], a[out]
        times = np.arange(OUTPUTS + 1) * self.duration / OUTPUTS
        pushes = np.array([self.loads_at(t) for t in times]) @ self.along.T
        for name, bars in (("hub", slice(0, None)), ("elbow", slice(1, None))):
            change = a @ sum(self.masses[bars]) @ self.along.T  # of momentum
            found.append(Quantity(f"{name}.force", "N", _in_space(change - pushes)))
        joints = {"elbow": (self.roots[1][2], self.tips[0][2])}
        if self.turn is None:
            joints["hub"] = (self.roots[0][2], None)
        for name, (on, of) in joints.items():
            found += [
                Quantity(f"{name}, {what}", unit, each[:, on] - (each[:, of] if of is not None else 0.0))
                for what, unit, each in (("angle", "rad", q), ("rate", "rad/s", v))
            ]
        for k, name in enumerate(case.bars):
            tip = self.tips[k][:2]
            found += [
                PlaceQuantity(f"{name}.tip.position", "m", _in_space(q[:, tip])),
                Quantity(f"{name}.tip.velocity", "m/s", _in_space(v[:, tip])),
                Quantity(f"{name}.tip.acceleration", "m/s^2", _in_space(a[:, tip])),
            ]
            x, y, _ = (number(each) for each in case.table["body"][name]["element"]["spot"]["at"])
            spot, largest = np.array([self.stresses(each, k, (x, y)) for each in q]).T
            label = f"{name}.spot, von Mises stress"
            found += [
                Quantity(f"{name}, largest von Mises stress", "Pa", largest, largest=True),
                Quantity(label, "Pa", spot),
                Quantity(f"{label}, largest", "Pa", spot, largest=True),
            ]
        return {each.name: each for each in found}

    def _deflection(self, q: Array) -> Array:
        """Return how the last bar's tip lies beside where its root's section has it, in its axes, (n_times, 3)."""
        root, tip = self.roots[-1], self.tips[-1]
        across, theta = q[:, tip[:2]] - q[:, root[:2]], q[:, root[2]]
        c, s = np.cos(theta), np.sin(theta)
        along = c * across[:, 0] + s * across[:, 1] - self.sections[-1].length
        return np.stack([along, c * across[:, 1] - s * across[:, 0], np.zeros(len(q))], axis=1)


def _in_space(plane: Array) -> Array:
    return np.concatenate([plane, np.zeros((len(plane), 1))], axis=1)


def beams_reference(case: Case) -> tuple[dict[str, Quantity], dict[str, float]]:
    """Return an arm's quantities by beams, and by how much these are off at most."""
    fine, coarse = (Arm(case, elements).quantities(case, steps) for elements, steps in (FINE, COARSE))
    return fine, {name: coarse[name].error(each) for name, each in fine.items()}
