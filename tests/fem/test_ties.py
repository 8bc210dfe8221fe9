"""Ties of meshes without common nodes: patch tests, bores, frequencies, and faces that can't be tied."""

from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse as sp

from fmd.core.arrays import Array, IntArray
from fmd.core.rotations import rigid_motions
from fmd.fem.assembly import assemble
from fmd.fem.connections import TiedFaces
from fmd.fem.links import Linked, LinkedFace, LinkedModel, link_points
from fmd.fem.markers import face_marker
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.fem.mortar import bilinear_places, common_triangles
from fmd.fem.ties import tie_faces
from fmd.reduction.eigen import FreeBodySolver

ALUMINIUM = Material(70e9, 0.33, 2700.0)
_CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
_SPLIT = {
    "hexahedron": [tuple(range(8))],
    "tetra": [(0, 1, 3, 7), (0, 1, 7, 5), (0, 5, 7, 4), (1, 2, 3, 7), (1, 2, 7, 6), (1, 6, 7, 5)],
    "wedge": [(0, 1, 2, 4, 5, 6), (0, 2, 3, 4, 6, 7)],
}


def box(kind: str, n: tuple[int, int, int], low: Array, high: Array, seed: int | None = None) -> tuple[Array, IntArray]:
    """Return points and cells of a box, of layers of random thickness if there is a seed."""
    axes = [np.linspace(a, b, k + 1) for a, b, k in zip(low, high, n, strict=True)]
    for axis in axes if seed is not None else ():
        axis[1:-1] += 0.3 * (axis[1] - axis[0]) * np.random.default_rng(seed).uniform(-1, 1, len(axis) - 2)
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    at = np.arange(len(x)).reshape([k + 1 for k in n])
    corners = np.stack([at[i : i + n[0], j : j + n[1], k : k + n[2]].ravel() for i, j, k in _CORNERS], axis=1)
    return x, np.concatenate([corners[:, own] for own in _SPLIT[kind]])


def two(kind: str, one: tuple[Array, IntArray], other: tuple[Array, IntArray], **faces: IntArray) -> SolidMesh:
    points, cells = np.concatenate([one[0], other[0]]), np.concatenate([one[1], len(one[0]) + other[1]])
    return SolidMesh(points, cells, kind, {"all": np.arange(len(cells))}, faces)


def stacked(
    kind: str, below: tuple[int, int, int], above: tuple[int, int, int], sizes: Array, seed: int | None = None
) -> SolidMesh:
    """Two boxes, one on the other: lengths of the lower, then of the upper one in the lower one's middle."""
    (a, b, c), (d, e, f) = sizes
    one = box(kind, below, np.zeros(3), np.array([a, b, c]), seed)
    other = box(kind, above, np.array([(a - d) / 2, (b - e) / 2, c]), np.array([(a + d) / 2, (b + e) / 2, c + f]), seed)
    low, up = (np.flatnonzero(np.abs(x[:, 2] - c) < 1e-9) for x, _ in (one, other))
    return two(kind, one, other, low=low, up=len(one[0]) + up, foot=np.flatnonzero(one[0][:, 0] == 0))


def tied(mesh: SolidMesh, order: int, face: str = "up", onto: str = "low", within: float | None = None) -> LinkedModel:
    fe = assemble(mesh, order, ALUMINIUM)
    faces = np.concatenate([mesh.faces[face].ravel(), mesh.faces[onto].ravel()])
    given = TiedFaces("tie", faces, mesh.faces[face], mesh.faces[onto], within)
    return link_points(fe, Linked(ties=[tie_faces(fe, fe.discretisation.members[0], given)]))


def lowest_hz(fe: FEModel, fixed: IntArray, count: int) -> Array:
    return np.asarray(FreeBodySolver(fe, fixed=fixed).modes(count).omega / (2 * np.pi))


