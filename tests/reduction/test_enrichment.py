"""Static responses beside the modes: what they add, and that the modes stay what they were."""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.linalg import null_space

from fmd.core.arrays import Array
from fmd.fem.assembly import assemble
from fmd.fem.markers import Marker, face_marker
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.meshes.bar import hexahedral_bar
from fmd.recovery.stress import modal_stress
from fmd.reduction.body import FlexibleBody, reduced_body
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.loads import enrich_modes, motion_loads
from fmd.reduction.mode_families import lowest_modes, modes_of_family
from fmd.reduction.modes import Modes

Z = np.array([0.0, 0.0, 1.0])
LENGTH = 0.5
ROD = Material(E=70e9, nu=0.0, rho=2700.0)  # without Poisson's ratio the stress along the bar is one-dimensional
SPIN = 300.0


class Rod(NamedTuple):
    fe: FEModel
    solver: FreeBodySolver
    modes: Modes
    root: Marker
    loads: Array


@pytest.fixture(scope="module")
def rod() -> Rod:
    mesh = SolidMesh(*hexahedral_bar(LENGTH, 0.03, 0.02, (20, 2, 1)))
    fe = assemble(mesh, 2, ROD)
    solver = FreeBodySolver(fe)
    root = face_marker(fe.discretisation, mesh.faces["x-"])
    return Rod(fe, solver, lowest_modes(solver, 6), root, motion_loads(fe, root, Z))


def test_the_modes_come_back_unchanged_in_front(rod: Rod) -> None:
    omega, shapes = enrich_modes(rod.modes, rod.fe, rod.solver, rod.loads)
    assert len(omega) == shapes.shape[2] == 6 + 4
    assert np.array_equal(omega[:6], rod.modes.omega)
    assert np.array_equal(shapes[..., :6], rod.modes.shapes)


def test_the_basis_is_orthonormal_and_its_stiffness_diagonal(rod: Rod) -> None:
    omega, shapes = enrich_modes(rod.modes, rod.fe, rod.solver, rod.loads)
    Phi = shapes.reshape(-1, len(omega))
    assert np.abs(Phi.T @ rod.fe.M @ Phi - np.eye(len(omega))).max() < 1e-9
    assert np.abs((Phi.T @ rod.fe.K @ Phi) / np.outer(omega, omega) - np.eye(len(omega))).max() < 1e-6
    assert np.abs(rod.fe.rigid_modes.T @ (rod.fe.M @ Phi)).max() < 1e-9 * np.sqrt(rod.fe.mass)


def test_the_basis_holds_the_response_to_each_load(rod: Rod) -> None:
    """The response that solves K u = f is a combination of the basis: its M-projection is itself."""
    _, shapes = enrich_modes(rod.modes, rod.fe, rod.solver, rod.loads)
    M, Phi = rod.fe.M, shapes.reshape(-1, shapes.shape[2])
    u = rod.solver.static_response(rod.loads).reshape(len(Phi), -1)
    rest = u - Phi @ (Phi.T @ (M @ u))
    assert np.sqrt((np.einsum("ij,ij->j", rest, M @ rest) / np.einsum("ij,ij->j", u, M @ u)).max()) < 1e-7
    # the modes alone don't
    Phi = Phi[:, :6]
    rest = u - Phi @ (Phi.T @ (M @ u))
    assert np.sqrt((np.einsum("ij,ij->j", rest, M @ rest) / np.einsum("ij,ij->j", u, M @ u)).max()) > 0.1


def test_a_load_that_adds_nothing_new_adds_no_shape(rod: Rod) -> None:
    # the inertia load ω² M φ of a mode answers with that mode; a load given twice answers twice the same
    inertia = (rod.fe.M @ rod.modes.shapes[..., 0].ravel()).reshape(-1, 3, 1)
    twice = np.concatenate([inertia, rod.loads[..., [0, 0]]], axis=2)
    omega, _ = enrich_modes(rod.modes, rod.fe, rod.solver, twice)
    assert len(omega) == 6 + 1


@pytest.mark.parametrize("scale", [1e-3, 1e6])
def test_the_size_of_the_loads_does_not_matter(rod: Rod, scale: float) -> None:
    omega, _ = enrich_modes(rod.modes, rod.fe, rod.solver, rod.loads)
    scaled, _ = enrich_modes(rod.modes, rod.fe, rod.solver, scale * rod.loads)
    assert scaled == pytest.approx(omega, rel=1e-6)


