"""Cases of contact: a bar and a ball that bounce, a block on a slope, a struck beam, and a pressed ball."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.spatial import Delaunay

from fmd.accuracy.solved_scene import SolvedScene
from fmd.contact.half_space import half_space_flexibility
from fmd.contact.touching_body import ContactPlane, ContactPoints, TouchingBody
from fmd.core.arrays import Array
from fmd.core.cache import Cache
from fmd.dynamics.compiled_system.shared import share_system
from fmd.dynamics.links import Link, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.integrators.protocol import evaluate
from fmd.output.contacts import contact_figures
from fmd.output.exports import nodal_stress_at
from fmd.scene.joints.free import FREE
from fmd.scene.scene import load_scene
from fmd.verification.case import Figure, VerificationCase, open_scene
from fmd.verification.frequencies import write_abaqus_box

SPEED, RADIUS, E, NU = 0.05, 0.01, 210e9, 0.3  # of the ball [m/s, m, Pa]


def _bar(cache: Cache | None) -> list[Figure]:
    floor = open_scene("verification/bouncing-bar", cache).motion.contacts["floor"]
    begin, end = floor.span
    return [
        Figure("impulse [N s]", float(floor.impulse[-1, 0]), 800 / 3, 0.01),
        Figure("begin of the contact [s]", begin or 0.0, 1.0, 0.005),
        Figure("its end [s]", end or 0.0, 5 / 3, 0.005),
    ]


def _slope(cache: Cache | None) -> list[Figure]:
    found = []
    for friction in (0.5, 0.57):
        motion = open_scene("verification/slope", cache, [f"contact.slope.friction={friction}"]).motion
        later = motion.times > 0.5 * motion.times[-1]
        fit = np.polyfit(motion.times[later], motion.trajectory.v[later, 0], 1)
        exact = -10 * (0.5 - friction * np.sqrt(0.75))
        found.append(Figure(f"acceleration, friction {friction} [m/s²]", float(fit[0]), exact, 0.001))
    return found


def _ball(cache: Cache | None) -> list[Figure]:
    """Largest approach ``(15 m v²/(16 E* √R))^0.4``, contact for 2.9432 of it over v; modes take next to nothing."""
    run = open_scene("verification/ball", cache)
    floor, mass = contact_figures(run)["contacts"]["floor"], run.mechanism.mass
    stiff = E / (1.0 - NU**2)
    approach = (15.0 / 16.0 * mass * SPEED**2 / (stiff * np.sqrt(RADIUS))) ** 0.4
    force, half = 4.0 / 3.0 * stiff * np.sqrt(RADIUS) * approach**1.5, np.sqrt(RADIUS * approach)
    pressure, lasts = 1.5 * force / (np.pi * half**2), floor["end_s"] - floor["begin_s"]
    return [
        Figure("largest force [N]", floor["largest_force_n"], float(force), 0.01),
        Figure("largest pressure [Pa]", floor["largest_pressure_pa"], float(pressure), 0.01),
        Figure("duration [s]", lasts, 2.9432 * approach / SPEED, 0.02),
        Figure("impulse [N s]", floor["impulse_n_s"][2], 2.0 * mass * SPEED, 0.01),
        Figure("largest area [m²]", floor["largest_area_m2"], float(np.pi * half**2), 0.05),
        Figure("largest von Mises stress below [Pa]", floor["largest_stress_below_pa"], 0.62 * float(pressure), 0.02),
        Figure("its depth [m]", floor["its_depth_m"], 0.48 * float(half), 0.02),
    ]


_STRUCK_BEAM = """
title = "Ball of steel that strikes a free beam at 1 m/s"
[body.beam]
mesh = { file = "beam.inp", unit = "mm" }
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
modes = { count = 40, enrich = "none" }
marker = { top = { face = "TOP" } }
[body.ball]
shape = "rigid"
mass = "32.88 g"
inertia = ["1.315e-6 kg m^2", "1.315e-6 kg m^2", "1.315e-6 kg m^2"]
marker = { centre = { at = ["0 m", "0 m", "0 m"] } }
surface = { skin = { type = "file", file = "cap.obj", unit = "mm", E = "210 GPa", nu = 0.3 } }
[joint.rest]
type = "free"
parent = "ground"
child = "beam.top"
[joint.fall]
type = "free"
parent = "ground"
child = "ball.centre"
position = ["0 mm", "0 mm", "10.0001 mm"]
velocity = ["0 m/s", "0 m/s", "-1 m/s"]
[contact.hit]
between = ["beam.top", "ball.skin"]
[simulation]
duration = "90 us"
output_step = "1 us"
step = "auto"
tip = "ball.centre"
[[simulation.run]]
integrator = "central-difference"
"""


def _struck_beam(cache: Cache | None) -> list[Figure]:
    """A ball of 10 mm and a beam of 200 × 20 × 10 mm, with elements of 0.3 mm where they meet."""
    halves = []
    for reach, fine, growth in ((100.0, 2, 2.2), (10.0, 2, 2.2), (10.0, 1, 1.4)):
        sizes = [0.3] * fine
        while sum(sizes) < reach:
            sizes.append(min(growth * sizes[-1], 12.0))
        sizes[fine:] = np.array(sizes[fine:]) * (reach - 0.3 * fine) / sum(sizes[fine:])
        halves.append(np.cumsum([0.0, *sizes]))
    along, across, down = halves
    with TemporaryDirectory(prefix="fmd-") as folder:
        borders = [-along[::-1], along[1:]], [-across[::-1], across[1:]], [-down[::-1]]
        write_abaqus_box(Path(folder) / "beam.inp", [np.concatenate(own) for own in borders], top=0.6)
        _write_cap(Path(folder) / "cap.obj", 10.0, 0.55, 4)
        (scene := Path(folder) / "scene.toml").write_text(_STRUCK_BEAM, encoding="utf-8")
        run = SolvedScene(load_scene(scene), cache).run
        hit = contact_figures(run)["contacts"]["hit"]
        back = int(np.linalg.norm(run.part.space.x - [0.0, 0.0, -0.01], axis=1).argmin())
        bent = [float(nodal_stress_at(run, "beam", k)[back, 0]) for k in (40, 50)]
    return [
        Figure("largest force [N]", hit["largest_force_n"], 1330.4, 0.01),
        Figure("duration [s]", hit["end_s"] - hit["begin_s"], 64.2e-6, 0.02),
        Figure("restitution", hit["impulse_n_s"][2] / 0.03288 - 1.0, 0.3913, 0.01),
        Figure("bending at the back after 40 µs [Pa]", bent[0], 30.41e6, 0.03),
        Figure("the same after 50 µs [Pa]", bent[1], 28.25e6, 0.02),
    ]


def _write_cap(path: Path, radius: float, reach: float, rings: int) -> None:
    """Write the lowest part of a ball, up to a reach beside its axis along z, as triangles between rings."""
    k = np.repeat(np.arange(rings + 1), [1, *(6 * np.arange(1, rings + 1))])
    turn = 2.0 * np.pi * (np.arange(len(k)) - 1 - 3 * k * (k - 1) + 0.5 * (k % 2)) / (6 * np.maximum(k, 1))
    x, y = reach * k / rings * np.array([np.cos(turn), np.sin(turn)])
    lines = [f"v {a:.12g} {b:.12g} {-np.sqrt(radius**2 - a**2 - b**2):.12g}" for a, b in zip(x, y, strict=True)]
    for a, b, c in Delaunay(np.column_stack([x, y])).simplices + 1:
        down = (x[b - 1] - x[a - 1]) * (y[c - 1] - y[a - 1]) < (y[b - 1] - y[a - 1]) * (x[c - 1] - x[a - 1])
        lines.append(f"f {a} {b} {c}" if down else f"f {a} {c} {b}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _pushed_ball(cache: Cache | None) -> list[Figure]:
    """``Q = μ F (1 − (1 − s/s₁)^1.5)`` up to the slide, which begins at s₁ = 3 μ F/(16 a G*).

    ν = 0.5, so that pressure doesn't move the surface along itself, as it doesn't between equal spheres.
    """
    E, nu, friction, half, radius = 210e3, 0.5, 0.3, 0.25, 10.0  # in N and mm
    places, side = _disc(150, 1.1 * half)
    n = len(places)
    foot = ContactPoints(
        x=np.column_stack([places, (places**2).sum(axis=1) / (2 * radius)]),
        areas={"foot": np.full(n, side**2)},
        shapes=np.zeros((n, 3, 0)),
        G=half_space_flexibility(places, (side, side), E, nu)[:, [1, 2, 0]][..., [1, 2, 0]],
        faces={"foot": np.arange(n)},
    )
    plane = ContactPlane("floor", np.zeros(3), np.array([0.0, 0.0, 1.0]), friction, "foot")
    link = Link("ball", rigid_integrals(1.0, np.zeros(3), np.eye(3)), FREE)
    system = share_system(Mechanism([link], contacts=[TouchingBody("ball", foot, (plane,))]))
    q, p = system.mechanism.rest_positions, system.parameters
    c, q[2] = p.contact, -(half**2) / radius

    def press() -> None:
        evaluate(p, 0.0, q, np.zeros(6), np.zeros(6))
        c.tip[:] = c.spot + np.einsum("ikb,ik->ib", c.Q, c.moved)
        c.known[:], c.seen[:, 1] = np.einsum("ikb,ik->ib", c.Q, c.own), 1

    press()
    pressed = c.force[:, 0].sum()
    slide = 3 * friction * pressed / (16 * half) * (2 - nu) * 2 * (1 + nu) / E
    found = []
    for part in np.arange(0.1, 0.95, 0.1):
        q[0] += 0.1 * slide
        press()
        across = float(np.linalg.norm((c.force[:, 1:, None] * plane.axes[1:]).sum(axis=(0, 1))))
        exact = 1.0 - (1.0 - part) ** 1.5
        found.append(Figure(f"Q/(μ F) at {part:.1f}", across / (friction * pressed), exact, 0.01 / exact))
    return found


def _disc(count: int, half: float) -> tuple[Array, float]:
    """Return middles of squares in a circle, and their sides."""
    n = int(np.sqrt(4 * count / np.pi))
    middles = (np.arange(n) + 0.5) / n * 2 * half - half
    places = np.stack(np.meshgrid(middles, middles), axis=-1).reshape(-1, 2)
    return places[np.hypot(*places.T) < half], 2 * half / n


_DOYEN = "Doyen, Ern & Piperno, SIAM J Sci Comput 33 (2011)"
_HERTZ = "Hertz (1882); Johnson, Contact Mechanics (1985)"
_MINDLIN = "Cattaneo (1938); Mindlin (1949)"
CASES = (
    VerificationCase("bouncing-bar", "contact of a bar that bounces", _DOYEN, _bar),
    VerificationCase("slope", "friction on a slope of 30°", "−g (sin 30° − μ cos 30°)", _slope),
    VerificationCase("ball", "ball that bounces, elements of 9 mm", _HERTZ, _ball),
    VerificationCase("struck-beam", "ball that strikes a beam", "whole elements, explicit", _struck_beam),
    VerificationCase("pushed-ball", "pressed ball that is pushed aside", _MINDLIN, _pushed_ball),
)
