"""A robot from an MJCF file, MuJoCo's own format: bodies with inertia and geoms, joints, sites.

The file's conventions are those of its reference (mujoco.readthedocs.io/en/stable/XMLreference.html): a body's frame is
given in its parent's, its joints act in their order at places in the body's frame, angles are in degrees unless the
compiler says radian, and a body without ``inertial`` has the mass of its geoms.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from fmd.cli.geoms import Geom, SolidMass, add_masses
from fmd.cli.mjcf_attributes import DISABLED, direction, list_untaken, read_turn, turn_z
from fmd.cli.mjcf_files import read_model
from fmd.cli.robot import Pose, Robot, RobotJoint, RobotLink, Shape, naming, read_list, read_number, read_numbers
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.limits.scene import LIGHT_SHARE

_WORLD = "world"
_READ = {"compiler", "option", "default", "asset", "worldbody", "equality", "include"}
_IDLE = {"visual", "statistic", "size", "custom"}  # pictures and sizes of arrays
_OF_BODIES = {"inertial", "joint", "freejoint", "geom", "camera", "light"}  # read with the body, or idle
_KINDS = {"hinge": "revolute", "slide": "prismatic", "ball": "ball", "free": "floating"}

_LAWS = ("stiffness", "damping")  # with further coefficients, of higher powers of deflection or rate

Attributes = Mapping[str, str]


def read_mjcf(path: Path) -> Robot:
    """Read an MJCF file.

    Raises
    ------
    InputError
        It can't be read, is no MJCF, or has a body whose inertia or place isn't clear.
    """
    top = read_model(path)
    with naming(path, ""):
        return _Reader(top, path).robot()


def _shorten(names: Sequence[str]) -> str:
    return f"{', '.join(names[:6])}{' …' if len(names) > 6 else ''}"


class _Reader:
    """Reads links and joints body by body, with the classes of defaults."""

    def __init__(self, top: ElementTree.Element, path: Path) -> None:
        self.top, self.path = top, path
        self.notes: list[str] = []
        self.untaken: dict[str, list[str]] = {}
        self.compiler, self.option, flags = (self._settings(tag) for tag in ("compiler", "option", "option/flag"))
        off = [DISABLED[key] for key, value in flags.items() if value == "disable" and key in DISABLED]
        self.disabled = set[str]().union(*off)
        self.unit = 1.0 if self.compiler.get("angle", "degree") == "radian" else math.pi / 180
        self.defaults: dict[str, dict[str, dict[str, str]]] = {"main": {}}
        mains = top.findall("default")
        for element in mains:
            self._read_defaults(element, "main", self.defaults["main"])
        self.defaults |= {element.get("class", "main"): self.defaults["main"] for element in mains}
        self.meshes = {
            mesh.get("name", Path(mesh.get("file", "")).stem): self._of(mesh, "main")
            for mesh in top.iterfind("asset/mesh")
        }
        self.links: dict[str, RobotLink] = {_WORLD: RobotLink(_WORLD, 0.0, np.zeros(3), np.zeros((3, 3)))}
        self.joints: dict[str, RobotJoint] = {}

    def robot(self) -> Robot:
        """Return the robot."""
        worlds = self.top.findall("worldbody")
        if any(world.find(".//geom") is not None for world in worlds):
            self.notes.append("geoms of the world, and contact of others, aren't taken: as in docs/contact.md")
        for world in worlds:
            self._read_children(world, _WORLD, np.zeros(3), world.get("childclass", "main"))
        if len(self.links) == 1:
            raise InputError(str(self.path), "worldbody", None, "has no body")
        self._read_followers()
        others = sorted({child.tag for child in self.top} - _READ - _IDLE)
        self.notes += [f"<{tag}> isn't read{self._names_in(tag)}" for tag in others]
        for what, names in self.untaken.items():
            self.notes.append(f"{what} isn't taken: {_shorten(names)}")
        weight = "0 0 0" if "gravity" in self.disabled else self.option.get("gravity")
        x, y, z = read_numbers(weight, "0 0 -9.81").tolist()
        name = self.top.get("model", self.path.stem)
        return Robot(name, self.links, self.joints, _WORLD, tuple(self.notes), (x, y, z))

    def _names_in(self, tag: str) -> str:
        names = [child.get("name", child.tag) for element in self.top.findall(tag) for child in element]
        return f": {_shorten(names)}" if names else ""

    def _settings(self, path: str) -> Attributes:
        """Return the attributes of the elements of a path, of which the last counts."""
        given = {key: value for element in self.top.findall(path) for key, value in element.attrib.items()}
        self._note_untaken(path.rpartition("/")[2], given, "the file")
        return given

    def _note_untaken(self, tag: str, given: Attributes, name: str) -> None:
        for what in list_untaken(tag, given):
            self.untaken.setdefault(what, []).append(name)

    def _read_defaults(self, element: ElementTree.Element, name: str, inherited: dict[str, dict[str, str]]) -> None:
        own = {tag: dict(values) for tag, values in inherited.items()}
        for child in element:
            if child.tag != "default":
                own[child.tag] = {**own.get(child.tag, {}), **child.attrib}
        self.defaults[name] = own
        for child in element.findall("default"):
            if (name := child.attrib["class"]) in self.defaults:
                raise ValueError(f"two defaults are of the class {name!r}")
            self._read_defaults(child, name, own)

    def _of(self, element: ElementTree.Element, scope: str, kind: str = "") -> Attributes:
        """Return an element's attributes with those of its class; raises ``ValueError`` for an unknown class."""
        if (name := element.get("class", scope)) not in self.defaults:
            raise ValueError(f"<{element.tag}> is of the class {name!r}, which isn't there")
        return {**self.defaults[name].get(kind or element.tag, {}), **element.attrib}

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
                name = self._name(child, "body")
                with naming(self.path, f"body {name}"):
                    self._read_body(child, name, link, within, child.get("childclass", scope))
            elif child.tag == "site":
                at = self._of(child, scope)
                name = self._name(child, "site")
                self.links[name] = RobotLink(name, 0.0, np.zeros(3), np.zeros((3, 3)))
                self._add_joint(f"{name}-on-{link}", "fixed", link, name, within.then(self._pose(at)), {})
            elif child.tag in ("frame", "replicate", "composite", "flexcomp", "attach"):
                raise ValueError(f"<{child.tag}> isn't read; save the model compiled")
            elif child.tag not in _OF_BODIES:
                self.notes.append(f"<{child.tag}> of {link} isn't read")

    def _read_body(self, body: ElementTree.Element, name: str, parent: str, within: Pose, scope: str) -> None:
        self._note_untaken("body", body.attrib, name)
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
                given = {key: of for key, of in self._of(element, scope).items() if key not in self.disabled}
                name = given.get("name", f"of {body.get('name', 'a body')}")
                self._note_untaken("joint", given, name)
                given |= {
                    key: self._linear(given[key], f"{key} of joint {name}")
                    for key in sorted(_LAWS & given.keys(), reverse=True)
                }
                if (kind := given.get("type", "hinge")) not in _KINDS:
                    raise ValueError(f"a joint of type {kind} is none of {', '.join(_KINDS)}")
                found.append((given, _KINDS[kind]))
        return found

    def _linear(self, text: str, what: str) -> str:
        """Return the first coefficient of a spring's or damper's polynomial; a note names the others."""
        first, *higher = text.split() or [text]
        if any(read_list(" ".join(higher))):
            self.notes.append(f"{what} is a polynomial, {text}: only its linear part is taken, a drive has formulas")
        return first

    def _add_joint(self, name: str, kind: str, parent: str, child: str, pose: Pose, given: Attributes) -> None:
        unit = self.unit if kind == "revolute" else 1.0
        axis = direction(read_numbers(given.get("axis"), "0 0 1"), f"the axis of {name}")
        start = unit * read_number(given, "ref", "0")
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
        if read_number(given, "armature", "0", least=0.0):
            self.notes.append(f"{name}: armature {given['armature']} (a motor's rotor: as in docs/control.md)")
        if kind not in ("revolute", "prismatic"):
            resists = [key for key in ("stiffness", "damping", "frictionloss") if read_number(given, key, "0")]
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
            axis,
            limits,
            read_number(given, "damping", "0", least=0.0),
            read_number(given, "frictionloss", "0", least=0.0),
            spring=read_number(given, "stiffness", "0"),
            rest=unit * read_number(given, "springref", "0") - start,
        )

    def _link(self, body: ElementTree.Element, name: str, origin: Array, scope: str) -> RobotLink:
        geoms = [self._geom(element, scope, name) for element in body.findall("geom")]
        shapes: tuple[list[Shape], list[Shape]] = ([], [])
        for geom, given in geoms:
            touches = given.get("contype", "1") != "0" or given.get("conaffinity", "1") != "0"
            shapes[touches].append(geom.shape(Pose(geom.pose.at - origin, geom.pose.axes)))
        inertial, from_geoms = body.find("inertial"), self.compiler.get("inertiafromgeom", "auto")
        if inertial is None or from_geoms == "true":
            part = add_masses(() if from_geoms == "false" else self._parts(geoms, name))
        else:
            part = self._inertial(inertial)
        visuals, collisions = (tuple(of) for of in shapes)
        return RobotLink(name, part.mass, part.centre - origin, part.inertia, visuals, collisions)

    def _inertial(self, element: ElementTree.Element) -> SolidMass:
        pose, given = self._pose(element.attrib), element.attrib
        if "fullinertia" in given:
            xx, yy, zz, xy, xz, yz = read_numbers(given["fullinertia"], "0 0 0 0 0 0")
            inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        else:
            inertia = np.diag(read_numbers(given["diaginertia"], "0 0 0"))
        return SolidMass(read_number(given, "mass", least=0.0), pose.at, pose.axes @ inertia @ pose.axes.T)

    def _parts(self, geoms: list[tuple[Geom, Attributes]], name: str) -> Iterator[SolidMass]:
        low, high = read_numbers(self.compiler.get("inertiagrouprange"), "0 5")
        for geom, given in geoms:
            mass = read_number(given, "mass", least=0.0) if "mass" in given else None
            density = read_number(given, "density", "1000", least=0.0)
            if (density if mass is None else mass) == 0.0 or not low <= read_number(given, "group", "0") <= high:
                continue
            if geom.kind in ("mesh", "plane", "hfield", "sdf") or given.get("shellinertia") == "true":
                raise ValueError(f"body {name} has its inertia from a {geom.kind}: give it <inertial>")
            yield geom.part(mass, density)

    def _geom(self, element: ElementTree.Element, scope: str, body: str) -> tuple[Geom, Attributes]:
        given = self._of(element, scope)
        self._note_untaken("geom", given, given.get("name", f"of {body}"))
        kind, pose = given.get("type", "sphere"), self._pose(given)
        size = tuple(read_list(given.get("size", "")))
        if kind not in ("mesh", "sdf") and "mesh" in given:
            raise ValueError(f"a {kind} of the size of the mesh {given['mesh']} isn't read; save the model compiled")
        if "fromto" in given:
            ends = read_numbers(given["fromto"], "0 0 0 0 0 0")
            apart = ends[:3] - ends[3:]
            pose = Pose(0.5 * (ends[:3] + ends[3:]), turn_z(apart, "fromto").as_matrix())
            half = 0.5 * float(np.linalg.norm(apart))
            size = (*size[:1], half) if kind in ("capsule", "cylinder") else (*size[:1], *size[:1], half)
        mesh = self.meshes.get(given.get("mesh", ""), {}) if kind == "mesh" else {}
        if kind == "mesh" and not mesh:
            raise ValueError(f"body {body} has a geom of the mesh {given.get('mesh')}, which isn't there")
        folder = self.compiler.get("meshdir", self.compiler.get("assetdir", ""))
        file = (Path(folder) / mesh["file"]).as_posix() if mesh.get("file") else ""
        scale = tuple(read_numbers(mesh.get("scale"), "1 1 1").tolist())
        return Geom(kind, pose, size, file, scale), given

    def _pose(self, given: Attributes) -> Pose:
        """Return the pose that an element's attributes give."""
        turn = read_turn(given, self.unit, self.compiler.get("eulerseq", "xyz"))
        return Pose(read_numbers(given.get("pos"), "0 0 0"), turn.as_matrix())

    def _read_followers(self) -> None:
        """Let joints follow others where an equality says so by a straight line; name the other equalities."""
        for element in (child for equality in self.top.findall("equality") for child in equality):
            name = element.get("name", element.tag)
            with naming(self.path, f"equality {name}"):
                given = self._of(element, "main", "equality")
                factors = read_list(given.get("polycoef", ""))
                offset, ratio, *higher = factors + [0.0, 1.0][len(factors) :]
                active = given.get("active", "true") == "true" and "equality" not in self.disabled
                follower, driver = given.get("joint1", ""), given.get("joint2", "")
                if element.tag == "joint" and active and driver in self.joints and not any(higher):
                    if follower not in self.joints:
                        raise ValueError(f"the joint {follower!r} isn't there")
                    self.joints[follower] = replace(self.joints[follower], mimic=(driver, ratio, offset))
                else:
                    self.notes.append(f"equality {name} isn't taken: {element.tag if active else 'not active'}")
