"""Ties of shells: patch tests, plates glued edge to edge and face to face, a rib, and faces that can't be tied."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import lsqr

from fmd.core.arrays import Array, IntArray
from fmd.core.rotations import rigid_motions, rotation_matrix
from fmd.fem.assembly import assemble
from fmd.fem.connections import Connections, TiedFaces
from fmd.fem.deck_links import find_deck_links
from fmd.fem.links import LinkedModel, link_points
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.reduction.eigen import FreeBodySolver
from tests.fem.sheets import shell_mesh, unit_grid

METAL = Material(70e9, 0.33, 2700.0)


def sheet(
    n: tuple[int, int], element: str, low: tuple[float, float], high: tuple[float, float], seed: int | None = None
) -> tuple[Array, IntArray]:
    """Nodes and cells of a rectangle in the plane z = 0, inner nodes moved at random if there is a seed."""
    p, cells = unit_grid(*n, element)
    if seed is not None:
        moved = np.random.default_rng(seed).uniform(-0.25, 0.25, p.shape) / n
        p = p + np.where((p > 0) & (p < 1), moved, 0.0)
    return np.column_stack([np.array(low) + p * (np.array(high) - low), np.zeros(len(p))]), cells


def two(one: tuple[Array, IntArray], other: tuple[Array, IntArray], thickness: float, **faces: IntArray) -> SolidMesh:
    cells = np.concatenate([one[1], len(one[0]) + other[1]])
    return shell_mesh(np.concatenate([one[0], other[0]]), cells, thickness, **faces)


def tied(mesh: SolidMesh, face: IntArray, onto: IntArray, within: float | None = None) -> LinkedModel:
    tie = TiedFaces("tie 1", np.union1d(face, onto), face, onto, within)
    fe = assemble(mesh, 1, METAL)
    return link_points(fe, find_deck_links(Connections(ties=(tie,)), fe))


def hz(fe: FEModel, count: int) -> Array:
    return np.asarray(FreeBodySolver(fe).modes(count).omega / (2 * np.pi))


@pytest.mark.parametrize("element", ["quadrilateral", "triangle"])
@pytest.mark.parametrize("counts", [(3, 5), (5, 3), (3, 4)], ids=["finer onto", "finer follows", "alike"])
def test_constant_strain_and_constant_bending_pass_a_tie_exactly(element: str, counts: tuple[int, int]) -> None:
    one = sheet((3, counts[0]), element, (0.0, 0.0), (1.0, 1.0), 1)
    other = sheet((4, counts[1]), element, (1.0, 0.0), (2.0, 1.0), 2)
    n = len(one[0])
    onto, face = (np.flatnonzero(np.abs(x[:, 0] - 1.0) < 1e-9) for x, _ in (one, other))
    flat = two(one, other, 0.05)
    R = rotation_matrix(np.array([[0.3, -0.8, 0.5]]))[0]
    fe = tied(two((one[0] @ R.T, one[1]), (other[0] @ R.T, other[1]), 0.05), n + face, onto)
    assert flat.midsurface is not None
    z, plane = np.split(np.concatenate([flat.points, flat.midsurface.nodes])[:, [2, 0, 1]], [1], axis=1)
    edge = np.abs(plane * (plane - [2.0, 1.0])).min(axis=1) < 1e-9
    shown = sp.csc_array(fe.T[np.flatnonzero(np.repeat(edge, 3))])
    inner = np.diff(shown.indptr) == 0
    for strain in np.array([[[1.0, 0], [0, 0]], [[0, 0], [0, 1.0]], [[0, 0.5], [0.5, 0]]]):
        stretched = np.column_stack([plane @ strain, 0 * z])
        bent = np.column_stack([-z * (plane @ strain), 0.5 * np.einsum("ni,ij,nj->n", plane, strain, plane)])
        for field in (stretched, bent):
            u = (field @ R.T).ravel()
            y = lsqr(fe.T, u, atol=1e-15, btol=1e-15)[0]
            assert np.abs(fe.T @ y - u).max() < 1e-9 * np.abs(u).max()  # the tie lets it be
            assert np.abs((fe.T.T @ (fe.K @ u))[inner]).max() < 1e-9 * np.abs(fe.K @ u).max()


def on_one(mesh: SolidMesh) -> SolidMesh:
    """The mesh with nodes at one place made one."""
    assert mesh.midsurface is not None
    k = mesh.cells.shape[1] // 2
    x, cells = mesh.midsurface.nodes, mesh.midsurface.owner[mesh.cells[:, :k]]
    _, first, place = np.unique(np.round(x, 9), axis=0, return_index=True, return_inverse=True)
    return shell_mesh(x[first], place.ravel()[cells], 0.004)


@pytest.mark.parametrize("element", ["quadrilateral", "triangle"])
def test_plates_tied_edge_to_edge_are_one_plate(element: str) -> None:
    one = sheet((12, 10), element, (0.0, 0.0), (0.6, 0.4))
    other = sheet((8, 7), element, (0.6, 0.0), (1.0, 0.4))
    wanted = hz(assemble(shell_mesh(*sheet((20, 8), element, (0.0, 0.0), (1.0, 0.4)), 0.02), 1, METAL), 6)
    onto, face = (np.flatnonzero(np.abs(x[:, 0] - 0.6) < 1e-9) for x, _ in (one, other))
    found = hz(tied(two(one, other, 0.02), len(one[0]) + face, onto), 6)
    assert found == pytest.approx(wanted, rel=5e-3)
    back = hz(tied(two(one, other, 0.02), onto, len(one[0]) + face), 6)
    assert back == pytest.approx(found, rel=1e-4)


@pytest.mark.parametrize("gap", [0.0, 0.002], ids=["to the middle", "to the face"])
def test_a_rib_on_a_plate_is_as_if_it_had_its_nodes(gap: float) -> None:
    """The plate's half thickness counts beside a distance that is given."""
    plate, (x, cells) = (
        sheet((16, 10), "quadrilateral", (-0.15, 0.0), (0.15, 0.2)),
        sheet((5, 10), "quadrilateral", (0.0, 0.0), (0.1, 0.2)),
    )
    finer = sheet((5, 13), "quadrilateral", (0.0, 0.0), (0.1, 0.2))
    upright = np.column_stack([0 * x[:, 0], x[:, 1], x[:, 0]])
    wanted = hz(assemble(on_one(two(plate, (upright, cells), 0.004)), 1, METAL), 6)
    rib = np.column_stack([0 * finer[0][:, 0], finer[0][:, 1], gap + finer[0][:, 0] * (0.1 - gap) / 0.1])
    n = len(plate[0])
    fe = tied(two(plate, (rib, finer[1]), 0.004), n + np.flatnonzero(rib[:, 2] < gap + 1e-9), np.arange(n), 1e-6)
    assert hz(fe, 6) == pytest.approx(wanted, rel=3e-3 if gap == 0.0 else 2.5e-2)
    rigid = rigid_motions(fe.x).reshape(-1, 6)
    assert np.abs(fe.K @ rigid).max() < 1e-6 * np.abs(fe.K.data).max()
    assert (
        np.abs(fe.T @ np.column_stack([lsqr(fe.T, r, atol=1e-15, btol=1e-15)[0] for r in rigid.T]) - rigid).max() < 1e-9
    )