def test_what_polygons_share_covers_them_where_they_are_tiled() -> None:
    rng = np.random.default_rng(3)
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]]) + 0.15 * rng.uniform(-1, 1, (200, 4, 2))
    steps = list(pairwise(np.linspace(-1, 2, 8)))
    tiles = np.array([[[a, c], [b, c], [b, d], [a, d]] for a, b in steps for c, d in steps])
    i, j = (each.ravel() for each in np.indices((len(corners), len(tiles))))
    triangles, pair = common_triangles(corners[i], tiles[j])
    sides = triangles[:, 1:] - triangles[:, :1]
    areas = np.bincount(i[pair], np.linalg.det(sides) / 2, len(corners))
    r = corners[:, 2:] - corners[:, :1], corners[:, 1:3] - corners[:, :1]
    whole = (np.linalg.det(np.stack([r[1][:, 0], r[1][:, 1]], axis=1)) + np.linalg.det(r[0])) / 2
    assert areas == pytest.approx(whole, rel=1e-12)
    middle = triangles.mean(axis=1)
    (x0, x1, x2, x3), (s, t) = corners[i[pair]].swapaxes(0, 1), bilinear_places(corners[i[pair]], middle).T[..., None]
    assert np.abs((1 - s) * (1 - t) * x0 + s * (1 - t) * x1 + s * t * x2 + (1 - s) * t * x3 - middle).max() < 1e-12
    assert min(s.min(), t.min(), 1 - s.max(), 1 - t.max()) > 0


@pytest.mark.parametrize("counts", [((3, 3, 1), (2, 4, 1)), ((2, 3, 1), (5, 4, 1))], ids=["alike", "finer follows"])
@pytest.mark.parametrize(
    ("kind", "order"), [("hexahedron", 1), ("hexahedron", 2), ("tetra", 1), ("tetra", 2), ("wedge", 1)]
)
def test_constant_stress_passes_a_tie_exactly(kind: str, order: int, counts: tuple[tuple[int, int, int], ...]) -> None:
    mesh = stacked(kind, *counts, np.array([[1.0, 1.0, 0.5], [1.0, 1.0, 0.5]]), seed=5)
    for face, onto in (("up", "low"), ("low", "up")):
        fe = tied(mesh, order, face, onto)
        stretched = (fe.x * [-0.33, -0.33, 1.0]).ravel()
        free = sp.csc_array(fe.T[np.flatnonzero(np.abs(np.repeat(fe.x[:, 2], 3) % 1) < 1e-9)])
        inner = np.flatnonzero(np.diff(free.indptr) == 0)
        own = np.setdiff1d(np.arange(len(fe.x)), np.flatnonzero(np.diff(fe.T.indptr).reshape(-1, 3)[:, 0] != 1))
        y = fe.T[(3 * own[:, None] + np.arange(3)).ravel()].T @ stretched[(3 * own[:, None] + np.arange(3)).ravel()]
        assert np.abs(fe.T @ y - stretched).max() < 1e-12  # a linear field needs no strain at the tie
        forces = fe.K @ stretched
        assert np.abs((fe.T.T @ forces)[inner]).max() < 1e-12 * np.abs(forces).max()


def test_frequencies_of_a_small_box_on_a_larger_one_are_those_of_calculix() -> None:
    # CalculiX 2.20, *TIE, C3D20, one end fixed; its tie moves each node of the upper box with the facet below it
    wanted = [332.8661, 704.9943, 1427.660, 3130.829, 3377.763, 3658.743]
    sizes = np.array([[0.3, 0.1, 0.04], [0.2, 0.1, 0.06]])
    mesh = stacked("hexahedron", (6, 3, 2), (5, 4, 2), sizes)
    fe = tied(mesh, 2)
    fixed = np.flatnonzero(np.abs(np.repeat(fe.x[:, 0], 3)) < 1e-9)
    assert lowest_hz(fe, fixed, 6) == pytest.approx(wanted, rel=3e-4)
    assert lowest_hz(tied(mesh, 2, "low", "up"), fixed, 6) == pytest.approx(wanted, rel=3e-3)