@pytest.mark.parametrize("axis", [Z, np.array([0.0, 2.0, 0.0]), np.array([1.0, -1.0, 3.0])], ids=["z", "y", "oblique"])
def test_inertia_loads_are_those_of_a_spin(rod: Rod, axis: Array) -> None:
    """Check resultants: the centrifugal force m r_c, unit forces in the plane and a unit torque about the axis."""
    e = axis / np.linalg.norm(axis)
    loads = motion_loads(rod.fe, rod.root, axis)
    force = loads.sum(axis=0)
    r = rod.fe.x - rod.root.position
    torque = np.cross(r[:, :, None], loads, axis=1).sum(axis=0)
    centre = np.array([LENGTH / 2, 0, 0])
    assert force[:, 0] == pytest.approx(rod.fe.mass * (centre - e * (e @ centre)), abs=1e-12)
    # two unit forces, normal to the axis and to each other, through the joint
    assert force[:, 1:3].T @ force[:, 1:3] == pytest.approx(np.eye(2), abs=1e-12)
    assert np.abs(e @ force[:, 1:3]).max() < 1e-12
    assert np.abs(torque[:, 1:3]).max() < 1e-12
    assert torque[:, 3] == pytest.approx(e, abs=1e-12)
    assert np.abs(force[:, 3]).max() < 1e-12


@pytest.mark.parametrize("beside", [0, 1])
def test_loads_that_a_free_body_balances_itself_add_no_shape(rod: Rod, beside: int) -> None:
    # weight and the Euler load ρ e × r are rigid accelerations: nothing is left of them but round-off
    rigid = np.stack([np.tile(Z, (len(rod.fe.x), 1)), np.cross(Z, rod.fe.x - rod.root.position)], axis=2)
    own = (rod.fe.M @ rigid.reshape(-1, 2)).reshape(rigid.shape)
    omega, _ = enrich_modes(rod.modes, rod.fe, rod.solver, np.concatenate([own, rod.loads[..., :beside]], axis=2))
    assert len(omega) == 6 + beside


def stretch(rod: Rod, omega: Array, shapes: Array) -> tuple[Array, Array]:
    """Stress along a rod in steady spin and where: the reduced statics ``diag(ω²) q = Ω² D`` about its joint."""
    body: FlexibleBody = reduced_body(rod.fe, omega, shapes, {"root": rod.root}, "root", Z[None])
    D = body.integrals.G[0, 0] + body.integrals.G[1, 1]
    q = SPIN**2 * D[1:, 0] / body.omega**2
    along = np.flatnonzero((np.abs(rod.fe.x[:, 1]) < 1e-9) & (rod.fe.x[:, 2] < -0.01 + 1e-9))
    stress = modal_stress(rod.fe.discretisation, ROD, body.shapes, along) @ q
    order = np.argsort(rod.fe.x[along, 0])
    return rod.fe.x[along[order], 0], stress[order, 0]


def test_a_spinning_rod_is_stretched_as_it_should_be(rod: Rod) -> None:
    # what lies outside r pulls: σ = ρ Ω² ∫_r^L s ds = ρ Ω² (L² − r²)/2
    bending = modes_of_family(rod.solver, rod.fe, 5, "in-plane bending", Z)
    r, stress = stretch(rod, *enrich_modes(bending, rod.fe, rod.solver, rod.loads))
    exact = ROD.rho * SPIN**2 * (LENGTH**2 - r**2) / 2
    assert len(r) >= 21
    assert np.abs(stress - exact).max() < 0.01 * exact.max()


def test_free_modes_alone_miss_the_stretch_at_the_hub(rod: Rod) -> None:
    # a free end carries no stress, in none of the modes: nothing of ρ Ω² L²/2 is left at the hub
    exact = ROD.rho * SPIN**2 * LENGTH**2 / 2
    for family, count in (("in-plane bending", 5), ("axial", 2)):
        modes = modes_of_family(rod.solver, rod.fe, count, family, Z)
        _, stress = stretch(rod, modes.omega, modes.shapes)
        assert abs(stress[0] - exact) > 0.2 * exact


@pytest.fixture(scope="module")
def bar(small_bar: FEModel) -> Rod:
    """A bar with a side marker, its modes clamped at the root, and the loads of any motion in space."""
    faces = small_bar.discretisation.mesh.faces
    root, side = (face_marker(small_bar.discretisation, faces[face]) for face in ("x-", "y+"))
    solver = FreeBodySolver(small_bar)
    modes = lowest_modes(solver, 6, root.columns(len(small_bar.x), np.eye(3)))
    return Rod(small_bar, solver, modes, root, motion_loads(small_bar, root, None, [(side, None)]))


