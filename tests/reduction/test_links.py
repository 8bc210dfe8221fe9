"""Bodies with links and lumped masses: frequencies of CalculiX, closed forms, dense algebra, a spinning disc."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq

from fmd.core.arrays import Array, IntArray
from fmd.fem import assembly
from fmd.fem.assembly import assemble
from fmd.fem.formats.import_mesh import read_mesh
from fmd.fem.links import Linked, LinkedFace, LinkedModel, LumpedMass, link_points
from fmd.fem.markers import face_marker
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.fem.selection import nodes_on_faces
from fmd.fem.space import Discretisation
from fmd.meshes.bar import hexahedral_bar
from fmd.reduction.body import supported_body
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.free_motions import count_pieces
from fmd.reduction.modes import EigenPairs
from fmd.reduction.rotating import rotating_modes
from fmd.reduction.stiffening import stiffen_body

BRACKET = Path(__file__).parents[1] / "fem" / "formats" / "decks" / "bracket.inp"
REFERENCE = np.array([0.042, 0.0, 0.03])
# CalculiX 2.20: *RIGID BODY of the nodes of BORE, MASS of 0.4 kg on its reference node, nodes of FOOT fixed.
CALCULIX_HZ = [375.066, 640.655, 1624.415, 7594.937, 20453.998, 22452.978]


def clamp(fe: FEModel, face: str) -> IntArray:
    nodes = nodes_on_faces(fe.discretisation, [fe.discretisation.mesh.faces[face]])
    return np.asarray((3 * nodes[:, None] + np.arange(3)).ravel())


def linked(fe: FEModel, face: str, rigid: bool, at: Array, mass: float, inertia: Array | None = None) -> LinkedModel:
    space = fe.discretisation
    link = LinkedFace(face_marker(space, space.mesh.faces[face], rigid), at)
    J = np.zeros((3, 3)) if inertia is None else inertia
    return link_points(fe, Linked({"end": link}, [LumpedMass("end", mass, at, J)]))


def test_a_bracket_with_a_motor_on_a_rigid_bore_has_the_frequencies_of_calculix() -> None:
    # CalculiX integrates masses of quadratic tetrahedra at four points; with these it is the same in all its digits.
    mesh = read_mesh(BRACKET, 1.0)
    space = Discretisation(mesh, 2)
    found = {}
    for order in (space.kind.mass_order, 2):
        own, aluminium = Discretisation(mesh, 2), Material(70e9, 0.33, 2700.0)
        own.__dict__["kind"] = replace(space.kind, mass_order=order)
        fe = FEModel(own, aluminium, assembly._stiffness(own, aluminium), assembly._mass(own, aluminium))
        model = linked(fe, "BORE", True, REFERENCE, 0.4)
        found[order] = FreeBodySolver(model, fixed=clamp(model, "FOOT")).modes(6).omega / 2 / np.pi
    assert np.round(found[2], 3).tolist() == CALCULIX_HZ
    assert found[space.kind.mass_order] == pytest.approx(CALCULIX_HZ, rel=5e-5)


@pytest.mark.parametrize("rigid", [True, False])
def test_a_rod_with_a_mass_at_its_end_has_the_axial_frequency_of_the_closed_form(rigid: bool) -> None:
    """``tan(ωL/c) ωL/c = ρAL/M`` without lateral contraction; the section moves as a whole, linked in either way."""
    E, rho, length, width, mass = 70e9, 2700.0, 0.5, 0.02, 0.3
    fe = assemble(SolidMesh(*hexahedral_bar(length, width, width, (10, 1, 1))), 2, Material(E, 0.0, rho))
    model = linked(fe, "x+", rigid, np.array([length, 0.0, 0.0]), mass)
    pairs = FreeBodySolver(model, fixed=clamp(model, "x-")).modes(12)
    axial = (pairs.shapes[:, 0] ** 2).sum(axis=0) > 0.9 * (pairs.shapes**2).sum(axis=(0, 1))
    ratio = rho * width**2 * length / mass
    root = brentq(lambda z: z * np.tan(z) - ratio, 1e-3, 1.5)
    assert pairs.omega[axial][0] == pytest.approx(root / length * np.sqrt(E / rho), rel=1e-7)


@pytest.mark.parametrize("fixed", [True, False])
def test_a_mass_on_an_average_link_adds_its_inertia_in_the_mean_motion(small_bar: FEModel, fixed: bool) -> None:
    """Dense: ``M + Dᵀ diag(m 1, J) D`` with D the displacement and rotation of the reference by the face's weights."""
    at, J, mass = np.array([0.33, 0.05, -0.02]), np.diag([2e-4, 3e-4, 4e-4]), 0.7
    model = linked(small_bar, "x+", False, at, mass, J)
    marker = face_marker(small_bar.discretisation, small_bar.discretisation.mesh.faces["x+"])
    columns = marker.columns(len(small_bar.x), np.eye(3)).reshape(-1, 6)
    turn = columns[:, 3:].T
    D = np.concatenate([columns[:, :3].T + np.cross(turn.T, at - marker.position).T, turn])
    K, M = small_bar.K.toarray(), small_bar.M.toarray() + D.T @ np.diag([mass] * 3 + J.diagonal().tolist()) @ D
    held = clamp(small_bar, "x-") if fixed else np.zeros(0, dtype=int)
    kept = np.setdiff1d(np.arange(len(K)), held)
    exact = np.sqrt(eigh(K[np.ix_(kept, kept)], M[np.ix_(kept, kept)], eigvals_only=True)[(0 if fixed else 6) :][:8])
    solver = FreeBodySolver(model, fixed=held if fixed else None)
    pairs = solver.modes(8)
    assert pairs.omega == pytest.approx(exact, rel=1e-8)
    assert pairs.n_rigid == (0 if fixed else 6)
    f = np.zeros((len(model.x), 3, 1))
    f[model.references["end"][0], 2] = 1.0  # a force at the reference acts on the face by the same weights
    u = solver.static_response(f)
    if fixed:
        g = D[2, kept]
        assert u[: len(small_bar.x)].reshape(-1)[kept] == pytest.approx(
            np.linalg.solve(K[np.ix_(kept, kept)], g), abs=1e-12
        )


