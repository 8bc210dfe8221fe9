"""Frequency responses of reduced scenes against harmonic solutions of the whole finite element model."""

from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.linalg import splu

from fmd.core.arrays import Array
from fmd.recovery.stress import element_stress
from fmd.scene.scene import load_scene
from fmd.stages.linear_model import linearise_scene
from fmd.stages.part import FlexiblePart
from fmd.stages.pipeline import Pipeline

ALPHA, BETA = 40.0, 2e-6
RAYLEIGH = f'body.plate.modes.damping={{ alpha = "{ALPHA} 1/s", beta = "{BETA} s" }}'


def harmonic_fields(part: FlexiblePart, force: Array, frequencies: Array) -> Array:
    """Solve ``(K − ω² M + iω (α M + β K)) u = f`` with what supports hold left out, (n_frequencies, n_nodes, 3)."""
    fe, n = part.fe, part.fe.K.shape[0]
    free = np.setdiff1d(np.arange(n), part.fixed)
    K, M = (matrix.tocsr()[free][:, free] for matrix in (fe.K, fe.M))
    found = np.zeros((len(frequencies), n), dtype=complex)
    for row, omega in zip(found, 2 * np.pi * frequencies, strict=True):
        dynamic = (1 + 1j * omega * BETA) * K + (1j * omega * ALPHA - omega**2) * M
        row[free] = splu(dynamic.tocsc()).solve(force[free].astype(complex))
    return found.reshape(len(frequencies), -1, 3)


@pytest.fixture(scope="module")
def plate() -> Pipeline:
    return Pipeline(load_scene("plate", ["body.plate.mesh.divisions=[6, 4, 2]", RAYLEIGH]))


def test_displacement_and_stress_are_those_of_the_whole_model_up_to_half_the_highest_mode(plate: Pipeline) -> None:
    linear = linearise_scene(plate, ["plate.side.z"], ["plate.tip.z", "plate.tip.rx", "plate.side.z", "plate.root.xx"])
    part = plate.part
    highest = part.modes.frequencies_hz[-1] / 2
    frequencies = highest * np.array([0.001, 0.1, 0.35, 0.6, 0.8, 1.0])
    columns = {
        name: marker.columns(len(part.space.x), np.eye(3)).reshape(-1, 6) for name, marker in part.markers.items()
    }
    u = harmonic_fields(part, columns["side"][:, 2], frequencies)
    flat = u.reshape(len(frequencies), -1)
    element = np.array([part.elements["root"]])
    fields = np.moveaxis(u, 0, -1)
    stress = sum(
        factor * element_stress(part.space, part.material, of, element)[0, 0]
        for factor, of in ((1.0, fields.real.copy()), (1j, fields.imag.copy()))
    )
    expected = [flat @ columns["tip"][:, 2], flat @ columns["tip"][:, 3], flat @ columns["side"][:, 2], stress]
    found = linear.frequency_response(frequencies)[:, :, 0].T
    for ours, theirs in zip(found, expected, strict=True):
        # Beside a zero, as the tip has one at half the highest mode, the share is that of a hundredth of the response
        # at rest.
        error = np.abs(ours - theirs) / np.maximum(np.abs(theirs), 0.01 * np.abs(theirs[0]))
        np.testing.assert_allclose(error, 0.0, atol=5e-3)
    np.testing.assert_allclose(found[:, 0], np.array(expected)[:, 0], rtol=1e-5)  # statically exact


def test_a_shaken_ground_does_what_forces_of_inertia_do(plate: Pipeline) -> None:
    linear = linearise_scene(plate, ["ground.z"], ["plate.tip.z"])
    part = plate.part
    frequencies = np.array([1.0, 60.0, 250.0, 500.0, 900.0])
    force = -part.fe.M @ np.tile([0.0, 0.0, 1.0], len(part.space.x))
    u = harmonic_fields(part, force, frequencies).reshape(len(frequencies), -1)
    expected = u @ part.markers["tip"].columns(len(part.space.x), np.eye(3)).reshape(-1, 6)[:, 2]
    found = linear.frequency_response(frequencies)[:, 0, 0]
    np.testing.assert_allclose(np.abs(found - expected) / np.abs(expected), 0.0, atol=2e-3)


def test_a_prescribed_motion_of_the_ground_is_its_acceleration_seen_from_space(tmp_path: Path) -> None:
    # The plate on a slide whose position is prescribed moves in space as it does on shaken ground, and with it.
    text = (Path(__file__).parents[2] / "models" / "plate.toml").read_text(encoding="utf-8")
    text = text.replace('type = "fixed"', 'type = "prismatic"\naxis = [0, 0, 1]').replace("[12, 8, 2]", "[6, 4, 2]")
    shake = '[drive.shake]\ntype = "motion"\njoint = "clamp"\nposition = { formula = "0.001*t**2", unit = "m" }\n'
    file = tmp_path / "shaken.toml"
    file.write_text(text.replace("[simulation]", f"{shake}\n[simulation]", 1), encoding="utf-8")
    frequencies = np.array([5.0, 60.0, 250.0, 500.0])
    outputs = ["plate.tip.z", "plate.root.xx"]
    moved = linearise_scene(Pipeline(load_scene(file)), ["drive.shake"], [*outputs, "clamp.position"])
    fixed = Pipeline(load_scene("plate", ["body.plate.mesh.divisions=[6, 4, 2]"]))
    shaken = linearise_scene(fixed, ["ground.z"], outputs)
    by_position = moved.frequency_response(frequencies)[:, :, 0]
    by_ground = -((2 * np.pi * frequencies) ** 2)[:, None] * shaken.frequency_response(frequencies)[:, :, 0]
    np.testing.assert_allclose(by_position[:, 0], 1.0 + by_ground[:, 0], rtol=1e-4)
    np.testing.assert_allclose(by_position[:, 1], by_ground[:, 1], rtol=1e-4)
    np.testing.assert_allclose(by_position[:, 2], 1.0, rtol=1e-12)
    assert moved.input_names(as_positions=True) == [("drive.shake", "m")]
    assert moved.model.inputs[0].unit == "m/s^2"
