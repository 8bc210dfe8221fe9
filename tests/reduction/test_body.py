"""The reduced body at its joint: pinned, uncoupled and normalised."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.linalg import eigh, null_space
from scipy.optimize import brentq

from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError
from fmd.fem.assembly import assemble
from fmd.fem.markers import Marker, face_marker
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.meshes.bar import hexahedral_bar
from fmd.reduction.body import FlexibleBody, floating_body, free_frame_body, reduced_body
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.loads import enrich_modes, motion_loads
from fmd.reduction.mode_families import lowest_modes, modes_of_family
from fmd.reduction.modes import Modes

Z = np.array([0.0, 0.0, 1.0])
LENGTH, DEPTH, WIDTH = 0.34, 0.025, 0.01
PLASTIC = Material(722e6, 0.34, 2000.0)


class Beam(NamedTuple):
    fe: FEModel
    modes: Modes
    markers: dict[str, Marker]
    enlarged: tuple[Array, Array]


@pytest.fixture(scope="module")
def beam() -> Beam:
    """The paper's beam, its five lowest in-plane bending modes, and the basis with the static responses too."""
    mesh = SolidMesh(*hexahedral_bar(LENGTH, DEPTH, WIDTH, (24, 2, 1)))
    fe = assemble(mesh, 2, PLASTIC)
    solver = FreeBodySolver(fe)
    markers = {name: face_marker(fe.discretisation, mesh.faces[f]) for name, f in (("root", "x-"), ("tip", "x+"))}
    modes = modes_of_family(solver, fe, 5, "in-plane bending", Z)
    return Beam(fe, modes, markers, enrich_modes(modes, fe, solver, motion_loads(fe, markers["root"], Z)))


def conforming(beam: Beam, joint: str = "root", axis: Array = Z) -> FlexibleBody:
    return reduced_body(beam.fe, beam.modes.omega, beam.modes.shapes, beam.markers, joint, axis[None])


def free(beam: Beam) -> FlexibleBody:
    return free_frame_body(beam.fe, beam.modes.omega, beam.modes.shapes, beam.markers, "root", Z)


@pytest.fixture(params=["joint-conforming", "free", "joint-conforming enriched", "free enriched"])
def body(request: pytest.FixtureRequest, beam: Beam) -> FlexibleBody:
    omega, shapes = beam.enlarged if "enriched" in request.param else (beam.modes.omega, beam.modes.shapes)
    if "joint" in request.param:
        return reduced_body(beam.fe, omega, shapes, beam.markers, "root", Z[None])
    return free_frame_body(beam.fe, omega, shapes, beam.markers, "root", Z)


def test_the_joint_does_not_move(body: FlexibleBody) -> None:
    size = np.abs(body.shapes).max()
    assert np.abs(body.markers["root"].translation).max() < 1e-12 * size
    assert np.array_equal(body.markers["root"].position, np.zeros(3))


def test_modal_mass_is_one_and_stiffness_diagonal(beam: Beam, body: FlexibleBody) -> None:
    n = len(body.omega)
    Phi = body.shapes.reshape(-1, n)
    assert np.abs(Phi.T @ beam.fe.M @ Phi - np.eye(n)).max() < 1e-9
    scale = np.outer(body.omega, body.omega)
    assert np.abs((Phi.T @ beam.fe.K @ Phi - np.diag(body.omega**2)) / scale).max() < 1e-7
    assert (np.diff(body.omega) > 0).all()
    assert body.frequencies_hz == pytest.approx(body.omega / (2 * np.pi), rel=1e-15)


def test_a_mode_has_the_sign_of_the_free_mode_that_it_has_most_of(beam: Beam) -> None:
    """How much it has of each is what strain energies say: the rigid motions between the two have none."""
    sides = np.array([1.0, -1.0, -1.0, 1.0, -1.0])
    given = sides * beam.modes.shapes
    found = reduced_body(beam.fe, beam.modes.omega, given, beam.markers, "root", Z[None]).shapes
    of_each = given.reshape(-1, 5).T @ beam.fe.K @ found.reshape(-1, 5) / beam.modes.omega[:, None] ** 2
    assert (of_each[np.abs(of_each).argmax(axis=0), range(5)] > 0).all()


def test_a_conforming_frame_is_not_coupled_with_the_modes(beam: Beam) -> None:
    omega, shapes = beam.enlarged
    assert conforming(beam).coupling < 1e-8
    assert reduced_body(beam.fe, omega, shapes, beam.markers, "root", Z[None]).coupling < 1e-8


def test_the_coupling_is_what_the_inertia_integrals_say(body: FlexibleBody) -> None:
    # M of (rotation about z, modes) at rest, from the inertia shape integrals
    rest = np.eye(1, 1 + len(body.omega))[0]
    M = body.integrals.mass_matrix(rest)
    assert body.coupling == pytest.approx(np.linalg.norm(M[5, 6:]) / np.sqrt(M[5, 5]), rel=1e-9, abs=1e-12)


