"""Springs, bushings, bearings, end stops and friction of scenes, against joints' own springs and closed forms."""

from pathlib import Path

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.errors import InputError
from fmd.dynamics.elements import PointSpring, SixAxisSpring
from fmd.dynamics.transmitted_loads import transmitted_loads
from fmd.recovery.motion import Motion
from tests.stages.sliding_block import sliding_block

BLOCK = sliding_block('{ integrator = "runge-kutta", tolerance = 1e-11 }', "SLIDE")


def run_of(folder: Path, text: str, *overrides: str) -> Pipeline:
    (folder / "scene.toml").write_text(text)
    return Pipeline(load_scene(folder / "scene.toml", overrides))


def slide(folder: Path, of_joint: str = "", more: str = "", *overrides: str) -> Motion:
    return run_of(folder, BLOCK.replace("SLIDE", of_joint) + more, *overrides).motion


WALL_SPRING = """
[spring.coil]
between = ["ground.wall", "block.centre"]
stiffness = "200 N/m"
length = "1.05 m"
damper = "3 N s/m"
"""


def test_a_spring_to_the_wall_does_what_the_joint_s_own_spring_does(tmp_path: Path) -> None:
    start = 'position = "0.2 m"\n'
    own = slide(tmp_path, start + 'spring = "200 N/m"\nrest = "0.05 m"\ndamper = "3 N s/m"')
    between = slide(tmp_path, start, WALL_SPRING)
    assert between.joint_position("slide") == pytest.approx(own.joint_position("slide"), abs=1e-9)
    for one, other in zip(between.energies, own.energies, strict=True):
        assert one == pytest.approx(other, abs=1e-8)
    assert np.ptp(own.joint_position("slide")) > 0.2


@pytest.mark.parametrize(
    "force",
    [
        'force = { formula = "200*x", unit = "N" }',
        'force = { elongations = ["-10 cm", "0 m", "10 cm"], values = [-0.02, 0, 0.02], unit = "kN" }',
        'force = { elongations = ["-10 cm", "0 m", "10 cm"], values = [-20, 0, 20], unit = "N", between = "smooth" }',
    ],
)
def test_a_spring_given_by_its_force_is_that_by_its_stiffness(tmp_path: Path, force: str) -> None:
    start = 'position = "0.2 m"\n'
    linear = slide(tmp_path, start, WALL_SPRING)
    given = slide(tmp_path, start, WALL_SPRING.replace('stiffness = "200 N/m"', force))
    assert given.joint_position("slide") == pytest.approx(linear.joint_position("slide"), abs=1e-9)


def test_a_spring_without_a_length_rests_at_the_start(tmp_path: Path) -> None:
    still = slide(tmp_path, 'position = "0.2 m"', WALL_SPRING.replace('length = "1.05 m"', ""))
    assert still.joint_position("slide") == pytest.approx(0.2, abs=1e-12)


def test_a_stop_sends_a_block_back_with_its_energy(tmp_path: Path) -> None:
    stop = 'rate = "2 m/s"\nstop = { high = "0.3 m", stiffness = "50 kN/m", width = "1 mm" }'
    motion = slide(tmp_path, stop, "", "simulation.output_step=0.5 ms")
    x, v = motion.joint_position("slide"), motion.joint_rate("slide")
    assert v[-1] == pytest.approx(-2.0, rel=1e-8)
    assert np.sum(motion.energies, axis=0) == pytest.approx(0.5 * 2 * 2.0**2, rel=1e-8)
    # ½ m v² = k (p³ − (p − w)³)/(6 w) at rest, p beyond the stop: p² − p w + w²/3 = m v²/k.
    k, w, m = 50e3, 1e-3, 2.0
    p = 0.5 * (w + np.sqrt(w * w - 4 * (w * w / 3 - m * 4.0 / k)))
    assert x.max() == pytest.approx(0.3 + p, abs=2e-5)