def ring(inner: float, outer: float, n: tuple[int, int, int], turned: float) -> tuple[Array, IntArray]:
    """A ring of hexahedra around z from a box of radius, angle and height."""
    x, cells = box("hexahedron", n, np.array([inner, 0, 0]), np.array([outer, 2 * np.pi, 0.3]))
    angle = x[:, 1] + turned
    x = np.column_stack([x[:, 0] * np.cos(angle), x[:, 0] * np.sin(angle), x[:, 2]])
    _, first, place = np.unique(np.round(x, 9), axis=0, return_index=True, return_inverse=True)
    return x[first], place.ravel()[cells]


def test_a_bush_in_a_bore_moves_as_one_piece_though_their_polygons_differ() -> None:
    one, other = ring(1.0, 1.5, (1, 24, 1), 0.0), ring(0.7, 1.0, (1, 17, 2), 0.1)
    bore, bush = (np.flatnonzero(np.abs(np.hypot(*x[:, :2].T) - 1) < 1e-9) for x, _ in (one, other))
    fe = tied(two("hexahedron", one, other, low=bore, up=len(one[0]) + bush), 2)
    rigid = rigid_motions(fe.x).reshape(-1, 6)
    free = np.flatnonzero(np.diff(fe.T.indptr) == 1)
    y = fe.T[free].T @ rigid[free]
    assert np.abs(fe.T @ y - rigid).max() < 1e-12
    whole = assemble(SolidMesh(*ring(0.7, 1.5, (2, 24, 1), 0.0), "hexahedron", {}, {}), 2, ALUMINIUM)
    free_free = np.zeros(0, dtype=np.int64)
    assert lowest_hz(fe, free_free, 4) == pytest.approx(lowest_hz(whole, free_free, 4), rel=0.01)


def test_faces_that_cant_be_tied_are_refused() -> None:
    sizes = np.array([[1.0, 1.0, 0.5], [1.0, 1.0, 0.5]])
    mesh = stacked("hexahedron", (2, 2, 1), (3, 3, 1), sizes)
    fe = assemble(mesh, 1, ALUMINIUM)
    space, (member,) = fe.discretisation, fe.discretisation.members
    up, low, foot = (mesh.faces[name] for name in ("up", "low", "foot"))
    with pytest.raises(ValueError, match=r"don't lie against each other; they come as near as 0 m"):
        tie_faces(fe, member, TiedFaces("T", up, up, foot))
    with pytest.raises(ValueError, match=r"share 3 nodes, by which they are joined already"):
        tie_faces(fe, member, TiedFaces("T", low, low, foot))
    with pytest.raises(ValueError, match=r"no facet of the mesh's boundary is on the second face"):
        tie_faces(fe, member, TiedFaces("T", up, up, low[:1]))
    link = LinkedFace(face_marker(space, up, True), np.zeros(3))
    with pytest.raises(ValueError, match="by a link and a tie"):
        link_points(fe, Linked({"a": link}, ties=[tie_faces(fe, member, TiedFaces("T", up, up, low))]))


def test_a_gap_is_bridged_where_that_is_said() -> None:
    sizes = np.array([[1.0, 1.0, 0.5], [1.0, 1.0, 0.5]])
    mesh = stacked("hexahedron", (2, 2, 1), (3, 3, 1), sizes)
    lifted = mesh.points + np.where(np.arange(len(mesh.points))[:, None] < 18, 0.0, [0, 0, 0.2])
    apart = SolidMesh(lifted, mesh.cells, mesh.cell_type, mesh.parts, mesh.faces)
    with pytest.raises(ValueError, match=r"as near as 0.2 m. Give the distance"):
        tied(apart, 1)
    fe = tied(apart, 1, within=0.25)
    rigid = rigid_motions(fe.x).reshape(-1, 6)
    free = np.flatnonzero(np.diff(fe.T.indptr) == 1)
    assert np.abs(fe.T @ (fe.T[free].T @ rigid[free]) - rigid).max() < 1e-12