def test_a_rigid_link_to_the_middle_of_its_own_face_is_a_rigid_attachment(small_bar: FEModel) -> None:
    space = small_bar.discretisation
    marker = face_marker(space, space.mesh.faces["x+"], rigid=True)
    alone = FreeBodySolver(small_bar, [marker]).modes(6)
    model = link_points(small_bar, Linked({"end": LinkedFace(marker, marker.position + np.array([0.1, 0.2, 0.3]))}))
    pairs = FreeBodySolver(model).modes(6)
    assert pairs.omega == pytest.approx(alone.omega, rel=1e-9)
    at = model.marker("end")
    assert at.rotation(pairs.shapes) == pytest.approx(marker.rotation(pairs.shapes[: len(small_bar.x)]), abs=1e-9)


def test_parts_of_a_mesh_that_a_link_joins_are_one_piece(box_mesh: Callable[..., SolidMesh], steel: Material) -> None:
    one, n = box_mesh("hexahedron", (2, 1, 1)), 12
    points = np.concatenate([one.points, one.points + np.array([2.0, 0.0, 0.0])])
    mesh = SolidMesh(
        points, np.concatenate([one.cells, one.cells + n]), "hexahedron", {}, {"inner": np.r_[8:12, 12:16]}
    )
    fe = assemble(mesh, 1, steel)
    assert count_pieces(fe.K) == 2
    link = LinkedFace(face_marker(fe.discretisation, mesh.faces["inner"], rigid=True), np.zeros(3))
    model = link_points(fe, Linked({"bolt": link}))
    assert count_pieces(model.K, model.T) == 1
    assert FreeBodySolver(model).modes(4).n_rigid == 6