def test_a_free_frame_is_coupled_as_euler_and_bernoulli_say(beam: Beam) -> None:
    # Free–free modes of unit modal mass have φ(0) = ±2/√m and are orthogonal to rigid motions, so with the end held
    # M_θq = ∓√m L, M_qq = 1 + 4·11ᵀ up to signs, J = m L²/3, and β² = M_θq M_qq⁻¹ M_qθ / J = 3n / (1 + 4n).
    assert free(beam).coupling == pytest.approx(np.sqrt(3 * 5 / (1 + 4 * 5)), rel=0.01)
    modes = beam.modes
    one = free_frame_body(beam.fe, modes.omega[:1], modes.shapes[..., :1], beam.markers, "root", Z)
    assert one.coupling == pytest.approx(np.sqrt(3 / 5), rel=0.01)


def pinned_by_receptance(free_hz: Array, mobilities: Array, mass: float) -> Array:
    """Frequencies at which the end of a free beam needs no force to stay where it is.

    The receptance of the end is Σ_j φ_j(0)²/(ω_j² − ω²), with φ² = 1/m and (L/2)²/J for the two rigid motions at ω = 0;
    one zero lies between any two neighbours.
    """
    squares = np.r_[0.0, free_hz**2]
    weights = np.r_[1 / mass + (LENGTH / 2) ** 2 / (mass * (LENGTH**2 + DEPTH**2) / 12), mobilities]

    def receptance(square: float) -> float:
        return float(np.sum(weights / (squares - square)))

    gaps = pairwise(squares)
    return np.sqrt([brentq(receptance, a + 1e-9 * (b - a), b - 1e-9 * (b - a)) for a, b in gaps])


def test_five_free_modes_give_the_pinned_frequencies(beam: Beam) -> None:
    # independent path: the receptance of the end, from the free modes' own frequencies and displacements there
    mobilities = beam.markers["root"].translation(beam.modes.shapes)[1] ** 2
    pinned = pinned_by_receptance(beam.modes.frequencies_hz, mobilities, beam.fe.mass)
    assert conforming(beam).frequencies_hz == pytest.approx(pinned, rel=1e-6)


def test_five_free_modes_of_timoshenkos_beam_give_the_same(beam: Beam, timoshenko: Callable[..., Any]) -> None:
    theory = timoshenko(LENGTH, DEPTH, WIDTH, PLASTIC)
    pinned = pinned_by_receptance(theory.frequencies_hz(5), theory.end_mobilities(5), theory.mass)
    assert conforming(beam).frequencies_hz == pytest.approx(pinned, rel=0.005)


def test_the_reference_state_swings_at_the_pinned_frequencies_in_either_frame(beam: Beam) -> None:
    # independent path: rotation and modes of the free frame as one eigenproblem, its zero the rotation
    body = free(beam)
    M = body.integrals.mass_matrix(np.eye(1, 6)[0])[5:, 5:]
    lam = eigh(np.diag(np.r_[0.0, body.omega**2]), M, eigvals_only=True)
    assert abs(lam[0]) < 1e-9 * lam[1]
    assert np.sqrt(lam[1:]) == pytest.approx(conforming(beam).omega, rel=1e-9)


def test_an_enriched_beam_swings_as_timoshenko_says(beam: Beam, timoshenko: Callable[..., Any]) -> None:
    omega, shapes = beam.enlarged
    body = reduced_body(beam.fe, omega, shapes, beam.markers, "root", Z[None])
    exact = timoshenko(LENGTH, DEPTH, WIDTH, PLASTIC).frequencies_hz(4, pinned=True)
    for frequency in exact:  # among them are those of stretching
        assert np.abs(body.frequencies_hz / frequency - 1).min() < 0.005
    # a held end and a free one: c / 4L
    stretching = np.sqrt(PLASTIC.E / PLASTIC.rho) / (4 * LENGTH)
    assert np.abs(body.frequencies_hz / stretching - 1).min() < 1e-3


def test_bending_alone_swings_a_little_too_fast(beam: Beam, timoshenko: Callable[..., Any]) -> None:
    # Rayleigh and Ritz: fewer shapes, higher frequencies; the first two are near the true ones
    exact = timoshenko(LENGTH, DEPTH, WIDTH, PLASTIC).frequencies_hz(5, pinned=True)
    found = conforming(beam).frequencies_hz
    assert (found > exact).all()
    assert found[:2] == pytest.approx(exact[:2], rel=0.01)


