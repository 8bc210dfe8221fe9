"""Loads that act for a short time are never stepped over: each method against the sum of damped oscillators."""

from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.errors import InputError
from fmd.output.summary import summarise
from fmd.stages.runs import _given_step

pytestmark = pytest.mark.slow

SCENE = """
title = "Plate"
[body.plate]
shape = "bar"
length = "300 mm"
depth = "100 mm"
width = "4 mm"
E = "70 GPa"
nu = 0.33
rho = "2700 kg/m^3"
mesh = { element = "hexahedron", order = 2, divisions = [6, 2, 1] }
modes = { count = 4, boundary = "joint", enrich = "none", damping = 0.02 }
marker = { root = { face = "x-" }, tip = { face = "x+" } }
[joint.hub]
type = "fixed"
parent = "ground"
child = "plate.root"
[drive.blow]
type = "point force"
marker = "plate.tip"
direction = [0, 0, 1]
force = { formula = "FORCE", unit = "N" }
[simulation]
duration = "0.3 s"
output_step = "0.2 ms"
step = "20 us"
tip = "plate.tip"
run = [{ integrator = "auto" }, { integrator = "runge-kutta", tolerance = 1e-9 },
    { integrator = "exponential-rosenbrock", tolerance = 1e-8 }, { integrator = "Radau", tolerance = 1e-6 }]
"""
BLOWS = (
    "100*sin(pi*t/0.001) if t < 0.001 else 0",
    "500*exp(-((t-0.15)/0.0003)**2)",
    "sin(30*t) + 500*exp(-((t-0.15)/0.0003)**2)",
    "sin(30*t) + 100*max(0, 1 - abs(t - 0.2345)/0.0002)",
)


def plate(folder: Any, force: str, *settings: str) -> Pipeline:
    """Return the plate under a force at its tip."""
    file = folder / "plate.toml"
    file.write_text(SCENE.replace("FORCE", force))
    return Pipeline(load_scene(file, list(settings)))


def closed_form(run: Pipeline) -> np.ndarray[Any, Any]:
    """Return modal coordinates by Duhamel's integral, summed over 1 µs with the damped oscillator's own decay."""
    (link,), (load,) = run.mechanism.links, run.mechanism.loads
    h = 1e-6
    t = h * np.arange(round(run.output_times[-1] / h) + 1)
    force = np.outer(load.direction @ load.marker.translation, load.size.values(t)[:, 0])
    pole = link.omega * (-link.damping + 1j * np.sqrt(1 - link.damping**2))
    from scipy.signal import lfilter

    coordinates = []
    for p, f in zip(pole, force.astype(complex), strict=True):
        # The integral of exp(p (t − s)) f(s), exact for a force that is linear over each step.
        z = p * h
        first, second = (np.exp(z) * (z - 1) + 1) / z**2, (np.exp(z) - 1 - z) / z**2
        total = lfilter([h * second, h * first], [1.0, -np.exp(z)], f)
        total -= lfilter([h * second * f[0]], [1.0, -np.exp(z)], np.r_[1.0, np.zeros(len(f) - 1)])
        coordinates.append(total.imag / p.imag)
    return np.array(coordinates).T[:: round(run.scene.simulation.output_step / h)]


@pytest.mark.parametrize("force", BLOWS)
def test_a_short_blow_is_felt_by_every_adaptive_method(tmp_path: Any, force: str) -> None:
    run = plate(tmp_path, force, "body.plate.modes.count=2")
    exact = closed_form(run)
    for label, motion in run.motions.items():
        error = np.abs(motion.modal("plate") - exact).max() / np.abs(exact).max()
        assert error < (1e-3 if label == "auto" else 2e-5), label


def test_random_blows_are_felt_by_the_automatic_choice(tmp_path: Any) -> None:
    rng = np.random.default_rng(3)
    for _ in range(5):
        width, at = 10.0 ** rng.uniform(-4.5, -2.5), rng.uniform(0.02, 0.28)
        run = plate(tmp_path, f"100*exp(-((t-{at:.6f})/{width:.6g})**2)", "simulation.run=[{integrator='auto'}]")
        exact = closed_form(run)
        assert np.abs(run.motion.modal("plate") - exact).max() < 1e-3 * np.abs(exact).max()


def test_a_vibration_whose_periods_fit_the_steps_is_felt_by_the_automatic_choice(tmp_path: Any) -> None:
    """128 and 256 steps over 0.3 s see this force at its zeros alone."""
    only = "simulation.run=[{integrator='auto'}]"
    run = plate(tmp_path, "sin(30*t) + 100*sin(2*pi*256/0.3*t)", only)
    exact = closed_form(run)
    assert np.abs(run.motion.modal("plate") - exact).max() < 2e-3 * np.abs(exact).max()