def test_links_that_share_nodes_with_others_or_a_support_are_refused(small_bar: FEModel) -> None:
    space = small_bar.discretisation
    markers = [face_marker(space, space.mesh.faces[face], rigid=True) for face in ("x+", "y+")]
    with pytest.raises(ValueError, match="moved by two links"):
        link_points(small_bar, Linked({str(k): LinkedFace(marker, np.zeros(3)) for k, marker in enumerate(markers)}))
    model = linked(small_bar, "x+", True, np.zeros(3), 1.0)
    with pytest.raises(ValueError, match="share nodes"):
        FreeBodySolver(model, fixed=clamp(model, "y+"))
    with pytest.raises(ValueError, match="a rigid face and a link share nodes"):
        FreeBodySolver(model, markers[1:])


def test_a_rigid_face_beside_a_link_is_tied_as_by_a_link_of_its_own(small_bar: FEModel) -> None:
    space = small_bar.discretisation
    foot, end = (face_marker(space, space.mesh.faces[face], rigid=True) for face in ("x-", "x+"))
    mass = LumpedMass("end", 0.4, end.position, np.diag([1e-4] * 3))
    one = link_points(small_bar, Linked({"end": LinkedFace(end, end.position)}, [mass]))
    links = {"end": LinkedFace(end, end.position), "foot": LinkedFace(foot, foot.position)}
    both = link_points(small_bar, Linked(links, [mass]))
    assert FreeBodySolver(one, [foot]).modes(6).omega == pytest.approx(FreeBodySolver(both).modes(6).omega, rel=1e-9)


def rotor_frequencies(flexibility: Array, mass: float, J: float, Jp: float, rate: float) -> Array:
    """Return ω of a disc on a massless shaft in fixed axes, forward whirl positive: ``M q̈ − i Ω G q̇ + K q = 0``."""
    M, G, K = np.diag([mass, J]), np.diag([0.0, Jp]), np.linalg.inv(flexibility)
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, K), np.linalg.solve(M, 1j * rate * G)]])
    return np.sort((np.linalg.eigvals(A) / 1j).real)


@pytest.mark.parametrize("rigid", [True, False])
@pytest.mark.parametrize("rate", [0.0, 200.0, 600.0])
def test_a_disc_on_a_spinning_shaft_whirls_as_in_the_textbook(rigid: bool, rate: float) -> None:
    """A disc beyond the end of a light shaft, whose flexibility is that of the elements; in axes that turn ω − Ω.

    Without the second-order motion of the disc's arms it would be another rotor, whose motion grows.
    """
    length, width, reach = 0.3, 0.018, 0.02
    mass, J, Jp = 5.0, 0.02, 0.04
    fe = assemble(SolidMesh(*hexahedral_bar(length, width, width, (8, 2, 2))), 2, Material(200e9, 0.3, 1e-4))
    at = np.array([length + reach, 0.0, 0.0])
    model = linked(fe, "x+", rigid, at, mass, np.diag([Jp, J, J]))
    fixed = clamp(model, "x-")
    solver = FreeBodySolver(model, fixed=fixed)
    space = model.discretisation
    markers = {"foot": face_marker(space, space.mesh.faces["x-"]), "disc": model.marker("end")}
    loads = markers["disc"].columns(len(model.x), np.eye(3))[:, :, [1, 5]]
    answers = solver.static_response(loads)
    flexibility = np.einsum("iak,ial->kl", loads, answers)  # of a force along y and a torque about z
    pairs: EigenPairs = solver.modes(6)
    body = supported_body(model, pairs.omega, pairs.shapes, markers, "foot", np.zeros((0, 3)))
    x = np.array([1.0, 0.0, 0.0])
    whole = stiffen_body(body, model, solver, None, moving=markers, elements=False)
    found = rotating_modes(whole, x, rate)
    exact = np.abs(rotor_frequencies(flexibility, mass, J, Jp, rate) - rate)
    mine = 2 * np.pi * found.frequencies_hz
    assert all(np.abs(mine - omega).min() < 1e-5 * omega for omega in exact)
    assert found.growth.max() < 1e-5
    if rate == 600.0:  # the first order alone
        assert rotating_modes(body, x, rate).growth.max() > 10.0