def test_a_damped_stop_takes_energy_and_a_low_one_holds_from_below(tmp_path: Path) -> None:
    stop = 'rate = "-2 m/s"\nstop = { low = "-0.3 m", stiffness = "50 kN/m", damper = "300 N s/m" }'
    motion = slide(tmp_path, stop)
    assert motion.joint_position("slide").min() < -0.3
    assert 0.2 < motion.joint_rate("slide")[-1] < 1.6


def test_friction_stops_a_block_by_a_constant_force(tmp_path: Path) -> None:
    motion = slide(tmp_path, 'rate = "1 m/s"\nfriction = "5 N"\nfriction_rate = "1 mm/s"')
    t, v = motion.times, motion.joint_rate("slide")
    moving = t < 0.35  # it would stand still at 0.4 s
    assert v[moving] == pytest.approx(1.0 - 2.5 * t[moving], abs=1e-5)  # v/√(v² + 1e-6) is 1 to 5e-5 or better there
    assert np.abs(v[t > 0.45]).max() < 1e-6
    assert motion.joint_position("slide")[-1] == pytest.approx(0.2, abs=1e-4)


@pytest.mark.parametrize("kind", ["spring", "joint"])
def test_clearance_and_friction_count_in_the_step_limit(tmp_path: Path, kind: str) -> None:
    if kind == "joint":
        text = BLOCK.replace("SLIDE", 'friction = "5 N"\nstop = { high = "1 m", stiffness = "3 kN/m" }')
    else:
        text = BLOCK.replace("SLIDE", "") + WALL_SPRING.replace('stiffness = "200 N/m"', 'friction = "5 N"').replace(
            'damper = "3 N s/m"', 'stop = { high = "2 m", stiffness = "3 kN/m" }'
        )
    system = run_of(tmp_path, text).system
    k, c = 3e3 / 2.0, 5.0 / 1e-3 / 2.0  # over the mass; friction's slope at rest
    assert system.largest_step == pytest.approx(2.0 / (c + np.sqrt(c * c + k)), rel=1e-9)


HINGE = BLOCK.replace('type = "prismatic"', 'type = "revolute"').replace("axis = [1, 0, 0]", "axis = [0, 0, 1]")


def test_a_bushing_about_a_hinge_does_what_the_joint_s_own_spring_does(tmp_path: Path) -> None:
    own = run_of(tmp_path, HINGE.replace("SLIDE", 'angle = "70 deg"\nspring = "3 N m/rad"\ndamper = "0.02 N m s/rad"'))
    bushing = """
[bushing.torsion]
between = ["ground", "block.centre"]
stiffness = ["1 N/m", "1 N/m", "1 N/m", "5 N m/rad", "7 N m/rad", "3 N m/rad"]
damper = ["0 N s/m", "0 N s/m", "0 N s/m", "1 N m s/rad", "1 N m s/rad", "0.02 N m s/rad"]
position = ["0 m", "0 m", "0 m"]
turn = ["0 deg", "0 deg", "0 deg"]
"""
    given = run_of(tmp_path, HINGE.replace("SLIDE", 'angle = "70 deg"') + bushing)
    expected = own.motion.joint_position("slide")
    assert given.motion.joint_position("slide") == pytest.approx(expected, abs=1e-9)
    assert np.ptp(expected) > 1.5
    turned = bushing.replace('turn = ["0 deg", "0 deg", "0 deg"]', 'turn = ["0 deg", "0 deg", "70 deg"]')
    still = run_of(tmp_path, HINGE.replace("SLIDE", 'angle = "70 deg"') + turned)
    assert still.motion.joint_position("slide") == pytest.approx(np.deg2rad(70.0), abs=1e-12)


