"""Mechanisms of scenes that differ in numbers of joints: taken from one another, they are those that are built."""

import pytest

from fmd.core.cache import Cache
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.scene.scene import load_scene
from fmd.stages import like_mechanisms
from fmd.stages.like_mechanisms import build_like
from fmd.stages.mechanism import build_mechanism
from fmd.stages.pipeline import Pipeline

_DAMPED = ["joint.slide.rest=1 mm", "joint.slide.damper=1 N s/m"]


@pytest.fixture
def built(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Titles of the scenes whose mechanisms are built anew."""
    titles: list[str] = []
    build = like_mechanisms.build_mechanism
    monkeypatch.setattr(
        like_mechanisms, "build_mechanism", lambda *given: (titles.append(given[0].title), build(*given))[1]
    )
    return titles


@pytest.mark.parametrize(
    ("changes", "anew"),
    [
        (["joint.slide.spring=700 N/m", "joint.slide.rest=2 mm", "joint.slide.damper=3 N s/m"], 1),
        (["joint.slide.spring=0 N/m"], 1),  # whose equations have no spring
        (["joint.slide.stop={high='0.3 m', stiffness='1 kN/m'}"], 2),
        (["joint.slide.position=0.1 m"], 2),
        (["body.slider.mass=4 kg"], 2),
        (["simulation.fast=[]"], 2),
    ],
)
def test_a_mechanism_with_other_numbers_of_joints_is_the_one_that_is_built(
    built: list[str], changes: list[str], anew: int
) -> None:
    scene, other = (load_scene("rod-slider", [*_DAMPED, *own]) for own in ([], changes))
    kept: list[like_mechanisms.Built] = []
    mechanism = build_like(kept, scene, {})
    first = CompiledSystem(mechanism).compiled
    assert first.digest
    assert CompiledSystem(mechanism.rigid).compiled.digest
    both = (build_like(kept, other, {}), build_mechanism(other, {}))
    found, expected = (CompiledSystem(each).compiled for each in both)
    assert len(built) == anew
    assert found.digest == expected.digest
    assert found.numbers.tolist() == expected.numbers.tolist()
    rigid, expected_rigid = (CompiledSystem(each.rigid).compiled for each in both)
    assert rigid.digest == expected_rigid.digest
    assert rigid.numbers.tolist() == expected_rigid.numbers.tolist()
    if anew == 1:
        assert "rigid" in vars(both[0])
        assert (found.digest == first.digest) == bool(found.numbers.size == first.numbers.size)


def test_points_with_a_stiffened_body_have_one_body_and_no_mechanisms_of_their_own(built: list[str]) -> None:
    coarse = ["body.forearm.mesh.divisions=[4,1,1]", "body.forearm.modes.count=1", "simulation.stiffening=on"]
    first, other = (load_scene("arm", [*coarse, f"joint.elbow.damper={damper} N m s"]) for damper in (0.1, 0.2))
    one = Pipeline(first, Cache(None))
    assert one.mechanism.links[1].integrals.displacement2.size
    two = one.variant(other)
    assert two.bodies["forearm"] is one.bodies["forearm"]
    assert (one.mechanism.links[1].damper, two.mechanism.links[1].damper) == (0.1, 0.2)
    assert len(built) == len(two.built) == 2  # without stiffening, which is checked, and with it
