"""Modes with static derivatives of a solid of large displacements, as `benchmarks/nonlinear_modes.py` compares them."""

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.integrators.protocol import evaluate
from tests.verification.test_large_deflection import FORCE, elastica, strip

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
ACROSS = np.array([0.0, 0.0, 1.0])


@pytest.fixture
def solid(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """Return the strip of the elastica as a solid of large displacements, ν = 0 as in the beam's theory."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    part = strip(tmp_path, PIECES=1, LOAD="0 N", **FORCE | {"ALONG": 48}).part
    solid = importlib.import_module("nonlinear_solid").NonlinearSolid
    return solid(part.fe, part.markers["root"], part.markers["tip"])


def reduce_to(solid: Any, count: int) -> Any:
    modes = importlib.import_module("modal_derivatives").bending_modes(solid, count, ACROSS)
    return importlib.import_module("reduced_solid").reduce_solid(solid, modes)


def small_states(reduced: Any) -> Array:
    return np.asarray(1e-3 * np.random.default_rng(1).normal(size=(2, reduced.n)) / reduced.omega)


def test_forces_of_the_solid_are_the_slopes_of_its_energy_and_turn_with_it(solid: Any) -> None:
    rng, x = np.random.default_rng(2), solid.fe.x
    u, du = 1e-4 * rng.normal(size=(2, *x.shape))
    change = (solid.force(u + 1e-4 * du) - solid.force(u - 1e-4 * du)).ravel() / 2e-4
    expected = solid.tangent(u) @ du.ravel()
    assert change == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())
    R, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turned = (x + u) @ R.T - x
    assert solid.force(turned) == pytest.approx(solid.force(u) @ R.T, abs=1e-8 * np.abs(solid.force(u)).max())


def test_reduced_forces_are_those_of_the_solid_and_the_slopes_of_the_reduced_energy(solid: Any) -> None:
    reduced = reduce_to(solid, 3)
    flat = reduced.basis.reshape(-1, reduced.n)
    for q in small_states(reduced):
        force = reduced.force(q)
        assert force == pytest.approx(flat.T @ solid.force(reduced.basis @ q).ravel(), abs=1e-10 * np.abs(force).max())
        a = np.zeros(reduced.n)
        evaluate(reduced.parameters, 0.0, q, np.zeros(reduced.n), a)
        assert a == pytest.approx(-force, abs=1e-12 * np.abs(force).max())
        parts, weights = np.polynomial.legendre.leggauss(2)  # exact: the energy is quartic, the force along q cubic
        work = sum(0.5 * w * q @ reduced.force(0.5 * (1 + part) * q) for part, w in zip(parts, weights, strict=True))
        assert reduced.energy(q) == pytest.approx(work, rel=1e-10)


def test_the_tangent_of_the_reduced_forces_is_exact(solid: Any) -> None:
    reduced = reduce_to(solid, 2)
    q, dq = small_states(reduced)
    change = reduced.force(q + 1e-3 * dq) - reduced.force(q - 1e-3 * dq)
    assert change == pytest.approx(2e-3 * reduced.tangent(q) @ dq, abs=1e-7 * np.abs(change).max())


def test_three_modes_with_derivatives_follow_the_elastica_and_two_modes_alone_do_not(solid: Any) -> None:
    exact = elastica(2) - [1, 0]
    errors = []
    module = importlib.import_module("reduced_solid")
    modes = importlib.import_module("modal_derivatives").bending_modes(solid, 3, ACROSS)
    for reduced in (reduce_to(solid, 3), module.reduce_to_span(solid, modes)):
        load = reduced.basis.reshape(-1, reduced.n).T @ solid.load(2 * ACROSS).ravel()
        q = module.rest_of_reduced(reduced, load)
        moved = solid.tip.translation(reduced.basis) @ q
        errors.append(float(np.linalg.norm(moved[[0, 2]] - exact) / np.linalg.norm(exact)))
    assert errors[0] < 3e-3
    assert errors[1] > 0.5  # without the derivatives membrane strain holds the strip straight


def test_the_solid_let_go_from_a_small_deflection_swings_as_its_lowest_mode(solid: Any) -> None:
    mode = importlib.import_module("modal_derivatives").bending_modes(solid, 1, ACROSS)[:, :, 0]
    u = mode * (1e-6 / np.abs(mode).max())
    omega = np.sqrt(u.ravel() @ solid.fe.K @ u.ravel() / (u.ravel() @ solid.fe.M @ u.ravel()))
    times = np.arange(11) * 0.02
    tips = solid.march(u, times, 0.01)  # to 1.3 rad; the step's own error is (ω h)²/12 of the angle
    expected = np.outer(np.cos(omega * times), solid.tip.translation(u))
    assert tips == pytest.approx(expected, abs=2e-3 * np.abs(expected).max())


def test_a_solid_under_a_load_without_a_rest_nearby_says_so(solid: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("nonlinear_solid.CORRECTIONS", 2)
    with pytest.raises(RuntimeError, match=r"the solid's rest under .* N was not found"):
        solid.rest(10 * ACROSS)
    with pytest.raises(ValueError, match=r"found \d modes along"):
        importlib.import_module("modal_derivatives").bending_modes(solid, 1, 0 * ACROSS)
