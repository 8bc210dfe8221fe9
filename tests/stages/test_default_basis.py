"""The basis that a body has where the scene says nothing of it, against a cantilever's compliance by beam theory."""

import copy
from typing import Any

import pytest

from fmd import Pipeline, load_scene
from fmd.core.errors import InputError

L, B, H, E = 0.3, 0.01, 0.02, 70e9
BAR: dict[str, Any] = {
    "title": "Bar",
    "body": {
        "bar": {
            "shape": "bar",
            "length": L,
            "depth": H,
            "width": B,
            "E": E,
            "nu": 0.0,
            "rho": 2700.0,
            "mesh": {"divisions": [12, 1, 1], "order": 2},
            "modes": {"count": 3},
            "marker": {"root": {"face": "x-"}, "tip": {"face": "x+"}},
        }
    },
    "joint": {"clamp": {"type": "fixed", "parent": "ground", "child": "bar.root"}},
    "drive": {"push": {"type": "point force", "marker": "bar.tip", "direction": [0, 1, 0], "force": "1 N"}},
    "simulation": {"duration": 1e-3, "output_step": 1e-3, "tip": "bar.tip", "run": [{"integrator": "auto"}]},
}


def compliance(*overrides: str) -> float:
    """Return the deflection of the bar's tip by a steady unit force there [m/N]."""
    body = Pipeline(load_scene(BAR, overrides)).bodies["bar"]
    return float((body.markers["tip"].translation[1] ** 2 / body.omega**2).sum())


@pytest.mark.parametrize("boundary", ["free", "joint", "interface"])
def test_few_modes_deflect_as_a_beam_without_a_word_about_static_responses(boundary: str) -> None:
    inertia, area = B * H**3 / 12, B * H
    exact = L**3 / (3 * E * inertia) + 6 / 5 * L / (E / 2 * area)  # by Timoshenko, without lateral contraction
    assert compliance(f"body.bar.modes.boundary={boundary}") == pytest.approx(exact, rel=2e-3)
    if boundary == "free":
        assert compliance("body.bar.modes.enrich=none") < 0.8 * exact


def test_an_interface_has_its_own_static_responses_and_a_choice_is_kept() -> None:
    def chosen(*settings: str) -> str | None:
        scene = load_scene(BAR, [f"body.bar.modes.{setting}" for setting in settings])
        return scene.with_its_basis("bar").modes.enrich

    assert chosen() == "inertia"
    assert chosen("boundary=interface") == "none"
    assert chosen("boundary=interface", "enrich=ritz") == "ritz"
    assert chosen("enrich=none") == "none"


def test_free_modes_on_joints_with_others_stand_alone_unless_the_scene_says_otherwise() -> None:
    scene = copy.deepcopy(BAR)
    scene["body"]["far"] = scene["body"]["bar"]
    scene["joint"]["hinge"] = {"type": "revolute", "parent": "bar.tip", "child": "far.root", "axis": [0, 0, 1]}
    parts = Pipeline(load_scene(scene)).parts
    assert [part.shape.modes.enrich for part in parts.values()] == ["none", "none"]
    for choice in ("boundary=joint", "enrich=inertia"):
        assert Pipeline(load_scene(scene, [f"body.bar.modes.{choice}"])).parts["bar"].shape.modes.enrich == "inertia"


def test_static_responses_of_a_body_on_a_free_joint_belong_to_no_family() -> None:
    """They would bring torsion and bending across the plane back; without them all shapes stay in it."""
    family = ("joint.clamp.type=free", "body.bar.modes.family=in-plane bending", "body.bar.mesh.divisions=[12,2,2]")
    with pytest.raises(InputError, match=r'takes enrich = "none": static responses'):
        Pipeline(load_scene(BAR, family)).bodies["bar"]
    shapes = Pipeline(load_scene(BAR, (*family, "body.bar.modes.enrich=none"))).bodies["bar"].shapes
    assert abs(shapes[:, 2]).max() < 1e-6 * abs(shapes).max()
