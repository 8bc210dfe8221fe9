"""Modes of a body held at a joint, and of one whose faces are rigid."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh, expm, null_space
from scipy.optimize import brentq

from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError
from fmd.fem.assembly import assemble
from fmd.fem.markers import Marker, face_marker
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.meshes.bar import hexahedral_bar
from fmd.reduction.body import reduced_body
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.loads import enrich_modes, motion_loads
from fmd.reduction.mode_families import classify_modes, lowest_modes, modes_of_family

X, Y, Z = np.eye(3)
# Directions about which a joint holds a body's rotation, and the rigid motions that it leaves.
JOINTS = {"clamp": (np.eye(3), 0), "hinge": (np.array([X, Y]), 1), "ball": (np.zeros((0, 3)), 3)}


def marker_of(fe: FEModel, face: str, rigid: bool = False) -> Marker:
    return face_marker(fe.discretisation, fe.discretisation.mesh.faces[face], rigid)


def bar(length: float, depth: float, width: float, divisions: tuple[int, int, int], material: Material) -> FEModel:
    return assemble(SolidMesh(*hexahedral_bar(length, depth, width, divisions)), 2, material)


def dense_modes(fe: FEModel, basis: Array) -> Array:
    """Eigenvalues among the columns of a basis, by LAPACK."""
    return eigh(basis.T @ (fe.K @ basis), basis.T @ (fe.M @ basis), eigvals_only=True)


def rigid_motions(fe: FEModel, marker: Marker) -> Array:
    """The six rigid motions of a marker's face, zero elsewhere, shape (3 n_nodes, 6), column by column."""
    motions = np.zeros((len(fe.x), 3, 6))
    for a in range(3):
        motions[marker.nodes, a, a] = 1.0
        motions[marker.nodes, :, 3 + a] = np.cross(np.eye(3)[a], fe.x[marker.nodes] - marker.position)
    return motions.reshape(-1, 6)


def rigid_basis(fe: FEModel, markers: list[Marker]) -> Array:
    """Dense u = T u_r for rigid faces."""
    slaves = np.concatenate([marker.nodes for marker in markers])
    free = np.delete(np.eye(3 * len(fe.x)), (3 * slaves[:, None] + np.arange(3)).ravel(), axis=1)
    return np.concatenate([free, *(rigid_motions(fe, marker) for marker in markers)], axis=1)


@pytest.mark.parametrize("joint", JOINTS)
def test_held_modes_equal_those_of_a_dense_solver(small_bar: FEModel, joint: str) -> None:
    about, n_rigid = JOINTS[joint]
    B = marker_of(small_bar, "x-").columns(len(small_bar.x), about)
    pairs = FreeBodySolver(small_bar).modes(15, B)
    dense = dense_modes(small_bar, null_space(B.reshape(-1, B.shape[2]).T))
    assert pairs.n_rigid == n_rigid == np.count_nonzero(dense < 1e-6 * dense[3])
    assert pairs.omega**2 == pytest.approx(dense[n_rigid : n_rigid + 15], rel=1e-8)


@pytest.mark.parametrize("joint", JOINTS)
def test_held_modes_are_held_orthonormal_and_in_balance_with_the_reaction(small_bar: FEModel, joint: str) -> None:
    K, M = small_bar.K, small_bar.M
    B = marker_of(small_bar, "x-").columns(len(small_bar.x), JOINTS[joint][0])
    pairs = FreeBodySolver(small_bar).modes(12, B)
    Phi, B = pairs.shapes.reshape(len(K.toarray()), -1), B.reshape(-1, B.shape[2])
    size = np.abs(Phi).max()
    assert np.abs(B[:, :3].T @ Phi).max() < 1e-9 * size
    assert np.abs(B[:, 3:].T @ Phi).max(initial=0.0) < 1e-9 * size / 0.02
    assert np.abs(Phi.T @ (M @ Phi) - np.eye(12)).max() < 1e-9
    inertia = pairs.omega**2 * (M @ Phi)
    defect = K @ Phi - inertia
    rest = defect - B @ np.linalg.lstsq(B, defect, rcond=None)[0]
    assert (np.linalg.norm(rest, axis=0) < 1e-7 * np.linalg.norm(inertia, axis=0)).all()
    assert (np.linalg.norm(defect, axis=0) > 1e-3 * np.linalg.norm(inertia, axis=0)).any()  # which is needed
    assert pairs.residual < 1e-6


