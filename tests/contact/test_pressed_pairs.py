"""Pressures between blocks at rest on meshes that match or not, and a stiff block in the place of a plane."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import root

from fmd import Pipeline, load_scene
from fmd.contact.tables import ContactTable
from fmd.core.arrays import Array
from fmd.integrators.protocol import evaluate, move_positions

FORCE, AREA = 1000.0, 0.0016
SIMULATION = {
    "duration": "1 ms",
    "output_step": "0.1 ms",
    "step": "auto",
    "gravity": ["0 m/s^2"] * 3,
    "run": [{"integrator": "central-difference"}],
}


def pressed_blocks(first: list[int], second: list[int]) -> tuple[ContactTable, float]:
    """Two blocks end to end, the second on a slide with a force on it; the contact at rest, and the slide's position.

    Without Poisson's ratio the pressure is the same everywhere.
    """
    block = {"shape": "bar", "E": "70 GPa", "nu": 0.0, "rho": "2700 kg/m^3", "length": "100 mm"}
    block |= {"depth": "40 mm", "width": "40 mm", "modes": {"count": 1, "family": "axial", "enrich": "none"}}
    block |= {"marker": {"left": {"face": "x-"}, "right": {"face": "x+"}}}
    slide = {"type": "prismatic", "axis": [1, 0, 0], "parent": "ground.end"}
    scene = {
        "title": "Blocks",
        "ground": {"end": {"at": ["100 mm", "0 mm", "0 mm"]}},
        "body": {
            name: block | {"mesh": {"divisions": own, "order": 1}} for name, own in {"a": first, "b": second}.items()
        },
        "joint": {
            "held": {"type": "fixed", "parent": "ground", "child": "a.left"},
            "slide": slide | {"child": "b.left"},
        },
        "contact": {"hit": {"between": ["a.right", "b.left"]}},
        "simulation": SIMULATION | {"tip": "b.right"},
    }
    run = Pipeline(load_scene(scene))
    p, n, M = run.system.parameters, run.mechanism.n, run.system.mass_matrix(run.mechanism.rest_positions)
    (way,) = {*range(n)} - {*run.mechanism.modes_of(0)} - {*run.mechanism.modes_of(1)}

    def residual(x: Array) -> Array:
        a = np.zeros(n)
        evaluate(p, 0.0, 1e-6 * x, np.zeros(n), a)
        return (M @ a) / FORCE - np.eye(n)[way]

    found = root(residual, -0.1 * np.eye(n)[way], tol=1e-12)
    assert np.abs(found.fun).max() < 1e-9
    return p.contact, 1e-6 * found.x[way]


def pressures(contact: ContactTable) -> Array:
    """Pressures of the points, as parts of the exact one."""
    counted = contact.areas > 0.0
    return contact.force[counted, 0] / contact.areas[counted] / (FORCE / AREA)


def test_the_pressure_between_matching_meshes_is_exact() -> None:
    contact, _ = pressed_blocks([3, 3, 3], [3, 3, 3])
    assert pressures(contact) == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("second", [[3, 4, 4], [3, 5, 3]])
def test_the_pressure_between_other_meshes_is_that_of_points_on_triangles(second: list[int]) -> None:
    """The resultant and the approach are right; single points at corners have two thirds of the pressure."""
    _, exact = pressed_blocks([3, 3, 3], [3, 3, 3])
    contact, slide = pressed_blocks([3, 3, 3], second)
    found = pressures(contact)
    areas = contact.areas[contact.areas > 0.0]
    assert contact.force[:, 0].sum() == pytest.approx(FORCE, rel=1e-6)
    assert slide == pytest.approx(exact, rel=5e-3)
    assert np.sqrt(np.average((found - 1.0) ** 2, weights=areas)) < 0.12
    assert found.min() > 0.5
    assert found.max() < 1.15


def test_a_stiff_block_in_the_place_of_a_plane_has_its_forces() -> None:
    block: dict[str, Any] = {"shape": "bar", "length": "200 mm", "depth": "100 mm", "width": "60 mm", "E": "70 GPa"}
    block |= {
        "nu": 0.3,
        "rho": "2700 kg/m^3",
        "mesh": {"divisions": [4, 3, 2], "order": 1},
        "modes": {"count": 4, "enrich": "none"},
    }
    block |= {"marker": {"middle": {"at": ["100 mm", "0 mm", "0 mm"]}, "bottom": {"face": "y-"}}}
    anvil = block | {"length": "400 mm", "width": "200 mm", "E": "7e7 GPa", "modes": {"count": 1, "enrich": "none"}}
    anvil |= {"marker": {"end": {"face": "x-"}, "top": {"face": "y+"}}}
    free = {"type": "free", "parent": "ground", "child": "block.middle"}
    plane = {
        "title": "Block",
        "body": {"block": block},
        "joint": {"free": free | {"position": ["0 m", "60 mm", "0 m"]}},
        "contact": {"floor": {"between": ["ground", "block.bottom"], "normal": [0, 1, 0], "friction": 0.3}},
        "simulation": SIMULATION | {"tip": "block.middle"},
    }
    held = {"type": "fixed", "parent": "ground.under", "child": "anvil.end"}
    pair = plane | {
        "ground": {"under": {"at": ["-205 mm", "-50 mm", "0 mm"]}},
        "body": {"block": block, "anvil": anvil},
        "joint": plane["joint"] | {"hold": held},
        "contact": {"floor": {"between": ["anvil.top", "block.bottom"], "friction": 0.3}},
    }
    runs = [Pipeline(load_scene(scene)) for scene in (plane, pair)]
    rng, n = np.random.default_rng(5), runs[0].mechanism.n
    for _ in range(5):
        turn = rng.standard_normal(n) * np.r_[0, 0, 0, 2e-4, 0.1, 2e-4, [1e-6] * 4]
        pushes, depth = [], 0.0
        for run in runs:
            p, state = run.system.parameters, run.start[0].copy()
            change = np.zeros(run.mechanism.n)
            change[:n] = turn
            q = move_positions(p, state, change)
            for sunk in (0.0, None):
                q[1] -= depth if sunk is None else sunk
                evaluate(p, 0.0, q, np.zeros(change.size), np.zeros(change.size))
                if sunk == 0.0 and not depth:
                    depth = p.contact.free[p.contact.seen[:, 0] == 1, 0].min() + 1e-6
            pushes.append(p.contact.push[0].copy())
        assert pushes[0][1] > 0.0
        np.testing.assert_allclose(pushes[1], pushes[0], atol=2e-3 * np.abs(pushes[0]).max())