def test_all_edges_of_a_sheet_may_be_named_where_one_is_near() -> None:
    """A triangle in a corner has all its nodes on them, and is no face; of sides away from it only an end is near."""
    (one, cells), (other, more) = (
        sheet((6, 5), "quadrilateral", (0.0, 0.0), (0.6, 0.4)),
        sheet((4, 3), "quadrilateral", (0.6, 0.0), (1.0, 0.4)),
    )
    halves = [np.concatenate([each[:, [0, 1, 2]], each[:, [0, 2, 3]]]) for each in (cells, more)]
    mesh = two((one, halves[0]), (other, halves[1]), 0.02)
    near = [np.flatnonzero(np.abs(x[:, 0] - 0.6) < 1e-9) for x in (one, other)]
    ends = [
        np.flatnonzero((np.ptp(x, axis=0) * (x - x.min(axis=0)) * (x.max(axis=0) - x))[:, :2].min(axis=1) < 1e-9)
        for x in (one, other)
    ]
    assert any(np.isin(each, ends[0]).all() for each in halves[0])
    wanted = hz(tied(mesh, len(one) + near[1], near[0]), 6)
    assert hz(tied(mesh, len(one) + ends[1], ends[0]), 6) == pytest.approx(wanted, rel=1e-9)


def test_a_narrow_sheet_on_a_long_edge_holds_either_way() -> None:
    one, other = (
        sheet((6, 10), "quadrilateral", (0.0, 0.0), (0.6, 0.4)),
        sheet((4, 4), "quadrilateral", (0.6, 0.07), (1.0, 0.23)),
    )
    n, mesh = len(one[0]), two(one, other, 0.02)
    onto, face = (np.flatnonzero(np.abs(x[:, 0] - 0.6) < 1e-9) for x, _ in (one, other))
    whole, part = tied(mesh, n + face, onto), tied(mesh, onto, n + face)  # 0.16 of 0.4 m, and a thickness at each end
    assert hz(whole, 6) == pytest.approx(hz(part, 6), rel=1e-2)
    assert (whole.part_ties, part.part_ties) == ({}, {"tie 1": pytest.approx(0.5, abs=0.01)})


