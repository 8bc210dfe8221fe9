"""Shells from the scene file to their motion and stress, beside solids, and scenes with shells that are wrong."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eigh

import fmd
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.output.frequencies import rotating_table

METAL = {"E": "70 GPa", "nu": 0.33, "rho": "2700 kg/m^3"}
SHELL = {"shape": "plate", "length": "1 m", "width": "0.4 m", "thickness": "20 mm", "mesh": {"divisions": [40, 16]}}
SOLID = {"shape": "bar", "length": "1 m", "depth": "0.4 m", "width": "20 mm", "mesh": {"divisions": [40, 16, 1]}}
MARKERS = {"root": {"face": "x-"}, "tip": {"face": "x+"}}


def swung(shape: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """A plate, clamped in a hub that swings by 0.16 rad and back."""
    plate = shape | METAL | {"modes": {"count": 6, "boundary": "joint", "enrich": "none"}, "marker": MARKERS}
    return {
        "title": "Swung plate",
        "body": {"plate": plate | changes},
        "joint": {"hub": {"type": "revolute", "parent": "ground", "child": "plate.root", "axis": [0, 1, 0]}},
        "drive": {
            "swing": {
                "type": "motion",
                "joint": "hub",
                "angle": {"formula": "0.08*(1 - cos(2*pi*t/0.2))", "unit": "rad"},
            }
        },
        "simulation": {
            "duration": "0.2 s",
            "output_step": "1 ms",
            "tip": "plate.tip",
            "run": [{"integrator": "generalized-alpha", "step": "0.1 ms"}],
        },
    }


def test_a_swung_plate_of_shells_moves_as_one_of_solids() -> None:
    shell, solid = (fmd.load(swung(shape)) for shape in (SHELL, SOLID))
    assert shell.modes.frequencies_hz == pytest.approx(solid.modes.frequencies_hz, rel=6e-3)
    bent = [np.asarray(run.motion.tip_deflection) for run in (shell, solid)]
    assert np.abs(bent[0] - bent[1]).max() < 5e-3 * np.abs(bent[1]).max()
    stress = [run.stress.worst()[2] for run in (shell, solid)]
    assert stress[0] == pytest.approx(stress[1], rel=2e-2)


def test_a_named_element_has_the_stress_of_the_face_that_its_point_is_nearer_to() -> None:
    places = {"above": {"at": ["0.26 m", "0 m", "9 mm"]}, "below": {"at": ["0.26 m", "0 m", "-9 mm"]}}
    shell = fmd.load(swung(SHELL | {"mesh": {"divisions": [20, 8]}}, element=places)).run
    above, below = (next(iter(shell.element_stress(f"plate.{name}", "xx").values())) for name in places)
    assert np.abs(above + below).max() < 1e-6 * np.abs(above).max()  # by bending alone
    spots = {"above": {"at": ["0.275 m", "25 mm", "10 mm"]}}  # the middle of an element's face
    named = fmd.load(swung(SHELL | {"mesh": {"divisions": [20, 8]}}, element=spots)).run
    at_point = named.part.stress_at(np.array([[0.275, 0.025, 0.01]]))
    assert named.part.element_stress == pytest.approx(at_point, rel=1e-9, abs=1e-6 * np.abs(at_point).max())


@pytest.mark.parametrize("axis", [[0, 0, 1], [0, 1, 0], [1, 0, 0]], ids=["z", "y", "x"])
def test_turning_stiffens_a_plate_of_shells_as_one_of_solids(axis: list[int]) -> None:
    found = []
    for shape, divisions in ((SHELL, [20, 8]), (SOLID, [20, 8, 1])):
        scene = swung(shape | {"mesh": {"divisions": divisions}})
        scene["joint"]["hub"]["axis"] = axis
        scene["simulation"]["stiffening"] = "on"
        found.append(rotating_table(fmd.load(scene).run, 100.0))
    shell, solid = (table["rotating_frequencies_hz"] for table in found)
    assert shell == pytest.approx(solid, rel=1.5e-2)
    assert shell[0] == pytest.approx(solid[0], rel=4e-3)  # 16.5 Hz at rest; 23.9, 17.9 and 4.3 Hz at 100 rad/s


def test_turning_stiffens_a_plate_of_shells_with_a_linked_mass_as_one_of_solids() -> None:
    found = []
    for shape, divisions in ((SHELL, [20, 8]), (SOLID, [20, 8, 1])):
        motor = {"mass": "2 kg", "at": "end", "inertia": ["0.01 kg m^2", "0.02 kg m^2", "0.02 kg m^2"]}
        link = {"face": "x+", "type": "rigid", "at": ["1.02 m", "0 m", "0.05 m"]}
        scene = swung(shape | {"mesh": {"divisions": divisions}}, link={"end": link}, mass={"motor": motor})
        scene["simulation"]["stiffening"] = "on"
        found.append(rotating_table(fmd.load(scene).run, 60.0)["rotating_frequencies_hz"])
    shell, solid = found
    assert shell[:3] == pytest.approx(solid[:3], rel=1e-2)
    assert shell[0] == pytest.approx(solid[0], rel=2e-3)


def test_a_tubes_bending_frequency_is_that_of_a_beam() -> None:
    # Euler and Bernoulli's free beam, (4.730041 / L)² (E I / ρ A)^½, less shear and rotary inertia by Rayleigh's
    # quotient: its first mode has 49.48 ∫ φ² of L² ∫ φ'², and 12.30 ∫ φ"² of the next derivative.
    tube = {
        "shape": "tube",
        "length": "4 m",
        "radius": "100 mm",
        "thickness": "4 mm",
        "mesh": {"divisions": [40, 24]},
        "modes": {"count": 2},
    }
    run = fmd.load({"title": "Tube", "body": {"tube": tube | METAL | {"E": "70 GPa", "nu": 0.33}}})
    beam = (4.730041 / 4) ** 2 * (70e9 / 2700 * 0.1**2 / 2) ** 0.5 / (2 * np.pi)
    slender = 0.1**2 / 2 / 4**2  # I / (A L²)
    shear = 2 * (1 + 0.33) / 0.5  # E / (k G) of a thin ring, k = 0.5
    expected = beam * (1 - slender / 2 * (49.48 + 12.30 * shear))
    assert run.modes.frequencies_hz[0] == pytest.approx(expected, rel=4e-3)


def test_a_plate_of_shells_that_a_fixed_joint_clamps_is_clamped() -> None:
    """Thin square plates by Ritz's method: λ = ω a² (ρ t / D)^½, ν = 0.3; an average leaves the second 24 % too low."""
    plate = {"shape": "plate", "length": "1 m", "width": "1 m", "thickness": "5 mm", "mesh": {"divisions": [12, 12]}}
    plate |= {"E": "200 GPa", "nu": 0.3, "rho": "8000 kg/m^3", "modes": {"count": 3, "boundary": "joint"}}
    plate |= {"marker": {"root": {"face": "x-"}, "tip": {"face": "x+"}}}
    joint = {"clamp": {"type": "fixed", "parent": "ground", "child": "plate.root"}}
    times = {"duration": "1 ms", "output_step": "1 ms", "tip": "plate.tip", "run": [{"integrator": "auto"}]}
    run = fmd.load({"title": "Clamp", "body": {"plate": plate}, "joint": joint, "simulation": times})
    unit = (200e9 * 0.005**2 / 12 / (1 - 0.3**2) / 8000) ** 0.5 / (2 * np.pi)
    assert run.modes.frequencies_hz[:3] == pytest.approx(unit * np.array([3.4710, 8.5065, 21.284]), rel=0.02)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"marker": {"root": {"face": "top"}}}, "face"),
        ({"thickness": "-1 mm"}, "thickness"),
    ],
)
def test_what_shells_do_not_have_is_refused_by_name(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        fmd.load(swung(SHELL, **changes))


def test_shells_of_second_order_are_refused(tmp_path: Any) -> None:
    mesh = {"file": "panel.inp", "unit": "mm", "shell": "2 mm", "order": 2}
    with pytest.raises(InputError, match="shells have three or four nodes"):
        fmd.load({"title": "Panel", "body": {"panel": {"mesh": mesh, "modes": {"count": 2}} | METAL}})


def test_the_tower_of_the_page_moves_as_a_beam_with_a_mass_on_its_head() -> None:
    page = (Path(__file__).parents[2] / "docs" / "shells.md").read_text(encoding="utf-8")
    scene = tomllib.loads(page.partition("## A tower")[2].partition("```toml")[2].partition("```")[0])
    run = fmd.load(scene, "body.tower.mesh.divisions=[20, 16]", "output=[]").run
    stiffness, geometric, mass = timoshenko_beam_with_head(inertia=2.6e7)
    across = timoshenko_beam_with_head(inertia=4e7)  # bending in z turns the head about y
    beams = [np.sqrt(eigh(K, M, eigvals_only=True)[0]) / (2 * np.pi) for K, _, M in (across, (stiffness, 0, mass))]
    assert run.modes.frequencies_hz[:2] == pytest.approx(beams, rel=2e-3)

    squares, modes = eigh(stiffness + geometric, mass)

    def rates(t: float, y: Array) -> Array:
        force = np.interp(t, [0.0, 3.0, 6.0, 12.0], [0.0, 8e5, 3e5, 3e5])
        return np.concatenate([y[2:], modes[0] * force - 0.02 * np.sqrt(squares) * y[2:] - squares * y[:2]])

    times = run.motion.times
    beam = modes[0] @ solve_ivp(rates, (0.0, 12.0), np.zeros(4), rtol=1e-8, t_eval=times, max_step=0.05).y[:2]
    assert np.abs(run.motion.tip_deflection[:, 1] - beam).max() < 1e-2 * np.abs(beam).max()


def timoshenko_beam_with_head(inertia: float) -> tuple[Array, Array, Array]:
    """Return K, K_G by weight and M of the tower as one beam of 16 flat sides, for deflection and slope of its head."""
    E, nu, rho, radius, wall, length, head, g = 210e9, 0.3, 8500.0, 2.4, 0.027, 87.0, 350e3, 9.81
    side = 2 * radius * np.sin(np.pi / 16)
    area = 16 * side * wall * np.cos(np.pi / 16)  # its thickness is along the directors, which point away from the axis
    moment = area * ((radius * np.cos(np.pi / 16)) ** 2 / 2 + side**2 / 24)
    shear = E * area / (4 + 3 * nu)  # k G A of a thin ring, Cowper's k = 2 (1 + nu) / (4 + 3 nu)
    flexibility = [[length**3 / 3 + length * E * moment / shear, length**2 / 2], [length**2 / 2, length]]
    s, weights = (np.polynomial.legendre.leggauss(6) + np.array([[1.0], [0.0]])) / 2
    weights = weights * length
    shapes = np.array([3 * s**2 - 2 * s**3, length * (s**3 - s**2)])
    slopes = np.array([6 * s - 6 * s**2, length * (3 * s**2 - 2 * s)]) / length
    pressed = g * (head + rho * area * length * (1 - s))
    mass = (shapes * weights * rho * area) @ shapes.T + (slopes * weights * rho * moment) @ slopes.T
    K = np.linalg.inv(np.array(flexibility) / (E * moment))
    return K, -(slopes * weights * pressed) @ slopes.T, mass + np.diag([head, inertia])