FREE = """
title = "Rotor"

[body.rotor]
shape = "rigid"
mass = "3 kg"
inertia = ["0.05 kg m^2", "0.05 kg m^2", "0.02 kg m^2"]

[body.rotor.marker]
mid = { at = ["0 m", "0 m", "0 m"] }
a = { at = ["0 m", "0 m", "-0.2 m"] }
b = { at = ["0 m", "0 m", "0.2 m"] }

[ground.a]
at = ["0 m", "0 m", "-0.2 m"]
rotation = ["0 deg", "90 deg", "0 deg"]
[ground.b]
at = ["0 m", "0 m", "0.2 m"]

[joint.flight]
type = "free"
parent = "ground"
child = "rotor.mid"
VELOCITY

[simulation]
duration = "0.15 s"
output_step = "1 ms"
tip = "rotor.a"

[[simulation.run]]
integrator = "runge-kutta"
tolerance = 1e-9

[bearing.one]
between = ["ground.a", "rotor.a"]
axis = [-1, 0, 0]
radial = "20 kN/m"
axial = "6 kN/m"
[bearing.two]
between = ["ground.b", "rotor.b"]
axis = [0, 0, 2]
radial = "20 kN/m"
"""


@pytest.mark.parametrize(
    ("start", "omega", "axis"),
    [
        ('velocity = ["1e-3 m/s", "0 m/s", "0 m/s"]', np.sqrt(40e3 / 3), 0),
        ('velocity = ["0 m/s", "0 m/s", "1e-3 m/s"]', np.sqrt(6e3 / 3), 2),
        ('spin = ["0 rad/s", "1e-3 rad/s", "0 rad/s"]', np.sqrt(40e3 * 0.2**2 / 0.05), 0),
    ],
)
def test_a_rotor_swings_in_its_bearings_at_closed_frequencies(
    tmp_path: Path, start: str, omega: float, axis: int
) -> None:
    motion = run_of(tmp_path, FREE.replace("VELOCITY", start)).motion
    tip, size = motion.tip_position[:, axis], 1e-3 / omega
    centre = -0.2 if axis == 2 else 0.0
    if "spin" in start:
        size *= -0.2
    assert tip - centre == pytest.approx(size * np.sin(omega * motion.times), abs=1e-4 * abs(size))


def test_bearings_let_a_rotor_spin_freely(tmp_path: Path) -> None:
    motion = run_of(tmp_path, FREE.replace("VELOCITY", 'spin = ["0 rad/s", "0 rad/s", "300 rad/s"]')).motion
    assert motion.tip_position == pytest.approx(np.tile([0.0, 0.0, -0.2], (len(motion.times), 1)), abs=1e-12)
    assert motion.kinematics.body_spin(0)[:, 2] == pytest.approx(300.0, rel=1e-12)


def test_the_pull_of_a_spring_passes_through_the_body_to_its_joint(tmp_path: Path) -> None:
    # A block on a slide along x: across it, the joint carries all of an oblique spring's pull.
    spring = """
[ground.above]
at = ["0 m", "1 m", "0.5 m"]
[spring.oblique]
between = ["ground.above", "block.side"]
stiffness = "100 N/m"
length = "0.4 m"
"""
    motion = slide(tmp_path, 'position = "0.2 m"', spring, "simulation.output_step=0.1 ms")
    (loads,) = transmitted_loads(motion.kinematics)
    way = np.array([0.0, 1.0, 0.5]) - motion.tip_position
    length = np.linalg.norm(way, axis=1)[:, None]
    pull = 100.0 * (length - 0.4) * way / length
    assert loads.joint[:, 1:3] == pytest.approx(-pull[:, 1:], rel=1e-9)
    assert loads.joint[:, 3:] == pytest.approx(-np.cross([0.1, 0.0, 0.0], pull), abs=1e-3)