def test_spatial_loads_make_up_the_load_of_any_spin(bar: Rod) -> None:
    """−ρ Ω × (Ω × x) is the sum of the fields ½ρ(e_a x_b + e_b x_a), each with Ω²δ_ab − Ω_a Ω_b."""
    spin = np.array([1.0, -2.0, 0.5])
    rates = spin @ spin * np.eye(3) - np.outer(spin, spin)
    weights = [rates[a, b] * (1 if a == b else 2) for a in range(3) for b in range(a, 3)]
    r = bar.fe.x - bar.root.position
    exact = bar.fe.m @ -np.cross(spin, np.cross(spin, r))
    assert np.abs(bar.loads[..., :6] @ weights - exact).max() < 1e-12 * np.abs(exact).max()


def test_spatial_loads_have_three_forces_and_three_torques_at_each_marker(bar: Rod) -> None:
    assert bar.loads.shape[2] == 6 + 6 + 6
    for first, at in ((6, [0.0, 0.0, 0.0]), (12, [0.15, 0.02, 0.0])):
        load = bar.loads[..., first : first + 6]
        assert load.sum(axis=0) == pytest.approx(np.eye(3, 6), abs=1e-12)
        torque = np.cross((bar.fe.x - at)[:, :, None], load, axis=1).sum(axis=0)
        assert torque == pytest.approx(np.eye(3, 6, 3), abs=1e-12)


def test_planar_loads_go_on_with_two_forces_and_a_torque_at_each_outboard_marker(rod: Rod) -> None:
    tip = face_marker(rod.fe.discretisation, rod.fe.discretisation.mesh.faces["x+"])
    loads = motion_loads(rod.fe, rod.root, Z, [(tip, Z)])
    assert np.array_equal(loads[..., :4], rod.loads)
    forces = loads[..., 4:].sum(axis=0)
    torques = np.cross((rod.fe.x - [LENGTH, 0, 0])[:, :, None], loads[..., 4:], axis=1).sum(axis=0)
    assert forces[:, :2].T @ forces[:, :2] == pytest.approx(np.eye(2), abs=1e-12)
    assert np.abs(Z @ forces[:, :2]).max() < 1e-12
    assert np.abs(forces[:, 2]).max() < 1e-10
    assert np.abs(torques - np.array([[0, 0, 0], [0, 0, 0], [0, 0, 1]])).max() < 1e-12


@pytest.mark.parametrize("about", [np.eye(3), np.eye(3)[:2], np.zeros((0, 3))], ids=["clamp", "hinge", "ball"])
def test_responses_are_held_as_the_modes_are(bar: Rod, about: Array) -> None:
    fe, solver = bar.fe, bar.solver
    B = bar.root.columns(len(fe.x), about)
    modes = lowest_modes(solver, 6, B)
    omega, shapes = enrich_modes(modes, fe, solver, bar.loads, B)
    n, size = len(omega), np.abs(shapes).max()
    assert np.array_equal(shapes[..., :6], modes.shapes)
    assert np.abs(bar.root.translation(shapes)).max() < 1e-8 * size
    assert np.abs(about @ bar.root.rotation(shapes)).max(initial=0.0) < 1e-8 * size / 0.02
    Phi = shapes.reshape(-1, n)
    assert np.abs(Phi.T @ fe.M @ Phi - np.eye(n)).max() < 1e-8
    assert np.abs((Phi.T @ fe.K @ Phi) / np.outer(omega, omega) - np.eye(n)).max() < 1e-6
    # to the rigid motions that the joint leaves the basis is M-orthogonal
    left = fe.rigid_modes @ null_space(B.reshape(len(Phi), -1).T @ fe.rigid_modes)
    assert left.shape[1] == 3 - len(about)
    assert np.abs(left.T @ (fe.M @ Phi)).max(initial=0.0) < 1e-8 * np.sqrt(fe.mass)


def test_a_held_basis_has_the_static_deflection_under_each_load(bar: Rod) -> None:
    """Independent path: K u = f + B μ with Bᵀ u = 0, solved densely; the reduced statics give the same."""
    fe = bar.fe
    B = bar.root.columns(len(fe.x), np.eye(3)).reshape(-1, 6)
    N = null_space(B.T)
    f = bar.loads.reshape(len(N), -1)
    exact = N @ np.linalg.solve(N.T @ (fe.K @ N), N.T @ f)
    omega, shapes = enrich_modes(bar.modes, fe, bar.solver, bar.loads, B.reshape(-1, 3, 6))
    Phi = shapes.reshape(-1, len(omega))
    found = Phi @ ((Phi.T @ f) / omega[:, None] ** 2)
    loaded = np.linalg.norm(exact, axis=0) > 1e-9 * np.linalg.norm(exact, axis=0).max()
    error = np.linalg.norm(found - exact, axis=0)[loaded] / np.linalg.norm(exact, axis=0)[loaded]
    assert np.count_nonzero(loaded) == 12  # the joint bears its own six
    assert error.max() < 1e-4  # shapes of less than that beside the others are left out
