"""Random vibration against closed forms and against long marches under noise."""

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from fmd.core.errors import AccuracyError, InputError
from fmd.output.responses import compute_response
from fmd.responses.random_vibration import random_response
from fmd.responses.state_space import Channel, StateSpace, choose_frequencies
from fmd.scene.scene import load_scene
from fmd.stages.linear_model import read_density
from fmd.stages.pipeline import Pipeline

AT = ("--psd", "")


def chain(damping: float) -> StateSpace:
    """Return two masses on springs with a force on the first and the displacement of the second."""
    K, M = np.array([[3e4, -1e4], [-1e4, 1e4]]), np.eye(2)
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-K, -damping * K / 100.0]])
    names = tuple(Channel(f"x{k}", "m") for k in range(4))
    B, C = np.zeros((4, 1)), np.zeros((1, 4))
    B[2, 0] = C[0, 1] = M[0, 0]
    return StateSpace(A, B, C, np.zeros((1, 1)), names, (Channel("f", "N"),), (Channel("x", "m"),))


@pytest.mark.parametrize("damping", [1e-4, 1e-2, 0.3])
def test_white_noise_gives_the_covariance_of_lyapunovs_equation(damping: float) -> None:
    # A one-sided density S of a force is a two-sided intensity of S/2: A P + P Aᵀ + B S/2 Bᵀ = 0.
    model, density = chain(damping), 0.4
    P = solve_continuous_lyapunov(model.A, -model.B @ model.B.T * density / 2)
    frequencies = choose_frequencies(model, 0.0, 5000.0, 4000, 1.05)
    response = model.frequency_response(frequencies)[:, :, 0]
    found = random_response(frequencies, response, lambda f: np.full(len(f), density))
    assert found.rms[0] ** 2 == pytest.approx((model.C @ P @ model.C.T).item(), rel=1e-3)


def test_a_long_march_under_noise_has_the_root_mean_square_of_the_density(tmp_path: Path) -> None:
    # Noise as a sum of sines of equal power and random phases, 200 in 20 … 220 Hz about the plate's first mode, as a
    # table for the hammer. Over its period of 2 s, when the start has died away, the mean square is that of all
    # lines together.
    step, low, high, density = 1.0, 20.0, 220.0, 0.25
    lines = np.arange(low + step / 2, high, step)
    phases = np.random.default_rng(3).uniform(0.0, 2 * np.pi, len(lines))
    times = np.linspace(0.0, 4.0, 8001)
    force = np.sqrt(2 * density * step) * np.cos(2 * np.pi * np.outer(times, lines) + phases[None]).sum(axis=1)
    table = f'{{ times = {[f"{t:.6g} s" for t in times]}, values = {np.round(force, 9).tolist()}, unit = "N" }}'
    overrides = [
        "body.plate.mesh.divisions=[6, 4, 2]",
        "body.plate.modes.damping=0.05",
        'body.plate.modes.enrich="residual"',
        f"drive.hammer.force={table}",
        "simulation.duration=4 s",
        "simulation.output_step=1 ms",
        'simulation.run=[{ integrator = "exponential", step = "0.1 ms" }]',
        "output=[]",
    ]
    run = Pipeline(load_scene("plate", overrides))
    outputs = ["plate.tip.z", "plate.root.xx"]
    found = compute_response(run, ["drive.hammer"], outputs, high, low, 500, psd=(str(density), tmp_path, AT))
    late = (run.motion.times > 2.0) & (run.motion.times < 3.9995)
    marched = [run.motion.tip_deflection[:, 2], next(iter(run.element_stress("plate.root", "xx").values()))]
    assert found.random is not None
    np.testing.assert_allclose([np.sqrt((x[late] ** 2).mean()) for x in marched], found.random.rms, rtol=0.01)


def test_noise_in_a_band_crosses_zero_as_often_as_rice_says() -> None:
    """Between f₁ and f₂ of a flat density ``√((f₂³ − f₁³)/(3 (f₂ − f₁)))`` times a second (Rice, 1945)."""
    low, high = 20.0, 50.0
    frequencies = np.linspace(low, high, 3001)
    found = random_response(frequencies, np.full((3001, 1), 2.0 + 0.0j), np.ones_like)
    assert found.rates_hz == pytest.approx([np.sqrt((high**3 - low**3) / (3 * (high - low)))], rel=1e-6)
    assert found.rms == pytest.approx([2.0 * np.sqrt(high - low)], rel=1e-12)


def test_densities_are_numbers_formulas_and_tables(tmp_path: Path) -> None:
    f = np.array([10.0, 100.0, 1000.0])
    np.testing.assert_allclose(read_density("0.5", tmp_path, AT)(f), 0.5)
    np.testing.assert_allclose(read_density("f/100 if f < 500 else 0", tmp_path, AT)(f), [0.1, 1.0, 0.0])
    (tmp_path / "shock.csv").write_text("frequency,psd\n20, 0.01\n200, 1.0\n", encoding="utf-8")
    table = read_density("shock.csv", tmp_path, AT)
    np.testing.assert_allclose(table(np.array([10.0, 20.0, np.sqrt(20 * 200), 200.0, 201.0])), [0, 0.01, 0.1, 1, 0])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("2*t", "formula of the frequency f in Hz, not of t"),
        ("2*(", r"a number, a formula such as"),
        ("none.csv", "can't be read"),
        ("bad.csv", "line 2 isn't two numbers"),
        ("short.csv", "two rows at least"),
        ("three.csv", "line 1 has 3 numbers"),
    ],
)
def test_a_wrong_density_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "bad.csv").write_text("1, 2\nx, 3\n", encoding="utf-8")
    (tmp_path / "short.csv").write_text("1, 2\n", encoding="utf-8")
    (tmp_path / "three.csv").write_text("1, 2, 3\n", encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_density(text, tmp_path, AT)


def test_a_negative_density_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a density is 0 or above"):
        read_density("10 - f", tmp_path, AT)(np.array([1.0, 20.0]))


@pytest.mark.parametrize(
    ("overrides", "lowest", "message"),
    [
        (["body.plate.modes.damping=0.0"], 10.0, "the mode at 91.* Hz has no damping"),
        (["joint.clamp.type=free", "body.plate.support=[]"], 0.0, "unbounded at 0 Hz; begin above"),
    ],
)
def test_noise_without_a_stationary_answer_is_refused(
    tmp_path: Path, overrides: list[str], lowest: float, message: str
) -> None:
    run = Pipeline(load_scene("plate", ["body.plate.mesh.divisions=[6, 4, 2]", "output=[]", *overrides]))
    with pytest.raises(AccuracyError, match=message):
        compute_response(run, ["plate.side.z"], ["plate.tip.z"], 500.0, lowest, psd=("1", tmp_path, AT))


def test_a_density_belongs_to_one_input(tmp_path: Path) -> None:
    run = Pipeline(load_scene("plate"))
    with pytest.raises(InputError, match="belongs to one input; 2 are given"):
        compute_response(run, ["drive.hammer", "ground.z"], ["plate.tip.z"], 100.0, psd=("1", tmp_path, AT))
