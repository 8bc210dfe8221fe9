"""Random force elements on random mechanisms, and what they do by virtual power: plain NumPy that shares no code."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from fmd.core.arrays import Array
from fmd.core.formula import parse_formula
from fmd.dynamics.elements import Attachment, Element, PointSpring, SixAxisSpring
from fmd.dynamics.force_laws import ForceCurve, ForceLaw, Stop, smooth_curve, straight_curve
from fmd.reduction.body import MarkerShapes
from tests.dynamics.compiler import kane
from tests.dynamics.compiler.mechanisms import PointMechanism, random_mechanism

KNOTS, FORCES = [-1.0, 0.2, 0.9, 2.0], [-3.0, 0.5, 1.0, 4.0]
FORMULA = (
    "3*t + 2*t**3 + tanh(t) + exp(-t*t) + sqrt(4 + t*t) - abs(t) + max(t, 0.3) + (t if t < 0.4 else 0.4)"
    " + min(sin(t), 0.5) + log(3 + t)/cos(0.1*t)"
)


def straight(x: float) -> float:
    """Straight lines through the knots, which go on beyond the ends."""
    k = int(np.clip(np.searchsorted(KNOTS, x) - 1, 0, 2))
    return FORCES[k] + (x - KNOTS[k]) * (FORCES[k + 1] - FORCES[k]) / (KNOTS[k + 1] - KNOTS[k])


def natural(x: float) -> float:
    """Natural cubic spline by its second derivatives, straight beyond the ends."""
    h, y = np.diff(KNOTS), np.array(FORCES)
    A = np.array([[2 * (h[0] + h[1]), h[1]], [h[1], 2 * (h[1] + h[2])]])
    M = np.r_[0.0, np.linalg.solve(A, 6 * np.diff(np.diff(y) / h)), 0.0]
    inside = min(max(x, KNOTS[0]), KNOTS[-1])
    k = int(np.clip(np.searchsorted(KNOTS, inside) - 1, 0, 2))
    a, b = KNOTS[k + 1] - inside, inside - KNOTS[k]
    value = (M[k] * a**3 + M[k + 1] * b**3) / (6 * h[k])
    value += (y[k] / h[k] - M[k] * h[k] / 6) * a + (y[k + 1] / h[k] - M[k + 1] * h[k] / 6) * b
    slope = (M[k + 1] * b**2 - M[k] * a**2) / (2 * h[k]) + (y[k + 1] - y[k]) / h[k] - (M[k + 1] - M[k]) * h[k] / 6
    return float(value + slope * (x - inside))


def by_formula(x: float) -> float:
    """Value of the formula."""
    smooth = 3 * x + 2 * x**3 + np.tanh(x) + np.exp(-x * x) + np.sqrt(4 + x * x) + np.log(3 + x) / np.cos(0.1 * x)
    return float(smooth - abs(x) + max(x, 0.3) + min(x, 0.4) + min(np.sin(x), 0.5))


CURVES: dict[str, tuple[ForceCurve, Callable[[float], float]]] = {
    "linear": (ForceCurve((0.0, 4.0)), lambda x: 4.0 * x),
    "straight": (straight_curve(KNOTS, FORCES), straight),
    "smooth": (smooth_curve(KNOTS, FORCES), natural),
    "formula": (ForceCurve(formula=parse_formula(FORMULA), factor=1.5), lambda x: 1.5 * by_formula(x)),
}


def law_force(name: str, law: ForceLaw, x: float, rate: float) -> float:
    """Force of a law in words of its own: the slope of a stop's force grows evenly over its width."""
    force = CURVES[name][1](x) + law.damping * rate + law.friction * rate / np.hypot(rate, law.friction_rate)
    for stop in law.stops:
        p = stop.side * (x - stop.at)
        share = min(max(p / stop.width, 0.0), 1.0)
        pushed = 0.5 * share * min(p, stop.width) + max(p - stop.width, 0.0)
        force += stop.side * stop.stiffness * pushed + stop.damping * share * rate
    return float(force)


