"""Variants of a scene: what changes in each, and that all else stays."""

import pytest

from fmd.scene.runs import AutoRun
from fmd.scene.scene import Scene, load_scene
from fmd.scene.variants import (
    change_modes,
    change_simulation,
    coarsen_meshes,
    compare_element_sizes,
    enrich_bases,
    refine_meshes,
    replace_order,
)

TETRAHEDRA = 'body.beam.mesh={element="tetrahedron", size="6 mm"}'
MATRICES = {
    "shape": "matrices",
    "matrices": {"stiffness": "K.mtx", "mass": "M.mtx", "nodes": "n.csv", "unit": "m"},
    "modes": {"count": 3},
    "marker": {"a": {"nodes": [1]}},
}
OF_MATRICES = Scene.model_validate({"title": "From matrices", "body": {"part": MATRICES}})


def test_other_runs_take_the_place_of_the_scenes():
    scene = load_scene("beam")
    other = change_simulation(scene, run=(AutoRun(integrator="auto"),))
    assert [run.integrator for run in other.simulation.run] == ["auto"]
    assert other.simulation.duration == scene.simulation.duration
    assert other.file == scene.file


def test_another_error_changes_nothing_else():
    scene = load_scene("beam")
    assert change_simulation(scene, error=1e-5).simulation == scene.simulation.model_copy(update={"error": 1e-5})


def test_modes_are_changed_body_by_body():
    other = change_modes(load_scene("beam"), lambda body: {"count": 2 * body.modes.count})
    assert other.flexible["beam"].modes.count == 10


def test_a_richer_basis_has_load_dependent_vectors_and_then_more_modes():
    once = enrich_bases(load_scene("beam"))
    twice = enrich_bases(once)
    assert [(s.flexible["beam"].modes.enrich, s.flexible["beam"].modes.count) for s in (once, twice)] == [
        ("ritz", 5),
        ("ritz", 8),  # half of 5, rounded, and one more
    ]


def test_elements_of_another_order_are_those_of_meshes_alone():
    assert replace_order(load_scene("beam"), 1).flexible["beam"].mesh.order == 1
    assert replace_order(OF_MATRICES, 1) == OF_MATRICES


@pytest.mark.parametrize("factor", [1.3, 2.0, 3.1])
def test_a_refined_bar_has_even_numbers_of_elements_so_that_half_of_them_is_a_mesh(factor: float):
    finer = refine_meshes(load_scene("beam"), factor)
    assert finer is not None
    divisions = finer.flexible["beam"].mesh.divisions
    assert all(count % 2 == 0 for count in divisions)
    coarser = coarsen_meshes(finer)
    assert coarser is not None
    assert coarser.flexible["beam"].mesh.divisions == tuple(count // 2 for count in divisions)


def test_tetrahedra_are_refined_by_their_size():
    finer = refine_meshes(load_scene("beam", [TETRAHEDRA]), 2.0)
    assert finer is not None
    assert finer.flexible["beam"].mesh.size == 3e-3


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_propeller_keeps_the_width_of_its_joints(factor: float):
    other = refine_meshes(load_scene("propeller"), factor)
    assert other is not None
    propeller = other.flexible["propeller"]
    assert propeller.mesh.sleeve[0] % propeller.blades == 0
    assert propeller.mesh.joint[:2] == propeller.mesh.blade[:2]
    assert propeller.seat == pytest.approx(2 * 3.141592653589793 * 8 / 66)  # 8 of the 66 cells around


def test_what_cannot_be_coarser_or_finer_has_no_variant():
    assert coarsen_meshes(load_scene("beam", ["body.beam.mesh.divisions=[1, 1, 1]"])) is None
    assert refine_meshes(load_scene("rod-slider"), 2.0) is None
    assert refine_meshes(OF_MATRICES, 2.0) is None


def test_sizes_of_elements_are_compared_in_the_directions_that_are_divided():
    beam = load_scene("beam").flexible["beam"]  # 30 x 3 x 1: two directions
    assert compare_element_sizes(beam, 400, 100) == pytest.approx(2.0)
    propeller = load_scene("propeller").flexible["propeller"]
    assert compare_element_sizes(propeller, 800, 100) == pytest.approx(2.0)
