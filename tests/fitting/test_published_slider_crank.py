"""A published slider-crank with a spring and a damper: derivatives of its kinetic energy, by tangents and the adjoint.

From the examples of IDAS, the solver of SUNDIALS with sensitivities (Hindmarsh et al., ACM Trans Math Softw 31, 2005):
github.com/LLNL/sundials, examples/idas/serial/idasSlCrank_FSA_dns, by Serban and Petra, BSD 3-Clause. The second source
are the equations of motion for the crank's angle alone, derived here, whose derivatives are those by complex steps.
"""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import simpson, solve_ivp

import fmd as package
from fmd.core.arrays import Array
from fmd.fitting import result_function

KEYS = ["spring.link.stiffness", "spring.link.damper"]
PUBLISHED = (3.3366158, 3.3345e-1, -3.6375e-1)  # the energy's integral over time, and its derivatives by both
CRANK, TIMES = 0.5, np.linspace(0.0, 10.0, 401)  # [m], [s]
TURN = {"type": "revolute", "axis": [0, 0, 1]}
# The rod is 1 m long, and its centre of mass is the slider, which has a part of its mass here.
SCENE: dict[str, Any] = {
    "title": "Slider-crank of IDAS",
    "body": {
        "crank": {
            "shape": "rigid",
            "mass": 1.0,
            "centre": [0.0, 0.0, 0.0],
            "inertia": [1.0, 1.0, 1.0],
            "marker": {"hub": {"at": [0, 0, 0]}, "middle": {"at": [0.25, 0, 0]}, "pin": {"at": [CRANK, 0, 0]}},
        },
        "rod": {
            "shape": "rigid",
            "mass": 0.4,
            "centre": [0.0, 0.0, 0.0],
            "inertia": [2.0, 2.0, 2.0],
            "marker": {
                "pin": {"at": [-1, 0, 0]},
                "middle": {"at": [-0.5, 0, 0]},
                "slider": {"at": [0, 0, 0]},
                "pushed": {"at": [1, 0, 0]},
            },
        },
        "slider": {"shape": "point", "mass": 0.6, "marker": {"pin": {"at": [0, 0, 0]}}},
    },
    "joint": {
        "hub": {**TURN, "parent": "ground", "child": "crank.hub", "angle": "90 deg"},
        "pin": {**TURN, "parent": "crank.pin", "child": "rod.pin", "angle": "-120 deg"},
        "guide": {
            "type": "prismatic",
            "parent": "ground",
            "child": "slider.pin",
            "axis": [1, 0, 0],
            "position": np.sqrt(0.75),
        },
        "close": {**TURN, "parent": "rod.slider", "child": "slider.pin"},
    },
    "spring": {
        "link": {"between": ["crank.middle", "rod.middle"], "stiffness": 1.0, "damper": 1.0, "length": 1.0},
    },
    "drive": {"push": {"type": "point force", "marker": "rod.pushed", "direction": [1, 0, 0], "force": 1.0}},
    "simulation": {
        "duration": 10.0,
        "output_step": TIMES[1],
        "tip": "slider.pin",
        "run": [{"integrator": "runge-kutta", "tolerance": 1e-9}],
    },
}


def kinetic_energies(stiffness: Array, damper: Array) -> Array:
    """Return kinetic energies [J] at `TIMES`, (n, 401), from the equation of motion for the crank's angle q alone.

    With the slider at x and the rod at p from the line of the guide, ``sin p = −a sin q`` and ``x = cos p + a cos q``;
    the spring is x/2 long, and the force moves by ``x + cos p``.
    """

    def shape(q: Array) -> tuple[Array, Array, Array, Array]:
        """Return x and its slope over q, the slope of p, and of the kinetic energy's ``½ m q̇²`` the mass."""
        s, c = CRANK * np.sin(q), CRANK * np.cos(q)
        by_angle = -c / np.sqrt(1.0 - s * s)
        slide = s * (by_angle - 1.0)
        return np.sqrt(1.0 - s * s) + c, slide, by_angle, 1.0 + slide**2 + 2.0 * by_angle**2

    def rates(_: float, state: Array) -> Array:
        q, v = state.reshape(2, -1)
        x, slide, by_angle, mass = shape(q)
        s, c = CRANK * np.sin(q), CRANK * np.cos(q)
        bend = s * (1.0 - by_angle**2) / np.sqrt(1.0 - s * s)  # second derivative of p
        growth = slide * (c * (by_angle - 1.0) + s * bend) + 2.0 * by_angle * bend  # half the mass's slope
        pull = stiffness * (0.5 * x - 1.0) + damper * 0.5 * slide * v
        return np.append(v, (slide + s * by_angle - 0.5 * slide * pull - growth * v * v) / mass)

    start = np.append(0.5 * np.pi + 0.0 * stiffness, 0.0 * stiffness)
    states = solve_ivp(rates, (0.0, 10.0), start, "DOP853", TIMES, rtol=1e-11, atol=1e-12).y
    q, v = states.reshape(2, -1, len(TIMES))
    return np.asarray(0.5 * shape(q)[-1] * v * v)


def test_derivatives_of_a_published_slider_crank_are_those_of_its_equation_and_of_the_publication(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of the kinetic energy's integral over 10 s, published to five digits at a tolerance of 1e-6."""
    result = package.load(SCENE)
    found = package.jacobian(result, ["kinetic_energy"], KEYS)
    own = kinetic_energies(np.array([1.0 + 1e-30j, 1.0]), np.array([1.0, 1.0 + 1e-30j]))
    np.testing.assert_allclose(found[0].value, own[0].real, rtol=0, atol=1e-8)
    assert simpson(found[0].value, x=TIMES) == pytest.approx(PUBLISHED[0], rel=1e-5)
    monkeypatch.setattr(result_function, "FEWEST_BY_ADJOINT", 1)
    function = package.ResultFunction(result, ["kinetic_energy"], KEYS)
    by_adjoint = function.vjp(function.start, simpson(np.eye(len(TIMES)), x=TIMES))
    assert not function.lacking
    for each, expected, total, published in zip(found, own, by_adjoint, PUBLISHED[1:], strict=True):
        assert each.by_tangents
        np.testing.assert_allclose(each.slope, expected.imag / 1e-30, rtol=0, atol=1e-9)
        assert simpson(each.slope, x=TIMES) == pytest.approx(published, abs=1e-5)
        assert total == pytest.approx(simpson(each.slope, x=TIMES), rel=1e-7)
