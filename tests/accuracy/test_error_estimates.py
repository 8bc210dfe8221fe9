"""What is stated of two computations, on functions whose error is known."""

from dataclasses import replace

import numpy as np
import pytest

from fmd.accuracy.changed_bodies import keep_lowest, retune_body, soften_body
from fmd.accuracy.error_budget import Budget
from fmd.accuracy.error_estimates import NO_PART, Quantity, Row, refinement_gain, shifted_frequencies
from fmd.accuracy.quantities import find_counterparts
from fmd.reduction.body import FlexibleBody, MarkerShapes
from fmd.reduction.inertia import inertia_integrals

T = np.linspace(0.0, 1.0, 101)


@pytest.mark.parametrize(
    ("kind", "edges", "power"),
    [("displacement", 1, 4), ("stress", 1, 2), ("spot stress", 1, 3), ("geometry", 1, 2), ("geometry", 2, 4)],
)
def test_the_gain_of_a_finer_mesh_is_richardsons(kind: str, edges: int, power: int) -> None:
    exact = 3.0
    coarse, fine = exact + 0.2**power, exact + 0.1**power  # an error of c h^power
    assert (coarse - fine) / refinement_gain(2.0, 2, edges, kind) == pytest.approx(fine - exact)


def test_frequencies_go_to_their_limit_when_all_of_the_excess_is_taken_off() -> None:
    exact = np.array([10.0, 20.0])
    omega = exact * np.sqrt([1.1, 1.2])
    assert shifted_frequencies(omega, 1 - (exact / omega) ** 2, 1.0) == pytest.approx(exact)
    assert (shifted_frequencies(omega, np.array([5.0, 5.0]), 1.0) == omega / 2).all()  # never to nothing


def test_an_error_is_relative_to_the_largest_value() -> None:
    history = Quantity("x", "m", np.sin(7 * T))
    other = Quantity("x", "m", np.sin(7 * T) + 0.01)
    assert other.error(history) == pytest.approx(0.01 / np.abs(np.sin(7 * T)).max())
    vectors = Quantity("x", "m", np.outer(1 + T, [3.0, 4.0, 0.0]))
    assert vectors.scale == pytest.approx(10.0)


def test_a_largest_value_that_is_the_same_by_chance_still_counts_as_changed() -> None:
    """Two bumps of heights 1 and 0.9; the lower one grows."""
    bumps = np.abs(np.sin(2 * np.pi * T))
    one = Quantity("x", "m", np.where(T < 0.5, bumps, 0.9 * bumps), largest=True)
    other = Quantity("x", "m", np.where(T < 0.5, bumps, 0.96 * bumps), largest=True)
    assert one.error(other) == 0
    assert one.change(other) == pytest.approx(0.03)


def test_a_peak_that_only_comes_later_has_hardly_changed() -> None:
    t = np.linspace(0.0, 1.0, 10001)
    one, late = (Quantity("x", "m", np.sin(7 * t - lag), largest=True) for lag in (0.0, 0.01))
    assert one.change(late) < 1e-6


def test_what_has_no_estimate_is_no_number_and_does_not_count() -> None:
    row = Row("x", "m", 1.0, False, {"discretisation": 0.01, "truncation": NO_PART, "time": 0.02, "recovery": "not"})
    assert row.total == pytest.approx(2 * np.sqrt(5) * 0.01)
    assert row.dominant == "time"


def test_shapes_that_changed_places_are_found() -> None:
    x = np.random.default_rng(0).uniform(size=(40, 3))
    shapes = np.linalg.qr(np.random.default_rng(1).standard_normal((120, 6)))[0].reshape(40, 3, 6)
    order = np.array([3, 0, 5, 1, 4, 2])
    found, _ = find_counterparts(x, shapes[:, :, order[:4]], x, np.eye(40), -shapes, np.arange(1.0, 7.0))
    assert found.tolist() == order[:4].tolist()


def test_shapes_that_turned_in_their_plane_are_alike_and_noise_is_not() -> None:
    x = np.random.default_rng(0).uniform(size=(40, 3))
    shapes = np.linalg.qr(np.random.default_rng(1).standard_normal((120, 4)))[0].reshape(40, 3, 4)
    turned, other = np.array([[0.8, -0.6], [0.6, 0.8]]), shapes.copy()
    other[:, :, :2] = shapes[:, :, :2] @ turned
    other[:, :, 2] = np.random.default_rng(2).standard_normal((40, 3)) / np.sqrt(120)
    numbers, alike = find_counterparts(x, shapes, x, np.eye(40), other[:, :, :3], np.array([5.0, 5.001, 9.0]))
    assert sorted(numbers[:2]) == [0, 1]
    assert alike[:2] == pytest.approx([1.0, 1.0])
    assert (alike[2:] < 0.1).all()


def body_of(x: np.ndarray, shapes: np.ndarray, omega: np.ndarray) -> FlexibleBody:
    marker = MarkerShapes(np.zeros(3), shapes[0], shapes[1])
    return FlexibleBody(
        x, shapes, omega, np.eye(3)[2], "at", {"at": marker}, inertia_integrals(x, np.eye(len(x)), shapes), 0
    )


