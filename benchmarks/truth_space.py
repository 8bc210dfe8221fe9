"""References of trees in space by exact beams: a scene as nodes, elements and joints, and its quantities."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
from truth_parts import Table
from truth_references import course_of, number
from truth_scenes import Case
from truth_spatial import Bodies, Joint

from fmd.accuracy.details import PlaceQuantity
from fmd.accuracy.error_estimates import Quantity
from fmd.core.arrays import Array

OUTPUTS = 100
FINE, COARSE = (8, 4), (6, 3)  # elements of a bar, steps in an output step; doubled once more, and extrapolated
SHORTER = (1, 2, 4)  # times as many steps, where one of them has no solution
SMALL = 1e-5  # of the duration: the step of a prescribed angle's first difference
TERMS = 40  # of the series of a rectangle's torsion


def torsion_constant(depth: float, width: float) -> float:
    """Return the torsion constant of a rectangle (Timoshenko & Goodier, Theory of Elasticity, art. 109) [m⁴]."""
    a, b = sorted((depth, width))
    odd = np.arange(1, 2 * TERMS, 2)
    return b * a**3 / 3 * (1 - 192 * a / (math.pi**5 * b) * float((np.tanh(odd * math.pi * b / 2 / a) / odd**5).sum()))


class Tree:
    """A tree of bars and rigid bodies in space as nodes, elements and joints."""

    def __init__(self, case: Case, n_elements: int) -> None:
        self.table, self.n_elements = case.table, n_elements
        self.duration = number(case.table["simulation"]["duration"])
        self.x: list[Array] = [np.zeros(3)]
        self.mass: list[float] = [0.0]
        self.inertia: list[Array] = [np.zeros((3, 3))]
        self.v: list[Array] = [np.zeros(6)]
        self.ends: list[tuple[int, int]] = []
        self.stiffness: list[Array] = []
        self.markers: dict[str, tuple[int, Array]] = {"ground": (0, np.zeros(3))}  # node and place in its axes
        self.nodes: dict[str, list[int]] = {}  # of each body
        self.joints: dict[str, Joint] = {}
        for name, table in case.table["joint"].items():
            self._add(name, table)
        self.pushes = []
        for drive in case.table.get("drive", {}).values():
            self._drive(drive)
        gravity = np.array([number(each) for each in case.table["simulation"]["gravity"]])
        self.bodies = Bodies(
            np.array(self.x), np.array(self.mass), np.array(self.inertia), np.reshape(self.ends, (-1, 2)).astype(int),
            np.reshape(self.stiffness, (-1, 6)), [each for each in self.joints.values() if each.kind != "free"],
            self.pushes, gravity, np.array(self.v),
        )  # fmt: skip

    def _drive(self, drive: Table) -> None:
        if drive["type"] == "torque":
            self.joints[drive["joint"]].load = course_of(drive["torque"])
        elif drive["type"] == "point force":
            node, place = self.markers[drive["marker"]]
            way = np.array(drive["direction"], dtype=float)
            course, way = course_of(drive["force"]), way / np.linalg.norm(way)
            self.pushes.append((node, place, lambda t: course(t) * way, bool(drive.get("following", False))))

    def _add(self, name: str, table: Table) -> None:
        """Add a joint and the body that it carries, which moves with its parent and along the joint at first."""
        child, marker = table["child"].split(".")
        parent, at_parent = self.markers[table["parent"]]
        axis = np.array(table.get("axis", [1, 0, 0]), dtype=float)
        axis, spins = axis / np.linalg.norm(axis), np.zeros(3)
        moves = self.v[parent][:3] + np.cross(self.v[parent][3:], at_parent)
        drives = [each for each in self.table.get("drive", {}).values() if each.get("joint") == name]
        motion = next((each["angle"] for each in drives if each["type"] == "motion"), None)
        kind = table["type"] if motion is None else "driven"
        joint = Joint(parent, 0, at_parent, np.zeros(3), kind, axis)
        if motion is not None:
            h, course = SMALL * self.duration, course_of(motion)
            joint.angle = course
            spins = axis * (4 * course(h) - course(2 * h) - 3 * course(0.0)) / (2 * h)
        elif table["type"] == "revolute":
            spins = axis * number(table.get("rate", "0"))
        elif table["type"] == "prismatic":
            moves = moves + axis * number(table.get("rate", "0"))
        elif table["type"] in ("free", "spherical"):
            spins = np.array([number(each) for each in table.get("spin", ["0"] * 3)])
            moves = moves + np.array([number(each) for each in table.get("velocity", ["0"] * 3)])
        joint.spring, joint.damper = (number(table.get(key, "0")) for key in ("spring", "damper"))
        place, omega = self.x[parent] + at_parent, self.v[parent][3:] + spins
        self._add_body(child, self.table["body"][child], marker, place, moves, omega)
        joint.child, joint.at_child = self.markers[f"{child}.{marker}"]
        self.joints[name] = joint

    def _add_body(self, name: str, body: Table, marker: str, place: Array, moves: Array, omega: Array) -> None:
        """Add the nodes of a body whose marker is at a place in space and moves there."""
        if body["shape"] == "bar":
            nodes = self._add_bar(name, body, place)
        else:
            at = {key: np.array([number(each) for each in own["at"]]) for key, own in body["marker"].items()}
            mass, inertia, centre = number(body["mass"]), np.zeros(3), np.zeros(3)
            if body["shape"] == "rod":
                length = number(body["length"])
                centre, inertia = np.array([length / 2, 0, 0]), mass * length**2 / 12 * np.array([0, 1, 1])
            elif body["shape"] == "rigid":
                centre = np.array([number(each) for each in body["centre"]])
                inertia = np.array([number(each) for each in body["inertia"]])
            nodes = [self._add_node(place + centre - at[marker], mass, np.diag(inertia))]
            self.markers |= {f"{name}.{key}": (nodes[0], own - centre) for key, own in at.items()}
        for node in nodes:
            self.v[node] = np.concatenate([moves + np.cross(omega, self.x[node] - place), omega])
        self.nodes[name] = nodes

    def _add_node(self, x: Array, mass: float, inertia: Array) -> int:
        self.x.append(x)
        self.mass.append(mass)
        self.inertia.append(inertia)
        self.v.append(np.zeros(6))
        return len(self.x) - 1

    def _add_bar(self, name: str, body: Table, place: Array) -> list[int]:
        """Add a bar from its root, along x, of Cowper's shear area (J Appl Mech 33, 1966)."""
        length, depth, width, young, rho = (number(body[key]) for key in ("length", "depth", "width", "E", "rho"))
        A, nu = depth * width, body["nu"]
        shear = young / (2 * (1 + nu))
        Iz, Iy = width * depth**3 / 12, depth * width**3 / 12
        of_shear = shear * A * 10 * (1 + nu) / (12 + 11 * nu)
        stiffness = [young * A, of_shear, of_shear, shear * torsion_constant(depth, width), young * Iy, young * Iz]
        n, nodes = self.n_elements, []
        for k in range(n + 1):
            share = length / n * (0.5 if k in (0, n) else 1.0)
            part = rho * share * np.diag([Iy + Iz, Iy, Iz])
            nodes.append(self._add_node(place + np.array([k * length / n, 0, 0]), rho * A * share, part))
        self.ends += list(pairwise(nodes))
        self.stiffness += [np.array(stiffness)] * n
        self.markers |= {f"{name}.root": (nodes[0], np.zeros(3)), f"{name}.tip": (nodes[-1], np.zeros(3))}
        return nodes

    def beyond(self, name: str) -> list[int]:
        """Return the nodes of all bodies that a joint carries."""
        carried, found = [self.joints[name].child], []
        while carried:
            node = carried.pop()
            own = next(nodes for nodes in self.nodes.values() if node in nodes)
            found += own
            carried += [each.child for each in self.joints.values() if each.parent in own]
        return found

    def values(self, substeps: int) -> dict[str, Array]:
        """Return quantities at the output times, by their names; of what only the size counts the size."""
        rows: dict[str, list[Any]] = {}
        bodies, steps = self.bodies, OUTPUTS * substeps
        tip, _, marker = self.table["simulation"]["tip"].partition(".")
        carried = {
            name: self.beyond(name) for name, each in self.joints.items() if each.kind not in ("free", "prismatic")
        }

        def look(x: Array, R: Array, v: Array, a: Array, t: float) -> None:
            now: dict[str, Any] = {}
            for name, (node, place) in self.markers.items():
                if name != "ground":
                    w, b = v[node, 3:], a[node, 3:]
                    whirl = np.cross(b, place) + np.cross(w, np.cross(w, place))
                    now[f"{name}.position"] = x[node] + R[node] @ place
                    now[f"{name}.velocity"] = v[node, :3] + R[node] @ np.cross(w, place)
                    now[f"{name}.acceleration"] = a[node, :3] + R[node] @ whirl
            spin = np.einsum("ni,nij,nj", v[:, 3:], bodies.inertia, v[:, 3:])
            now["kinetic energy"] = 0.5 * (bodies.mass @ (v[:, :3] ** 2).sum(axis=1) + spin)
            outer = np.zeros((len(x), 3))
            outer += bodies.mass[:, None] * bodies.gravity
            for node, _, push, follows in bodies.pushes:
                outer[node] += R[node] @ push(t) if follows else push(t)
            for name, joint in self.joints.items():
                if name in carried:
                    now[f"{name}.force"] = (bodies.mass[:, None] * a[:, :3] - outer)[carried[name]].sum(axis=0)
                if joint.has_load:
                    at, slope = joint.coordinate(x, R)
                    what = "angle" if joint.kind == "revolute" else "position"
                    dofs = np.r_[6 * joint.parent : 6 * joint.parent + 6, 6 * joint.child : 6 * joint.child + 6]
                    now[f"{name}, {what}"], now[f"{name}, rate"] = at, slope @ v.ravel()[dofs]
            if len(self.nodes[tip]) > 1:
                root, end = self.nodes[tip][0], self.markers[f"{tip}.{marker}"][0]
                now["tip, deflection"] = R[root].T @ (x[end] - x[root]) - (bodies.x[end] - bodies.x[root])
            for name, value in now.items():
                rows.setdefault(name, []).append(value)

        bodies.march(self.duration / steps, steps, substeps, look)
        return {name: np.array(value) for name, value in rows.items()}


def extrapolated(case: Case, n_elements: int, substeps: int) -> dict[str, Quantity]:
    """Return a tree's quantities, extrapolated from a number of elements and steps and from twice as many."""
    rough, fine = Tree(case, n_elements).values(substeps), Tree(case, 2 * n_elements).values(2 * substeps)
    found = []
    for name, own in fine.items():
        kind = PlaceQuantity if name.endswith(".position") else Quantity
        found.append(kind(name, "", (4 * own - rough[name]) / 3))
    return {each.name: each for each in found}


def space_reference(case: Case) -> tuple[dict[str, Quantity], dict[str, float]]:
    """Return a tree's quantities by beams in space, and by how much these are off at most."""
    for times in SHORTER:
        try:
            fine, coarse = (extrapolated(case, elements, times * steps) for elements, steps in (FINE, COARSE))
        except RuntimeError:
            if times == SHORTER[-1]:
                raise
        else:
            break
    return fine, {name: coarse[name].error(each) for name, each in fine.items()}