@pytest.mark.parametrize("count", [1, 12, 18, 30])
def test_a_single_element_gives_all_its_held_modes(count: int, steel: Material) -> None:
    # 24 unknowns, six of them held
    fe = assemble(SolidMesh(*hexahedral_bar(0.1, 0.1, 0.1, (1, 1, 1))), 1, steel)
    B = marker_of(fe, "x-").columns(8, np.eye(3))
    pairs = FreeBodySolver(fe).modes(count, B)
    dense = dense_modes(fe, null_space(B.reshape(-1, 6).T))
    assert pairs.shapes.shape == (8, 3, min(count, 18))
    assert pairs.omega**2 == pytest.approx(dense[: min(count, 18)], rel=1e-9)


def test_a_held_body_with_a_hinge_in_it_is_refused(box_mesh: Callable[..., SolidMesh], steel: Material) -> None:
    # Two cubes that share an edge, one of them clamped: the other still turns about the edge.
    box = box_mesh("hexahedron", (2, 2, 1))
    place = np.floor(box.points[box.cells].mean(axis=1)[:, :2] * 2).astype(int)
    used, cells = np.unique(box.cells[place[:, 0] == place[:, 1]], return_inverse=True)
    mesh = SolidMesh(box.points[used], cells.reshape(-1, 8), "hexahedron", {}, {})
    fe = assemble(mesh, 2, steel)
    B = face_marker(fe.discretisation, np.flatnonzero(mesh.points[:, 0] == 0)).columns(len(fe.x), np.eye(3))
    with pytest.raises(AccuracyError, match="found 1 rigid-body modes, the body with its constraints has 0"):
        FreeBodySolver(fe).modes(6, B)


@pytest.fixture(scope="module")
def slender_bar(steel: Material) -> FEModel:
    """A bar forty times as long as deep."""
    return bar(0.8, 0.02, 0.01, (40, 2, 2), steel)


def clamped_determinant(omega: float, beam: Any) -> float:
    """Zero at a frequency of Timoshenko's cantilever: the clamp has moment and shear force, the free end neither."""
    return float(np.linalg.det(expm(beam.system(omega))[2:, 2:]))


def test_a_clamped_bar_bends_as_euler_bernoulli_and_timoshenko_say(
    slender_bar: FEModel, steel: Material, timoshenko: Callable[..., Any]
) -> None:
    B = marker_of(slender_bar, "x-").columns(len(slender_bar.x), np.eye(3))
    solver = FreeBodySolver(slender_bar)
    for family, depth, width in (("in-plane bending", 0.02, 0.01), ("out-of-plane bending", 0.01, 0.02)):
        found = modes_of_family(solver, slender_bar, 3, family, Z, B).omega
        # cos βL cosh βL = −1; shear and rotary inertia take some off
        euler = np.array([1.875104, 4.694091, 7.854757]) ** 2 * depth * np.sqrt(steel.E / (12 * steel.rho)) / 0.8**2
        assert found[:2] == pytest.approx(euler[:2], rel=0.008)
        assert (found < euler).all()
        beam = timoshenko(0.8, depth, width, steel)
        exact = [brentq(clamped_determinant, 0.9 * omega, 1.05 * omega, args=(beam,)) for omega in euler]
        assert found == pytest.approx(exact, rel=2e-3)


def test_a_clamped_bar_stretches_at_a_quarter_of_its_wave_transit_rate(slender_bar: FEModel, steel: Material) -> None:
    B = marker_of(slender_bar, "x-").columns(len(slender_bar.x), np.eye(3))
    axial = modes_of_family(FreeBodySolver(slender_bar), slender_bar, 1, "axial", Z, B)
    assert axial.frequencies_hz == pytest.approx([np.sqrt(steel.E / steel.rho) / (4 * 0.8)], rel=1e-3)


def test_families_of_held_modes_are_chosen_from_all_held_modes(small_bar: FEModel) -> None:
    B = marker_of(small_bar, "x-").columns(len(small_bar.x), np.eye(3))
    solver = FreeBodySolver(small_bar)
    pairs = solver.modes(16, B)
    families, _ = classify_modes(small_bar, pairs, Z)
    places = [k for k, family in enumerate(families) if family == "in-plane bending"][:3]
    chosen = modes_of_family(solver, small_bar, 3, "in-plane bending", Z, B)
    assert chosen.numbers == tuple(k + 1 for k in places)
    assert chosen.omega == pytest.approx(pairs.omega[places], rel=1e-9)
    assert chosen.n_rigid == 0
    assert lowest_modes(solver, 5, B).omega == pytest.approx(pairs.omega[:5], rel=1e-9)


