"""Attributes of an MJCF file that the reader takes, those without effect here, and those it has to refuse."""

from __future__ import annotations

import math
from collections.abc import Mapping

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
