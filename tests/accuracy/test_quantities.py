"""Quantities of the error budget: of any scene the joints, energies and, on a flexible body, the tip."""

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.accuracy.quantities import mesh_quantities, motion_quantities, stress_quantities

QUICK = ["body.beam.mesh.divisions=[12, 2, 1]", "simulation.duration=20 ms"]


@pytest.fixture(scope="module")
def beam() -> Pipeline:
    return Pipeline(load_scene("beam-paper", QUICK))


def test_a_beam_on_a_hinge_has_joint_energies_and_tip(beam: Pipeline) -> None:
    found = motion_quantities(beam.motion, beam.fine_motion)
    assert list(found) == [
        "hub, angle",
        "hub, rate",
        "kinetic energy",
        "potential energy",
        "tip, deflection",
        "tip, largest deflection",
    ]
    assert found["tip, deflection"].values.shape == (len(beam.output_times), 3)
    assert found["tip, largest deflection"].largest
    assert found["tip, largest deflection"].values.max() >= beam.motion.tip_size.max()


def test_rigid_bodies_have_joints_in_their_units() -> None:
    run = Pipeline(load_scene("rod-slider", ["simulation.duration=0.1 s"]))
    found = motion_quantities(run.motion, run.fine_motion)
    of_slide = ["slide, position", "slide, rate"]
    assert list(found) == ["hinge, angle", "hinge, rate", "kinetic energy", "potential energy", *of_slide]
    assert {name: quantity.unit for name, quantity in found.items()}["slide, rate"] == "m/s"


def test_a_joint_whose_motion_is_given_has_no_result() -> None:
    run = Pipeline(load_scene("spin-up", ["simulation.duration=0.5 s", "body.beam.mesh.divisions=[10, 1, 1]"]))
    assert not any(name.startswith("hub") for name in motion_quantities(run.motion, run.fine_motion))


def test_the_mesh_gives_frequencies_and_mass(beam: Pipeline) -> None:
    found = mesh_quantities(beam)
    assert list(found)[:2] == ["beam, frequency 1", "beam, frequency 2"]
    assert found["beam, frequency 1"].values == pytest.approx(beam.modes.frequencies_hz[:1])
    assert found["beam, mass"].values == pytest.approx([0.17])
    alike = mesh_quantities(beam, like=beam)
    assert np.array_equal(alike["beam, frequency 3"].values, found["beam, frequency 3"].values)


def test_the_stress_is_the_largest_on_the_body_at_the_chosen_times(beam: Pipeline) -> None:
    (name, quantity), *others = stress_quantities(beam, beam.motion, np.array([0, 20, 40])).items()
    assert name == "beam, largest von Mises stress"
    assert quantity.values.shape == (3,)
    assert quantity.values[0] == 0.0
    assert not others
