"""Static responses beside the modes: what they add, and that the modes stay what they were."""

from typing import NamedTuple

import numpy as np
import pytest

from meshes.bar import hexahedral_bar
from pipeline.checks import Array
from pipeline.fem.assembly import assemble
from pipeline.fem.marker import Marker, face_marker
from pipeline.fem.material import Material
from pipeline.fem.mesh import SolidMesh
from pipeline.fem.model import FEModel
from pipeline.recovery.stress import modal_stress
from pipeline.reduction.body import FlexibleBody, joint_conforming_body
from pipeline.reduction.eigen import FreeBodySolver
from pipeline.reduction.enrichment import enriched, inertia_loads
from pipeline.reduction.families import lowest_modes, modes_of_family
from pipeline.reduction.modes import Modes

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
    return Rod(fe, solver, lowest_modes(solver, 6), root, inertia_loads(fe, root, Z))


def test_the_modes_come_back_unchanged_in_front(rod: Rod) -> None:
    omega, shapes = enriched(rod.modes, rod.fe, rod.solver, rod.loads)
    assert len(omega) == shapes.shape[2] == 6 + 4
    assert np.array_equal(omega[:6], rod.modes.omega)
    assert np.array_equal(shapes[..., :6], rod.modes.shapes)


def test_the_basis_is_orthonormal_and_its_stiffness_diagonal(rod: Rod) -> None:
    omega, shapes = enriched(rod.modes, rod.fe, rod.solver, rod.loads)
    Phi = shapes.reshape(-1, len(omega))
    assert np.abs(Phi.T @ rod.fe.M @ Phi - np.eye(len(omega))).max() < 1e-9
    assert np.abs((Phi.T @ rod.fe.K @ Phi) / np.outer(omega, omega) - np.eye(len(omega))).max() < 1e-6
    assert np.abs(rod.fe.rigid_modes.T @ (rod.fe.M @ Phi)).max() < 1e-9 * np.sqrt(rod.fe.mass)


def test_the_basis_holds_the_response_to_each_load(rod: Rod) -> None:
    """The response that solves K u = f is a combination of the basis: its M-projection is itself."""
    _, shapes = enriched(rod.modes, rod.fe, rod.solver, rod.loads)
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
    omega, _ = enriched(rod.modes, rod.fe, rod.solver, twice)
    assert len(omega) == 6 + 1


@pytest.mark.parametrize("scale", [1e-3, 1e6])
def test_the_size_of_the_loads_does_not_matter(rod: Rod, scale: float) -> None:
    omega, _ = enriched(rod.modes, rod.fe, rod.solver, rod.loads)
    scaled, _ = enriched(rod.modes, rod.fe, rod.solver, scale * rod.loads)
    assert scaled == pytest.approx(omega, rel=1e-6)


@pytest.mark.parametrize("axis", [Z, np.array([0.0, 2.0, 0.0]), np.array([1.0, -1.0, 3.0])], ids=["z", "y", "oblique"])
def test_inertia_loads_are_those_of_a_spin(rod: Rod, axis: Array) -> None:
    """Check resultants: the centrifugal force m r_c, unit forces in the plane and a unit torque about the axis."""
    e = axis / np.linalg.norm(axis)
    loads = inertia_loads(rod.fe, rod.root, axis)
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
    omega, _ = enriched(rod.modes, rod.fe, rod.solver, np.concatenate([own, rod.loads[..., :beside]], axis=2))
    assert len(omega) == 6 + beside


def stretch(rod: Rod, omega: Array, shapes: Array) -> tuple[Array, Array]:
    """Stress along a rod in steady spin and where: the reduced statics ``diag(ω²) q = Ω² D`` about its joint."""
    body: FlexibleBody = joint_conforming_body(rod.fe, omega, shapes, {"root": rod.root}, "root", Z)
    D = body.gram.G[0, 0] + body.gram.G[1, 1]
    q = SPIN**2 * D[1:, 0] / body.omega**2
    along = np.flatnonzero((np.abs(rod.fe.x[:, 1]) < 1e-9) & (rod.fe.x[:, 2] < -0.01 + 1e-9))
    stress = modal_stress(rod.fe.discretisation, ROD, body.shapes, along) @ q
    order = np.argsort(rod.fe.x[along, 0])
    return rod.fe.x[along[order], 0], stress[order, 0]


def test_a_spinning_rod_is_stretched_as_it_should_be(rod: Rod) -> None:
    # what lies outside r pulls: σ = ρ Ω² ∫_r^L s ds = ρ Ω² (L² − r²)/2
    bending = modes_of_family(rod.solver, rod.fe, 5, "in-plane bending", Z)
    r, stress = stretch(rod, *enriched(bending, rod.fe, rod.solver, rod.loads))
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
