"""State-space models: poles, zeros, responses and files of small systems whose answers are known."""

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.responses.state_space import Channel, StateSpace, choose_frequencies


def model_of(K: Array, C: Array, forced: int, seen: int) -> StateSpace:
    """Return unit masses with stiffness and damping matrices, a force on one and the displacement of another."""
    n = len(K)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-K, -C]])
    B, out = np.zeros((2 * n, 1)), np.zeros((1, 2 * n))
    B[n + forced, 0] = out[0, seen] = 1.0
    states = tuple(Channel(f"mass {k}", "m") for k in range(2 * n))
    return StateSpace(A, B, out, np.zeros((1, 1)), states, (Channel("a.f", "N"),), (Channel("a.x", "m"),))


STIFF = np.array([[2.0, -1.0], [-1.0, 1.0]]) * 1e4


def test_poles_and_zeros_are_those_of_two_masses() -> None:
    # The zero of the driven mass is the frequency of the other one with the driven one held.
    model = model_of(STIFF, 1e-4 * STIFF, 0, 0)
    expected = np.sqrt(np.linalg.eigvalsh(STIFF))
    assert model.poles_hz == pytest.approx(expected / 2 / np.pi, rel=1e-9)
    assert model.damping == pytest.approx(1e-4 * expected / 2, rel=1e-9)
    assert model.zeros_hz() == pytest.approx([100.0 / 2 / np.pi], rel=1e-9)
    assert model_of(STIFF, 1e-4 * STIFF, 0, 1).zeros_hz().size == 0
    assert model.growth == 0.0


def test_an_overdamped_motion_hides_no_slow_one() -> None:
    """One of 10 rad/s beside one that damping proportional to a very large stiffness holds."""
    K = np.diag([1e2, 1e12])
    model = model_of(K, 1e-3 * K, 0, 0)
    assert model.poles_hz == pytest.approx([10.0 / 2 / np.pi], rel=1e-4)
    assert model.damping == pytest.approx([0.005], rel=1e-2)
    falling = model_of(np.diag([1e2, -1e2, 1e12]), np.diag([0.0, 0.0, 1e9]), 0, 0)
    assert falling.growth == pytest.approx(10.0, rel=1e-4)


def test_zeros_that_cancel_poles_are_left_out() -> None:
    model = model_of(np.diag([1e4, 4e4, 9e4]), np.zeros((3, 3)), 1, 1)
    assert model.zeros_hz().size == 0


@pytest.mark.parametrize("seed", range(5))
def test_modes_that_an_output_does_not_see_give_no_zeros(seed: int) -> None:
    """Two oscillators without a coupling, turned into each other's coordinates: the force moves both, one is seen."""
    rng = np.random.default_rng(seed)
    Q, _ = np.linalg.qr(rng.normal(size=(2, 2)))
    K = Q @ np.diag(rng.uniform(1e3, 1e5, 2)) @ Q.T
    model = model_of(K, 1e-4 * K, 0, 0)
    alone = replace(model, C=np.concatenate([Q[:, 0], np.zeros(2)])[None])
    assert len(model.zeros_hz()) == 1
    assert alone.zeros_hz().size == 0


def test_a_growing_motion_is_told() -> None:
    assert model_of(np.diag([1.0, -4.0]), np.zeros((2, 2)), 0, 0).growth == pytest.approx(2.0)


def test_the_response_is_that_of_solutions_frequency_by_frequency() -> None:
    # Stiffnesses 14 orders apart, as static correction brings them.
    rng = np.random.default_rng(1)
    turn, _ = np.linalg.qr(rng.normal(size=(6, 6)))
    K = np.diag(10.0 ** np.arange(2, 14, 2))
    model = model_of(K, 1e-6 * K, 0, 0)
    mixed = StateSpace(
        model.A, np.r_[np.zeros((6, 1)), turn[:, :1]], np.c_[turn[1:2], np.zeros((1, 6))], *(model.D, model.states),
        model.inputs, model.outputs,
    )  # fmt: skip
    frequencies = np.array([0.1, 1.0, 30.0, 4e3])
    s = 2j * np.pi * frequencies[:, None]
    expected = (turn[1] * turn[:, 0] / (s**2 + 1e-6 * s * K.diagonal() + K.diagonal())).sum(axis=1)
    np.testing.assert_allclose(mixed.frequency_response(frequencies)[:, 0, 0], expected, rtol=1e-9)


def test_no_resonance_lies_between_two_frequencies() -> None:
    model = model_of(STIFF, 1e-6 * STIFF, 0, 0)
    f = choose_frequencies(model, 0.0, 40.0, 30)
    values = np.abs(model.frequency_response(f)[:, 0, 0])
    for pole, damping in zip(model.poles_hz, model.damping, strict=True):
        peak = np.abs(model.frequency_response(np.array([pole * np.sqrt(1 - 2 * damping**2)]))[0, 0, 0])
        assert values[np.abs(f - pole).argmin()] == pytest.approx(peak, rel=1e-9)
    assert f[0] == 0.0
    assert f[-1] == 40.0


def test_files_hold_matrices_names_and_units(tmp_path: Path) -> None:
    from scipy.io import loadmat

    model = model_of(STIFF, 0.0 * STIFF, 0, 1)
    for suffix in (".npz", ".mat"):
        model.save(tmp_path / f"model{suffix}")
    found = np.load(tmp_path / "model.npz")
    np.testing.assert_array_equal(found["A"], model.A)
    assert found["inputs"].tolist() == ["a.f"]
    assert found["input_units"].tolist() == ["N"]
    read = loadmat(tmp_path / "model.mat")
    np.testing.assert_array_equal(read["B"], model.B)
    assert [str(name[0][0]) for name in read["states"]] == [name for name, _ in model.states]
    with pytest.raises(ValueError, match=r"\.npz and \.mat are"):
        model.save(tmp_path / "model.csv")


def test_shapes_have_to_fit_the_names() -> None:
    model = model_of(STIFF, STIFF, 0, 0)
    with pytest.raises(ValueError, match="don't have 4 states, 1 inputs and 0 outputs"):
        StateSpace(model.A, model.B, model.C, model.D, model.states, model.inputs, ())


def test_python_control_is_only_needed_when_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    model = model_of(STIFF, STIFF, 0, 0)
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(ModuleNotFoundError, match="pip install control"):
        model.to_control()
    calls: list[Any] = []
    monkeypatch.setitem(sys.modules, "control", SimpleNamespace(ss=lambda *a, **names: calls.append((a, names))))
    model.to_control()
    ((matrices, names),) = calls
    np.testing.assert_array_equal(matrices[0], model.A)
    assert names["inputs"] == ["a_f"]  # python-control reads a dot as a subsystem's
