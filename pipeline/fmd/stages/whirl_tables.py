"""Vibrations of a rotor whose bearings follow the frequency of its whirl.

The models of the Campbell diagram are affine in the coefficients: a bearing of stiffness k and damping c at the point y
adds ``-B (k C + c (C A + Ω J C))`` to the state matrix A of the turning axes, B of forces on the point, C of its
displacement across the axis, ``J = [[0, -1], [1, 0]]``. The
coefficients of a vibration are those at its own frequency.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.limits.responses import WHIRLS_BETWEEN
from fmd.core.limits.round_off import EXACT
from fmd.reduction.rotating import WhirlingModes
from fmd.responses.interpolated_models import Matrices, interpolate_models, matrices_of, with_inputs_seen
from fmd.responses.whirl_search import WhirlSearch
from fmd.scene.force_elements import BearingTable
from fmd.scene.variants import change_bearings
from fmd.stages.force_elements import bearing_curves
from fmd.stages.state_functions import make_curve
from fmd.stages.turning import TurningRotor

if TYPE_CHECKING:
    from fmd.dynamics.state_functions import StateCurve
    from fmd.scene.scene import Scene
    from fmd.stages.pipeline import Pipeline

_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


def synchronous(run: Pipeline, order: float) -> Pipeline:
    """Return the stages of a scene that whirls at so many times its rate: tables over whirl become ones over speed."""

    def over_speed(table: BearingTable) -> BearingTable | float:
        arguments, values = table.rows
        if not order:
            return _value_at_rest(table)
        speeds = tuple(x / abs(order) for x in arguments)
        given = {"over": "speed", "arguments": speeds, "argument_unit": "rad/s", "values": tuple(values)}
        return table.model_copy(update={**given, "unit": None})

    return _with_tables(run, over_speed)


def without_whirl_tables(run: Pipeline) -> Pipeline:
    """Return the stages of a scene whose tables over whirl are constant, with what they have at frequency 0."""
    return _with_tables(run, _value_at_rest)


def _with_tables(run: Pipeline, change: Callable[[BearingTable], BearingTable | float]) -> Pipeline:
    scene = change_bearings(run.scene, change)
    return run if scene is run.scene else run.variant(scene, run.store.monitor)


def _value_at_rest(table: BearingTable) -> float:
    return float(make_curve(table).values(np.zeros(1))[0])


def warn_of_last_rows(scene: Scene, highest: float, order: float = 0.0) -> tuple[dict[str, str], ...]:
    """Return a warning for each table that ends below the highest rate [rad/s], or so many times it if over whirl."""
    reached = {"speed": highest, "whirl": abs(order) * highest}
    ends = [
        (f"bearing.{name}.{key}", table.rows[0][-1], table.over)
        for name, bearing in scene.bearing.items()
        for key, table in bearing.tables.items()
    ]
    said = "{} ends at {:.5g} rpm of {}: beyond, its last value holds"
    rpm = 2 * np.pi / 60
    return tuple(
        {"code": "end-of-table", "text": said.format(key, end / rpm, over)}
        for key, end, over in ends
        if end < reached[over] * (1 - EXACT)
    )


def find_vibrations_by_whirl(run: Pipeline, highest: float | None) -> Callable[[float], WhirlingModes]:
    """Return the vibrations of a rotor in bearings as a function of its rate of rotation [rad/s].

    Raises
    ------
    InputError
        A bearing with such a table doesn't hold a marker on the ground; or as `TurningRotor`.
    """
    places, curves = _read_bearings(run.scene)

    rotor = TurningRotor(without_whirl_tables(run), in_bearings=True)
    n, forced = len(rotor.markers), rotor.forced(*places)
    seen = [[rotor.markers.index(place), n + rotor.markers.index(place)] for place in places]

    def model(rate: float) -> Matrices:
        return matrices_of(lambda rate: with_inputs_seen(forced(rate)), rate)

    interpolated = None
    if highest is not None:
        interpolated = interpolate_models(lambda rate: with_inputs_seen(forced(rate)), 0.0, highest, rotor.bends)
    knots = np.unique([0.0, *(knot for pair in curves for curve in pair for knot in curve.knots)])
    grid = np.interp(np.arange(0, len(knots) - 1 + 1e-9, 1 / WHIRLS_BETWEEN), range(len(knots)), knots)

    def vibrations(rate: float) -> WhirlingModes:
        A, both = (interpolated or model)(rate)
        C, B = both[: 6 * n], both[6 * n :].T
        terms = [
            (B[:, 2 * k : 2 * k + 2] @ C[rows], B[:, 2 * k : 2 * k + 2] @ (C[rows] @ A + rate * _TURN @ C[rows]))
            for k, rows in enumerate(seen)
        ]

        def matrix(omega: float) -> Array:
            changed = A.copy()
            for pair, by in zip(curves, terms, strict=True):
                for curve, term in zip(pair, by, strict=True):
                    now, rest = curve.values(np.array([omega, 0.0]))
                    changed -= (now - rest) * term
            return changed

        return WhirlSearch(matrix, rotor.view(C, rate), grid).find()

    return vibrations


def _read_bearings(scene: Scene) -> tuple[list[str], list[tuple[StateCurve, StateCurve]]]:
    """Return the markers that bearings with tables over whirl hold, and stiffness and damping of each."""
    places, curves = [], []
    for name, bearing in scene.bearing.items():
        if bearing.whirl_tables:
            housing, shaft = bearing.between
            if housing.partition(".")[0] != "ground" or shaft.partition(".")[0] == "ground":
                mend = "with a table over whirl, has to be a place on the ground and a marker of the shaft"
                raise InputError(scene.file, f"bearing.{name}.between", list(bearing.between), mend)
            places.append(shaft)
            given = bearing_curves(bearing)
            curves.append((given["radial"], given["radial_damper"]))
            for key in bearing.tables.keys() - bearing.whirl_tables.keys():
                mend = "is over speed beside one over whirl; give both over the same"
                raise InputError(scene.file, f"bearing.{name}.{key}.over", "speed", mend)
    return places, curves
