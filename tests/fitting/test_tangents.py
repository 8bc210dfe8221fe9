"""Tangents of motions by all methods that march them, in trees and loops, against extrapolated differences."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import pytest

import fmd as package
from fmd.core.arrays import Array
from fmd.dynamics.compiler.compiled import CompiledMechanism
from fmd.fitting.frozen_run import FrozenRun
from fmd.fitting.parameters import Parameter, find_parameter
from fmd.fitting.sensitivities import Sensitivity
from fmd.output.channels import ResultChannel, find_all_channels
from tests.verification.test_random_mechanisms import SI, random_scene

SMALL_ARM = (
    "simulation.run=[{integrator='central-difference'}]",
    "body.forearm.modes.count=3",
    "body.forearm.modes.enrich=none",
)
ZERO = ["0 m", "0 m", "0 m"]


def rod(length: float, **more: Any) -> dict[str, Any]:
    markers = {"a": {"at": ZERO}, "b": {"at": [f"{length} m", "0 m", "0 m"]}}
    return {"shape": "rod", "mass": "0.7 kg", "length": f"{length} m", "marker": markers, **more}


def revolute(parent: str, child: str, **more: Any) -> dict[str, Any]:
    return {"type": "revolute", "parent": parent, "child": child, "axis": [0, 0, 1], **more}


RUNS = {
    "central-difference": {"integrator": "central-difference", "step": "0.2 ms"},
    "runge-kutta": {"integrator": "runge-kutta", "tolerance": 1e-12},
    "generalized-alpha": {"integrator": "generalized-alpha", "step": "1 ms"},
    "exponential": {"integrator": "exponential", "step": "1 ms"},
    "sub-cycling": {
        "integrator": "sub-cycling",
        "substeps": 4,
        "step": "0.1 ms",
        "split": "20 Hz",
        "forces": "tangents",
    },
}


def scene(method: str, **tables: Any) -> dict[str, Any]:
    simulation = {"duration": "0.15 s", "output_step": "7.3 ms", "run": [RUNS[method]], **tables.pop("simulation")}
    return {"title": "Loop", "simulation": simulation, **tables}


def four_bar(method: str) -> dict[str, Any]:
    """A crank on a spring, driven by a torque; all hinges are parallel, so two constraints of three are redundant."""
    torque = {"formula": "4*sin(30*t)", "unit": "N m"}
    return scene(
        method,
        simulation={"tip": "crank.b", "gravity": ["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]},
        body={"crank": rod(0.3), "coupler": rod(0.5), "rocker": rod(0.4)},
        ground={"foot": {"at": ["0.6 m", "0 m", "0 m"]}},
        joint={
            "drive": revolute("ground", "crank.a", angle="80 deg", spring="20 N m", damper="0.2 N m s"),
            "pin": revolute("crank.b", "coupler.a", angle="-70 deg", spring="5 N m"),
            "foot": revolute("ground.foot", "rocker.a", angle="100 deg"),
            "close": revolute("coupler.b", "rocker.b"),
        },
        drive={"push": {"type": "torque", "joint": "drive", "torque": torque}},
    )


def differences(frozen: FrozenRun, parameter: Parameter) -> tuple[Array, Array]:
    """Extrapolate the derivatives of positions and rates by a number's logarithm from whole marches."""
    found: list[tuple[Array, Array]] = []
    for share in (4e-3, 2e-3, 1e-3):
        sides = [frozen.at({parameter: parameter.value * (1.0 + side * share)}) for side in (-1.0, 1.0)]
        low, high = (side.run.motion.trajectory for side in sides)
        found.append(((high.q - low.q) / (2.0 * share), (high.v - low.v) / (2.0 * share)))
    q, v = ((64.0 * c - 20.0 * b + a) / 45.0 for a, b, c in zip(*found, strict=True))
    return q, v


def chain(method: str) -> dict[str, Any]:
    """The crank and the coupler of the four-bar, whose end is free."""
    tables = four_bar(method)
    tables["body"].pop("rocker")
    tables["joint"] = {name: tables["joint"][name] for name in ("drive", "pin")}
    return tables