def test_free_modes_pinned_at_a_joint_converge_to_the_held_ones(small_bar: FEModel) -> None:
    """Rayleigh and Ritz: the free modes' pinned frequencies come down to those of the body held there."""
    markers = {"root": marker_of(small_bar, "x-")}
    B = markers["root"].columns(len(small_bar.x), np.array([X, Y]))
    solver = FreeBodySolver(small_bar)
    held = modes_of_family(solver, small_bar, 2, "in-plane bending", Z, B).omega
    excess = []
    for count in (3, 6, 12):
        modes = modes_of_family(solver, small_bar, count, "in-plane bending", Z)
        body = reduced_body(small_bar, modes.omega, modes.shapes, markers, "root", Z[None])
        excess.append(body.omega[:2] / held - 1)
    assert (np.diff(excess, axis=0) < 0).all()
    assert (excess[-1] > 0).all()
    assert (excess[-1] < [0.01, 0.02]).all()
    # the response to the joint's force makes up for the modes that are left out
    enlarged = enrich_modes(modes, small_bar, solver, motion_loads(small_bar, markers["root"], Z))
    body = reduced_body(small_bar, *enlarged, markers, "root", Z[None])
    for omega in held:  # among them are those of stretching
        assert np.abs(body.omega / omega - 1).min() < 1e-5


@pytest.mark.parametrize("faces", [["x-"], ["x-", "x+"]])
def test_modes_with_rigid_faces_equal_those_of_a_dense_solver(small_bar: FEModel, faces: list[str]) -> None:
    markers = [marker_of(small_bar, face, rigid=True) for face in faces]
    pairs = FreeBodySolver(small_bar, markers).modes(15)
    dense = dense_modes(small_bar, rigid_basis(small_bar, markers))
    assert pairs.n_rigid == 6
    assert pairs.omega**2 == pytest.approx(dense[6:21], rel=1e-8)
    # less freedom, higher frequencies, each of them (Courant and Fischer)
    assert (pairs.omega >= FreeBodySolver(small_bar).modes(15).omega * (1 - 1e-9)).all()
    for marker in markers:
        face = pairs.shapes[marker.nodes]
        r = small_bar.x[marker.nodes] - marker.position
        rigid = marker.translation(pairs.shapes) + np.cross(marker.rotation(pairs.shapes), r[:, :, None], 0, 1, 1)
        assert np.abs(face - rigid).max() < 1e-10 * np.abs(pairs.shapes).max()


def test_holding_a_rigid_face_is_fixing_its_nodes(small_bar: FEModel) -> None:
    marker = marker_of(small_bar, "x-", rigid=True)
    pairs = FreeBodySolver(small_bar, [marker]).modes(10, marker.columns(len(small_bar.x), np.eye(3)))
    fixed = (3 * marker.nodes[:, None] + np.arange(3)).ravel()
    dense = dense_modes(small_bar, np.delete(np.eye(3 * len(small_bar.x)), fixed, axis=1))
    assert pairs.n_rigid == 0
    assert pairs.omega**2 == pytest.approx(dense[:10], rel=1e-8)
    assert np.abs(pairs.shapes[marker.nodes]).max() < 1e-10 * np.abs(pairs.shapes).max()


def test_a_static_response_keeps_rigid_faces_rigid(small_bar: FEModel) -> None:
    markers = [marker_of(small_bar, face, rigid=True) for face in ("x-", "x+")]
    loads = np.random.default_rng(0).standard_normal((len(small_bar.x), 3, 3))
    u = FreeBodySolver(small_bar, markers).static_response(loads).reshape(-1, 3)
    T, R, M = rigid_basis(small_bar, markers), small_bar.rigid_modes, small_bar.M
    flat = loads.reshape(-1, 3)
    balanced = flat - M @ R @ np.linalg.solve(R.T @ (M @ R), R.T @ flat)
    exact = T @ np.linalg.lstsq(T.T @ (small_bar.K @ T), T.T @ balanced, rcond=1e-12)[0]
    exact -= R @ np.linalg.solve(R.T @ (M @ R), R.T @ (M @ exact))
    assert np.abs(u - exact).max() < 1e-7 * np.abs(exact).max()


def test_rigid_faces_that_share_nodes_are_refused(small_bar: FEModel) -> None:
    below = np.flatnonzero(small_bar.discretisation.mesh.points[:, 1] < -0.0199)
    side = face_marker(small_bar.discretisation, below, rigid=True)
    with pytest.raises(ValueError, match="two rigid faces share nodes; make one of the attachments 'averaged'"):
        FreeBodySolver(small_bar, [marker_of(small_bar, "x-", rigid=True), side])
