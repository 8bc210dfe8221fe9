"""What a run computes of a body's inertia and geometric stiffness: what its motion takes, and the rest for a file."""

from pathlib import Path

import numpy as np
import pytest

import fmd.reduction.inertia
import fmd.reduction.stiffening
from fmd import Pipeline, load_scene
from fmd.core.cache import Cache
from fmd.output.exports import write_export
from fmd.reduction.body_file import load_body
from fmd.reduction.inertia import inertia_integrals

QUICK = ["body.beam.mesh.divisions=[12,1,1]", "simulation.duration=0.01s", 'simulation.stiffening="on"']
EXPORT = [*QUICK, 'output=[{type="export",body="beam",file="body.nc"}]']


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, ...]]:
    """Shapes of the two factors of each product of inertia, and of the displacements that stiffen."""
    found: list[tuple[int, ...]] = []
    products, stiffness = fmd.reduction.inertia._products, fmd.fem.geometric_stiffness.geometric_stiffness

    def counted_products(some, m, others):
        found.append((some.shape[1], others.shape[1]))
        return products(some, m, others)

    def counted_stiffness(fe, u):
        found.append(u.shape[1:])
        return stiffness(fe, u)

    monkeypatch.setattr(fmd.reduction.inertia, "_products", counted_products)
    monkeypatch.setattr(fmd.fem.geometric_stiffness, "geometric_stiffness", counted_stiffness)
    return found


def test_a_planar_run_takes_two_axes_of_inertia_and_few_loads_of_stiffness(asked, tmp_path: Path) -> None:
    # Rotation, the hub's torque, three accelerations for its reactions, three forces and three torques at the tip.
    run = Pipeline(load_scene("beam-paper", QUICK), Cache(tmp_path))
    assert run.motion.modal("beam").any()
    assert run.body.integrals.stiffening.any()
    assert asked == [(2, 2), (3, 11)]


def test_a_body_file_adds_what_is_lacking_and_keeps_it(asked, tmp_path: Path) -> None:
    for again in range(2):
        run = Pipeline(load_scene("beam-paper", EXPORT), Cache(tmp_path / "cache"))
        before = run.motion.modal("beam")
        write_export(run, run.scene.output[0], tmp_path)
        assert asked == [(2, 2), (3, 11), (1, 3)]
        assert ("inertia" in run.log.cached) == bool(again)
        assert run.body.integrals.normal == 2  # left as it was
    written = load_body(tmp_path / "body.nc").body
    want = inertia_integrals(run.body.x, run.part.fe.m, run.body.shapes).G.copy()
    want[:, :, 1:, 1:] -= run.body.integrals.stiffening
    assert np.abs(written.integrals.G - want).max() < 1e-14 * np.abs(want).max()
    assert written.integrals.mass_matrix(np.eye(1, 1 + len(run.body.omega))[0])[2, 2] == run.body.integrals.mass
    assert np.array_equal(before, run.motion.modal("beam"))


def test_a_body_that_may_move_in_other_ways_has_them_all(asked) -> None:
    assert Pipeline(load_scene("arm"), Cache(None)).parts["forearm"].body.integrals.normal == -1  # its elbow moves
    assert Pipeline(load_scene("beam-paper", ["joint.hub.axis=[0,1,1]"])).part.joint.normal == -1
    assert asked[0] == (3, 3)
