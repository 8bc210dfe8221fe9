"""Geometric stiffening by loads that pass through a body: an arm with a tip mass, a column, a pendulum."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.linalg import eigh
from scipy.optimize import brentq

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.dynamics.compiled_system.shared import share_system
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.compiler.compiled import compile_mechanism
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.links import Link, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.integrators.runge_kutta import RungeKutta
from fmd.reduction.body import MarkerShapes
from fmd.scene.joints.fixed import FIXED
from fmd.scene.joints.revolute import REVOLUTE
from fmd.stages.mechanism import find_start
from tests.tasks import Tasks

LENGTH, WIDTH, HEIGHT, E, RHO = 1.0, 0.02, 0.006, 70e9, 2700.0
EI, MU = E * WIDTH * HEIGHT**3 / 12, RHO * WIDTH * HEIGHT
EULER = np.pi**2 * EI / (4 * LENGTH**2)  # of a column that is clamped at its foot

BAR = f"""
title = "A bar"
[body.bar]
shape = "bar"
length = "{LENGTH} m"
E = "{E} Pa"
nu = 0.0
rho = "{RHO} kg/m^3"
[body.bar.mesh]
element = "hexahedron"
order = 2
[body.bar.modes]
count = 6
enrich = "inertia"
[body.bar.marker]
root = {{ face = "x-" }}
tip = {{ face = "x+" }}
[simulation]
output_step = "1 ms"
tip = "bar.tip"
[[simulation.run]]
integrator = "auto"
"""
FLAT = ("body.bar.depth=20 mm", "body.bar.width=6 mm", "body.bar.mesh.divisions=[20,2,1]")  # bends along z
UPRIGHT = ("body.bar.depth=6 mm", "body.bar.width=20 mm", "body.bar.mesh.divisions=[60,1,1]")  # bends along y
IN_PLANE = 'body.bar.modes.family="in-plane bending"'


def bar(tmp_path: Path, overrides: Sequence[str], parts: str = "") -> Pipeline:
    file = tmp_path / "bar.toml"
    file.write_text(BAR.replace("[simulation]", f"{parts}\n[simulation]", 1))
    return Pipeline(load_scene(file, list(overrides)))


def hub(kind: str) -> str:
    axis = "axis = [0, 0, 1]" if kind == "revolute" else ""
    return f'[joint.hub]\ntype = "{kind}"\nparent = "ground"\nchild = "bar.root"\n{axis}\n'


def payload(mass: float) -> str:
    if not mass:
        return ""
    return (
        f'[body.load]\nshape = "point"\nmass = "{mass} kg"\nmarker = {{ at = {{ at = ["0 m", "0 m", "0 m"] }} }}\n'
        '[joint.weld]\ntype = "fixed"\nparent = "bar.tip"\nchild = "load.at"\n'
    )


# A turning arm with a mass at its tip --------------------------------------------------------------------------------

RATE, PULL = 20.0, 1.0  # rad/s, m/s²
TURN = f'[drive.turn]\ntype = "motion"\njoint = "hub"\nangle = {{ formula = "{RATE}*t", unit = "rad" }}\n'
WEIGHT = f'simulation.gravity=["0 m/s^2", "0 m/s^2", "{-PULL} m/s^2"]'


def drooping_tip(mass: float) -> float:
    """Tip of a beam under the tension ``M Ω² L + ½ μ Ω² (L² − x²)`` and its own and the tip's weight [m]."""

    def slopes(x: Array, y: Array) -> Array:  # w, w', moment EI w'', and the transverse force
        tension = mass * RATE**2 * LENGTH + 0.5 * MU * RATE**2 * (LENGTH**2 - x**2)
        return np.array([y[1], y[2] / EI, tension * y[1] - y[3], np.full_like(x, MU * PULL)])

    def ends(root: Array, tip: Array) -> Array:
        return np.array([root[0], root[1], tip[2], tip[3] + mass * PULL])

    x = np.linspace(0.0, LENGTH, 201)
    return float(solve_bvp(slopes, ends, x, np.zeros((4, len(x))), tol=1e-9, max_nodes=100_000).y[0, -1])