def test_a_body_has_its_inertia_about_the_joint(body: FlexibleBody) -> None:
    # m (L²/3 + d²/12) about the middle of the end face
    mass = PLASTIC.rho * LENGTH * DEPTH * WIDTH
    assert body.inertia_about_joint == pytest.approx(mass * (LENGTH**2 / 3 + DEPTH**2 / 12), rel=1e-9)
    assert body.integrals.mass == pytest.approx(mass, rel=1e-9)


def test_markers_follow_the_shapes(beam: Beam, body: FlexibleBody) -> None:
    assert body.markers["tip"].position == pytest.approx([LENGTH, 0, 0], abs=1e-12)
    q = np.random.default_rng(0).standard_normal(len(body.omega))
    u = body.shapes @ q
    for name, marker in beam.markers.items():
        shapes = body.markers[name]
        assert shapes.translation @ q == pytest.approx(marker.translation(u), rel=1e-9, abs=1e-9)
        assert shapes.rotation @ q == pytest.approx(marker.rotation(u), rel=1e-9, abs=1e-7)
    assert body.joint_rotation @ q == pytest.approx(beam.markers["root"].rotation(u)[2], rel=1e-9)


def test_positions_are_relative_to_the_joint(beam: Beam) -> None:
    assert conforming(beam, "tip").x == pytest.approx(beam.fe.x - [LENGTH, 0, 0], abs=1e-12)


def test_a_beam_swings_alike_from_both_ends(beam: Beam) -> None:
    assert conforming(beam, "tip").omega == pytest.approx(conforming(beam).omega, rel=1e-6)


def test_only_the_line_of_the_axis_matters(beam: Beam) -> None:
    one, other = conforming(beam), conforming(beam, axis=-Z)
    assert other.omega == pytest.approx(one.omega, rel=1e-12)
    assert np.abs(other.joint_rotation) == pytest.approx(np.abs(one.joint_rotation), rel=1e-9)
    modes = beam.modes
    long = free_frame_body(beam.fe, modes.omega, modes.shapes, beam.markers, "root", 7.0 * Z)
    assert long.axis == pytest.approx(Z, abs=1e-15)
    assert long.omega == pytest.approx(free(beam).omega, rel=1e-12)


# Directions about which a joint leaves a body free to turn.
JOINTS = {"clamp": np.zeros((0, 3)), "hinge": Z[None], "universal": np.eye(3)[1:], "ball": np.eye(3)}


@pytest.fixture(scope="module")
def stocky() -> Beam:
    """A thick bar whose markers lie off its axis, its 15 lowest modes of all families and the static responses."""
    mesh = SolidMesh(*hexahedral_bar(0.3, 0.04, 0.02, (7, 2, 1)))
    fe = assemble(mesh, 2, PLASTIC)
    solver = FreeBodySolver(fe)
    markers = {name: face_marker(fe.discretisation, mesh.faces[f]) for name, f in (("root", "x-"), ("side", "y+"))}
    modes = lowest_modes(solver, 15)
    return Beam(fe, modes, markers, enrich_modes(modes, fe, solver, motion_loads(fe, markers["root"], None)))


@pytest.fixture(scope="module", params=JOINTS)
def joined(request: pytest.FixtureRequest, stocky: Beam) -> tuple[FlexibleBody, Array]:
    free = JOINTS[request.param]
    return reduced_body(stocky.fe, *stocky.enlarged, stocky.markers, "root", free), free


def test_the_joint_moves_only_about_its_free_directions(joined: tuple[FlexibleBody, Array]) -> None:
    body, free = joined
    root = body.markers["root"]
    assert np.abs(root.translation).max() < 1e-12 * np.abs(body.shapes).max()
    held = (np.eye(3) - free.T @ free) @ root.rotation
    assert np.abs(held).max() < 1e-10 * np.abs(body.markers["side"].rotation).max()


def test_about_the_free_directions_rotation_and_modes_are_not_coupled(joined: tuple[FlexibleBody, Array]) -> None:
    # the mass matrix of (translation, rotation, modes) at rest, from the inertia shape integrals
    body, free = joined
    n = len(body.omega)
    M = body.integrals.mass_matrix(np.eye(1, 1 + n)[0])
    size = np.sqrt(np.diag(M)[3:6].max())
    assert np.abs(free @ M[3:6, 6:]).max(initial=0.0) < 1e-9 * size
    others = np.linalg.svd(np.eye(3) - free.T @ free)[0][:, : 3 - len(free)].T
    assert (np.abs(others @ M[3:6, 6:]).max(axis=1) > 0.01 * size).all()
    assert M[6:, 6:] == pytest.approx(np.eye(n), abs=1e-9)


def test_a_basis_is_diagonal_on_any_joint(stocky: Beam, joined: tuple[FlexibleBody, Array]) -> None:
    body, _ = joined
    Phi = body.shapes.reshape(-1, len(body.omega))
    assert np.abs(Phi.T @ stocky.fe.K @ Phi / np.outer(body.omega, body.omega) - np.eye(len(body.omega))).max() < 1e-6


