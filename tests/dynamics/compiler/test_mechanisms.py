"""The random mechanisms that the others' laws are tested on have all that a mechanism can have."""

from collections import Counter
from collections.abc import Iterator

from fmd.scene.joints.fixed import FIXED
from fmd.scene.joints.prismatic import PRISMATIC
from fmd.scene.joints.revolute import REVOLUTE
from tests.dynamics.compiler.mechanisms import JOINTS, SEEDS, random_mechanism


def traits(seed: int) -> Iterator[tuple[object, ...]]:
    """What a random mechanism has, of what the equations tell apart."""
    made = random_mechanism(seed, second_order=True)
    links = made.mechanism.links
    for link in links:
        carrier = links[link.parent] if link.parent >= 0 else None
        yield "on", link.joint, "ground" if carrier is None else "flexible" if len(carrier.omega) else "rigid"
        yield "is", link.joint, "flexible" if len(link.omega) else "rigid"
        yield "prescribed", link.joint, link.motion is not None
        yield (
            "second order",
            *(
                bool(form.any())
                for form in (link.integrals.displacement2, link.joint_displacement2, link.place.displacement2)
            ),
        )
    for load in made.mechanism.loads:
        yield "load", load.torque, load.following, len(load.marker.rotation.T) > 0
    yield "carries several", max(Counter(link.parent for link in links).values()) > 1
    yield "bodies", len(links)
    yield "fast joints", bool(made.mechanism.fast_joints)
    yield "slow modes", bool(made.mechanism.slow_modes)
    yield "gravity", bool(made.mechanism.gravity.any())
    yield "plane", seed % 5 == 4


def test_the_seeds_have_all_that_a_hundred_of_them_have() -> None:
    found = {trait for seed in SEEDS for trait in traits(seed)}
    assert found == {trait for seed in range(100) for trait in traits(seed)}
    assert {("is", joint, "flexible") for joint in JOINTS} <= found
    assert {("prescribed", joint, True) for joint in (REVOLUTE, PRISMATIC)} <= found
    assert ("on", FIXED, "flexible") in found