def test_a_blow_on_a_lasting_load_is_felt_by_the_automatic_choice_where_modes_couple() -> None:
    """Steps of generalised-α and of central difference, of a tenth of a millisecond, saw nothing of it.

    The impulse on the wrist of the arm, beside a march that is steered by its own error.
    """
    blow = "drive.blow={type='point force', marker='forearm.wrist', direction=[1,0,0], force={formula="
    blow += "'5 if t < 0.30003 else 5 + 2e5*sin(pi*(t - 0.30003)/5e-6) if t < 0.300035 else 5', unit='N'}}"
    stiff = ["joint.elbow.spring=600 N m", "joint.wrist.spring=2000 N m", "drive.swing.torque=0 N m"]
    given = [blow, *stiff, "simulation.duration=0.5 s", "simulation.error=1e-2", "output=[]"]
    auto, exact = (
        Pipeline(load_scene("arm", [*given, f"simulation.run=[{{integrator={method}}}]"])).motion.trajectory
        for method in ("'auto'", "'runge-kutta', tolerance=1e-9")
    )
    assert np.abs(auto.q - exact.q).max() < 0.02 * np.abs(exact.q).max()
    # A trial before the blow knows nothing of it: the Rosenbrock method's march is ended as it costs more than others.
    assert auto.integrator == "auto (runge-kutta)"
    assert auto.evaluations < 2 * exact.evaluations


@pytest.mark.parametrize("method", ["exponential", "generalized-alpha"])
def test_a_fixed_step_that_would_step_over_a_blow_is_refused_with_one_that_works(tmp_path: Any, method: str) -> None:
    only = f"simulation.run=[{{integrator='{method}'}}]"
    with pytest.raises(InputError, match=r"a load acts for 0\.001 s only.* a step of 0\.00025 s or less works"):
        _ = plate(tmp_path, BLOWS[0], only, "simulation.step=5 ms").plans
    run = plate(tmp_path, BLOWS[0], only, "simulation.step=0.05 ms")
    exact = closed_form(run)
    assert np.abs(run.motion.modal("plate") - exact).max() < 0.05 * np.abs(exact).max()


def test_a_fixed_step_that_would_step_over_a_blow_on_a_lasting_load_is_refused(tmp_path: Any) -> None:
    only = "simulation.run=[{integrator='exponential'}]"
    force = "100 + 500*exp(-((t-0.15)/0.0003)**2)"
    with pytest.raises(InputError, match=r"a load acts for 0\.0009\d* s only.* a step of 0\.00022 s or less works"):
        _ = plate(tmp_path, force, only, "simulation.step=1 ms").plans
    run = plate(tmp_path, force, only, "simulation.step=0.22 ms")
    exact = closed_form(run)
    assert np.abs(run.motion.modal("plate") - exact).max() < 0.01 * np.abs(exact).max()


@pytest.mark.parametrize("method", ["sub-cycling", "reversible-sub-cycling"])
def test_a_cycle_that_would_step_over_a_pulse_is_refused(method: str) -> None:
    """The torque lasts for 15 fast steps, but a cycle of ten of them holds it; its impulse turns rod and slider."""
    torque = "drive.motor.torque={formula='0 if t < 0.1 else 20*sin(pi*(t-0.1)/0.015) if t < 0.115 else 0', unit='N m'}"
    only = f"simulation.run=[{{integrator='{method}', substeps=10}}]"
    given = [torque, only, "simulation.duration=0.3 s", "simulation.output_step=0.1 s", "joint.slide.position=0 m"]
    message = r"acts for 0\.015 s only, which .* freezes loads over 10 steps, .* a step of 0\.00037 s or less works"
    with pytest.raises(InputError, match=message):
        _ = Pipeline(load_scene("rod-slider", given)).plans


def test_a_step_that_is_chosen_is_short_enough_for_loads() -> None:
    torque = "drive.motor.torque={formula='5 + 20*exp(-((t - 0.1)/0.0003)**2)', unit='N m'}"
    given = [torque, "simulation.duration=0.3 s", "simulation.output_step=0.1 s", "simulation.step=auto"]
    step = _given_step(Pipeline(load_scene("rod-slider", given)))
    assert step is not None
    assert 10 * step < 3e-4  # its longest cycle is of ten steps


def test_a_load_that_moves_nothing_is_warned_of(tmp_path: Any) -> None:
    run = plate(tmp_path, BLOWS[0], "simulation.run=[{integrator='auto'}]")
    assert summarise(run, [], budget=False)["warnings"] == []
    run.motion.trajectory.q[:] = 0.0
    (warning,) = summarise(run, [], budget=False)["warnings"]
    assert warning["code"] == "load-without-motion"
    assert "a load acts, but nothing moves" in warning["text"]