def spatial(method: str, seed: int = 0) -> dict[str, Any]:
    """The four-bar with skew axes and a coupler on two ball joints, whose rotation is a quaternion; random bodies."""
    rng, tables = np.random.default_rng(seed), four_bar(method)
    for own in tables["body"].values():
        own.pop("length")
        centre = rng.uniform([0.17, -0.03, -0.03], [0.23, 0.03, 0.03])
        moments = rng.uniform(0.01, 0.02, 3)
        own |= {"shape": "rigid", "centre": [f"{x} m" for x in centre], "inertia": [f"{x} kg m^2" for x in moments]}
    balls = {"pin": ("crank.b", "coupler.a"), "close": ("coupler.b", "rocker.b")}
    balls = {name: {"type": "spherical", "parent": one, "child": other} for name, (one, other) in balls.items()}
    tables["joint"] |= balls
    tables["joint"]["foot"]["axis"] = [0.1, *rng.uniform(-0.3, 0.3, 1), 1.0]
    tables["ground"]["foot"]["at"][2] = "0.13 m"
    return tables


def spatial_chain(method: str) -> dict[str, Any]:
    """The crank and the coupler of the spatial four-bar, whose end is free."""
    tables = spatial(method)
    tables["body"].pop("rocker")
    tables["joint"] = {name: tables["joint"][name] for name in ("drive", "pin")}
    return tables


def balanced(method: str) -> dict[str, Any]:
    """The chain with a coupler whose centre of mass lies on its hinge: 0 there is no number of the equations."""
    tables = spatial_chain(method)
    tables["joint"]["pin"] = chain(method)["joint"]["pin"]
    centre = ["0.2 m", "0 m", "0 m"]
    markers = {"a": {"at": centre}, "b": {"at": ["0.5 m", "0 m", "0 m"]}}
    tables["body"]["coupler"] |= {"centre": centre, "marker": markers}
    return tables


def fast_slides(method: str) -> dict[str, Any]:
    """Two fast slides that don't couple, one with a drive and a damper, on a slow crank that turns."""
    push = {"formula": "4*sin(300*t)", "unit": "N"}
    slide = {"type": "prismatic", "axis": [1, 0, 0], "position": "5 mm"}
    tables = chain(method)
    tables["body"] = {"crank": rod(0.3), "block": rod(0.1), "beside": rod(0.1)}
    tables["joint"] = {
        "drive": revolute("ground", "crank.a", angle="80 deg", spring="2 N m", rate="8 rad/s"),
        "slide": {**slide, "parent": "crank.b", "child": "block.a", "spring": "60 N/mm", "damper": "20 N s/m"},
        "other": {**slide, "parent": "crank.a", "child": "beside.a", "spring": "80 N/mm"},
    }
    tables["drive"] = {"push": {"type": "force", "joint": "slide", "force": push}}
    return tables


def fast_loop(method: str, of: Any = four_bar) -> dict[str, Any]:
    """A loop of which but the slowest coordinates take fast steps."""
    tables: dict[str, Any] = of(method)
    run = {**tables["simulation"]["run"][0], "split": "0.5 Hz"}
    tables["simulation"] |= {"duration": "20 ms", "output_step": "4.3 ms", "run": [run]}
    return tables


SPRINGS = ["joint.drive.spring", "joint.pin.spring"]
OTHERS = ["joint.drive.damper", "drive.push.torque"]
SPATIAL = ["joint.drive.spring", "drive.push.torque", "body.coupler.mass", "body.rocker.inertia.1"]
CENTRES = ["body.coupler.centre.0", "body.coupler.mass"]
MASSES = ["body.coupler.mass", "body.crank.marker.b.at.0"]  # the second is the length of the crank


