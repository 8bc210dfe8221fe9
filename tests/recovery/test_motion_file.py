"""The data set of a motion: names, units, values, and the same of every scene."""

import tracemalloc
from pathlib import Path

import numpy as np
import pint
import pytest
import xarray
from scipy.spatial.transform import Rotation

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.core.cache import Cache
from fmd.dynamics.links import Link, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.integrators.protocol import State, Trajectory
from fmd.recovery.motion import Motion
from fmd.recovery.motion_file import motion_dataset, write_motions
from fmd.reduction.body import MarkerShapes
from fmd.scene.joints.free import FREE
from fmd.scene.joints.revolute import REVOLUTE
from fmd.scene.joints.spherical import SPHERICAL

QUICK = ["body.beam.mesh.divisions=[12, 2, 1]", "simulation.duration=20 ms"]
NEVER_STILL = "joint.hub.damper=1e-12 N m s"


def trajectory(q: Array, v: Array) -> Trajectory:
    """Make up a trajectory: only times, coordinates and rates matter here."""
    return Trajectory("made up", 1.0, 1, np.arange(float(len(q))), q, v, 0, 0, 0.0, State(0, q[-1], v[-1], 0 * v[-1]))


@pytest.fixture(scope="module")
def run() -> Pipeline:
    return Pipeline(load_scene("beam-paper", QUICK))


@pytest.fixture(scope="module")
def dataset(run: Pipeline) -> xarray.Dataset:
    return motion_dataset(run.motions)


@pytest.fixture(scope="module")
def spatial() -> Motion:
    """A top on a free carrier, which share a name with its joint, at random states."""
    nothing = np.zeros((3, 0))
    markers = {"nose": MarkerShapes(np.array([0.5, 0.0, 0.0]), nothing, nothing)}
    integrals = rigid_integrals(2.0, np.array([0.1, 0.2, 0.0]), np.diag([0.5, 0.6, 0.7]))
    links = [
        Link("carrier", integrals, FREE, joint_name="drift", markers=markers),
        Link(
            "top",
            integrals,
            SPHERICAL,
            0,
            joint_name="top",
            markers=markers,
            place=MarkerShapes(np.array([0.0, 0.0, 1.0])),
        ),
        Link("wheel", integrals, REVOLUTE, 1, joint_name="axle", markers=markers),
    ]
    mechanism, rng = Mechanism(links), np.random.default_rng(4)
    q, v = rng.normal(size=(5, mechanism.n_positions)), rng.normal(size=(5, mechanism.n))
    for first in (mechanism.layout.position[0] + 3, mechanism.layout.position[1]):
        q[:, first : first + 4] /= np.linalg.norm(q[:, first : first + 4], axis=1)[:, None]
    return Motion(mechanism, trajectory(q, v), "top.nose")


def test_every_variable_has_a_unit_and_a_name(dataset: xarray.Dataset) -> None:
    registry = pint.UnitRegistry()
    numbers = [name for name, variable in dataset.variables.items() if variable.dtype.kind == "f"]
    assert set(dataset.data_vars) < set(numbers)
    for name in numbers:
        assert registry.Unit(dataset[name].attrs["units"]) is not None
        assert dataset[name].attrs["long_name"]
    assert {"time", "beam.mode"} < set(numbers)


def test_the_data_set_holds_each_run_by_its_label(run: Pipeline, dataset: xarray.Dataset) -> None:
    for label, motion in run.motions.items():
        one = dataset.sel(run=label)
        assert np.array_equal(one["hub.position"], motion.joint_position("hub"))
        assert np.array_equal(one["hub.rate"], motion.joint_rate("hub"))
        assert np.array_equal(one["beam.modal_coordinates"], motion.modal("beam"))
        assert np.array_equal(one["tip.position"], motion.tip_position)
        assert np.array_equal(one["beam.tip.position"], motion.tip_position)
        assert np.array_equal(one["beam.tip.deflection"], motion.tip_deflection)
        assert np.array_equal(one["kinetic_energy"], motion.energies[0])
        assert np.array_equal(one["potential_energy"], motion.energies[1])
        assert np.array_equal(one["momentum"], motion.kinematics.momentum)
        turns = Rotation.from_quat(one["beam.orientation"].to_numpy()).as_rotvec()
        assert turns[:, 2] == pytest.approx(motion.trajectory.q[:, 0], abs=1e-12)
    assert np.array_equal(dataset["beam.mode"], run.body.frequencies_hz)


