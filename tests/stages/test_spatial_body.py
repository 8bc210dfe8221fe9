"""A body for other programs takes what its scene has computed, and solves for the loads alone that this left out."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import fmd
from fmd.core.arrays import Array
from fmd.reduction.eigen import FreeBodySolver
from fmd.stages.basis import stiffen_reduced
from fmd.stages.part import FlexiblePart
from fmd.stages.spatial_body import spatial_body

SPATIAL = ["0.3 m/s^2", "0 m/s^2", "-9.81 m/s^2"]
DOWN = ["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]
PRODUCTS, TURNS = 6, 3


def arm(joint: str, gravity: list[str] | None, **body: Any) -> FlexiblePart:
    """A bar on a joint to the ground about z."""
    bar = {
        "shape": "bar", "length": "0.4 m", "depth": "30 mm", "width": "20 mm", "mesh": {"divisions": [8, 1, 1]},
        "E": "70 GPa", "nu": 0.33, "rho": "2700 kg/m^3", "modes": {"count": 3, "boundary": "joint"},
        "marker": {"root": {"face": "x-"}, "tip": {"face": "x+"}},
    }  # fmt: skip
    holding = {"type": joint, "parent": "ground", "child": "bar.root"}
    scene = {
        "title": "Arm",
        "body": {"bar": bar | body},
        "joint": {"hub": holding | ({"axis": [0, 0, 1]} if joint == "revolute" else {})},
        "simulation": {
            "duration": "0.1 s",
            "output_step": "10 ms",
            "tip": "bar.tip",
            "run": [{"integrator": "runge-kutta"}],
        }
        | ({"gravity": gravity} if gravity else {}),
    }
    return fmd.load(scene).run.parts["bar"]


WITH_ARMS = {
    "marker": {"root": {"face": "x-"}, "tip": {"link": "head"}},
    "link": {"head": {"face": "x+", "type": "rigid", "at": ["0.45 m", "10 mm", "5 mm"]}},
    "mass": {"motor": {"at": "head", "mass": "0.3 kg"}},
}


@pytest.mark.parametrize("stiffened", [True, False], ids=["stiffened", "arms alone"])
@pytest.mark.parametrize("gravity", [DOWN, SPATIAL, None], ids=["in a plane", "in space", "about an axis"])
@pytest.mark.parametrize("joint", ["revolute", "fixed"])
def test_a_body_for_others_is_the_one_computed_for_any_motion_at_once(
    joint: str, gravity: list[str] | None, stiffened: bool
) -> None:
    part = arm(joint, gravity, **WITH_ARMS)
    assert part.joint.in_plane == (gravity is not SPATIAL)
    in_space = replace(part.model, joint=replace(part.joint, in_plane=False))
    wanted = stiffen_reduced(in_space, part.for_any_motion(part.body), stiffened)
    found = spatial_body(part, stiffened)
    for name in ("G", "S", "stiffening", "displacement2", "rotation2"):
        same(getattr(found.integrals, name), getattr(wanted.integrals, name))
    for name, marker in wanted.markers.items():
        same(found.markers[name].displacement2, marker.displacement2)


def same(found: Array, wanted: Array) -> None:
    assert found.shape == wanted.shape
    assert np.abs(found - wanted).max(initial=0.0) <= 1e-9 * np.abs(wanted).max(initial=0.0)


@pytest.mark.parametrize(("gravity", "loads"), [(DOWN, PRODUCTS + TURNS - 1), (SPATIAL, 0), (None, 0)])
def test_loads_that_a_scene_is_stiffened_by_are_not_solved_for_again(
    gravity: list[str] | None, loads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    part = arm("fixed", gravity)  # in a plane it has the turn about the plane's normal already
    assert part.stiffened.integrals.stiffening.size
    solved, factors = list[int](), list[FreeBodySolver]()
    response, make = FreeBodySolver.static_response, FreeBodySolver.__init__

    def count_loads(self: FreeBodySolver, f: Array, *options: Any) -> Array:
        solved.append(f.shape[-1])
        return response(self, f, *options)

    def count_factors(self: FreeBodySolver, *model: Any) -> None:
        factors.append(self)
        make(self, *model)

    monkeypatch.setattr(FreeBodySolver, "static_response", count_loads)
    monkeypatch.setattr(FreeBodySolver, "__init__", count_factors)
    spatial_body(part, stiffened=True)
    assert sum(solved) == loads
    assert not factors
