"""Attributes of an MJCF file: turns, those that the reader takes, that have no effect here, and that it refuses."""

import math
from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from fmd.cli.robot import read_numbers
from fmd.core.arrays import Array


def read_turn(given: Mapping[str, str], unit: float, order: str) -> Rotation:
    """Return an element's turn, by the unit of angles [rad] and the order of Euler's axes; raises ``ValueError``."""
    if "quat" in given:
        w, *xyz = read_numbers(given["quat"], "1 0 0 0")
        return Rotation.from_quat([*xyz, w])
    if "axisangle" in given:
        *axis, angle = read_numbers(given["axisangle"], "0 0 1 0")
        return Rotation.from_rotvec(unit * angle * direction(np.array(axis), "axisangle"))
    if "euler" in given:
        # Capitals in both: small letters are axes that turn there, and fixed ones in SciPy.
        return Rotation.from_euler(order.swapcase(), unit * read_numbers(given["euler"], "0 0 0"))
    if "xyaxes" in given:
        x, y = read_numbers(given["xyaxes"], "1 0 0 0 1 0").reshape(2, 3)
        x = direction(x, "xyaxes")
        y = direction(y - (x @ y) * x, "xyaxes")
        return Rotation.from_matrix(np.stack([x, y, np.cross(x, y)], axis=1))
    return turn_z(read_numbers(given.get("zaxis"), "0 0 1"), "zaxis")


def turn_z(to: Array, what: str) -> Rotation:
    """Return the shortest turn that takes the z axis to a vector (3,); half a turn is about x, as in MuJoCo."""
    x, y, z = direction(to, what)
    across = float(np.hypot(x, y))
    axis = np.array([-y, x, 0.0]) / across if across > 1e-10 else np.array([1.0, 0.0, 0.0])
    return Rotation.from_rotvec(np.arctan2(across, z) * axis)


def direction(vector: Array, what: str) -> Array:
    """Return the unit vector (3,) along a vector; raises ``ValueError`` for one of no length."""
    size = float(np.linalg.norm(vector))
    if not size > 0.0:
        raise ValueError(f"{what} has a vector of no length")
    return vector / size


DISABLED = {
    "gravity": {"gravity"},
    "limit": {"range", "limited"},
    "frictionloss": {"frictionloss"},
    "spring": {"stiffness"},
    "damper": {"damping"},
    "passive": {"stiffness", "damping"},
    "equality": {"equality"},
    "constraint": {"range", "limited", "frictionloss", "equality"},
}
"""What goes without effect where the flag of this name says ``disable``."""
_TURNS = "quat axisangle euler xyaxes zaxis"
_TAKEN = {
    "compiler": "autolimits angle eulerseq meshdir assetdir inertiafromgeom inertiagrouprange",
    "option": "gravity",
    "flag": " ".join(DISABLED),
    "body": f"name childclass pos {_TURNS}",
    "joint": "name class type pos axis limited range ref springref stiffness damping frictionloss armature "
    "actuatorfrcrange",
    "geom": f"name class type pos {_TURNS} size fromto mesh mass density shellinertia contype conaffinity group",
}
# Solver, contact (of which no geom has any here), pictures, names of files, and what only actuators or sensors use.
_IDLE = {
    "compiler": "strippath fitaabb texturedir discardvisual usethread fusestatic saveinertial alignfree conflict "
    "convexhull exactmeshinertia",
    "option": "timestep apirate impratio tolerance ls_tolerance noslip_tolerance ccd_tolerance mpr_tolerance "
    "sleep_tolerance magnetic o_margin o_solref o_solimp o_friction integrator collision cone jacobian solver "
    "iterations ls_iterations noslip_iterations ccd_iterations mpr_iterations sdf_iterations sdf_initpoints "
    "actuatorgroupdisable",
    "flag": "contact clampctrl warmstart filterparent actuation refsafe sensor midphase eulerdamp autoreset nativeccd "
    "island multiccd override energy fwdinv invdiscrete sleep diagexact sensornoise",
    "body": "user sleep simple",
    "joint": "group user actuatorfrclimited actuatorgravcomp solreflimit solimplimit solreffriction solimpfriction",
    "geom": "material rgba friction condim priority solmix solref solimp margin gap surfacevel adhesion hfield user "
    "fluidshape fluidcoef",
}
_REFUSED = {
    "compiler": "coordinate balanceinertia settotalmass boundmass boundinertia",
    "joint": "springdamper",
}


def list_untaken(tag: str, given: Mapping[str, str]) -> list[str]:
    """Return the attributes of an element, with their values, that have an effect on motion that isn't taken.

    Raises
    ------
    ValueError
        One of them changes mass or resistance by rules of MuJoCo's compiler.
    """
    for key in _words(_REFUSED, tag) & given.keys():
        if _acts(given[key], negative=False):
            raise ValueError(f"{tag} {key} {given[key]!r} isn't read; save the model compiled")
    known = _words(_TAKEN, tag) | _words(_IDLE, tag) | _words(_REFUSED, tag)
    return [f"{tag} {key} {value}" for key, value in given.items() if key not in known and _acts(value)]


def _words(table: Mapping[str, str], tag: str) -> set[str]:
    return set(table.get(tag, "").split())


def _acts(value: str, *, negative: bool = True) -> bool:
    """Return whether a value is other than the one without effect: a word for off, zeros, or numbers below them."""
    for word in value.split():
        try:
            number = float(word)
        except ValueError:
            if word not in {"false", "auto", "local", "enable"}:
                return True
        else:
            if number > 0.0 or math.isnan(number) or (negative and number < 0.0):
                return True
    return False
