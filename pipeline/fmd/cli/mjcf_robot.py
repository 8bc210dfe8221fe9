"""A robot from an MJCF file, MuJoCo's own format: bodies with inertia and geoms, joints, sites.

The file's conventions are those of its reference (mujoco.readthedocs.io/en/stable/XMLreference.html): a body's frame is
given in its parent's, its joints act in their order at places in the body's frame, angles are in degrees unless the
compiler says radian, and a body without ``inertial`` has the mass of its geoms.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from fmd.cli.geoms import Geom, SolidMass, add_masses
from fmd.cli.robot import Pose, Robot, RobotJoint, RobotLink, Shape, read_numbers, read_xml
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.limits.scene import LIGHT_SHARE

_WORLD = "world"
_READ = {"compiler", "option", "default", "asset", "worldbody", "equality", "include"}
_IDLE = {"visual", "statistic", "size", "custom"}  # pictures and sizes of arrays
_KINDS = {"hinge": "revolute", "slide": "prismatic", "ball": "ball", "free": "floating"}

Attributes = Mapping[str, str]


def read_mjcf(path: Path) -> Robot:
    """Read an MJCF file.

    Raises
    ------
    InputError
        It can't be read, is no MJCF, or has a body whose inertia or place isn't clear.
    """
    top = read_xml(path, "mujoco", "MJCF")
    try:
        _include(top, path)
        return _Reader(top, path).robot()
    except (KeyError, ValueError) as error:
        raise InputError(str(path), "", None, f"has an element that can't be read: {error}") from None


def _include(top: ElementTree.Element, path: Path) -> None:
    """Put the elements of included files in their places."""
    for parent in [*top.iter()]:
        for place, element in reversed([*enumerate(parent)]):
            if element.tag == "include":
                parent.remove(element)
                file = path.parent / element.attrib["file"]
                other = read_xml(file, "mujoco", "MJCF")
                _include(other, path)
                for child in reversed(other):
                    parent.insert(place, child)


class _Reader:
    """Reads links and joints body by body, with the classes of defaults."""

    def __init__(self, top: ElementTree.Element, path: Path) -> None:
        self.top, self.path = top, path
        self.compiler: dict[str, str] = {}
        for element in top.findall("compiler"):
            self.compiler |= element.attrib
        for key, value in (("coordinate", "global"), ("inertiafromgeom", "true"), ("balanceinertia", "true")):
            if self.compiler.get(key) == value:
                raise InputError(str(path), f"compiler {key}", value, "isn't read; save the model compiled")
        if float(self.compiler.get("settotalmass", "-1")) > 0.0:
            raise InputError(str(path), "compiler settotalmass", None, "isn't read; save the model compiled")
        self.unit = 1.0 if self.compiler.get("angle", "degree") == "radian" else math.pi / 180
        self.defaults: dict[str, dict[str, dict[str, str]]] = {}
        for element in top.findall("default"):
            self._read_defaults(element, {})
        self.meshes = {
            mesh.get("name", Path(mesh.get("file", "")).stem): self._of(mesh, "main")
            for mesh in top.iterfind("asset/mesh")
        }
        self.links: dict[str, RobotLink] = {_WORLD: RobotLink(_WORLD, 0.0, np.zeros(3), np.zeros((3, 3)))}
        self.joints: dict[str, RobotJoint] = {}
        self.notes: list[str] = []

    def robot(self) -> Robot:
        """Return the robot."""
        worlds = self.top.findall("worldbody")
        if any(world.find("geom") is not None for world in worlds):
            self.notes.append("geoms of the world, and contact of others, aren't taken: as in docs/contact.md")
        for world in worlds:
            self._read_children(world, _WORLD, np.zeros(3), world.get("childclass", "main"))
        if len(self.links) == 1:
            raise InputError(str(self.path), "worldbody", None, "has no body")
        self._read_followers()
        others = sorted({child.tag for child in self.top} - _READ - _IDLE)
        self.notes += [f"<{tag}> isn't read{self._names_in(tag)}" for tag in others]
        option = {key: value for element in self.top.findall("option") for key, value in element.attrib.items()}
        x, y, z = read_numbers(option.get("gravity"), "0 0 -9.81").tolist()
        name = self.top.get("model", self.path.stem)
        return Robot(name, self.links, self.joints, _WORLD, tuple(self.notes), (x, y, z))

    def _names_in(self, tag: str) -> str:
        names = [child.get("name", child.tag) for element in self.top.findall(tag) for child in element]
        return f": {', '.join(names[:6])}{' …' if len(names) > 6 else ''}" if names else ""

    def _read_defaults(self, element: ElementTree.Element, inherited: dict[str, dict[str, str]]) -> None:
        own = {tag: dict(values) for tag, values in inherited.items()}
        for child in element:
            if child.tag != "default":
                own[child.tag] = {**own.get(child.tag, {}), **child.attrib}
        self.defaults[element.get("class", "main")] = own
        for child in element.findall("default"):
            self._read_defaults(child, own)

    def _of(self, element: ElementTree.Element, scope: str) -> Attributes:
        """Return an element's attributes with those of its class; raises ``KeyError`` for an unknown class."""
        name = element.get("class", scope)
        defaults = self.defaults[name] if name != "main" else self.defaults.get("main", {})
        return {**defaults.get(element.tag, {}), **element.attrib}

    def _name(self, element: ElementTree.Element, kind: str) -> str:
        base = name = element.get("name") or f"{kind}-{len(self.links)}"
        while name in self.links:
            name = f"{base}-{kind}-{len(self.links)}"
        return name

    def _read_children(self, body: ElementTree.Element, link: str, origin: Array, scope: str) -> None:
        """Read the bodies and sites in a body, whose link has its origin (3,) in the body's frame."""
        within = Pose(-origin)
        for child in body:
            if child.tag == "body":
                self._read_body(child, link, within, child.get("childclass", scope))
            elif child.tag == "site":
                at = self._of(child, scope)
                name = self._name(child, "site")
                self.links[name] = RobotLink(name, 0.0, np.zeros(3), np.zeros((3, 3)))
                self._add_joint(f"{name}-on-{link}", "fixed", link, name, within.then(self._pose(at)), {})
            elif child.tag in ("frame", "replicate", "composite", "flexcomp", "attach"):
                raise ValueError(f"<{child.tag}> isn't read; save the model compiled")

    def _read_body(self, body: ElementTree.Element, parent: str, within: Pose, scope: str) -> None:
        name = self._name(body, "body")
        self.links[name] = RobotLink(name, 0.0, np.zeros(3), np.zeros((3, 3)))  # keeps its name
        pose, joints = within.then(self._pose(body.attrib)), self._joints_of(body, scope)
        places, at = [], np.zeros(3)
        for given, kind in joints:
            at = read_numbers(given.get("pos"), "0 0 0") if kind in ("revolute", "ball") else at
            places.append(at)
        whole = self._link(body, name, at, scope)
        for number, (given, kind) in enumerate(joints):
            pose = pose.then(Pose(places[number] - (places[number - 1] if number else np.zeros(3))))
            link = name if number == len(joints) - 1 else f"{name}-{number + 1}"
            if link != name:
                moments = LIGHT_SHARE * np.trace(whole.inertia) * np.eye(3)
                self.links[link] = RobotLink(link, LIGHT_SHARE * whole.mass, np.zeros(3), moments)
                self.notes.append(f"{link} stands between two joints of {name}, with {LIGHT_SHARE:g} of its mass")
            self._add_joint(given.get("name", f"{link}-joint"), kind, parent, link, pose, given)
            parent, pose = link, Pose()
        if not joints:
            self._add_joint(f"{name}-on-{parent}", "fixed", parent, name, pose, {})
        self.links[name] = whole
        self._read_children(body, name, at, scope)

    def _joints_of(self, body: ElementTree.Element, scope: str) -> list[tuple[Attributes, str]]:
        found: list[tuple[Attributes, str]] = []
        for element in body:
            if element.tag == "freejoint":
                found.append((element.attrib, "floating"))
            elif element.tag == "joint":
                given = self._of(element, scope)
                found.append((given, _KINDS[given.get("type", "hinge")]))
        return found

    def _add_joint(self, name: str, kind: str, parent: str, child: str, pose: Pose, given: Attributes) -> None:
        unit = self.unit if kind == "revolute" else 1.0
        axis = read_numbers(given.get("axis"), "0 0 1")
        size = float(np.linalg.norm(axis))
        if not size > 0.0:
            raise ValueError(f"joint {name} has an axis of no length")
        start = unit * float(given.get("ref", "0"))
        limited = given.get("limited", "auto")
        ranged = "range" in given and limited == "auto" and self.compiler.get("autolimits", "true") == "true"
        limits: dict[str, float] = {}
        if kind in ("revolute", "prismatic") and (limited == "true" or ranged):
            low, high = unit * read_numbers(given["range"], "0 0") - start
            limits = {"lower": float(low), "upper": float(high)}
        elif ranged or limited == "true":
            self.notes.append(f"{name}: the range of a {kind} joint isn't taken")
        if "actuatorfrcrange" in given:
            limits["effort"] = float(np.abs(read_numbers(given["actuatorfrcrange"], "0 0")).max())
        if start:
            self.notes.append(f"{name}: its position counts from the file's ref, {given['ref']}")
        if float(given.get("armature", "0")):
            self.notes.append(f"{name}: armature {given['armature']} (a motor's rotor: as in docs/control.md)")
        if kind not in ("revolute", "prismatic"):
            resists = [key for key in ("stiffness", "damping", "frictionloss") if float(given.get(key, "0"))]
            self.notes += [f"{name}: {key} {given[key]} of a {kind} joint isn't taken" for key in resists]
            given = {}
        if name in self.joints:
            raise ValueError(f"two joints are named {name}")
        self.joints[name] = RobotJoint(
            name,
            kind,
            parent,
            child,
            pose,
            axis / size,
            limits,
            float(given.get("damping", "0")),
            float(given.get("frictionloss", "0")),
            spring=float(given.get("stiffness", "0")),
            rest=unit * float(given.get("springref", "0")) - start,
        )

    def _link(self, body: ElementTree.Element, name: str, origin: Array, scope: str) -> RobotLink:
        geoms = [self._geom(element, scope, name) for element in body.findall("geom")]
        shapes: tuple[list[Shape], list[Shape]] = ([], [])
        for geom, given in geoms:
            touches = given.get("contype", "1") != "0" or given.get("conaffinity", "1") != "0"
            shapes[touches].append(geom.shape(Pose(geom.pose.at - origin, geom.pose.axes)))
        inertial = body.find("inertial")
        part = self._inertial(inertial) if inertial is not None else add_masses(self._parts(geoms, name))
        visuals, collisions = (tuple(of) for of in shapes)
        return RobotLink(name, part.mass, part.centre - origin, part.inertia, visuals, collisions)

    def _inertial(self, element: ElementTree.Element) -> SolidMass:
        pose, given = self._pose(element.attrib), element.attrib
        if "fullinertia" in given:
            xx, yy, zz, xy, xz, yz = read_numbers(given["fullinertia"], "0 0 0 0 0 0")
            inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        else:
            inertia = np.diag(read_numbers(given["diaginertia"], "0 0 0"))
        return SolidMass(float(given["mass"]), pose.at, pose.axes @ inertia @ pose.axes.T)

    def _parts(self, geoms: list[tuple[Geom, Attributes]], name: str) -> Iterator[SolidMass]:
        for geom, given in geoms:
            mass, density = given.get("mass"), float(given.get("density", "1000"))
            if float(mass if mass is not None else density) == 0.0:
                continue
            if geom.kind in ("mesh", "plane", "hfield", "sdf") or given.get("shellinertia") == "true":
                raise ValueError(f"body {name} has its inertia from a {geom.kind}: give it <inertial>")
            yield geom.part(None if mass is None else float(mass), density)

    def _geom(self, element: ElementTree.Element, scope: str, body: str) -> tuple[Geom, Attributes]:
        given = self._of(element, scope)
        kind, pose = given.get("type", "sphere"), self._pose(given)
        size = tuple(float(word) for word in given.get("size", "").split())
        if "fromto" in given:
            ends = read_numbers(given["fromto"], "0 0 0 0 0 0")
            apart = ends[:3] - ends[3:]
            turn, _ = Rotation.align_vectors(apart[None], np.array([[0.0, 0.0, 1.0]]))
            pose = Pose(0.5 * (ends[:3] + ends[3:]), turn.as_matrix())
            half = 0.5 * float(np.linalg.norm(apart))
            size = (size[0], half) if kind in ("capsule", "cylinder") else (size[0], size[-1], half)
        mesh = self.meshes.get(given.get("mesh", ""), {}) if kind == "mesh" else {}
        if kind == "mesh" and not mesh:
            raise ValueError(f"body {body} has a geom of the mesh {given.get('mesh')}, which isn't there")
        folder = self.compiler.get("meshdir", self.compiler.get("assetdir", ""))
        file = (Path(folder) / mesh["file"]).as_posix() if mesh.get("file") else ""
        scale = tuple(read_numbers(mesh.get("scale"), "1 1 1").tolist())
        return Geom(kind, pose, size, file, scale), given

    def _pose(self, given: Attributes) -> Pose:
        """Return the pose that an element's attributes give, turned in one of five ways."""
        turn = Rotation.identity()
        if "quat" in given:
            w, *xyz = read_numbers(given["quat"], "1 0 0 0")
            turn = Rotation.from_quat([*xyz, w])
        elif "axisangle" in given:
            *axis, angle = read_numbers(given["axisangle"], "0 0 1 0")
            turn = Rotation.from_rotvec(self.unit * angle * np.array(axis) / np.linalg.norm(axis))
        elif "euler" in given:
            # Capitals in both: small letters are axes that turn there, and fixed ones in SciPy.
            order = self.compiler.get("eulerseq", "xyz").swapcase()
            turn = Rotation.from_euler(order, self.unit * read_numbers(given["euler"], "0 0 0"))
        elif "xyaxes" in given:
            x, y = read_numbers(given["xyaxes"], "1 0 0 0 1 0").reshape(2, 3)
            x = x / np.linalg.norm(x)
            y = y - (x @ y) * x
            y = y / np.linalg.norm(y)
            turn = Rotation.from_matrix(np.stack([x, y, np.cross(x, y)], axis=1))
        elif "zaxis" in given:
            turn, _ = Rotation.align_vectors(read_numbers(given["zaxis"], "0 0 1")[None], np.array([[0.0, 0.0, 1.0]]))
        return Pose(read_numbers(given.get("pos"), "0 0 0"), turn.as_matrix())

    def _read_followers(self) -> None:
        """Let joints follow others where an equality says so by a straight line; name the other equalities."""
        for element in (child for equality in self.top.findall("equality") for child in equality):
            given = {**self.defaults.get("main", {}).get("equality", {}), **element.attrib}
            factors = [float(word) for word in given.get("polycoef", "0 1 0 0 0").split()]
            follower, driver = given.get("joint1", ""), given.get("joint2", "")
            if element.tag == "joint" and driver in self.joints and not any(factors[2:]):
                self.joints[follower] = replace(self.joints[follower], mimic=(driver, factors[1], factors[0]))
            else:
                self.notes.append(f"equality {given.get('name', element.tag)} isn't taken: {element.tag}")
