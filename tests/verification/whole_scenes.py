"""Random scenes of one bar that whole finite elements can follow: clamped or turned, loaded anywhere, on springs."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from fmd.output.result import Result
from tests.fem.nonlinear_solid import NonlinearSolid
from tests.verification.whole_elements import Spring, WholeElements

MATERIALS = ((210e9, 0.3, 7850.0), (70e9, 0.33, 2700.0), (3e9, 0.35, 1200.0))  # E, ν, ρ


@dataclass(frozen=True)
class WholeScene:
    """A scene as text, and the same for whole elements.

    Parameters
    ----------
    text : str
        The scene in TOML.
    angle : tuple of float
        Final rate [rad/s] and time [s] of the root's spin-up about z after Kane, Ryan & Banerjee (1987); 0, 1 at rest.
    gravity : tuple of float
    forces : list of (marker, amplitude (3,), frequency [Hz])
        ``F sin(2π f t)`` at markers [N].
    blows : bool
        The forces end with their first half wave.
    spring : tuple, optional
        Marker, place, stiffness and damper.
    duration : float
    """

    text: str
    angle: tuple[float, float]
    gravity: tuple[float, float, float]
    forces: list[tuple[str, Any, float]]
    spring: tuple[str, Any, float, float] | None
    duration: float
    blows: bool = False

    def whole(self, result: Result) -> WholeElements:
        """Return the whole elements on the mesh of a result."""
        part = result.run.parts["bar"]
        markers = part.markers
        rate, over = self.angle
        turn = 2 * np.pi / over

        def angle(t: float) -> tuple[float, float, float]:
            if t >= over:
                return rate * (t - over / 2), rate, 0.0
            return (
                rate / over * (t * t / 2 + (np.cos(turn * t) - 1) / turn**2),
                rate / over * (t - np.sin(turn * t) / turn),
                rate / over * (1 - np.cos(turn * t)),
            )

        def force(t: float, F: Any, f: float) -> Any:
            return F * (0.0 if self.blows and t >= 0.5 / f else np.sin(2 * np.pi * f * t))

        forces = [(markers[name], lambda t, F=F, f=f: force(t, F, f)) for name, F, f in self.forces]
        springs = []
        if self.spring is not None:
            name, place, stiffness, damper = self.spring
            length = float(np.linalg.norm(place - markers[name].position))
            springs = [Spring(markers[name], place, stiffness, damper, length)]
        solid = NonlinearSolid(part.fe, markers["root"], markers["tip"])
        return WholeElements(solid, angle, np.array(self.gravity), forces, springs)


def random_scene(seed: int) -> WholeScene:
    """Return the scene of a seed."""
    rng = np.random.default_rng([seed, 32])
    E, nu, rho = MATERIALS[int(rng.integers(3))]
    length = float(rng.uniform(0.2, 0.6))
    depth, width = length / rng.uniform(12, 40), length / rng.uniform(10, 25)
    along = int(rng.integers(8, 13))
    thin, mass = min(depth, width), rho * length * depth * width
    omega = 1.03 * np.sqrt(E / rho) * thin / length**2  # the first bending frequency, near enough
    period = 2 * np.pi / omega
    duration = float(f"{period * rng.uniform(1.0, 2.5):.3g}")
    stiff = 3 * E * max(depth, width) * thin**3 / 12 / length**3
    spins = rng.random() < 0.45
    rate = float(omega * rng.uniform(0.1, 0.7)) if spins else 0.0
    over = float(f"{duration * rng.uniform(0.3, 0.8):.4g}")
    gravity = (0.0, -9.81, 0.0) if rng.random() < 0.5 else (0.0, 0.0, 0.0)
    at = [float(f"{length * rng.uniform(0.35, 0.8):.4g}"), depth / 2, 0.0]
    forces, tables = [], []
    for name in ("side", "tip"):
        if rng.random() < 0.6 or (name == "tip" and not forces and not spins):
            direction = rng.normal(size=3) * [0.3, 1.0, 1.0]
            size = float(stiff * length * 10 ** rng.uniform(-3.0, -1.6))
            F, f = float(size) * direction / np.linalg.norm(direction), float(f"{rng.uniform(0.2, 2.0) / period:.4g}")
            forces.append((name, F, f))
            tables.append(
                f"[drive.{name}]\ntype = 'point force'\nmarker = 'bar.{name}'\ndirection = {F.tolist()!r}\n"
                f"force = {{ formula = '{float(np.linalg.norm(F))!r}*sin(2*pi*{f!r}*t)', unit = 'N' }}\n"
            )
    spring = None
    if not spins and rng.random() < 0.4:
        name, place = str(rng.choice(["side", "tip"])), np.array([at[0], -float(rng.uniform(0.2, 0.5)), 0.1])
        k, c = float(stiff * rng.uniform(0.2, 2)), float(np.sqrt(stiff * mass) * rng.uniform(0, 0.2))
        spring = (name, place, k, c)
        tables.append(f"[ground.post]\nat = {[f'{x!r} m' for x in place.tolist()]!r}\n")
        tables.append(
            f"[spring.strut]\nbetween = ['ground.post', 'bar.{name}']\nstiffness = '{k!r} N/m'\n"
            f"damper = '{c!r} N s/m'\n"
        )
    if spins:
        W, T = repr(rate), repr(over)
        turn = f"{W}/{T}*(t**2/2 + ({T}/(2*pi))**2*(cos(2*pi*t/{T}) - 1)) if t < {T} else {W}*(t - {T}/2)"
        tables.append(f"[drive.turn]\ntype = 'motion'\njoint = 'hub'\nangle = {{ formula = '{turn}', unit = 'rad' }}\n")
    hub = "type = 'revolute'\naxis = [0, 0, 1]" if spins else "type = 'fixed'"
    pull = [f"{g} m/s^2" for g in gravity]
    text = f"""
