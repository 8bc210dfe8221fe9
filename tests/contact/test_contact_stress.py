"""Stress of bodies that touch: with what forces of contact deform beside the modes."""

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.output.exports import nodal_stress_at
from fmd.recovery.stress import modal_stress
from tests.contact.test_contact_points import BLOCK

AT_REST = (
    'simulation.start="equilibrium"',
    'simulation.duration="2 ms"',
    'joint.free.position=["0 m", "50 mm", "0 m"]',
)


@pytest.fixture(scope="module")
def standing() -> Pipeline:
    """A block at rest on its face, with an element."""
    block = BLOCK["body"]["block"] | {"element": {"low": {"at": ["100 mm", "-40 mm", "10 mm"]}}}
    return Pipeline(load_scene(BLOCK | {"body": {"block": block}}, (*AT_REST, "contact.floor.friction=0.3")))


def stress_without_modes(run: Pipeline) -> Array:
    """Stress of the whole mesh under the first forces of contact and its weight, by a dense solver, (n_nodes, 6)."""
    part, motion = run.part, run.motion
    assert motion.touched is not None
    points = motion.mechanism.contacts[0].points
    f = np.zeros((len(part.fe.x), 3))
    f[points.nodes] = motion.touched.forces["block"][0]
    K, M, R = part.fe.K.toarray(), part.fe.M.toarray(), part.model.solver.rigid_modes
    f = f.ravel()
    f -= M @ R @ np.linalg.solve(R.T @ M @ R, R.T @ f)  # the weight, and what is left of its balance
    u = np.linalg.lstsq(K, f, rcond=1e-12)[0].reshape(-1, 3, 1)
    return modal_stress(part.space, part.material, u, np.arange(len(part.space.x)))[..., 0]


def test_stress_at_rest_is_that_of_the_whole_mesh_under_its_weight(standing: Pipeline) -> None:
    exact, surface = stress_without_modes(standing), standing.part.surface.nodes
    scale = np.abs(exact).max()
    np.testing.assert_allclose(standing.stress.tensor(0.0), exact[surface], atol=1e-4 * scale)
    np.testing.assert_allclose(nodal_stress_at(standing, "block", 0), exact, atol=1e-4 * scale)
    modes_alone = standing.part.surface_stress @ standing.motion.modal("block")[0]
    assert np.abs(modes_alone - exact[surface]).max() > 0.2 * scale


def test_stress_at_a_contact_is_its_pressure() -> None:
    """A block without lateral strain under its weight: ``σ = ρ g H`` below, 0 above, of each element the mean."""
    run = Pipeline(load_scene(BLOCK, (*AT_REST, "body.block.nu=0")))
    heights = run.part.space.x[run.part.surface.nodes, 1]
    below, above = heights < -49e-3, heights > 49e-3
    stress = run.stress.tensor(0.0)[:, 1] / (2700 * 9.81 * 0.1)
    np.testing.assert_allclose(stress[below], -5 / 6, atol=1e-6)  # three elements high
    np.testing.assert_allclose(stress[above], -1 / 6, atol=1e-6)


def test_stress_in_elements_and_deflections_have_the_contacts_part(standing: Pipeline) -> None:
    own = standing.contact_deformation("block", standing.motion)
    assert own is not None
    (element,) = standing.element_stress("block.low", "yy").values()
    assert element[0] == pytest.approx(-2700 * 9.81 * 0.1 * 5 / 6, rel=0.1)
    nodes = standing.part.contact_points.nodes
    moved = standing.deform("block", [0], nodes)[0] @ np.array([0.0, 1.0, 0.0])
    modal = standing.bodies["block"].shapes[nodes, 1] @ standing.motion.modal("block")[0]
    np.testing.assert_allclose(moved - modal, own.fields.shapes[nodes, 1] @ own.fields.sizes[0], atol=1e-15)