BEAM_RUNS = """
base = "beam-paper"
[ground.post]
at = ["340 mm", "-100 mm", "0 mm"]
[spring.tip]
between = ["ground.post", "beam.tip"]
stiffness = "2 N/m"
damper = "1e-4 N s/m"
[bushing.tip]
between = ["beam.tip", "ground.post"]
stiffness = ["1 N/m", "1 N/m", "1 N/m", "1e-3 N m/rad", "1e-3 N m/rad", "1e-3 N m/rad"]
[simulation]
duration = "40 ms"
output_step = "1 ms"
step = "20 us"
tip = "beam.tip"
"""
METHODS = {
    "runge-kutta": ("tolerance = 1e-10", 0.0),
    "exponential-rosenbrock": ("tolerance = 1e-9", 1e-7),
    "central-difference": ("", 3e-3),
    "sub-cycling": ("substeps = 5", 3e-3),
    "reversible-sub-cycling": ("substeps = 5", 3e-3),
    "generalized-alpha": ("", 3e-3),
}


def test_all_methods_integrate_elements_on_a_flexible_body_alike(tmp_path: Path) -> None:
    runs = "".join(f'[[simulation.run]]\nintegrator = "{name}"\n{more}\n' for name, (more, _) in METHODS.items())
    exact, *others = run_of(tmp_path, BEAM_RUNS + runs, "simulation.duration=10 ms").motions.values()
    size = np.abs(exact.tip_deflection).max()
    for motion, (_, error) in zip(others, list(METHODS.values())[1:], strict=True):
        assert np.abs(motion.tip_deflection - exact.tip_deflection).max() < error * size


def test_elements_of_a_scene_have_its_places_and_rates(tmp_path: Path) -> None:
    bushing = """
[bushing.full]
between = ["block.side", "ground.wall"]
rotation = ["0 deg", "0 deg", "90 deg"]
stiffness_matrix = [[4,1,0,0,0,0],[1,3,0,0,0,0],[0,0,2,0,0,0],[0,0,0,5,0,0],[0,0,0,0,6,0],[0,0,0,0,0,7]]
"""
    built = run_of(tmp_path, BLOCK.replace("SLIDE", 'position = "0.2 m"') + WALL_SPRING + bushing).mechanism
    spring, full = built.elements
    assert isinstance(spring, PointSpring)
    assert isinstance(full, SixAxisSpring)
    assert (spring.rest, spring.law.curve.polynomial, spring.law.damping) == (1.05, (0.0, 200.0), 3.0)
    assert [end.body for end in full.ends] == ["block", ""]
    # From the block's side at 0.3 m to the wall at -1 m; x of the bushing is y of space, its y is -x of space.
    assert full.position == pytest.approx([0.0, 1.3, 0.0], abs=1e-12)
    assert full.K[0].tolist() == [4, 1, 0, 0, 0, 0]