@pytest.mark.parametrize("mass", [0.0, 0.5, 5.0])
def test_a_turning_arm_with_a_tip_mass_droops_as_a_beam_under_tension(tmp_path: Path, mass: float) -> None:
    settings = ('body.bar.modes.boundary="joint"', "simulation.duration=1 s", "simulation.start=steady")
    run = bar(tmp_path, [*FLAT, *settings, WEIGHT], hub("revolute") + TURN + payload(mass))
    assert run.stiffening_loads["bar"].stiffened
    mechanism = run.mechanism
    q, still = find_start(run.scene, share_system(mechanism))
    at = Kinematics(mechanism, np.zeros(1), q[None], still[None]).displacement(0, "tip")[0]
    assert at[2] == pytest.approx(drooping_tip(mass), rel=3e-3)


def test_an_arm_whose_tip_mass_closes_a_loop_starts_as_steadily_as_one_that_carries_it(tmp_path: Path) -> None:
    mass = 5.0
    free = (
        f'[body.load]\nshape = "rigid"\nmass = "{mass} kg"\ncentre = ["0 m", "0 m", "0 m"]\n'
        'inertia = ["1e-3 kg m^2", "1e-3 kg m^2", "1e-3 kg m^2"]\nmarker = { at = { at = ["0 m", "0 m", "0 m"] } }\n'
        '[joint.air]\ntype = "free"\nparent = "ground"\nchild = "load.at"\n'
        '[joint.ball]\ntype = "spherical"\nparent = "bar.tip"\nchild = "load.at"\n'
    )
    settings = ('body.bar.modes.boundary="joint"', "simulation.duration=0.2 s", "simulation.start=steady", WEIGHT)
    deflection = bar(tmp_path, [*FLAT, *settings], hub("revolute") + TURN + free).motion.tip_deflection[:, 2]
    assert deflection[0] == pytest.approx(drooping_tip(mass), rel=3e-3)
    assert deflection == pytest.approx(deflection[0], rel=1e-5)  # it stays


# A column under a dead load at its free end --------------------------------------------------------------------------


def first_frequency(load: float) -> float:
    """First root ω of the characteristic equation of a cantilever under a dead tension at its end [rad/s].

    ``EI w⁗ − N w″ = μ ω² w`` with ``w″ = 0`` and ``EI w‴ = N w′`` at the end has e^{±ax}, e^{±ibx} as solutions.
    """

    def lack(omega: float) -> float:
        half, whole = load / (2 * EI), np.sqrt((load / (2 * EI)) ** 2 + MU * omega**2 / EI)
        a, b = np.sqrt(half + whole), np.sqrt(whole - half)
        ca, sa, cb, sb = np.cosh(a), np.sinh(a), np.cos(b), np.sin(b)
        # w = A (cosh ax − cos bx) + B (sinh ax / a − sin bx / b), for L = 1
        bent = a**2 * ca + b**2 * cb, a * sa + b * sb
        n = load / EI
        cut = a**3 * sa - b**3 * sb - n * (a * sa + b * sb), a**2 * ca + b**2 * cb - n * (ca - cb)
        return float(bent[0] * cut[1] - bent[1] * cut[0])

    grid = np.linspace(0.05, 4.0, 400) * 3.516 * np.sqrt(EI / MU)
    values = [lack(omega) for omega in grid]
    k = next(k for k in range(len(grid) - 1) if values[k] * values[k + 1] < 0)
    return float(brentq(lack, grid[k], grid[k + 1]))


def column(tmp_path: Path, load: str, *more: str) -> Pipeline:
    force = f'[drive.load]\ntype = "point force"\nmarker = "bar.tip"\ndirection = [1, 0, 0]\nforce = {load}\n'
    clamped = ('body.bar.modes.boundary="joint"', "simulation.duration=1 s", IN_PLANE)
    return bar(tmp_path, [*UPRIGHT, *clamped, *more], hub("fixed") + force)


@pytest.mark.parametrize("part", [-0.9, -0.5, 0.5, 1.0, 2.0])
def test_a_column_vibrates_under_a_dead_load_as_its_characteristic_equation_says(tmp_path: Path, part: float) -> None:
    run = column(tmp_path, f'"{part * EULER} N"')
    mechanism = run.mechanism
    compiled, still = compile_mechanism(mechanism), np.zeros(mechanism.n)
    K, _, M = compiled.tangents(compiled.signal_values(0.0), mechanism.rest_positions, still, still)
    found = np.sqrt(eigh(0.5 * (K + K.T), M, eigvals_only=True)[0])
    assert found == pytest.approx(first_frequency(part * EULER), rel=5e-3)
    change = run.stiffness_changes["bar"]
    assert change.buckling == pytest.approx(max(-part, 0.0), rel=2e-3, abs=1e-9)
    assert change.growth == 0.0


