"""Families of modes: named after their own symmetry, whatever the order of the list and the direction of the bar."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError
from fmd.fem.assembly import assemble
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.meshes.bar import hexahedral_bar, tetrahedral_bar
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.mode_families import classify_modes, lowest_modes, modes_of_family
from fmd.reduction.modes import EigenPairs, TooManyModesError

Z = np.array([0.0, 0.0, 1.0])
SIZES = (0.3, 0.04, 0.02)


@pytest.fixture(scope="module")
def pairs(small_bar: FEModel) -> EigenPairs:
    return FreeBodySolver(small_bar).modes(16)


@pytest.fixture(scope="module")
def families(small_bar: FEModel, pairs: EigenPairs) -> list[str]:
    return classify_modes(small_bar, pairs, Z)[0]


def moved(fe: FEModel, turn: Array) -> FEModel:
    """Turn a body about the origin."""
    mesh = fe.discretisation.mesh
    turned = SolidMesh(mesh.points @ turn.T, mesh.cells.copy(), mesh.cell_type, {}, {})
    return assemble(turned, fe.discretisation.order, fe.material)


def random_rotation(seed: int) -> Array:
    turn = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]
    return turn * np.linalg.det(turn)


def test_each_family_has_the_frequencies_of_its_beam_theory(
    pairs: EigenPairs, families: list[str], steel: Material, timoshenko: Callable[..., Any]
) -> None:
    length, depth, width = SIZES
    speed = np.sqrt(steel.E / steel.rho)
    # Torsion: c = √(G J_t / ρ J_p) with Saint-Venant's J_t of a rectangle 2:1, 0.2287 d w³ (Timoshenko & Goodier)
    twist = speed * np.sqrt(0.2287 * depth * width**3 / (2.6 * depth * width * (depth**2 + width**2) / 12))
    theory = {
        "in-plane bending": timoshenko(length, depth, width, steel).frequencies_hz(2),
        "out-of-plane bending": timoshenko(length, width, depth, steel).frequencies_hz(2),
        "axial": np.array([speed / (2 * length)]),
        "torsion": np.array([twist / (2 * length)]),
    }
    for family, exact in theory.items():
        found = pairs.omega[[name == family for name in families]] / (2 * np.pi)
        assert found[: len(exact)] == pytest.approx(exact, rel=0.03)


@pytest.mark.parametrize("seed", range(3))
def test_families_do_not_depend_on_the_order_of_the_list(
    small_bar: FEModel, pairs: EigenPairs, families: list[str], seed: int
) -> None:
    order = np.random.default_rng(seed).permutation(len(families))
    shuffled = EigenPairs(pairs.omega[order], pairs.shapes[:, :, order], 6, pairs.residual)
    found, shapes = classify_modes(small_bar, shuffled, Z)
    assert found == [families[k] for k in order]
    assert np.array_equal(shapes, shuffled.shapes)


def test_a_mode_has_its_family_without_the_others_too(
    small_bar: FEModel, pairs: EigenPairs, families: list[str]
) -> None:
    for k, family in enumerate(families):
        alone = EigenPairs(pairs.omega[[k]], pairs.shapes[:, :, [k]], 6, pairs.residual)
        assert classify_modes(small_bar, alone, Z)[0] == [family]


@pytest.mark.parametrize(
    "turn",
    [
        pytest.param(np.eye(3)[[2, 0, 1]], id="along y"),
        pytest.param(np.eye(3)[[1, 2, 0]], id="along z"),
        pytest.param(random_rotation(0), id="oblique"),
        pytest.param(random_rotation(1), id="oblique too"),
    ],
)
def test_families_turn_with_the_bar(small_bar: FEModel, families: list[str], turn: Array) -> None:
    fe = moved(small_bar, turn)
    found, _ = classify_modes(fe, FreeBodySolver(fe).modes(16), 3.0 * turn @ Z)
    assert found == families


def test_the_planes_of_bending_change_places_with_the_normal(
    small_bar: FEModel, pairs: EigenPairs, families: list[str]
) -> None:
    swap = {"in-plane bending": "out-of-plane bending", "out-of-plane bending": "in-plane bending"}
    found, _ = classify_modes(small_bar, pairs, np.array([0.0, 1.0, 0.0]))
    assert found == [swap.get(family, family) for family in families]


def test_tetrahedra_have_the_same_families(
    small_bar: FEModel, pairs: EigenPairs, families: list[str], steel: Material
) -> None:
    fe = assemble(SolidMesh(*tetrahedral_bar(*SIZES, 0.02)), 2, steel)
    other = FreeBodySolver(fe).modes(8)
    assert classify_modes(fe, other, Z)[0] == families[:8]
    assert other.omega == pytest.approx(pairs.omega[:8], rel=0.03)


@pytest.fixture(scope="module")
def square_bar(steel: Material) -> FEModel:
    return assemble(SolidMesh(*hexahedral_bar(0.2, 0.02, 0.02, (8, 2, 2))), 2, steel)


def test_pairs_of_a_square_bar_are_parted_into_the_two_planes(square_bar: FEModel) -> None:
    pairs = FreeBodySolver(square_bar).modes(15)  # the highest is one of a pair, and both are there
    families, shapes = classify_modes(square_bar, pairs, Z)
    x = square_bar.x
    # a mode that mirrors in the plane of bending has no displacement out of that plane
    for family, axis, across in (("in-plane bending", 2, 1), ("out-of-plane bending", 1, 2)):
        chosen = shapes[..., [name == family for name in families]]
        assert chosen.shape[2] >= 4
        size = np.abs(chosen).max(axis=(0, 1))
        assert (np.abs(chosen[np.abs(x[:, axis]) < 1e-9, axis]).max(axis=0) < 1e-7 * size).all()
        assert (np.abs(chosen[np.abs(x[:, axis]) < 1e-9, across]).max(axis=0) > 0.1 * size).all()
    # turned within their subspace, they are still modes
    Phi = shapes.reshape(square_bar.K.shape[0], -1)
    assert np.abs(Phi.T @ square_bar.M @ Phi - np.eye(15)).max() < 1e-9
    assert np.abs(Phi.T @ square_bar.K @ Phi / pairs.omega**2 - np.eye(15)).max() < 1e-5


@pytest.mark.parametrize("turn", [np.eye(3), random_rotation(2)], ids=["along x", "oblique"])
def test_pairs_of_a_square_bar_have_equal_frequencies_in_both_planes(square_bar: FEModel, turn: Array) -> None:
    fe = moved(square_bar, turn)
    solver = FreeBodySolver(fe)
    across = [modes_of_family(solver, fe, 3, f"{plane} bending", turn @ Z) for plane in ("in-plane", "out-of-plane")]
    assert across[0].omega == pytest.approx(across[1].omega, rel=1e-8)
    assert not set(across[0].numbers) & set(across[1].numbers)


def test_the_chosen_modes_are_the_lowest_of_their_family(
    small_bar: FEModel, pairs: EigenPairs, families: list[str]
) -> None:
    places = [k for k, name in enumerate(families) if name == "in-plane bending"][:3]
    chosen = modes_of_family(FreeBodySolver(small_bar), small_bar, 3, "in-plane bending", Z)
    assert chosen.numbers == tuple(k + 1 for k in places)
    assert chosen.omega == pytest.approx(pairs.omega[places], rel=1e-9)
    assert chosen.frequencies_hz == pytest.approx(pairs.omega[places] / (2 * np.pi), rel=1e-9)
    assert chosen.n_rigid == 6
    assert chosen.dofs == small_bar.K.shape[0]


def test_modes_of_any_family_are_the_lowest(small_bar: FEModel, pairs: EigenPairs) -> None:
    modes = lowest_modes(FreeBodySolver(small_bar), 5)
    assert modes.numbers == (1, 2, 3, 4, 5)
    assert modes.omega == pytest.approx(pairs.omega[:5], rel=1e-9)


def test_more_modes_are_computed_until_the_family_is_complete(steel: Material) -> None:
    # (βL)² = π √12 L/d at the first axial frequency: for L/d = 75 each of the two planes bends eight times below it,
    # and eight modes are tried at first.
    fe = assemble(SolidMesh(*hexahedral_bar(1.5, 0.02, 0.02, (30, 1, 1))), 2, steel)
    axial = modes_of_family(FreeBodySolver(fe), fe, 1, "axial", Z)
    assert axial.numbers[0] > 16
    assert axial.frequencies_hz == pytest.approx([np.sqrt(steel.E / steel.rho) / (2 * 1.5)], rel=1e-3)


def test_a_family_that_does_not_come_is_refused(steel: Material) -> None:
    # A plate of thickness h bends about A k²/4π times before it stretches at k² = √12 π/(L h) (Weyl): 87 times here,
    # and 64 modes are tried.
    fe = assemble(SolidMesh(*hexahedral_bar(1.0, 0.8, 0.008, (10, 8, 1))), 2, steel)
    with pytest.raises(TooManyModesError, match=r"^only 0 axial modes are among the 64 lowest; take another family$"):
        modes_of_family(FreeBodySolver(fe), fe, 1, "axial", Z)


def test_more_modes_than_the_mesh_has_are_refused(steel: Material) -> None:
    # 4 × 2 × 2 nodes have 48 unknowns: 42 elastic modes, and a fourth of 48, less the turn about x, mirror like torsion
    fe = assemble(SolidMesh(*hexahedral_bar(0.3, 0.1, 0.05, (3, 1, 1))), 1, steel)
    with pytest.raises(TooManyModesError, match=r"^only 11 torsion modes are among the 42 lowest; take at most 11$"):
        modes_of_family(FreeBodySolver(fe), fe, 20, "torsion", Z)


def test_a_body_that_is_not_symmetric_is_refused(box_mesh: Callable[..., SolidMesh], steel: Material) -> None:
    box = box_mesh("hexahedron", (6, 3, 2), (0.3, 0.06, 0.04))
    middle = box.points[box.cells].mean(axis=1)
    keep = (middle[:, 0] > 0.1) | (middle[:, 1] < 0.02)  # an L: symmetric in z, not in y
    used, cells = np.unique(box.cells[keep], return_inverse=True)
    fe = assemble(SolidMesh(box.points[used], cells.reshape(-1, 8), "hexahedron", {}, {}), 2, steel)
    message = r"not symmetric about the plane with normal \[.*\] \(\d\.\d\de-\d\d m off\).*use family = \"any\""
    with pytest.raises(AccuracyError, match=message):
        modes_of_family(FreeBodySolver(fe), fe, 2, "in-plane bending", Z)


@pytest.mark.parametrize("seed", range(3))
def test_four_families_of_one_frequency_are_parted(
    small_bar: FEModel, pairs: EigenPairs, families: list[str], seed: int
) -> None:
    """Mix one mode of each family at random, as a solver would that finds them at the same frequency."""
    names = ["in-plane bending", "out-of-plane bending", "torsion", "axial"]
    chosen = pairs.shapes[..., [families.index(name) for name in names]]
    mix = np.linalg.qr(np.random.default_rng(seed).standard_normal((4, 4)))[0]
    found, shapes = classify_modes(small_bar, EigenPairs(np.ones(4), chosen @ mix, 6, 0.0), Z)
    assert sorted(found) == sorted(names)
    order = [found.index(name) for name in names]
    assert np.abs(np.abs(shapes[..., order]) - np.abs(chosen)).max() < 1e-6 * np.abs(chosen).max()


FIELDS = {
    "in-plane bending": lambda x: x[:, [0]] ** 2 * [0, 1, 0],
    "out-of-plane bending": lambda x: x[:, [0]] ** 2 * [0, 0, 1],
    "axial": lambda x: x * [1, -0.3, -0.3],
    "torsion": lambda x: x[:, [0]] * np.stack([0 * x[:, 0], -x[:, 2], x[:, 1]], axis=1),
    "other": lambda x: x[:, [1]] * [1, 0, 0],  # mirrors like bending in the plane, but shears lengthwise
}


@pytest.mark.parametrize("family", FIELDS)
@pytest.mark.parametrize("turn", [np.eye(3), random_rotation(3)], ids=["along x", "oblique"])
def test_a_field_has_the_family_of_its_formula(small_bar: FEModel, family: str, turn: Array) -> None:
    fe = moved(small_bar, turn)
    u = FIELDS[family](small_bar.x - [0.15, 0, 0]) @ turn.T
    u /= np.sqrt(np.einsum("ia,ia->", u, fe.m @ u))
    assert classify_modes(fe, EigenPairs(np.ones(1), u[:, :, None], 6, 0.0), turn @ Z)[0] == [family]


def test_a_field_between_two_families_has_none(small_bar: FEModel) -> None:
    u = FIELDS["in-plane bending"](small_bar.x) + FIELDS["out-of-plane bending"](small_bar.x)
    u /= np.sqrt(np.einsum("ia,ia->", u, small_bar.m @ u))
    assert classify_modes(small_bar, EigenPairs(np.ones(1), u[:, :, None], 6, 0.0), Z)[0] == ["other"]


def test_a_mode_whose_twin_was_not_looked_for_is_not_taken(square_bar: FEModel) -> None:
    """Of the eight lowest the last is one of a pair, in any plane; the second in-plane one has to wait for its twin."""
    bending = modes_of_family(FreeBodySolver(square_bar), square_bar, 1, "in-plane bending", Z)
    middle = np.abs(square_bar.x[:, 2]) < 1e-9
    assert np.abs(bending.shapes[middle, 2]).max() < 1e-7 * np.abs(bending.shapes).max()
    all_of_them = FreeBodySolver(square_bar).modes(16)
    for count in (2, 3, 4):
        bending = modes_of_family(FreeBodySolver(square_bar), square_bar, count, "in-plane bending", Z)
        assert np.abs(bending.shapes[middle, 2]).max() < 1e-7 * np.abs(bending.shapes).max()
        assert np.abs(all_of_them.omega[:, None] / bending.omega - 1).min(axis=0).max() < 1e-8
