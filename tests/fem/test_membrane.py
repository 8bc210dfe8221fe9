"""Stretching by large deflection, against the energies of a beam."""

import numpy as np
import pytest

from fmd.accuracy.deflection import excess_deflection
from fmd.core.limits.errors import OF_BENDING
from fmd.fem.assembly import assemble
from fmd.fem.geometric_stiffness import membrane_ratio, quadratic_strain_load
from fmd.fem.markers import Marker
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.meshes.bar import hexahedral_bar
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.factor.factor import factorise
from tests.fem.nonlinear_solid import NonlinearSolid

LENGTH, WIDTH, DEPTH = 1.0, 0.02, 0.005
SOFT = Material(E=70e9, nu=0.0, rho=2700.0)


def strip() -> FEModel:
    return assemble(SolidMesh(*hexahedral_bar(LENGTH, WIDTH, DEPTH, (32, 1, 1))), 2, SOFT)


def ratio(fe: FEModel, held: tuple[float, ...], load: float) -> tuple[float, float]:
    """Return the stiffening of a strip held at some of its sections under a uniform load, and its deflection."""
    along = fe.x[:, 0] - fe.x[:, 0].min()
    nodes = np.flatnonzero(np.min([np.abs(along - x) for x in held], axis=0) < 1e-9)
    solver = FreeBodySolver(fe, [], (3 * nodes[:, None] + np.arange(3)).ravel(), factorise)
    weight = np.zeros((len(fe.x), 3, 1))
    weight[:, 2, 0] = load * np.asarray(fe.m.sum(axis=1)).ravel()
    u = solver.static_response(weight)[:, :, 0]
    f, energy = quadratic_strain_load(fe, u)
    v = solver.static_response(-f[:, :, None])[:, :, 0]
    return membrane_ratio(fe, u, v, f, energy), float(np.abs(u[:, 2]).max())


def test_a_strip_held_at_both_ends_stiffens_as_von_karmans_beam() -> None:
    """With ``w ~ x² (1 − x)²`` the tension ``EA/2L ∫ w'²`` has energies in the ratio 0.697 (w/h)²."""
    stiffer, deflection = ratio(strip(), (0.0, LENGTH), 300.0)
    assert stiffer == pytest.approx(0.697 * (deflection / DEPTH) ** 2, rel=0.05)


def test_a_cantilever_is_free_to_shorten_and_hardly_stiffens() -> None:
    stiffer, deflection = ratio(strip(), (0.0,), 30.0)
    assert deflection > 10 * DEPTH
    assert stiffer < 2 * (deflection / LENGTH) ** 2


def test_a_strip_that_bends_evenly_answers_to_its_largest_rotation_alone() -> None:
    """So much is taken for large rotation, and no more is left for stretch."""
    fe = strip()
    root, end = (np.flatnonzero(np.abs(fe.x[:, 0] - x) < 1e-9) for x in (fe.x[:, 0].min(), fe.x[:, 0].max()))
    solver = FreeBodySolver(fe, [], (3 * root[:, None] + np.arange(3)).ravel(), factorise)
    moment = np.zeros((len(fe.x), 3, 1))
    moment[end, 0, 0] = 1e3 * fe.x[end, 2]
    u = solver.static_response(moment)[:, :, 0]
    f, energy = quadratic_strain_load(fe, u)
    ratio = membrane_ratio(fe, u, solver.static_response(-f[:, :, None])[:, :, 0], f, energy)
    turn = np.polyfit(fe.x[end, 2], u[end, 0], 1)[0]
    assert 0.6 * turn**2 < ratio < OF_BENDING * turn**2


def test_at_constant_gradients_energy_and_load_are_their_integrands_times_the_volume() -> None:
    """Of ``u = A x`` the quadratic strain is ``½ Aᵀ A``; without Poisson's ratio stress is E times the strain."""
    fe, (A, B) = strip(), 1e-3 * np.random.default_rng(1).normal(size=(2, 3, 3))
    f, energy = quadratic_strain_load(fe, fe.x @ A.T)
    strain, stiff = 0.5 * A.T @ A, SOFT.E * LENGTH * WIDTH * DEPTH
    assert energy == pytest.approx(0.5 * stiff * (strain**2).sum(), rel=1e-9)
    work = stiff * ((strain * B).sum() + (0.5 * (A + A.T) * (A.T @ B)).sum())
    assert (f * (fe.x @ B.T)).sum() == pytest.approx(work, rel=1e-9)


def test_the_load_is_quadratic_and_its_energy_quartic_and_no_translation_works() -> None:
    fe = strip()
    u = 1e-4 * np.sin(fe.x @ np.random.default_rng(0).normal(size=(3, 3)))
    f, energy = quadratic_strain_load(fe, u)
    twice, of_twice = quadratic_strain_load(fe, 2 * u)
    assert twice == pytest.approx(4 * f, rel=1e-9, abs=1e-9 * np.abs(f).max())
    assert of_twice == pytest.approx(16 * energy, rel=1e-12)
    assert np.abs(f.sum(axis=0)).max() < 1e-9 * np.abs(f).sum()


def test_a_twisted_plate_stiffens_as_a_nonlinear_solid_does() -> None:
    """Corners of a cantilever two thicknesses up and down: a seventh of the linear deflection isn't there."""
    plate = SolidMesh(*hexahedral_bar(0.3, 0.3, 0.002, (6, 6, 1)))
    fe = assemble(plate, 2, Material(E=70e9, nu=0.3, rho=2700.0))
    x, root = fe.x, np.flatnonzero(fe.x[:, 0] < fe.x[:, 0].min() + 1e-9)
    ends = [np.linalg.norm(x - [x[:, 0].max(), y, 0.0], axis=1).argmin() for y in (x[:, 1].max(), x[:, 1].min())]
    root_marker, corners = (
        Marker(x[nodes].mean(axis=0), nodes, weights, np.zeros((3, len(nodes), 3)))
        for nodes, weights in ((root, np.ones(len(root))), (np.array(ends), np.array([1.0, -1.0])))
    )
    solid = NonlinearSolid(fe, root_marker, corners)
    force = np.array([0.0, 0.0, 10.0])
    load = solid.load(force)
    solver = FreeBodySolver(fe, [], (3 * root[:, None] + np.arange(3)).ravel(), factorise)
    u = solver.static_response(load[:, :, None])[:, :, 0]
    f, energy = quadratic_strain_load(fe, u)
    ratio = membrane_ratio(fe, u, solver.static_response(-f[:, :, None])[:, :, 0], f, energy)
    true = float((load * u).sum() / (load * solid.rest(force)).sum()) - 1
    assert true > 0.1
    assert true < excess_deflection(ratio) < 1.2 * true