def test_a_column_that_would_buckle_is_refused_before_anything_is_integrated(tmp_path: Path) -> None:
    scene, tasks = column(tmp_path, f'"{-1.3 * EULER} N"').scene, Tasks()
    run = Pipeline(scene, monitor=tasks)
    with pytest.raises(InputError, match=r"body\.bar: the body would buckle: from t = 0 s on .* up to 1\.3 times"):
        _ = run.motions
    assert not tasks.began_a_run(scene)


def test_a_load_that_passes_the_buckling_load_for_a_moment_is_warned_of(tmp_path: Path) -> None:
    from fmd.output.summary import _stiffness_warnings

    run = column(tmp_path, f'{{ formula = "{-1.3 * EULER} if t < 0.02 else 0", unit = "N" }}')
    (warning,) = _stiffness_warnings(run)
    assert warning["code"] == "buckling"
    assert "1.3 times its buckling load at t = 0 s" in warning["text"]


# A free bar that is compressed between its ends -----------------------------------------------------------------------

ENDS = """
[drive.at-root]
type = "point force"
marker = "bar.root"
direction = [1, 0, 0]
force = "{load} N"
[drive.at-tip]
type = "point force"
marker = "bar.tip"
direction = [-1, 0, 0]
force = "{load} N"
"""
STRUT = """
[spring.strut]
between = ["bar.root", "bar.tip"]
length = "{shorter} m"
stiffness = "1000 N/m"
"""


@pytest.mark.parametrize("between", [ENDS, STRUT])
def test_a_free_bar_that_is_compressed_between_its_ends_buckles_at_the_load_of_euler(
    tmp_path: Path, between: str
) -> None:
    load = 0.5 * 4 * EULER  # w = cos(πx/L) bends neither end, and takes π² EI/L²
    parts = hub("free") + between.format(load=load, shorter=LENGTH - load / 1000)
    run = bar(tmp_path, [*FLAT, "simulation.duration=1 s"], parts)
    assert run.stiffness_changes["bar"].buckling == pytest.approx(0.5, rel=5e-3)


# A heavy pendulum against a chain of rigid links ---------------------------------------------------------------------


def chain(n_links: int, mass: float) -> Mechanism:
    """Rigid links on springs EI/l, for slices of the bar, which converge to it as 1/n²."""
    length = LENGTH / n_links
    inertia = np.diag([0.0, 0.0, MU * length**3 / 12 + RHO * WIDTH * HEIGHT**3 / 12 * length])
    links = [
        Link(
            f"link {k}",
            rigid_integrals(MU * length, np.array([length / 2, 0.0, 0.0]), inertia),
            REVOLUTE,
            k - 1,
            place=MarkerShapes(np.array([length if k else 0.0, 0.0, 0.0])),
            spring=EI / length if k else 0.0,
        )
        for k in range(n_links)
    ]
    load = rigid_integrals(mass, np.zeros(3), np.zeros((3, 3)))
    links.append(Link("load", load, FIXED, n_links - 1, place=MarkerShapes(np.array([length, 0.0, 0.0]))))
    return Mechanism(links, gravity=np.array([0.0, -9.81, 0.0]))


def fall(mechanism: Mechanism, times: Array) -> tuple[Array, Array]:
    """Positions and rates from rest."""
    still = np.zeros(mechanism.n)
    march = RungeKutta(1e-10).march(CompiledSystem(mechanism), still, still, times)
    return march.q, march.v


@pytest.mark.slow
def test_a_heavy_pendulum_falls_as_a_chain_of_rigid_links(tmp_path: Path) -> None:
    times, mass = np.linspace(0.0, 0.6, 121), 1.0
    angles = []
    for n_links in (6, 12):
        q, _ = fall(chain(n_links, mass), times)
        angles.append(q[:, 0])
    exact = angles[1] + (angles[1] - angles[0]) / 3
    rigid, _ = fall(chain(1, mass), times)
    weight = 'simulation.gravity=["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]'
    run = bar(tmp_path, [*UPRIGHT, IN_PLANE, weight, "simulation.duration=0.6 s"], hub("revolute") + payload(mass))
    assert run.stiffening_loads["bar"].stiffened
    q, v = fall(run.mechanism, times)
    motion = Kinematics(run.mechanism, times, q, v)
    found = motion.along_joint(0)[0]
    assert np.abs(found - exact).max() < 0.01 * np.abs(rigid[:, 0] - exact).max()
    kinetic, potential = motion.energies
    assert np.ptp(kinetic + potential) < 1e-9 * np.ptp(kinetic)
