"""A slider with a clearance in its guide, by the numbers of Flores, Leine & Glocker (Multibody Syst Dyn 23, 2010).

They let hard corners strike by Newton's law, with Moreau's time-stepping, as is done here.
"""

from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from tests.contact.test_rigid_contacts import scene

CRANK, ROD, HALF_LENGTH, HALF_HEIGHT, CLEARANCE = 0.153, 0.306, 0.05, 0.025, 0.001  # [m]
MASSES, INERTIAS = (0.038, 0.038, 0.076), (7.4e-5, 5.9e-4, 2.7e-6)  # of crank, rod and slider [kg], [kg m²]
RATES, GRAVITY = (150.0, -75.0, 0.0), 9.81  # at the start, where all is in line [rad/s]; [m/s²]
RESTITUTION, FRICTION = 0.4, 0.01


def linkage(duration: float) -> Pipeline:
    """Corners of 1 mm and ten times as stiff as steel are nearly hard."""
    block = {"type": "box", "size": [2 * HALF_LENGTH, 2 * HALF_HEIGHT, 0.02], "rounding": 1e-3, "E": 2.07e12, "nu": 0.3}
    lengths, names, z = (CRANK, ROD, 0.0), ("crank", "rod", "slider"), {"type": "revolute", "axis": [0, 0, 1]}
    body: dict[str, dict[str, Any]] = {
        name: {"shape": "rigid", "mass": mass, "centre": [length / 2, 0, 0], "inertia": [inertia] * 3}
        | {"marker": {"begin": {"at": [0, 0, 0]}, "end": {"at": [length, 0, 0]}}}
        for name, mass, inertia, length in zip(names, MASSES, INERTIAS, lengths, strict=True)
    }
    body["slider"]["surface"] = {"block": block}
    joint = {
        child: z | {"parent": parent, "child": f"{child}.begin", "rate": rate}
        for child, parent, rate in zip(
            names, ("ground", "crank.end", "rod.end"), np.diff(RATES, prepend=0), strict=True
        )
    }
    law = {"restitution": RESTITUTION, "friction": FRICTION}
    contact = {
        name: {"between": [f"ground.{name}", "slider.block"], "normal": [0, up, 0], **law}
        for name, up in (("low", 1), ("high", -1))
    }
    own = scene(body, joint, contact, duration, gravity=[0, -GRAVITY, 0], tip="slider.begin")
    height = HALF_HEIGHT + CLEARANCE
    return Pipeline(load_scene(own | {"ground": {"low": {"at": [0, -height, 0]}, "high": {"at": [0, height, 0]}}}))


def by_time_stepping(times: Array, step: float) -> Array:
    """Return the angles of the three bodies, (n_times, 3): impulses by sweeps over corners in each step."""
    corners = [(x, up) for up in (1, -1) for x in (HALF_LENGTH, -HALF_LENGTH)]
    (m1, m2, m3), lever = MASSES, (MASSES[1] / 2 + MASSES[2]) * CRANK * ROD
    q, u, found = np.zeros(3), np.array(RATES), [np.zeros(3)]
    for _ in range(round(times[-1] / step)):
        middle = q + 0.5 * step * u
        s, c = np.sin(middle), np.cos(middle)
        off = lever * np.cos(middle[1] - middle[0])
        M = np.diag([INERTIAS[0] + (m1 / 4 + m2 + m3) * CRANK**2, INERTIAS[1] + (m2 / 4 + m3) * ROD**2, INERTIAS[2]])
        M[0, 1] = M[1, 0] = off
        turn = lever * np.sin(middle[1] - middle[0])
        h = [turn * u[1] ** 2 - (m1 / 2 + m2 + m3) * GRAVITY * CRANK * c[0]]
        h += [-turn * u[0] ** 2 - (m2 / 2 + m3) * GRAVITY * ROD * c[1], 0.0]
        inverse, before = np.linalg.inv(M), u
        u = u + step * inverse @ np.array(h)
        pushes = []
        for x, up in corners:
            place = CRANK * s[0] + ROD * s[1] + x * s[2] + up * HALF_HEIGHT * c[2]
            if up * place >= HALF_HEIGHT + CLEARANCE:
                w = -up * np.array([CRANK * c[0], ROD * c[1], x * c[2] - up * HALF_HEIGHT * s[2]])
                pushes.append((w, np.array([-CRANK * s[0], -ROD * s[1], -x * s[2] - up * HALF_HEIGHT * c[2]])))
        normal, across = np.zeros(len(pushes)), np.zeros(len(pushes))
        for _ in range(200 if pushes else 0):
            for k, (w, along) in enumerate(pushes):
                more = max(-normal[k], -(w @ u + RESTITUTION * (w @ before)) / (w @ inverse @ w))
                normal[k], u = normal[k] + more, u + more * inverse @ w
                wanted = across[k] - along @ u / (along @ inverse @ along)
                held = float(np.clip(wanted, -FRICTION * normal[k], FRICTION * normal[k]))
                across[k], u = held, u + (held - across[k]) * inverse @ along
        q = middle + 0.5 * step * u
        found.append(q)
    grid = step * np.arange(len(found))
    return np.stack([np.interp(times, grid, own) for own in np.array(found).T], axis=1)


@pytest.mark.long
def test_a_slider_in_a_wider_guide_moves_as_by_time_stepping_of_hard_corners() -> None:
    """Shocks at 2.69 ms, of two corners at once, and about 5.61 ms, of one after the other."""
    motion = linkage(6e-3).motion
    own, exact = np.cumsum(motion.trajectory.q[:, :3], axis=1), by_time_stepping(motion.times, 2e-6)
    heights = [CRANK * np.sin(q[:, 0]) + ROD * np.sin(q[:, 1]) for q in (own, exact)]
    off = np.maximum(np.abs(heights[0] - heights[1]), HALF_LENGTH * np.abs(own[:, 2] - exact[:, 2])) / CLEARANCE
    assert heights[1].max() > 0.96 * CLEARANCE
    assert off[motion.times < 5.5e-3].max() < 0.02
    assert off.max() < 0.06
