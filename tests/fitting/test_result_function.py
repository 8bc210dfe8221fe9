"""Results as a function of numbers, for optimisers: against a closed form, and by its own laws."""

import numpy as np
import pytest
from scipy.optimize import minimize

import fmd as package
from tests.fitting.test_sensitivities import MASS, OSCILLATOR, START, STIFFNESS

KEYS = ["joint.slide.spring", "body.block.mass"]


@pytest.fixture(scope="module")
def places() -> package.ResultFunction:
    result = package.load(OSCILLATOR, "simulation.step=1 ms")
    return package.ResultFunction(result, ["slide.position", "mass"], KEYS)


def closed_form(x: np.ndarray, t: np.ndarray, h: float = 1e-3) -> np.ndarray:
    """Leapfrog's own solution, ``x_0 cos nθ`` with ``2 sin(θ/2) = ω h``."""
    return START * np.cos(t / h * 2.0 * np.arcsin(0.5 * np.sqrt(x[0] / x[1]) * h))


def test_values_and_derivatives_are_those_of_the_closed_form(places: package.ResultFunction) -> None:
    t = places.result.run.output_times
    assert places.names == {"slide.position": slice(0, t.size), "mass": slice(t.size, t.size + 1)}
    np.testing.assert_array_equal(places.start, [STIFFNESS, MASS])
    for x in (places.start, places.start * [1.1, 0.9]):
        np.testing.assert_allclose(places(x)[:-1], closed_form(x, t), rtol=0, atol=1e-12)
        assert places(x)[-1] == pytest.approx(x[1], rel=1e-12)
        # Complex steps of the closed form have no error of their own.
        columns = [closed_form(x + 1e-30j * unit, t).imag / 1e-30 for unit in np.eye(2)]
        J = np.column_stack(columns)
        for k, part in enumerate((1e-9, 1e-6)):  # by the tangent, and by a difference over 0.02 % of the mass
            np.testing.assert_allclose(places.jacobian(x)[:-1, k], J[:, k], rtol=0, atol=part * abs(J[:, k]).max())
        np.testing.assert_allclose(places.jacobian(x)[-1], [0.0, 1.0], atol=1e-9)


def test_jvp_and_vjp_are_adjoint(places: package.ResultFunction) -> None:
    rng, x = np.random.default_rng(0), places.start
    dx, weights = rng.normal(size=2) * x, rng.normal(size=places(x).size)
    assert weights @ places.jvp(x, dx) == pytest.approx(dx @ places.vjp(x, weights), rel=1e-12)


def test_an_optimiser_of_ones_own_finds_the_numbers_that_made_a_history(places: package.ResultFunction) -> None:
    wanted = places(places.start * [1.05, 1.02])

    def loss(s: np.ndarray) -> tuple[float, np.ndarray]:
        apart = (places(places.start * s) - wanted) / [*[START] * (wanted.size - 1), MASS]
        sizes = np.array([*[START] * (wanted.size - 1), MASS])
        return float(apart @ apart), places.start * places.vjp(places.start * s, 2.0 * apart / sizes)

    found = minimize(loss, np.ones(2), jac=True, method="BFGS")
    np.testing.assert_allclose(found.x, [1.05, 1.02], rtol=1e-4)


def test_numbers_of_another_shape_or_not_finite_are_refused(places: package.ResultFunction) -> None:
    with pytest.raises(ValueError, match="x has shape"):
        places(np.ones(3))
    with pytest.raises(package.AccuracyError, match="x holds"):
        places(np.array([np.nan, 1.0]))
    with pytest.raises(ValueError, match="weights has shape"):
        places.vjp(places.start, np.ones(3))
    with pytest.raises(ValueError, match="dx has shape"):
        places.jvp(places.start, np.ones(3))