@pytest.mark.parametrize(
    ("method", "make", "keys"),
    [
        ("central-difference", four_bar, [SPRINGS[0], MASSES[1]]),
        pytest.param("central-difference", four_bar, SPRINGS + OTHERS + MASSES, marks=pytest.mark.long),
        pytest.param("runge-kutta", four_bar, ["joint.drive.spring", *MASSES], marks=pytest.mark.long),
        pytest.param("generalized-alpha", four_bar, ["joint.drive.damper", *MASSES], marks=pytest.mark.long),
        ("central-difference", spatial, SPATIAL[2:3]),
        ("central-difference", balanced, CENTRES),
        *(
            pytest.param(method, partial(spatial, seed=seed), SPATIAL, id=f"spatial-{seed}", marks=pytest.mark.long)
            for seed, method in enumerate(["central-difference"] * 6 + ["runge-kutta", "generalized-alpha"], start=1)
        ),
        ("generalized-alpha", chain, [SPRINGS[1], OTHERS[0]]),
        ("exponential", chain, OTHERS[1:]),
        ("sub-cycling", fast_slides, ["body.block.mass", "joint.slide.spring"]),
        ("sub-cycling", fast_loop, MASSES[1:]),
        pytest.param("sub-cycling", partial(fast_loop, of=spatial), SPATIAL, id="fast-spatial", marks=pytest.mark.long),
    ],
)
def test_tangents_are_extrapolated_differences_of_marches(method: str, make: Any, keys: list[str]) -> None:
    frozen = FrozenRun(package.load(make(method)).run)
    parameters = [find_parameter(frozen.run.scene, key) for key in keys]
    motion = frozen.at({}, by=parameters)
    assert all(frozen.beside(motion, parameter).by_tangents for parameter in parameters)
    tangents: dict[Parameter, Any] = motion.tangents
    largest = [max(np.abs(each[kind]).max() for each in tangents.values()) for kind in (0, 1)]
    for parameter in parameters:
        for mine, other, size in zip(tangents[parameter][:2], differences(frozen, parameter), largest, strict=True):
            np.testing.assert_allclose(mine, other, rtol=0, atol=1e-8 * size)


def test_motions_by_lifted_equations_are_those_of_scenes_with_these_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whose fast mass, weight, energy and accelerations are their own, though nothing is traced for the second one."""
    tables, names = fast_slides("sub-cycling"), ["block.b.acceleration", "block.b.position", "potential_energy"]
    tables["simulation"]["gravity"] = ["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]
    frozen = FrozenRun(package.load(tables).run)
    numbers = [find_parameter(frozen.run.scene, key) for key in ("body.block.mass", "simulation.gravity.1")]
    channels = find_all_channels(frozen.run, names)
    for values in ((0.8, -5.0), (1.4, -20.0)):
        run = frozen.at(dict(zip(numbers, values, strict=True))).run
        found = [channel.read(run) for channel in channels]
        monkeypatch.setattr(CompiledMechanism, "program", None)
    monkeypatch.undo()
    assert run.lifted
    mass, weight = values
    own = package.load(tables, f"body.block.mass={mass} kg", f"simulation.gravity=[0,{weight},0]").run
    for mine, channel in zip(found, channels, strict=True):
        expected = channel.read(own)
        np.testing.assert_allclose(mine, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def read_beside(frozen: FrozenRun, parameter: Parameter, channels: Sequence[ResultChannel]) -> list[Array]:
    """Extrapolate the derivatives of results by a number's logarithm from whole marches of scenes solved anew."""
    found: list[list[Array]] = []
    for share in (4e-3, 2e-3, 1e-3):
        low, high = (frozen.at({parameter: parameter.value * (1.0 + side * share)}).run for side in (-1.0, 1.0))
        found.append([np.asarray(each.read(high) - each.read(low)) / (2.0 * share) for each in channels])
    return [(64.0 * c - 20.0 * b + a) / 45.0 for a, b, c in zip(*found, strict=True)]


def largest_changes(found: Sequence[Sensitivity]) -> dict[str, float]:
    """Return each result's largest derivative by the logarithm of any number."""
    largest: dict[str, float] = {}
    for each in found:
        change = float(np.abs(each.slope * each.parameter.value).max())
        largest[each.channel.name] = max(largest.get(each.channel.name, 0.0), change)
    return largest


SUBCYCLED = "simulation.run=[{integrator='sub-cycling',substeps=3,step='10 us'}]"
DEPTH = "body.forearm.depth"


@pytest.mark.parametrize(
    ("method", "keys"),
    [
        (SMALL_ARM[0], [DEPTH, "body.forearm.length", "body.forearm.modes.damping"]),
        pytest.param(SUBCYCLED, [DEPTH, "joint.elbow.spring"], marks=pytest.mark.long),
    ],
)
def test_tangents_by_material_and_dimensions_are_differences_of_motions_with_bases_solved_anew(
    method: str, keys: list[str]
) -> None:
    """Of an arm's places and stress: its basis, with whatever signs, and its equations change with these numbers."""
    names = ["tip", "forearm.stress", "forearm.wrist.position.y"]
    small = (method, *SMALL_ARM[1:], "simulation.duration=0.05 s", "body.forearm.mesh.divisions=[8,1,1]")
    result = package.load("arm", *small)
    found = package.jacobian(result, names, keys)
    frozen, largest = FrozenRun(result.run), largest_changes(found)
    for parameter in (find_parameter(result.run.scene, key) for key in keys):
        mine = [each for each in found if each.parameter.key == parameter.key]
        expected = read_beside(frozen, parameter, [each.channel for each in mine])
        for each, slope in zip(mine, expected, strict=True):
            assert each.by_tangents
            np.testing.assert_allclose(
                each.slope * parameter.value, slope, rtol=0, atol=1e-6 * largest[each.channel.name]
            )


