"""Cyclic symmetry: one sector gives what the whole body does, and a body without it is refused."""

from dataclasses import replace
from functools import partial
from math import pi, radians
from typing import Literal

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse.linalg import LinearOperator, eigsh, lobpcg

from fmd import Pipeline, load_scene
from fmd.core.errors import AccuracyError
from fmd.fem.assembly import assemble
from fmd.fem.markers import face_marker
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.meshes.propeller import mesh
from fmd.reduction.cyclic import CyclicSolver, cut_first_sector
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.factor.factor import Solver, factorise
from fmd.scene.propeller import Propeller

ALUMINIUM = Material(E=70e9, nu=0.3, rho=2780.0)


def model(blades: int, order: int = 1, element: Literal["hexahedron", "tetrahedron"] = "hexahedron") -> FEModel:
    table = Propeller(
        shape="propeller",
        blades=blades,
        bore=0.08,
        hub=0.15,
        root=0.26,
        diameter=0.9,
        length=0.11,
        chord=(0.095, 0.06),
        thickness=(0.03, 0.01),
        pitch=(radians(60), radians(30)),
        camber=0.03,
        E=ALUMINIUM.E,
        nu=ALUMINIUM.nu,
        rho=ALUMINIUM.rho,
        modes={"count": 1},
        mesh={
            "element": element,
            "order": order,
            "sleeve": (4 * blades, 2, 1),
            "joint": (2, 2, 2 // order),
            "blade": (2, 2, 4 // order),
            "growth": 2.0,
        },
    )
    return assemble(SolidMesh(*mesh(table)), order, ALUMINIUM)


@pytest.fixture(scope="module", params=[(3, 1), (4, 1), (5, 1), (3, 2), (3, 1, "tetrahedron")], ids=str)
def body(request: pytest.FixtureRequest) -> tuple[FEModel, int]:
    return model(*request.param), request.param[0]


def test_a_sector_and_its_turns_make_the_body(body: tuple[FEModel, int]) -> None:
    fe, blades = body
    sector = cut_first_sector(fe, blades)
    assert blades * sector.fe.mass == pytest.approx(fe.mass, rel=1e-12)
    u = np.random.default_rng(0).standard_normal((len(fe.x), 3))
    energy = 0.0
    for k, image in enumerate(sector.images):
        own = sector.turn(u[image], -k).ravel()
        energy += own @ (sector.fe.K @ own)
    assert energy == pytest.approx(u.ravel() @ (fe.K @ u.ravel()), rel=1e-12)


def test_the_inverse_is_that_of_the_whole(body: tuple[FEModel, int]) -> None:
    fe, blades = body
    solver = CyclicSolver(fe, blades)
    f = np.random.default_rng(1).standard_normal((fe.K.shape[0], 3))
    u = solver._inverse(f)
    assert np.linalg.norm(fe.K @ u - solver.shift * (fe.M @ u) - f) < 1e-8 * np.linalg.norm(f)
    assert solver._inverse(f[:, 0]) == pytest.approx(u[:, 0], rel=1e-9, abs=1e-9 * np.abs(u).max())


@pytest.mark.slow
def test_the_modes_are_those_that_lapack_finds(body: tuple[FEModel, int]) -> None:
    fe, blades = body
    modes = CyclicSolver(fe, blades).modes(15)
    eigenvalues, Phi = eigh(fe.K.toarray(), fe.M.toarray(), subset_by_index=(0, 30))
    assert modes.n_rigid == 6
    # LAPACK leaves the round-off of the highest eigenvalue in the lowest ones
    (highest,) = eigsh(fe.K, 1, fe.M, which="LM", return_eigenvectors=False)
    assert modes.omega**2 == pytest.approx(eigenvalues[6:21], rel=1e-9, abs=1e-15 * highest)
    # each mode lies among LAPACK's of the same frequency
    found = modes.shapes.reshape(len(Phi), -1)
    for k, omega2 in enumerate(modes.omega**2):
        alike = Phi[:, np.abs(eigenvalues - omega2) < 1e-6 * omega2]
        assert np.linalg.norm(alike.T @ (fe.M @ found[:, k])) == pytest.approx(1.0, abs=1e-8)


def test_static_responses_are_those_of_the_whole(body: tuple[FEModel, int]) -> None:
    fe, blades = body
    f = np.random.default_rng(2).standard_normal((len(fe.x), 3, 2))
    whole, cyclic = (solver.static_response(f) for solver in (FreeBodySolver(fe), CyclicSolver(fe, blades)))
    assert cyclic == pytest.approx(whole, abs=1e-8 * np.abs(whole).max())


@pytest.mark.parametrize("solver", ["cholesky", "multifrontal"])
def test_any_factor_of_a_sectors_inside_gives_the_modes_of_the_whole(solver: Solver) -> None:
    if solver == "cholesky":
        pytest.importorskip("cvxopt", reason="cvxopt is not installed")
    fe = model(3)
    modes = CyclicSolver(fe, 3, partial(factorise, solver=solver)).modes(8)
    assert modes.omega == pytest.approx(FreeBodySolver(fe).modes(8).omega, rel=1e-8)
    assert modes.factor is not None
    assert modes.factor.unknowns < fe.K.shape[0] / 3


def test_a_held_body_has_the_modes_of_the_whole() -> None:
    fe = model(3)
    held = face_marker(fe.discretisation, fe.discretisation.mesh.faces["bore"]).columns(len(fe.x), np.eye(3))
    whole, cyclic = (solver.modes(8, held) for solver in (FreeBodySolver(fe), CyclicSolver(fe, 3)))
    assert cyclic.n_rigid == 0
    assert cyclic.omega == pytest.approx(whole.omega, rel=1e-8)


def test_a_body_with_one_blade_bent_is_refused() -> None:
    fe = model(3)
    points = fe.discretisation.mesh.points.copy()
    points[points[:, 0] > 0.3] += (0.0, 0.0, 1e-3)
    bent = assemble(replace(fe.discretisation.mesh, points=points), 1, ALUMINIUM)
    with pytest.raises(AccuracyError, match="turns of the mesh's first sector don't make the mesh"):
        CyclicSolver(bent, 3)


def test_two_sectors_are_too_few() -> None:
    with pytest.raises(ValueError, match="at least 3"):
        CyclicSolver(model(2), 2)


@pytest.mark.slow
def test_the_propeller_has_the_modes_that_two_other_solvers_find() -> None:
    """Shift-invert Lanczos on the whole body, and LOBPCG on it."""
    coarse = "body.propeller.mesh={order=1, sleeve=[36, 3, 2], joint=[3, 4, 4], blade=[3, 4, 9], growth=4.0}"
    run = Pipeline(load_scene("propeller", [coarse]))
    fe, modes = run.fe, run.modes
    assert modes.omega == pytest.approx(FreeBodySolver(fe).modes(24).omega, rel=1e-8)
    # pairs come complete: the first, second, fourth … are double
    pairs = np.diff(modes.omega) < 1e-8 * modes.omega[1:]
    assert np.flatnonzero(pairs)[:4].tolist() == [0, 3, 6, 9]
    inverse = CyclicSolver(fe, 6)._inverse
    inverse = LinearOperator(fe.K.shape, inverse, matmat=inverse, dtype=float)
    start = np.random.default_rng(3).standard_normal((fe.K.shape[0], 12))
    values, _ = lobpcg(fe.K, start, fe.M, inverse, fe.rigid_modes, tol=30.0, maxiter=40, largest=False)
    assert np.sort(values)[:6] == pytest.approx(modes.omega[:6] ** 2, rel=1e-6)
    assert 2 * pi * modes.frequencies_hz == pytest.approx(modes.omega)