@cache
def with_elements(seed: int, second_order: bool = False) -> tuple[PointMechanism, list[str]]:
    """Make a random mechanism with a spring of each kind and two bushings between its bodies and the ground."""
    made, rng = random_mechanism(seed, second_order), np.random.default_rng([seed, 11])
    elements: list[Element] = []
    for name, (curve, _) in CURVES.items():
        stops = (Stop(0.3, 1.0, 20.0, 0.5, 0.2), Stop(0.1, -1.0, 30.0, 0.7, 0.3))
        law = ForceLaw(curve, rng.uniform(0.1, 0.4), stops, 0.6, 0.5)
        elements.append(PointSpring(name, _ends(made, rng), law, rest=rng.uniform(0.5, 1.5)))
    for full in (True, False):
        K, C = (A @ A.T for A in rng.normal(size=(2, 6, 6)))
        if not full:
            K, C = np.diag([3.0, 2.0, 1.0, 0, 0, 0]), np.diag([0.3, 0.2, 0.1, 0, 0, 0])
        elements.append(SixAxisSpring(f"bushing {full}", _ends(made, rng), K, 0.1 * C, rng.normal(size=3)))
    return replace(made, mechanism=replace(made.mechanism, elements=elements)), list(CURVES)


def _ends(made: PointMechanism, rng: np.random.Generator) -> tuple[Attachment, Attachment]:
    links = made.mechanism.links
    numbers = rng.integers(-1, len(links), size=2)
    if (numbers < 0).all():
        numbers[1] = len(links) - 1
    first, second = (
        _attachment(links[k].name if k >= 0 else "", len(links[k].omega) if k >= 0 else 0, rng) for k in numbers
    )
    return first, second


def _attachment(body: str, n: int, rng: np.random.Generator) -> Attachment:
    shapes, turns = 0.3 * rng.normal(size=(2, 3, n))
    displacement2 = 0.2 * rng.normal(size=(6, n, n))
    axes = Rotation.from_rotvec(0.4 * rng.normal(size=3)).as_matrix()
    return Attachment(
        body, MarkerShapes(rng.normal(size=3), shapes, turns, displacement2 + displacement2.swapaxes(1, 2)), axes
    )


def strain(made: PointMechanism, element: Element, t: float, q: Array) -> Array:
    """Elongation of a spring, or displacement and rotation vector of a bushing, from products of matrices."""
    return _strain(made, element, kane.frames(made, t, q))


def _strain(made: PointMechanism, element: Element, bodies: Sequence[tuple[Array, Array, Array]]) -> Array:
    ends = [_pose(made, end, bodies) for end in element.ends]
    way = ends[1][0] - ends[0][0]
    if isinstance(element, PointSpring):
        return np.array([np.linalg.norm(way) - element.rest])
    turn = Rotation.from_matrix(ends[0][1].T @ ends[1][1]).as_rotvec()
    return np.concatenate([ends[0][1].T @ way - element.position, turn])


def _pose(made: PointMechanism, end: Attachment, bodies: Sequence[tuple[Array, Array, Array]]) -> tuple[Array, Array]:
    if not end.body:
        return end.marker.position, end.axes
    origin, R, z = bodies[made.mechanism.number_of(end.body)]
    bent, turned = kane.marker_motion(end.marker.translation, end.marker.rotation, end.marker.displacement2, z)
    return np.real(origin + R @ (end.marker.position + bent)), np.real(R @ kane.rotation(turned) @ end.axes)


def strains(made: PointMechanism, t: float, q: Array) -> Array:
    """Strains of all elements one after another."""
    bodies = kane.frames(made, t, q)
    return np.concatenate([_strain(made, element, bodies) for element in made.mechanism.elements])


def slopes(made: PointMechanism, t: float, q: Array, v: Array, flow: float) -> Array:
    """Rates of all strains for rates v, by differences of order 8; without prescribed motions for flow 0."""
    h = 1e-3
    return sum(
        side * weight / h * strains(made, t + flow * side * k * h, kane.advance(made, q, v, side * k * h))
        for k, weight in enumerate(kane.WEIGHTS, start=1)
        for side in (1, -1)
    )


def element_forces(made: PointMechanism, t: float, q: Array, v: Array) -> Array:
    """Generalised forces of all elements by virtual power."""
    found, rates, first = strains(made, t, q), slopes(made, t, q, v, 1.0), 0
    effort = np.zeros(len(found))
    for element in made.mechanism.elements:
        if isinstance(element, PointSpring):
            effort[first] = law_force(element.name, element.law, found[first], rates[first])
            first += 1
        else:
            six = slice(first, first + 6)
            effort[six] = element.K @ found[six] + element.C @ rates[six]
            first += 6
    return -np.array([effort @ slopes(made, t, q, unit, 0.0) for unit in np.eye(made.mechanism.n)])