def test_a_softened_body_yields_more_to_the_same_force_and_has_the_same_stress() -> None:
    random = np.random.default_rng(0)
    shapes = np.linalg.qr(random.standard_normal((30, 4)))[0].reshape(10, 3, 4)
    body = body_of(random.uniform(size=(10, 3)), shapes, np.array([1.0, 2.0, 5.0, 9.0]))
    excess = 0.02 * np.array([[1, 0.5, 0, 0], [0.5, 2, 0, 0], [0, 0, 3, -1], [0, 0, -1, 1]])
    soft, as_if = soften_body(body, excess)
    force = random.standard_normal(30)  # at the nodes
    q = (soft.shapes.reshape(30, 4).T @ force) / soft.omega**2
    K = np.diag(body.omega) @ (np.eye(4) - excess) @ np.diag(body.omega)
    modal = shapes.reshape(30, 4).T @ force
    assert soft.shapes @ q == pytest.approx(shapes @ np.linalg.solve(K, modal))
    assert as_if @ q == pytest.approx(modal / body.omega**2)  # the given body's coordinates under that force
    again = inertia_integrals(body.x, np.eye(10), soft.shapes)
    assert np.allclose(soft.integrals.G, again.G)
    assert soft.markers["at"].rotation == pytest.approx(soft.shapes[1])


def test_a_softened_body_keeps_the_order_and_the_zeros_of_the_given_one_so_that_it_takes_no_code_of_its_own() -> None:
    shapes = np.linalg.qr(np.random.default_rng(0).standard_normal((30, 4)))[0].reshape(10, 3, 4)
    body = body_of(np.random.default_rng(1).uniform(size=(10, 3)), shapes, np.array([1.0, 2.0, 2.01, 9.0]))
    excess = np.diag([0.0, 0.0, 0.1, 0.0]) + 1e-10 * np.ones((4, 4))  # the third rings below the second now
    soft, as_if = soften_body(body, excess)
    assert soft.omega == pytest.approx([1.0, 2.0, 2.01 * 0.9**0.5, 9.0])
    assert np.count_nonzero(as_if) == 4


def test_a_retuned_body_rings_at_other_frequencies_and_yields_to_a_static_force_as_before() -> None:
    random = np.random.default_rng(0)
    shapes = np.linalg.qr(random.standard_normal((30, 3)))[0].reshape(10, 3, 3)
    body = body_of(random.uniform(size=(10, 3)), shapes, np.array([1.0, 2.0, 5.0]))
    tuned, stressed = retune_body(body, np.array([0.9, 2.1, 5.0]))
    force = random.standard_normal(30)  # at the nodes
    q, before = (b.shapes.reshape(30, 3).T @ force / b.omega**2 for b in (tuned, body))
    assert tuned.omega.tolist() == [0.9, 2.1, 5.0]
    assert tuned.shapes @ q == pytest.approx(body.shapes @ before)
    assert stressed @ q == pytest.approx(before)
    assert np.allclose(inertia_integrals(body.x, np.eye(10), tuned.shapes).G, tuned.integrals.G)


def test_a_body_of_anothers_shapes_and_its_lowest_yields_to_a_force_as_both_do() -> None:
    """Against the stiffness of all these shapes, solved without a basis of the body's."""
    rng = np.random.default_rng(7)
    body = body_of(
        rng.normal(size=(6, 3)),
        np.linalg.qr(rng.normal(size=(18, 5)))[0].reshape(6, 3, 5),
        np.array([1.0, 2.0, 4.0, 9.0, 15.0]),
    )
    own = body.shapes @ rng.normal(size=(5, 2))  # of a poorer basis
    low, whole = keep_lowest(body, own, 1)
    assert len(low.omega) == 3
    q = rng.normal(size=3)
    np.testing.assert_allclose(low.shapes @ q, body.shapes @ (whole @ q))
    np.testing.assert_allclose(low.integrals.G, inertia_integrals(body.x, np.eye(6), low.shapes).G, atol=1e-12)
    nodal = body.shapes.reshape(18, 5)
    shapes = np.c_[own.reshape(18, 2), nodal[:, 0]]
    K = nodal @ np.diag(body.omega**2) @ nodal.T
    force = rng.normal(size=18)
    moved = low.shapes.reshape(18, 3) @ ((low.shapes.reshape(18, 3).T @ force) / low.omega**2)
    np.testing.assert_allclose(moved, shapes @ np.linalg.solve(shapes.T @ K @ shapes, shapes.T @ force))
    assert len(keep_lowest(body, body.shapes[:, :, :1], 2)[0].omega) == 2  # which are among the lowest
    still = replace(body, shapes=np.zeros_like(body.shapes))  # as of a file whose few nodes don't tell its shapes apart
    assert keep_lowest(still, still.shapes, 1)[0] is still


def test_at_most_three_quarters_of_a_stiffness_are_taken_off() -> None:
    body = body_of(
        np.eye(4, 3), np.linalg.qr(np.random.default_rng(0).standard_normal((12, 1)))[0].reshape(4, 3, 1), T[-1:]
    )
    assert soften_body(body, np.array([[5.0]]))[0].omega == pytest.approx(0.5 * T[-1:])


@pytest.mark.parametrize("truth", [1.0, 1.2, 1.33])
def test_an_interval_holds_the_value_the_better_one_and_a_truth_that_one_more_step_of_the_same_kind_would_reach(
    truth: float,
) -> None:
    better = 1.0 + (truth - 1.0) * 0.6  # a correction that takes off 60 % of the error
    row = Row("x", "m", 1.0, False, {"truncation": (better - 1.0) / better}, better - 1.0)
    assert row.interval is not None
    low, high = row.interval
    assert low <= min(1.0, better, truth) * (1 + 1e-12)
    assert high >= max(better, truth) * (1 - 1e-12)
    assert high - low <= 2.0 * row.total  # no wider than the value with its total on both sides


def test_nothing_is_stated_where_an_estimate_is_missing() -> None:
    row = Row("x", "m", 1.0, False, {"truncation": 0.1, "time": "not estimated: it would take about 9 s"}, 0.1)
    assert row.interval is None
    assert row.why == "not estimated: it would take about 9 s"
    summary = Budget((row,)).summary()["rows"][0]
    assert (summary["interval"], summary["total"], summary["better"]) == (None, None, 1.1)
