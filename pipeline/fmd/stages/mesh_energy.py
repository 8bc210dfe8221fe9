"""Elastic energy of two gears' teeth as a table: a sum of products of curves of the approach and of the place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from fmd.contact.gear_pair import ToothFlexibility, press_gears
from fmd.core.arrays import Array
from fmd.core.involute import GearPair
from fmd.core.limits import contact as limits
from fmd.dynamics.elements import MeshEnergy
from fmd.dynamics.state_functions import StateCurve


def tabulate_energy(pair: GearPair, flexibilities: Sequence[ToothFlexibility], width: float, load: float) -> MeshEnergy:
    """Tabulate the elastic energy of two gears' teeth by their approach and the place of a pair.

    Forces at the nodes are a sum of products, by singular values, up to ``OVERLOAD`` times the load along the line of
    action [N]. The factors are cubic splines of the place, and parabolas between nodes of the approach, so that the
    energy has pieces of cubics in both.
    """
    begin, pitch = pair.path[0], pair.pinion.base_pitch
    places = begin + np.arange(limits.PLACES_OF_PITCH) / limits.PLACES_OF_PITCH * pitch

    def press(approaches: Array, at: Array) -> Array:
        return press_gears(pair, flexibilities, width, approaches, at)

    reach = load / (width * limits.USUAL_MESH_STIFFNESS)
    for _ in range(2):  # forces rise a little faster than the approach
        reach *= (
            limits.OVERLOAD
            * load
            / float(press(np.array([0.0, reach]), places[:: limits.PLACES_OF_PITCH // 8])[1].min())
        )
    approaches = reach * np.linspace(0.0, 1.0, limits.APPROACHES + 1) ** 2
    forces = press(approaches, places)
    U, sizes, V = np.linalg.svd(forces, full_matrices=False)
    kept = range(int((sizes > limits.LEFT_OUT_FORCE * sizes[0]).sum()))
    yielded = np.array([np.interp(load, column, approaches) for column in forces.T])
    stiffest = float((np.diff(forces, axis=0) / np.diff(approaches)[:, None]).max())
    of_approach = tuple(_integrate(approaches, sizes[k] * U[:, k]) for k in kept)
    of_place = tuple(_repeat(places, V[k], pitch) for k in kept)
    between = 0.5 * (approaches[1:] + approaches[:-1])
    between = np.concatenate([[0.0], between[between < yielded.min()]])
    halfway = places[::4] + 0.5 * pitch / limits.PLACES_OF_PITCH
    table = sum(
        np.outer(a.slope.values(between), b.values(halfway)) for a, b in zip(of_approach, of_place, strict=True)
    )
    error = float(np.abs(press(between, halfway) - table).max()) / load
    return MeshEnergy(of_approach, of_place, stiffest, float((load / yielded).mean()), reach, error)


def _integrate(x: Array, y: Array) -> StateCurve:
    """Return the integral of parabolas through points, of which the first is 0 with no slope; straight beyond the last.

    Between points they have the area of a cubic spline.
    """
    h, spline = np.diff(x), CubicSpline(x, y)
    areas = np.diff(spline.antiderivative()(x))
    areas[0] = y[1] * h[0] / 3.0
    values = np.concatenate([[0.0], np.cumsum(areas)])
    start = np.concatenate([[0.0], y[1:-1]])
    mean = areas / h
    square = (3.0 * mean - 2.0 * start - y[1:]) / h
    cubic = (start + y[1:] - 2.0 * mean) / h**2
    beyond = [values[-1], y[-1], 0.5 * float(spline(x[-1], 1)), 0.0]
    return _curve(x, np.vstack([np.stack([values[:-1], start, square, cubic], axis=1), beyond]))


def _repeat(x: Array, y: Array, period: float) -> StateCurve:
    """Return the cubic spline through points that repeats."""
    spline = CubicSpline([*x, x[0] + period], [*y, y[0]], bc_type="periodic")
    return _curve(x, spline.c[::-1].T, period)


def _curve(knots: Array, cubics: Array, period: float = 0.0) -> StateCurve:
    a, b, c, d = cubics.T.tolist()
    return StateCurve(tuple(knots.tolist()), tuple(zip(a, b, c, d, strict=True)), period)