@pytest.mark.parametrize(
    ("override", "key", "said"),
    [
        ("spring.coil.between=['ground.wall', 'block.top']", "spring.coil.between.1", "no such marker"),
        ("spring.coil.between=['ground.wal', 'block.side']", "spring.coil.between.0", "did you mean 'ground.wall'?"),
        ("spring.coil.between=['ground.wall', 'ground']", "spring.coil.between", "two places that can move"),
        ("spring.coil.between=['block.side', 'block.side']", "spring.coil.between", "two places that can move"),
        ("spring.coil.stiffness=-1 N/m", "spring.coil.stiffness", "must not be negative"),
        ("spring.coil.stiffness=1 N m", "spring.coil.stiffness", "translational stiffness is wanted"),
        ("spring.coil.length=-1 m", "spring.coil.length", "must not be negative"),
        ("spring.coil.force={formula='5*x', unit='N'}", "spring.coil.force", "can't stand beside stiffness"),
        ("spring.coil={between=['ground', 'block.side']}", "spring.coil.stiffness", "a spring needs this"),
        ("spring.coil={between=['ground', 'block.side'], force={formula='5*t', unit='N'}}", "spring.coil.force.formula",
         "there is no 't'; the formula's variable is x"),
        ("spring.coil={between=['ground', 'block.side'], force={formula='5*x', unit='m'}}", "spring.coil.force.unit",
         "isn't a unit of force"),
        ("spring.coil={between=['ground', 'block.side'], force={unit='N'}}", "spring.coil.force.formula", "is missing"),
        ("spring.coil={between=['ground', 'block.side'], force={elongations=['0 m', '1 m'], values=[0], unit='N'}}",
         "spring.coil.force.values", "must hold 2 values"),
        ("spring.coil={between=['ground', 'block.side'], force={elongations=['0 m', '0 m'], values=[0, 1], unit='N'}}",
         "spring.coil.force.elongations.1", "must be above"),
        ("bushing={b={between=['ground', 'block.side']}}", "bushing.b.stiffness", "a bushing needs this"),
        ("joint.slide.stop={stiffness='1 N/m'}", "joint.slide.stop.high", "where the stop begins"),
        ("joint.slide.stop={low='1 m', high='0 m', stiffness='1 N/m'}", "joint.slide.stop.high", "must be above low"),
        ("joint.slide.stop={high='1 deg', stiffness='1 N/m'}", "joint.slide.stop.high", "a length is wanted"),
        ("joint.slide.friction_rate=0 m/s", "joint.slide.friction_rate", "must be greater than zero"),
    ],
)  # fmt: skip
def test_elements_that_can_not_be_are_refused(tmp_path: Path, override: str, key: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        run_of(tmp_path, BLOCK.replace("SLIDE", "") + WALL_SPRING, override)
    assert caught.value.key == key
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("stiffness_matrix = [[1,2,0,0,0,0],[0,1,0,0,0,0],[0,0,1,0,0,0],[0,0,0,1,0,0],[0,0,0,0,1,0],[0,0,0,0,0,1]]",
         "bushing.b: the stiffness of bushing b isn't a symmetric 6 x 6 matrix"),
        ("damper_matrix = [[1,2,0,0,0,0],[2,1,0,0,0,0],[0,0,1,0,0,0],[0,0,0,1,0,0],[0,0,0,0,1,0],[0,0,0,0,0,1]]",
         "bushing.b: the damping of bushing b has a negative eigenvalue"),
    ],
)  # fmt: skip
def test_matrices_that_are_no_bushing_are_refused(tmp_path: Path, given: str, said: str) -> None:
    bushing = f'\n[bushing.b]\nbetween = ["ground", "block.side"]\n{given}\n'
    with pytest.raises(InputError, match=said):
        _ = run_of(tmp_path, BLOCK.replace("SLIDE", "") + bushing).mechanism


def test_a_formula_without_a_value_at_the_start_is_refused(tmp_path: Path) -> None:
    bad = '\n[spring.s]\nbetween = ["ground", "block.side"]\nforce = { formula = "log(x)", unit = "N" }\n'
    with pytest.raises(InputError, match=r"spring\.s\.force\.formula = 'log\(x\)': has no finite value at the start"):
        _ = run_of(tmp_path, BLOCK.replace("SLIDE", "") + bad).mechanism


def test_a_spring_out_of_the_plane_of_motion_keeps_the_modes_that_it_excites(tmp_path: Path) -> None:
    aside = BEAM_RUNS.replace('at = ["340 mm", "-100 mm", "0 mm"]', 'at = ["340 mm", "-100 mm", "80 mm"]')
    part = run_of(tmp_path, aside + METHOD, "body.beam.modes.family=any")
    whole = Pipeline(part.scene, keep_all=True)
    (found,), (expected,) = part.motions.values(), whole.motions.values()
    assert np.ptp(expected.tip_position[:, 2]) > 1e-5
    assert found.tip_position == pytest.approx(expected.tip_position, abs=1e-9)


METHOD = '[[simulation.run]]\nintegrator = "runge-kutta"\ntolerance = 1e-9\n'