def test_two_sheets_glued_on_their_faces_are_one_of_both_thicknesses() -> None:
    one = sheet((20, 8), "quadrilateral", (0.0, 0.0), (1.0, 0.4))
    x, cells = sheet((23, 9), "quadrilateral", (0.0, 0.0), (1.0, 0.4))
    n = len(one[0])
    fe = tied(two(one, (x + np.array([0, 0, 0.01]), cells), 0.01), n + np.arange(len(x)), np.arange(n))
    wanted = hz(assemble(shell_mesh(*one, 0.02), 1, METAL), 6)
    assert hz(fe, 6) == pytest.approx(wanted, rel=5e-3)


def test_sheets_that_are_thin_beside_their_elements_are_glued_by_the_sides_that_face_each_other() -> None:
    """Their backs are within a tenth of an element, too."""
    one, (x, cells) = (sheet(n, "quadrilateral", (0.0, 0.0), (1.0, 0.4)) for n in ((10, 4), (11, 5)))
    n = len(one[0])
    mesh = two(one, (x + np.array([0, 0, 1e-3]), cells), 1e-3)
    wanted = hz(assemble(shell_mesh(*one, 2e-3), 1, METAL), 3)
    for face, onto in ((n + np.arange(len(x)), np.arange(n)), (np.arange(n), n + np.arange(len(x)))):
        assert hz(tied(mesh, face, onto), 3) == pytest.approx(wanted, rel=2e-2)


def test_sheets_that_cant_be_tied_are_refused() -> None:
    one = sheet((2, 2), "quadrilateral", (0.0, 0.0), (1.0, 1.0))
    x, cells = sheet((2, 2), "quadrilateral", (1.0, 0.0), (2.0, 1.0))
    mesh = two(one, (x + np.array([0.3, 0, 0]), cells), 0.01)
    onto, face = np.array([6, 7, 8]), 9 + np.array([0, 1, 2])
    with pytest.raises(ValueError, match=r"tie 1: its faces don't lie against each other; they come as near as 0.3 m"):
        tied(mesh, face, onto)
    assert hz(tied(mesh, face, onto, 0.31), 1)[0] > 1.0
    with pytest.raises(ValueError, match="tie 1: its faces share 2 nodes"):
        tied(mesh, np.array([5, 7, 8]), onto)
    with pytest.raises(ValueError, match="tie 1: no side of a shell is on the first face"):
        tied(mesh, face[:1], onto)
    with pytest.raises(ValueError, match="tie 1: no side of a shell is on the second face"):
        tied(mesh, face, onto[:1])
    sheets = [(one[0] + h * np.eye(3)[2], one[1] + 9 * k) for k, h in enumerate((0.0, 0.01, 0.02))]
    stack = shell_mesh(np.concatenate([x for x, _ in sheets]), np.concatenate([c for _, c in sheets]), 0.01)
    with pytest.raises(ValueError, match="tie 1: both sides of its first face lie against the second"):
        tied(stack, 9 + np.arange(9), np.concatenate([np.arange(9), 18 + np.arange(9)]))


def test_nodes_that_something_moves_already_are_refused() -> None:
    one, (x, cells) = (sheet((2, 2), "quadrilateral", (0.0, 0.0), (1.0, 1.0)) for _ in (0, 1))
    fe = assemble(two(one, (x + np.array([0, 0, 0.01]), cells), 0.01), 1, METAL)
    faces = np.arange(9), 9 + np.arange(9)
    upper, edge = (
        TiedFaces("tie 1", np.union1d(face, faces[0]), face, faces[0], None) for face in (faces[1], 9 + np.arange(3))
    )
    moved = "nodes of its first face are moved by other elements or ties already; swap its faces"
    for tie in (upper, edge):
        with pytest.raises(ValueError, match=f"tie 1: {moved}"):
            link_points(fe, find_deck_links(Connections(ties=(tie, tie)), fe))
    assert fe.T is not None
    row = 3 * (len(fe.discretisation.x) + 9)
    T = sp.lil_array(fe.T)
    T[row] = 0.5 * (T[row] + T[row + 3])
    for tie in (upper, edge):
        with pytest.raises(ValueError, match=f"tie 1: {moved}"):
            find_deck_links(Connections(ties=(tie,)), replace(fe, T=sp.csr_array(T)))
