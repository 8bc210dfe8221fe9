"""Craig and Bampton's reduction: exact in rigid motion and in statics at the interface, from above in frequency."""

import numpy as np
import pytest

from fmd.core.errors import AccuracyError
from fmd.fem.local_markers import point_marker
from fmd.fem.markers import Marker, face_marker
from fmd.fem.model import FEModel
from fmd.fem.selection import nodes_on_faces
from fmd.reduction.craig_bampton import (
    _count_rigid_motions,
    constraint_modes,
    craig_bampton_modes,
    craig_bampton_modes_of_family,
    interface_columns,
)
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.modes import TooManyModesError

BOTH = pytest.mark.parametrize("rigid", [False, True], ids=["averaged", "rigid"])


def ends(fe: FEModel, rigid: bool = False) -> list[Marker]:
    faces = fe.discretisation.mesh.faces
    return [face_marker(fe.discretisation, faces[name], rigid) for name in ("x-", "x+")]


def solver_of(fe: FEModel, markers: list[Marker]) -> FreeBodySolver:
    return FreeBodySolver(fe, [marker for marker in markers if marker.rigid])


@pytest.fixture(scope="module")
def clamped(small_bar: FEModel) -> FreeBodySolver:
    """The bar, clamped at x-."""
    nodes = nodes_on_faces(small_bar.discretisation, [small_bar.discretisation.mesh.faces["x-"]])
    return FreeBodySolver(small_bar, (), (3 * nodes[:, None] + np.arange(3)).ravel())


@BOTH
def test_constraint_modes_move_the_interface_by_units_and_cost_least(small_bar: FEModel, rigid: bool) -> None:
    markers = ends(small_bar, rigid)
    B = interface_columns(small_bar, markers)
    Psi = constraint_modes(small_bar, solver_of(small_bar, markers), B)
    flat = B.reshape(len(Psi), 12)
    assert flat.T @ Psi == pytest.approx(np.eye(12), abs=1e-9)
    if not rigid:  # in balance with forces at the interface alone: K Ψ = B F
        defect = small_bar.K @ Psi
        rest = defect - flat @ np.linalg.lstsq(flat, defect, rcond=None)[0]
        assert (np.linalg.norm(rest, axis=0) < 1e-8 * np.linalg.norm(defect, axis=0)).all()
    # the rigid motions are what comes of moving all markers rigidly
    R = small_bar.rigid_modes
    assert Psi @ (flat.T @ R) == pytest.approx(R, abs=1e-9)


def test_an_end_force_deflects_a_constraint_mode_as_a_beam(small_bar: FEModel) -> None:
    # A beam built in at both ends: 12 EI/L³ across, with shear's part 12 EI/(κ G A L²) of one. Rigid ends don't warp.
    markers = ends(small_bar, rigid=True)
    Psi = constraint_modes(small_bar, solver_of(small_bar, markers), interface_columns(small_bar, markers))
    E, nu = small_bar.material.E, small_bar.material.nu
    bending, shear = E * 0.02 * 0.04**3 / 12, 5 / 6 * E / (2 * (1 + nu)) * 0.02 * 0.04
    softer = 1 + 12 * bending / (shear * 0.3**2)
    assert Psi[:, 7] @ (small_bar.K @ Psi[:, 7]) == pytest.approx(12 * bending / 0.3**3 / softer, rel=0.05)
    # stretched: E A/L, a little more where the rigid ends forbid the contraction
    assert Psi[:, 6] @ (small_bar.K @ Psi[:, 6]) == pytest.approx(E * 0.04 * 0.02 / 0.3, rel=0.03)


@BOTH
def test_its_frequencies_come_down_to_those_of_the_free_body(small_bar: FEModel, rigid: bool) -> None:
    markers = ends(small_bar, rigid)
    solver = solver_of(small_bar, markers)
    exact = solver.modes(6).omega
    excess = []
    for count in (6, 12, 24, 48):
        modes = craig_bampton_modes(small_bar, solver, markers, count)
        assert (modes.n_rigid, len(modes.omega)) == (6, count + 12 - 6)
        excess.append(modes.omega[:6] / exact - 1)
    assert np.min(excess) > -1e-9
    assert (np.diff(excess, axis=0) < 1e-9).all()
    assert np.max(excess[-1]) < 5e-4


