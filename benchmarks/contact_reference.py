"""A model of rigid balls and boxes that strike, which shares nothing with the product but the laws it states.

Hertz's force of each corner's or ball's sphere with the loss of Hunt & Crossley, Coulomb's friction over Mindlin's
spring, which keeps its force as it gets stiffer; steps of semi-implicit Euler. What it doesn't know itself is what
twice the step changes, and the place within the depth where both spheres are pressed flat.
"""

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from contact_scenes import GRAVITY, NU, ContactCase, rotation
from scipy.optimize import brentq

STEPS = 3000
COMPARED = ("impulse_n_s", "largest_force_n", "friction_work_j", "damping_work_j")


@dataclass
class _Body:
    mass: float
    inertia: np.ndarray
    x: np.ndarray
    R: np.ndarray
    v: np.ndarray
    w: np.ndarray
    centres: np.ndarray  # of spheres, in its axes
    radius: float
    E: float

    def move(self, h: float, force: np.ndarray, moment: np.ndarray) -> None:
        self.v = self.v + h * (force / self.mass + np.array(GRAVITY))
        turned = self.R @ np.diag(self.inertia) @ self.R.T
        self.w = self.w + h * np.linalg.solve(turned, moment - np.cross(self.w, turned @ self.w))
        self.x, self.R = self.x + h * self.v, rotation(h * self.w) @ self.R


def is_known(case: ContactCase) -> bool:
    """Return true if the model has a case's surfaces: balls, or a box on the ground."""
    return case.kind in ("ball", "balls", "box")


def exact_figures(case: ContactCase) -> dict[str, tuple[Any, float]]:
    """Return a case's figures and how far off they are themselves at most."""
    fine, *others = _march(case, 2 * STEPS, 0.0), _march(case, STEPS, 0.0), _march(case, STEPS, 1.0)
    off = {key: sum(float(np.linalg.norm(np.subtract(fine[key], own[key]))) for own in others) for key in COMPARED}
    return {key: (fine[key], off[key]) for key in COMPARED}


def _bodies(scene: dict[str, Any]) -> list[_Body]:
    found = []
    for joint in scene["joint"].values():
        table = scene["body"][joint["child"].partition(".")[0]]
        skin = table["surface"]["skin"]
        radius, centres = skin.get("radius", 0.0), np.zeros((1, 3))
        if skin["type"] == "box":
            radius = 0.05 * min(skin["size"])
            centres = np.array(list(product(*([-0.5 * a + radius, 0.5 * a - radius] for a in skin["size"]))))
        v, w = np.array(joint["velocity"], dtype=float), np.array(joint.get("spin", [0, 0, 0]), dtype=float)
        R, inertia = rotation(joint.get("rotate", [0, 0, 0])), np.array(table["inertia"])
        x = np.array(joint["position"], dtype=float)
        found.append(_Body(table["mass"], inertia, x, R, v, R @ w, centres, radius, skin["E"]))
    return found


def _loss(e: float) -> float:
    def fault(c: float) -> float:
        return float(c * (1 + e) - np.log((1 + c) / (1 - c * e)))

    return 0.0 if e == 1.0 else float(brentq(fault, 0.5 * (1 - e), 1 / e - 1e-12))  # 0 is a root, too


def _march(case: ContactCase, steps: int, share: float) -> dict[str, Any]:
    """March with forces on the surface of the first sphere, or a share of the depth away from there."""
    bodies, law = _bodies(case.scene), case.scene["contact"]["touch"]
    one, other = bodies[0], bodies[1] if len(bodies) > 1 else None
    h, mu, c = case.scene["simulation"]["duration"] / steps, law["friction"], _loss(law.get("restitution", 1.0))
    soft = sum((1 - NU**2) / own.E for own in bodies)
    softer = sum((2 - NU) * 2 * (1 + NU) / own.E for own in bodies) / (6 * soft)  # Mindlin over Hertz's secant
    curved = 1 / one.radius + (1 / other.radius if other else 0.0)
    stiff = 4 / 3 / soft / np.sqrt(curved)
    dent, k_then, speed = np.zeros((len(one.centres), 3)), np.zeros(len(one.centres)), np.zeros(len(one.centres))
    impulse, most, friction, damped = np.zeros(3), 0.0, 0.0, 0.0
    for _ in range(steps):
        total, moments = np.zeros(3), [np.zeros(3), np.zeros(3)]
        arms = one.centres @ one.R.T
        if other:
            apart = one.x + arms - other.x
            distances = np.linalg.norm(apart, axis=1)
            normals, gaps = apart / distances[:, None], distances - one.radius - other.radius
        else:
            normals, gaps = np.tile([0.0, 1.0, 0.0], (len(arms), 1)), one.x[1] + arms[:, 1] - one.radius
        dent[gaps >= 0], k_then[gaps >= 0], speed[gaps >= 0] = 0, 0, 0
        for i in np.flatnonzero(gaps < 0):
            arm, gap, n = arms[i], float(gaps[i]), normals[i]
            at = one.x + arm - (one.radius + share * gap) * n
            v = one.v + np.cross(one.w, at - one.x)
            if other:
                v = v - other.v - np.cross(other.w, at - other.x)
            rate, slip = -float(v @ n), v - (v @ n) * n
            speed[i] = max(speed[i], rate, 1e-300)
            elastic = stiff * (-gap) ** 1.5
            drag = elastic * max(-1.0, c * rate / speed[i])
            normal, k = elastic + drag, elastic / (-gap * softer)
            before = k_then[i] * dent[i] @ dent[i] / 2
            if k > k_then[i]:
                dent[i] *= k_then[i] / k
            k_then[i] = k
            dent[i] = dent[i] - (dent[i] @ n) * n + h * slip
            pull = k * dent[i]
            if np.linalg.norm(pull) > mu * normal:
                dent[i] *= mu * normal / np.linalg.norm(pull)
                pull = k * dent[i]
            friction += h * float(pull @ slip) - (k * dent[i] @ dent[i] / 2 - before)
            damped += h * drag * rate
            force = normal * n - pull
            total += force
            moments[0] += np.cross(at - one.x, force)
            if other:
                moments[1] -= np.cross(at - other.x, force)
        impulse, most = impulse + h * total, max(most, float(np.linalg.norm(total)))
        one.move(h, total, moments[0])
        if other:
            other.move(h, -total, moments[1])
    if other:
        impulse = -impulse  # that on the second body, whose joint is the second
    return {"impulse_n_s": impulse, "largest_force_n": most, "friction_work_j": friction, "damping_work_j": damped}
