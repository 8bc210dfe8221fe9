"""Structure of mechanisms: what cleaning takes out and leaves in, what folds, what is reported."""

from dataclasses import replace

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.core.limits.round_off import SOLVED
from fmd.dynamics.compiler.cleaning import orthonormal_rows
from fmd.dynamics.compiler.compiled import CompiledMechanism, compile_mechanism
from fmd.dynamics.links import Link
from fmd.dynamics.mechanism import Mechanism
from fmd.reduction.body import MarkerShapes
from fmd.reduction.inertia import inertia_integrals
from fmd.scene.joints.revolute import REVOLUTE
from tests.dynamics.compiler import lagrange
from tests.dynamics.compiler.comparison import TIME, difference
from tests.dynamics.compiler.mechanisms import random_mechanism

PLANE = "plane motion: every body turns about z alone"


def plane_arm(lift: float = 0.0, n: int = 4) -> Mechanism:
    """Two flexible bodies of points in a plane, hinged across it; points, shapes and axes lifted out of it a little."""
    rng = np.random.default_rng(5)
    up = lift * rng.normal(size=(3, n))
    links = []
    for k in range(2):
        x, m, Phi = rng.normal(size=(12, 3)), rng.uniform(0.1, 0.5, 12), rng.normal(size=(12, 3, n))
        x[:, 2] *= lift
        Phi[:, 2] *= lift
        flat = Phi.reshape(36, n)
        L = np.linalg.cholesky(flat.T @ (np.repeat(m, 3)[:, None] * flat))
        Phi = np.linalg.solve(L, flat.T).T.reshape(12, 3, n)
        shapes, turns = 0.3 * rng.normal(size=(3, n)), 0.4 * rng.normal(size=(3, n))
        shapes[2], turns[:2] = up[0], up[1:]
        place = MarkerShapes(np.array([1.0, 0.2, lift]), shapes, turns) if k else MarkerShapes(np.zeros(3))
        integrals, omega = inertia_integrals(x, np.diag(m), Phi), rng.uniform(3.0, 9.0, n)
        links.append(Link(f"body {k}", integrals, REVOLUTE, k - 1, place, omega=omega))
    return Mechanism(links)


def state(mechanism: Mechanism) -> tuple[Array, Array]:
    rng = np.random.default_rng(1)
    return 0.3 * rng.normal(size=mechanism.n), rng.normal(size=mechanism.n)


def test_a_plane_mechanism_is_found_to_be_one() -> None:
    compiled = compile_mechanism(plane_arm())
    assert compiled.structure[0] == PLANE
    assert "cyclic angle: accelerations don't depend on that of body 0" in compiled.structure


def test_round_off_out_of_the_plane_is_no_arithmetic_and_changes_no_more_than_its_share() -> None:
    exact, lifted = plane_arm(), plane_arm(1e-11)
    assert compile_mechanism(lifted).flops() == compile_mechanism(exact).flops()
    q, v = state(exact)
    a, b = (compile_mechanism(mechanism).accelerations(TIME, q, v) for mechanism in (exact, lifted))
    assert difference(a, b) < 10 * SOLVED
    assert difference(a, lagrange.accelerations(lifted, q, v)) < 1e-8  # what differences leave


def test_a_part_that_is_nearly_plane_but_truly_is_not_stays_spatial() -> None:
    mechanism = plane_arm(1e-3)
    compiled = compile_mechanism(mechanism)
    q, v = state(mechanism)
    assert PLANE not in compiled.structure
    a = compiled.accelerations(TIME, q, v)
    assert difference(a, lagrange.accelerations(mechanism, q, v)) < 1e-8
    assert difference(a, compile_mechanism(plane_arm()).accelerations(TIME, q, v)) > 1e-8


@pytest.mark.parametrize("seed", [0, 3, 4, 5, 7, 11])
def test_cleaning_changes_no_mechanism_beyond_its_threshold(seed: int) -> None:
    # Noise of a tenth of the threshold on every constant: as it is, or cleaned.
    mechanism = random_mechanism(seed, second_order=False).mechanism
    q, v = random_mechanism(seed).state(seed)
    rng = np.random.default_rng(seed)

    def noisy(values: Array) -> Array:
        return values + 0.1 * SOLVED * np.abs(values).max(initial=0.0) * rng.uniform(-1, 1, values.shape)

    links = [
        replace(
            link,
            place=replace(link.place, translation=noisy(link.place.translation), position=noisy(link.place.position)),
        )
        for link in mechanism.links
    ]
    moved = replace(mechanism, links=links)
    a, b = (compile_interpreted(compile_mechanism(one), q, v) for one in (mechanism, moved))
    assert difference(b, a) < 1e3 * SOLVED  # what the condition of the mechanism makes of it


def compile_interpreted(compiled: CompiledMechanism, q: Array, v: Array) -> Array:
    from tests.dynamics.compiler.comparison import interpreted

    return interpreted(compiled, "accelerations", (len(v),), q=q, v=v)


def test_orthonormal_rows_span_their_rows_and_keep_zeros() -> None:
    rows = np.array([[0.0, 2.0, 0.0, 1.0], [3.0, 0.0, 1.0, 0.0], [0.0, -4.0, 0.0, -2.0], [0.0, 0.0, 0.0, 0.0]])
    Q, L = orthonormal_rows(rows)
    assert Q.shape == (2, 4)
    assert np.allclose(Q @ Q.T, np.eye(2))
    assert np.allclose(L @ Q, rows)
    assert np.array_equal(Q == 0.0, rows[:2] == 0.0)


def test_a_function_has_a_size_on_disk_and_in_operations() -> None:
    compiled = compile_mechanism(plane_arm())
    assert compiled.n_bytes() > compiled.flops()
    assert compiled.flops() > compile_mechanism(replace(plane_arm(), links=plane_arm().links[:1])).flops() > 0


def test_modes_of_bodies_that_carry_none_do_not_couple() -> None:
    compiled = compile_mechanism(replace(plane_arm(), links=plane_arm().links[:1]))
    assert compiled.flops("solve_fast") == 0


def test_varying_signals_are_inputs_and_constant_ones_numbers() -> None:
    made = next(m for m in (random_mechanism(seed) for seed in range(50)) if compile_mechanism(m.mechanism).signals)
    compiled = compile_mechanism(made.mechanism)
    values = compiled.signal_values(TIME)
    assert values.shape == (3 * len(compiled.signals),)
    assert np.allclose(values[:3], compiled.signals[0].value(TIME), rtol=1e-13, atol=0.0)
    assert not compile_mechanism(plane_arm()).signals