def numbers_of_random(scene: Any) -> list[str]:
    """Return keys of numbers of all kinds of a random scene."""
    joints = [f"joint.{name}.{key}" for name, own in scene.joint.items() for key in ("spring", "damper")]
    joints = [key for key in joints if hasattr(scene.joint[key.split(".")[1]], "spring")]
    rigid = [name for name, body in scene.body.items() if body.shape == "rigid"]
    flexible = [f"body.{name}.{key}" for name in scene.flexible for key in ("E", "depth")]
    bodies = [f"body.{name}.{key}" for name in rigid for key in ("mass", "inertia.1", "marker.outer.at.0")]
    return ["simulation.gravity.1", *joints[-2:], *bodies[-3:], *flexible[-2:]]


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.long) for seed in (0, *range(2, 24)))])
def test_tangents_of_random_mechanisms_are_differences_of_marches(seed: int) -> None:
    """Of trees of rigid and flexible bodies on all kinds of joints, by numbers of all kinds."""
    frozen = FrozenRun(package.load(random_scene(seed, SI)).run)
    run = frozen.run
    keys = numbers_of_random(run.scene)
    parameters = [find_parameter(run.scene, key) for key in keys]
    channels = find_all_channels(run, [f"{run.scene.simulation.tip}.position", "kinetic_energy"])
    found = package.jacobian(package.load(random_scene(seed, SI)), [each.name for each in channels], keys)
    largest = largest_changes(found)
    for parameter in parameters:
        mine = [each for each in found if each.parameter.key == parameter.key]
        expected = read_beside(frozen, parameter, [each.channel for each in mine])
        for each, slope in zip(mine, expected, strict=True):
            largest = max(
                np.abs(one.slope * one.parameter.value).max() for one in found if one.channel.name == each.channel.name
            )
            assert each.by_tangents
            np.testing.assert_allclose(each.slope * parameter.value, slope, atol=1e-8 * largest)


def test_tangents_by_a_slender_bars_modulus_are_those_of_similar_motions() -> None:
    """A modulus and a torque twice as large make the same motion in the root of half the time.

    So without gravity, from rest, ``E ∂y/∂E + T ∂y/∂T = t ẏ / 2``. Round-off of the bar's stiffness matrix made
    derivatives by its modulus 1e-4 off, where modes and static responses were its own.
    """
    bar = {"shape": "bar", "length": "0.312 m", "depth": "1 mm", "width": "6.98 mm", "E": "70 GPa", "nu": 0.33}
    bar |= {"rho": "2700 kg/m^3", "mesh": {"order": 2, "divisions": [13, 1, 1]}}
    bar |= {"modes": {"count": 5, "boundary": "joint", "enrich": "inertia"}}
    bar["marker"] = {"root": {"face": "x-"}, "tip": {"face": "x+"}}
    couple = {"type": "point torque", "marker": "bar.tip", "direction": [0, 0, 1], "torque": "0.02 N m"}
    tables = scene(
        "runge-kutta",
        body={"bar": bar},
        joint={"hub": revolute("ground", "bar.root")},
        drive={"couple": couple},
        simulation={"duration": "8 ms", "output_step": "0.4 ms", "tip": "bar.tip", "gravity": ["0 m/s^2"] * 3},
    )
    result, name = package.load(tables), "bar.tip.position.y"
    found = package.jacobian(result, [name], ["body.bar.E", "drive.couple.torque"])
    assert all(each.by_tangents for each in found)
    changes, errors = (sum(getattr(each, kind) * each.parameter.value for each in found) for kind in ("slope", "error"))
    (velocity,) = find_all_channels(result.run, ["bar.tip.velocity.y"])
    expected = 0.5 * result.run.output_times * velocity.read(result.run)
    apart = np.abs(changes - expected).max()
    assert apart <= 2e-6 * max(np.abs(each.slope * each.parameter.value).max() for each in found)
    assert apart <= np.max(errors)