def test_a_basis_has_the_frequencies_of_the_body_on_its_joint(stocky: Beam, joined: tuple[FlexibleBody, Array]) -> None:
    """Independent path: the eigenvalues of the whole model among all fields that the joint lets through."""
    body, free = joined
    others = np.linalg.svd(np.eye(3) - free.T @ free)[0][:, : 3 - len(free)].T
    B = stocky.markers["root"].columns(len(stocky.fe.x), others)
    N = null_space(B.reshape(-1, B.shape[2]).T)
    exact = eigh(N.T @ (stocky.fe.K @ N), N.T @ (stocky.fe.M @ N), eigvals_only=True)[len(free) :]
    assert body.omega[:6] == pytest.approx(np.sqrt(exact[:6]), rel=1e-4)


def test_the_free_frame_too_keeps_the_joint_to_its_axis(stocky: Beam) -> None:
    body = free_frame_body(stocky.fe, *stocky.enlarged, stocky.markers, "root", Z)
    root = body.markers["root"]
    assert np.abs(root.translation).max() < 1e-12 * np.abs(body.shapes).max()
    assert np.abs(root.rotation[:2]).max() < 1e-10 * np.abs(root.rotation[2]).max()


def test_modes_of_a_free_body_stay_as_they_are(stocky: Beam) -> None:
    modes = stocky.modes
    body = floating_body(stocky.fe, modes.omega, modes.shapes, stocky.markers, "side")
    assert body.omega == pytest.approx(modes.omega, rel=1e-9)
    assert np.abs(np.abs(body.shapes) - np.abs(modes.shapes)).max() < 1e-6 * np.abs(modes.shapes).max()
    assert body.x == pytest.approx(stocky.fe.x - stocky.markers["side"].position, abs=1e-15)
    # Tisserand's frame: neither momentum nor moment of momentum about the centre of mass comes from the modes
    n = len(modes.omega)
    M = body.integrals.mass_matrix(np.eye(1, 1 + n)[0])
    assert np.abs(M[:6, 6:]).max() < 1e-8 * np.sqrt(np.diag(M)[:6].max())


@pytest.mark.parametrize("joint", JOINTS)
def test_a_rigid_motion_among_the_shapes_is_refused_with_the_figure(stocky: Beam, joint: str) -> None:
    spin = np.cross(Z, stocky.fe.x - [0.1, 0.05, 0.0])[:, :, None]
    shapes = np.concatenate([stocky.modes.shapes, spin / np.sqrt(np.einsum("iak,iak->", spin, spin))], axis=2)
    omega = np.append(stocky.modes.omega, 0.0)
    message = (
        r"fixed at 'root', the 16 shapes depend on one another: a combination of them keeps -?\d\.\de[-+]\d+ of its"
    )
    with pytest.raises(AccuracyError, match=message):
        reduced_body(stocky.fe, omega, shapes, stocky.markers, "root", JOINTS[joint])


def test_shapes_that_differ_by_a_rigid_motion_are_refused_at_a_clamp(stocky: Beam) -> None:
    moved = stocky.modes.shapes[..., :1] + np.cross(Z, stocky.fe.x)[:, :, None]
    shapes = np.concatenate([stocky.modes.shapes, moved], axis=2)
    omega = np.append(stocky.modes.omega, stocky.modes.omega[0])
    with pytest.raises(AccuracyError, match="take fewer modes or modes of the body fixed there"):
        reduced_body(stocky.fe, omega, shapes, stocky.markers, "root", JOINTS["clamp"])


def test_a_shape_that_moves_with_the_free_frame_is_refused(stocky: Beam) -> None:
    # a unit of the mode, and a hundredth of a translation along x of unit modal mass
    shapes = stocky.modes.shapes.copy()
    shapes[:, 0, 3] += 0.01 / np.sqrt(stocky.fe.mass)
    with pytest.raises(
        AccuracyError, match=r"a shape is a rigid motion in part, 1\.0e-02 of 1; take modes of the free"
    ):
        floating_body(stocky.fe, stocky.modes.omega, shapes, stocky.markers, "root")


def test_a_spin_among_the_shapes_is_refused_in_the_free_modes_own_frame(stocky: Beam) -> None:
    spin = np.cross(Z, stocky.fe.x)[:, :, None]
    spin /= np.sqrt(np.einsum("iak,ij,jak->", spin, stocky.fe.m.toarray(), spin))
    shapes = np.concatenate([stocky.modes.shapes, spin], axis=2)
    omega = np.append(stocky.modes.omega, 0.0)
    with pytest.raises(AccuracyError, match=r"a combination of the 16 shapes is a rigid motion: ω² = .* beside \d"):
        free_frame_body(stocky.fe, omega, shapes, stocky.markers, "root", Z)