@BOTH
def test_its_shapes_are_orthonormal_and_hold_no_rigid_motion(small_bar: FEModel, rigid: bool) -> None:
    markers = ends(small_bar, rigid)
    modes = craig_bampton_modes(small_bar, solver_of(small_bar, markers), markers, 8)
    Phi = modes.shapes.reshape(len(small_bar.x) * 3, -1)
    assert Phi.T @ (small_bar.M @ Phi) == pytest.approx(np.eye(14), abs=1e-9)
    stiffness = Phi.T @ (small_bar.K @ Phi)
    assert stiffness == pytest.approx(np.diag(modes.omega**2), abs=1e-8 * modes.omega[-1] ** 2)
    assert np.abs(small_bar.rigid_modes.T @ (small_bar.M @ Phi)).max() < 1e-9


@pytest.mark.parametrize("count", [1, 5])
def test_loads_at_the_interface_deflect_it_exactly_however_few_modes_there_are(
    small_bar: FEModel, clamped: FreeBodySolver, count: int
) -> None:
    tip = ends(small_bar)[1]
    modes = craig_bampton_modes(small_bar, clamped, [tip], count)
    assert modes.n_rigid == 0
    f = tip.columns(len(small_bar.x), np.eye(3)).reshape(-1, 6)
    Phi = modes.shapes.reshape(len(f), -1)
    held = np.flatnonzero(~Phi.any(axis=1))
    free = np.setdiff1d(np.arange(len(f)), held)
    want = np.linalg.solve(small_bar.K.toarray()[np.ix_(free, free)], f[free])
    found = (Phi @ ((Phi.T @ f) / modes.omega[:, None] ** 2))[free]
    assert (np.abs(found - want).max(axis=0) < 1e-8 * np.abs(want).max(axis=0)).all()


def test_an_interface_that_a_support_holds_is_refused(small_bar: FEModel, clamped: FreeBodySolver) -> None:
    with pytest.raises(AccuracyError, match="its markers can't move apart from one another"):
        craig_bampton_modes(small_bar, clamped, ends(small_bar), 4)


def test_the_rigid_motions_found_are_counted_against_those_expected(small_bar: FEModel) -> None:
    B = interface_columns(small_bar, ends(small_bar))
    Psi, R = constraint_modes(small_bar, FreeBodySolver(small_bar), B), small_bar.rigid_modes
    zero = 1e-6 * FreeBodySolver(small_bar).modes(1).omega[0] ** 2
    assert _count_rigid_motions(small_bar, R, Psi, zero) == 6
    with pytest.raises(AccuracyError, match="space holds 6 rigid motions, the supports leave 5; its lowest eigenval"):
        _count_rigid_motions(small_bar, R[:, :5], Psi, zero)
    other = np.exp(small_bar.x).ravel()[:, None]  # no rigid motion, in the place of one
    with pytest.raises(AccuracyError, match=r"misses \d\.\de-0\d of a rigid motion, above 1e-06"):
        _count_rigid_motions(small_bar, np.c_[R[:, :5], other], Psi, zero)


def test_more_modes_than_the_mesh_has_are_refused(small_bar: FEModel) -> None:
    markers = ends(small_bar)
    with pytest.raises(
        TooManyModesError, match=r"at most \d+ modes can be computed of this mesh; take fewer, or refine it"
    ):
        craig_bampton_modes(small_bar, FreeBodySolver(small_bar), markers, 5000)


def test_a_family_holds_what_deflects_alike_on_both_sides_of_its_planes(small_bar: FEModel) -> None:
    """Two ends have two displacements and two rotations in the plane of bending, of which two are rigid motions."""
    markers, normal = ends(small_bar), np.array([0.0, 0.0, 1.0])
    solver = solver_of(small_bar, markers)
    every = craig_bampton_modes(small_bar, solver, markers, 8)
    modes = craig_bampton_modes_of_family(small_bar, solver, markers, 1, "in-plane bending", normal)
    assert modes.shapes.shape[2] == 2 + 1
    assert np.abs(every.omega - modes.omega[0]).min() < 1e-3 * modes.omega[0]
    across = markers[1].translation(modes.shapes)
    assert np.abs(across[[0, 2]]).max() < 1e-6 * np.abs(across[1]).max()


def test_an_interface_askew_has_no_families(small_bar: FEModel) -> None:
    corner = small_bar.x[(small_bar.x @ [1.0, 1.0, 1.0]).argmax()]
    markers = [ends(small_bar)[0], point_marker(small_bar.discretisation, corner)]
    with pytest.raises(AccuracyError, match="have no symmetry, so they are of no family"):
        craig_bampton_modes_of_family(
            small_bar, solver_of(small_bar, markers), markers, 1, "in-plane bending", np.array([0.0, 0.0, 1.0])
        )