title = 'whole elements {seed}'
[body.bar]
shape = 'bar'
length = '{length!r} m'
depth = '{depth!r} m'
width = '{width!r} m'
E = '{E!r} Pa'
nu = {nu}
rho = '{rho!r} kg/m^3'
mesh = {{ order = 2, divisions = [{along}, 1, 1] }}
[body.bar.marker]
root = {{ face = 'x-', attachment = 'rigid' }}
tip = {{ face = 'x+' }}
side = {{ at = {[f"{x!r} m" for x in at]!r} }}
[body.bar.modes]
count = {int(rng.integers(4, 9))}
boundary = 'joint'
enrich = 'inertia'
[joint.hub]
{hub}
parent = 'ground'
child = 'bar.root'
{"".join(tables)}
[simulation]
duration = '{duration!r} s'
output_step = '{duration / 100!r} s'
gravity = {pull!r}
tip = 'bar.tip'
[[simulation.run]]
integrator = 'auto'
[[output]]
type = 'history'
file = 'all.csv'
quantities = ['marker_position', 'marker_acceleration', 'joint_reaction']
markers = ['bar.tip', 'bar.side']
"""
    return WholeScene(text, (rate, over), gravity, forces, spring, duration)


def random_blow(seed: int) -> WholeScene:
    """Return a clamped bar that is struck at its tip, in few modes, without what makes up for the others."""
    rng = np.random.default_rng([seed, 3])
    E, nu, rho = MATERIALS[int(rng.integers(3))]
    length = float(rng.uniform(0.2, 0.6))
    depth, width = length / rng.uniform(20, 40), length / rng.uniform(12, 25)
    period = 2 * np.pi * length**2 / (1.03 * np.sqrt(E / rho) * depth)
    over = period * 10 ** rng.uniform(-1.7, -0.7)
    stiff = 3 * E * width * depth**3 / 12 / length**3
    F = np.array([0.0, 1.0, float(rng.uniform(-0.5, 0.5))])
    F *= float(2e-4 * stiff * length * period / over) / np.linalg.norm(F)
    size, f, duration = (
        float(np.linalg.norm(F)),
        float(f"{0.5 / over:.4g}"),
        float(f"{rng.uniform(0.4, 1.0) * period:.3g}"),
    )
    at = [float(f"{length * rng.uniform(0.35, 0.8):.4g}"), depth / 2, 0.0]
    text = f"""
title = 'struck {seed}'
[body.bar]
shape = 'bar'
length = '{length!r} m'
depth = '{depth!r} m'
width = '{width!r} m'
E = '{E!r} Pa'
nu = {nu}
rho = '{rho!r} kg/m^3'
mesh = {{ order = 2, divisions = [{int(rng.integers(12, 17))}, 1, 1] }}
[body.bar.marker]
root = {{ face = 'x-', attachment = 'rigid' }}
tip = {{ face = 'x+' }}
side = {{ at = {[f"{x!r} m" for x in at]!r} }}
[body.bar.modes]
count = {int(rng.integers(3, 9))}
boundary = 'joint'
enrich = '{rng.choice(["none", "inertia"])}'
[joint.hub]
type = 'fixed'
parent = 'ground'
child = 'bar.root'
[drive.blow]
type = 'point force'
marker = 'bar.tip'
direction = {F.tolist()!r}
force = {{ formula = '{size!r}*sin(2*pi*{f!r}*t) if t < {0.5 / f!r} else 0', unit = 'N' }}
[simulation]
duration = '{duration!r} s'
output_step = '{duration / 100!r} s'
gravity = ['0 m/s^2', '0 m/s^2', '0 m/s^2']
tip = 'bar.tip'
[[simulation.run]]
integrator = 'auto'
[[output]]
type = 'history'
file = 'all.csv'
quantities = ['marker_position', 'marker_acceleration', 'joint_reaction']
markers = ['bar.tip', 'bar.side']
"""
    return WholeScene(text, (0.0, 1.0), (0.0, 0.0, 0.0), [("tip", F, f)], None, duration, blows=True)
