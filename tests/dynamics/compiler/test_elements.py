"""Force elements between places of random mechanisms: forces, energies and tangents against NumPy and differences."""

from dataclasses import replace

import numpy as np
import pytest

from fmd.core.formula import parse_formula
from fmd.dynamics.compiler.compiled import compile_mechanism
from fmd.dynamics.elements import Attachment, SixAxisSpring
from fmd.dynamics.force_laws import ForceCurve, ForceLaw, Stop
from fmd.reduction.body import MarkerShapes
from tests.dynamics.compiler import kane
from tests.dynamics.compiler.comparison import TIME, difference, interpreted
from tests.dynamics.compiler.random_elements import element_forces, with_elements

SEEDS = range(2)
SMOOTH = ForceCurve(formula=parse_formula("3*t + 2*t**3 + tanh(t) + exp(-t*t) + tan(t/4) + 2**t"))


@pytest.mark.parametrize(("seed", "second_order"), [(0, False), (1, True)])
def test_elements_do_the_work_of_their_strains(seed: int, second_order: bool) -> None:
    made, _ = with_elements(seed, second_order)
    q, v = made.state(seed)
    M, Q = kane.mass_and_force(made, TIME, q, v)
    expected = np.linalg.solve(M, Q + element_forces(made, TIME, q, v))
    compiled = made.compiled
    a = interpreted(compiled, "accelerations", (made.mechanism.n,), q=q, v=v)
    assert difference(a, expected) < 1e-7
    assert difference(compiled.accelerations(TIME, q, v), a) < 1e-12
    residual = interpreted(compiled, "residual", (made.mechanism.n,), q=q, v=v, a=a)
    assert np.abs(residual).max() < 1e-9 * np.abs(M @ a).max()


@pytest.mark.parametrize("seed", range(2))
def test_elastic_forces_are_the_slopes_of_the_energy(seed: int) -> None:
    made, _ = with_elements(seed)
    links = [replace(link, motion=None, damper=0.0, damping=np.zeros(0)) for link in made.mechanism.links]
    lawful = [
        replace(element, law=replace(element.law, damping=0.0, friction=0.0, stops=_undamped(element.law.stops)))
        if not isinstance(element, SixAxisSpring)
        else replace(element, C=np.zeros((6, 6)))
        for element in made.mechanism.elements
    ]
    lawful[3] = replace(lawful[3], law=replace(lawful[3].law, curve=SMOOTH))  # a quadrature stumbles over kinks
    bare = replace(made.mechanism, links=links, elements=lawful, loads=())
    still = replace(bare, elements=())
    made = replace(made, mechanism=bare)
    q, _ = made.state(seed)
    with_, without = compile_mechanism(bare), compile_mechanism(still)
    rest = np.zeros(bare.n)
    zero = {"inputs": np.zeros(0), "q": q, "v": rest, "a": rest}
    forces = interpreted(without, "residual", (bare.n,), **zero) - interpreted(with_, "residual", (bare.n,), **zero)

    h, sides = 1e-4, [(side * k, side * weight) for k, weight in enumerate(kane.WEIGHTS, start=1) for side in (1, -1)]
    places = np.stack([kane.advance(made, q, unit, k * h) for unit in np.eye(bare.n) for k, _ in sides], axis=1)
    state = {"inputs": np.zeros(0), "q": places, "v": rest}
    energies = [interpreted(one, "energies", (2, places.shape[1]), **state)[1] for one in (with_, without)]
    slopes = np.subtract(*energies).reshape(bare.n, -1) @ [weight / h for _, weight in sides]
    assert forces == pytest.approx(-slopes, rel=1e-7, abs=1e-8 * (1 + np.abs(forces).max()))


def _undamped(stops: tuple[Stop, ...]) -> tuple[Stop, ...]:
    return tuple(replace(stop, damping=0.0) for stop in stops)


@pytest.mark.parametrize("seed", [0])
def test_tangents_with_elements_are_differences_of_the_residual(seed: int) -> None:
    made, _ = with_elements(seed)
    (q, v), n = made.state(seed), made.mechanism.n
    compiled, a = made.compiled, np.random.default_rng(seed).normal(size=n)
    inputs = compiled.signal_values(TIME)
    by_q, by_v, _ = compiled.tangents(inputs, q, v, a)

    h = 1e-6

    def slopes(which: str, at: np.ndarray) -> np.ndarray:
        moved = at[:, None] + h * np.hstack([np.eye(len(at)), -np.eye(len(at))])
        state = {"q": q, "v": v, "a": a} | {which: moved}
        ahead, behind = np.split(interpreted(compiled, "residual", (n, moved.shape[1]), **state), 2, axis=1)
        return (ahead - behind) / (2 * h)

    assert np.allclose(by_v, slopes("v", v), atol=1e-5)
    assert np.allclose(by_q, slopes("q", q), rtol=1e-5, atol=1e-4)


def test_what_is_no_element_is_refused() -> None:
    here = Attachment("", MarkerShapes(np.zeros(3), np.zeros((3, 0)), np.zeros((3, 0))))
    lopsided = np.eye(6)
    lopsided[0, 1] = 1.0
    with pytest.raises(ValueError, match="the stiffness of bushing b isn't a symmetric"):
        SixAxisSpring("b", (here, here), lopsided, np.eye(6))
    with pytest.raises(ValueError, match="the damping of bushing b has a negative eigenvalue"):
        SixAxisSpring("b", (here, here), np.eye(6), -np.eye(6))
    with pytest.raises(ValueError, match="the axes of a force element's place are not orthonormal"):
        replace(here, axes=2.0 * np.eye(3))
    with pytest.raises(ValueError, match="a friction's rate must be greater"):
        ForceLaw(friction=1.0, friction_rate=0.0)
    with pytest.raises(ValueError, match="a stop's width must be greater"):
        ForceLaw(ForceCurve(), stops=(Stop(0.0, 1.0, 1.0, 0.0, 0.0),))