def test_joints_in_space_have_orientations_and_angular_velocities(spatial: Motion) -> None:
    data = motion_dataset({"made up": spatial}).isel(run=0)
    layout, q, v = spatial.mechanism.layout, spatial.trajectory.q, spatial.trajectory.v
    first, rate = layout.position[0], layout.rate[0]
    assert np.array_equal(data["drift.displacement"], q[:, first : first + 3])
    assert np.array_equal(data["drift.orientation"], q[:, first + 3 : first + 7])
    assert np.array_equal(data["drift.velocity"], v[:, rate : rate + 3])
    assert np.array_equal(data["drift.angular_velocity"], v[:, rate + 3 : rate + 6])
    # The joint that shares the body's name steps back.
    of_joint = Rotation.from_quat(data["joint.top.orientation"].to_numpy())
    of_body = Rotation.from_quat(data["top.orientation"].to_numpy())
    carrier = Rotation.from_quat(data["carrier.orientation"].to_numpy())
    assert (carrier * of_joint).as_matrix() == pytest.approx(of_body.as_matrix(), abs=1e-12)
    assert data["axle.position"].units == "rad"
    nose = data["top.origin"].to_numpy() + of_body.apply([0.5, 0.0, 0.0])
    assert data["top.nose.position"].to_numpy() == pytest.approx(nose, abs=1e-12)
    assert "top.nose.deflection" not in data  # rigid


def test_a_damper_changes_no_name(run: Pipeline, dataset: xarray.Dataset) -> None:
    damped = Pipeline(load_scene("beam-paper", [*QUICK, NEVER_STILL]))
    other = motion_dataset(damped.motions)
    assert list(other.variables) == list(dataset.variables)
    assert [other[name].attrs for name in other] == [dataset[name].attrs for name in dataset]
    for name in ("hub.position", "beam.modal_coordinates", "kinetic_energy", "tip.position"):
        one, two = (data[name].to_numpy()[0] for data in (dataset, other))
        assert two == pytest.approx(one, abs=1e-6 * np.abs(one).max())


def test_the_file_holds_what_xarray_would_write(run: Pipeline, dataset: xarray.Dataset, tmp_path: Path) -> None:
    dataset.to_netcdf(tmp_path / "by-xarray.nc", engine="scipy")
    write_motions(run.motions, tmp_path / "motion.nc")
    names = (tmp_path / "motion.nc", tmp_path / "by-xarray.nc")
    back, reference = (xarray.load_dataset(name, engine="scipy") for name in names)
    xarray.testing.assert_identical(back, reference)
    assert back.equals(dataset)
    assert back.sizes == reference.sizes
    for name in dataset.variables:
        assert {key: back[name].attrs[key] for key in dataset[name].attrs} == dataset[name].attrs
        assert back[name].dtype == reference[name].dtype


def test_a_long_motion_is_written_piece_by_piece(tmp_path: Path) -> None:
    """The file has as many numbers as memory never holds, and pieces have the numbers of the whole."""
    long = Pipeline(load_scene("rod-slider", ["simulation.duration=1 s", "simulation.output_step=50 us"]), Cache(None))
    motions = long.motions
    tracemalloc.start()
    write_motions(motions, tmp_path / "motion.nc")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    size = (tmp_path / "motion.nc").stat().st_size
    assert size > 1.5e7
    assert peak < size / 2
    whole, back = motion_dataset(motions), xarray.load_dataset(tmp_path / "motion.nc", engine="scipy")
    for name in whole.variables:
        if whole[name].dtype.kind == "f":
            assert np.allclose(back[name], whole[name], rtol=1e-12, atol=1e-14)
