"""Bodies with supports, against dense solutions of the same model with the held unknowns struck out."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import eigh, null_space

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import AccuracyError
from fmd.fem.assembly import assemble
from fmd.fem.markers import face_marker
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.fem.selection import node_at, nodes_on_edge, nodes_on_faces
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.loads import acceleration_loads

LENGTH, DEPTH, WIDTH = 0.3, 0.04, 0.02  # small_bar


def on(fe: FEModel, *faces: str) -> IntArray:
    return nodes_on_faces(fe.discretisation, [fe.discretisation.mesh.faces[face] for face in faces])


def unknowns(nodes: IntArray, directions: str) -> IntArray:
    return np.sort(np.concatenate([3 * nodes + "xyz".index(a) for a in directions]))


# What is held, and the rigid motions that statics leaves: of a plane on its face two translations and a rotation, …
HOLDS: dict[str, tuple[Callable[[FEModel], IntArray], int]] = {
    "a face": (lambda fe: unknowns(on(fe, "x-"), "xyz"), 0),
    "a face along its normal": (lambda fe: unknowns(on(fe, "y-"), "y"), 3),
    "an edge as a hinge": (lambda fe: unknowns(on(fe, "x-", "y-"), "xyz"), 1),
    "an edge in one direction": (lambda fe: unknowns(on(fe, "z-", "y-"), "z"), 4),
    "a corner": (lambda fe: unknowns(on(fe, "x-", "y-", "z-"), "xyz"), 3),
    "two corners": (lambda fe: unknowns(np.r_[on(fe, "x-", "y-", "z-"), on(fe, "x+", "y+", "z+")], "xyz"), 1),
}


@pytest.mark.parametrize("hold", HOLDS)
def test_supported_modes_equal_those_of_a_dense_solver(small_bar: FEModel, hold: str) -> None:
    fixed, n_rigid = HOLDS[hold][0](small_bar), HOLDS[hold][1]
    solver = FreeBodySolver(small_bar, (), fixed)
    pairs = solver.modes(12)
    free = np.setdiff1d(np.arange(3 * len(small_bar.x)), fixed)
    K, M = (A.toarray()[np.ix_(free, free)] for A in (small_bar.K, small_bar.M))
    dense = eigh(K, M, eigvals_only=True)
    assert pairs.n_rigid == solver.rigid_modes.shape[1] == n_rigid
    assert np.count_nonzero(dense < 1e-6 * dense[6]) == n_rigid
    assert pairs.omega**2 == pytest.approx(dense[n_rigid : n_rigid + 12], rel=1e-8)
    assert np.abs(pairs.shapes.reshape(-1, 12)[fixed]).max() == 0.0


@pytest.mark.parametrize("hold", HOLDS)
def test_the_flexibility_of_points_takes_one_solution_though_some_are_held(
    small_bar: FEModel, hold: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Held points answer nothing, which was taken for round-off, and static responses stood in its place."""
    solver, nodes = FreeBodySolver(small_bar, (), HOLDS[hold][0](small_bar)), on(small_bar, "y-")
    n = 3 * len(nodes)
    loads = np.zeros((len(small_bar.x), 3, n))
    loads[nodes[np.arange(n) // 3], np.arange(n) % 3, np.arange(n)] = 1.0
    exact = solver.static_response(loads)[nodes].reshape(n, n)
    monkeypatch.setattr(FreeBodySolver, "static_response", lambda *_: pytest.fail("more than one solution a load"))
    np.testing.assert_allclose(solver.flexibility(nodes), exact, rtol=0, atol=1e-9 * np.abs(exact).max())


@pytest.mark.parametrize("hold", HOLDS)
def test_rigid_motions_that_supports_leave_strain_nothing_and_move_no_support(small_bar: FEModel, hold: str) -> None:
    fixed = HOLDS[hold][0](small_bar)
    left = FreeBodySolver(small_bar, (), fixed).rigid_modes
    R = small_bar.rigid_modes
    assert np.abs(left[fixed]).max(initial=0.0) == 0.0
    inside = R @ np.linalg.lstsq(R, left, rcond=None)[0]
    assert left == pytest.approx(inside, abs=1e-9)


def test_a_supported_body_bends_under_loads_as_a_dense_solution_does(small_bar: FEModel) -> None:
    fixed = unknowns(on(small_bar, "x-"), "xyz")
    marker = face_marker(small_bar.discretisation, small_bar.discretisation.mesh.faces["x+"])
    loads = np.concatenate(
        [acceleration_loads(small_bar, np.zeros(3), None), marker.columns(len(small_bar.x), np.eye(3))], axis=2
    )
    u = FreeBodySolver(small_bar, (), fixed).static_response(loads).reshape(-1, 12)
    free = np.setdiff1d(np.arange(len(u)), fixed)
    want = np.linalg.solve(small_bar.K.toarray()[np.ix_(free, free)], loads.reshape(-1, 12)[free])
    assert (np.abs(u[free] - want).max(axis=0) < 1e-8 * np.abs(want).max(axis=0)).all()
    # and as beams: F L³/3EI, with the shear's part of about (h/L)²
    force = u.reshape(len(small_bar.x), 3, 12)
    bending = small_bar.material.E * WIDTH * DEPTH**3 / 12
    assert marker.translation(force)[1, 7] == pytest.approx(LENGTH**3 / (3 * bending), rel=0.02)


def test_what_is_partly_free_keeps_its_balance(small_bar: FEModel) -> None:
    """Inertia relief takes off what the supports leave free, and nothing else."""
    fixed = unknowns(on(small_bar, "y-"), "y")
    loads = np.random.default_rng(0).standard_normal((len(small_bar.x), 3, 2))
    u = FreeBodySolver(small_bar, (), fixed).static_response(loads).reshape(-1, 2)
    free = np.setdiff1d(np.arange(len(u)), fixed)
    K, M = (A.toarray()[np.ix_(free, free)] for A in (small_bar.K, small_bar.M))
    R = small_bar.rigid_modes @ null_space(small_bar.rigid_modes[fixed])
    R = R[free]
    balanced = loads.reshape(-1, 2)[free]
    balanced = balanced - M @ R @ np.linalg.solve(R.T @ M @ R, R.T @ balanced)
    want = np.linalg.lstsq(K, balanced, rcond=1e-12)[0]
    want -= R @ np.linalg.solve(R.T @ M @ R, R.T @ (M @ want))
    assert np.abs(u[free] - want).max() < 1e-7 * np.abs(want).max()


def test_a_supported_body_with_a_hinge_in_it_is_refused(box_mesh: Callable[..., SolidMesh], steel: Material) -> None:
    # Two cubes that share an edge, one of them clamped: the other still turns about the edge.
    box = box_mesh("hexahedron", (2, 2, 1))
    place = np.floor(box.points[box.cells].mean(axis=1)[:, :2] * 2).astype(int)
    used, cells = np.unique(box.cells[place[:, 0] == place[:, 1]], return_inverse=True)
    mesh = SolidMesh(box.points[used], cells.reshape(-1, 8), "hexahedron", {}, {})
    fe = assemble(mesh, 2, steel)
    fixed = unknowns(np.flatnonzero(fe.x[:, 0] == 0), "xyz")
    with pytest.raises(AccuracyError, match="found 1 rigid-body modes, the body with its constraints has 0"):
        FreeBodySolver(fe, (), fixed).modes(6)


def test_a_rigid_face_beside_a_support_moves_rigidly(small_bar: FEModel) -> None:
    rigid = face_marker(small_bar.discretisation, small_bar.discretisation.mesh.faces["x+"], rigid=True)
    pairs = FreeBodySolver(small_bar, [rigid], unknowns(on(small_bar, "x-"), "xyz")).modes(5)
    face = pairs.shapes[rigid.nodes]
    r = small_bar.x[rigid.nodes] - rigid.position
    moved = rigid.translation(pairs.shapes) + np.cross(rigid.rotation(pairs.shapes), r[:, :, None], 0, 1, 1)
    assert np.abs(face - moved).max() < 1e-10 * np.abs(pairs.shapes).max()
    assert pairs.n_rigid == 0


def test_a_rigid_face_that_is_supported_is_refused(small_bar: FEModel) -> None:
    rigid = face_marker(small_bar.discretisation, small_bar.discretisation.mesh.faces["x+"], rigid=True)
    with pytest.raises(ValueError, match="a support and a rigid face share nodes; make the attachment 'averaged'"):
        FreeBodySolver(small_bar, [rigid], unknowns(on(small_bar, "y-"), "y"))


# Places ----------------------------------------------------------------------------------------------------------


def nodes_where(fe: FEModel, *conditions: Array) -> list[int]:
    return np.flatnonzero(np.all(conditions, axis=0)).tolist()


def test_faces_meet_in_edges_and_corners(small_bar: FEModel) -> None:
    x, y, z = small_bar.x.T
    left, below, behind = np.isclose(x, 0.0), np.isclose(y, -DEPTH / 2), np.isclose(z, -WIDTH / 2)
    assert on(small_bar, "x-").tolist() == nodes_where(small_bar, left)
    assert on(small_bar, "x-", "y-").tolist() == nodes_where(small_bar, left, below)
    assert on(small_bar, "x-", "y-", "z-").tolist() == nodes_where(small_bar, left, below, behind)
    with pytest.raises(ValueError, match="the faces have no node in common"):
        on(small_bar, "x-", "x+")


def test_a_line_between_two_points_holds_the_nodes_on_it(small_bar: FEModel) -> None:
    x, y, z = small_bar.x.T
    ends = np.array([[0.0, -DEPTH / 2, -WIDTH / 2], [0.5 * LENGTH, -DEPTH / 2, -WIDTH / 2]])
    on_it = nodes_where(small_bar, np.isclose(y, -DEPTH / 2), np.isclose(z, -WIDTH / 2), x < 0.5 * LENGTH + 1e-9)
    assert nodes_on_edge(small_bar.discretisation, ends).tolist() == on_it
    with pytest.raises(ValueError, match=r"no node of the mesh lies there; the nearest is 0\.1 m away"):
        nodes_on_edge(small_bar.discretisation, ends - [0.0, 0.0, 0.1])


def test_a_point_holds_the_node_nearest_to_it(small_bar: FEModel) -> None:
    (node,) = node_at(small_bar.discretisation, np.array([LENGTH + 0.1, DEPTH, WIDTH]))
    assert small_bar.x[node] == pytest.approx([LENGTH, DEPTH / 2, WIDTH / 2])


def test_what_inertia_bends_moves_no_support(small_bar: FEModel) -> None:
    fixed = unknowns(on(small_bar, "x-"), "xyz")
    solver = FreeBodySolver(small_bar, (), fixed)
    u = solver.inertia_response(solver.modes(2).shapes).reshape(-1, 2)
    assert np.abs(u[fixed]).max() == 0.0
    # of a mode, the answer to its inertia is the mode itself over ω² − σ
    modes = solver.modes(2)
    assert u == pytest.approx(modes.shapes.reshape(-1, 2) / (modes.omega**2 - solver.shift), abs=1e-6 * np.abs(u).max())
