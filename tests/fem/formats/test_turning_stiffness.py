"""Geometric stiffness of matrices with rotations: this package's own beams by another path, and a turning blade."""

import shutil
import subprocess
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.linalg import eigh

import fmd
from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError, InputError
from fmd.core.rotations import rigid_motions
from fmd.fem.assembly import assemble
from fmd.fem.beams import Beams, extrude
from fmd.fem.formats.matrices import read_matrices
from fmd.fem.formats.program_answers import read_geometric_stiffness, read_stress
from fmd.fem.formats.six_unknowns import SixUnknownsModel
from fmd.fem.geometric_stiffness import geometric_stiffness, reduced_geometric_stiffness
from fmd.fem.material import Material
from fmd.fem.model import FEModel
from fmd.fem.sections import Section, box_section, numbered_section, rectangular_section
from fmd.fem.thicken import Sheet, thicken
from fmd.output.formats import write_format
from fmd.output.frequencies import rotating_table
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.formats.load_cases_file import stiffening_cases
from fmd.reduction.loads import inertia_of
from tests.fem.formats.test_six_unknowns import SI, write

ALLOY = Material(70e9, 0.3, 2700.0)


def own_beams(x: Array) -> tuple[FEModel, sp.csr_array]:
    """Return beams along a line of nodes, and their points by displacement and rotation of each node."""
    ends = np.stack([np.arange(len(x) - 1), np.arange(1, len(x))], axis=1)
    axes = []
    for a, b in x[ends]:
        along = (b - a) / np.linalg.norm(b - a)
        y = np.cross([0.0, 0.0, 1.0], along)
        axes.append([along, y / np.linalg.norm(y), np.cross(along, y / np.linalg.norm(y))])
    drawn = rectangular_section(0.014, 0.014)
    section = (
        replace(drawn, torsion=float(drawn.moments.sum())),
    )  # whose shear has the forces and torque of its nodes
    fe = assemble(extrude(Beams(x, ends, np.array(axes), section, np.zeros(len(ends), int), {}, {})), 1, ALLOY)
    return fe, moved_by_nodes(fe, x)


def moved_by_nodes(fe: FEModel, x: Array) -> sp.csr_array:
    """Return points by displacement and rotation of each node at x."""
    owner = fe.discretisation.mesh.midsurface.owner  # type: ignore[union-attr]
    owner = np.concatenate([owner, np.arange(len(x))])
    entries = rigid_motions(fe.x[: len(owner)] - x[owner])
    columns = 6 * owner[:, None, None] + np.arange(6) + np.zeros((1, 3, 1), dtype=int)
    rows = 3 * np.arange(len(owner))[:, None, None] + np.arange(3)[:, None] + np.zeros((1, 1, 6), dtype=int)
    shape = 3 * len(fe.x), 6 * len(x)
    return sp.csr_array((entries.ravel(), (rows.ravel(), columns.ravel())), shape=shape)


def turned_stiffness(fe: FEModel, G: sp.csr_array, y: Array) -> Array:
    """Return the K_G (k, 6 n, 6 n) of beams or shells at displacements and rotations y (6 n, k) of nodes."""
    u = (G @ y).reshape(-1, 3, y.shape[1])
    by_node = G.toarray().reshape(len(fe.x), 3, -1)
    arms = fe.directors if fe.arms is None else fe.arms
    assert arms is not None
    elements = list(geometric_stiffness(fe, u))
    for k in elements:
        k.resize((len(fe.x), len(fe.x)))
    by_arms = arms.stiffness(-(fe.K @ G @ y).reshape(u.shape), by_node)
    return by_arms + [(G.T @ sp.kron(k, sp.eye_array(3)) @ G).toarray() for k in elements]


def lumps(x: Array) -> Array:
    """Return the masses of square bars of 14 mm, half a length on each end."""
    M, radii = np.zeros((6 * len(x),) * 2), 0.014**2 / 12 * np.array([2.0, 1.0, 1.0])
    for k, length in enumerate(np.linalg.norm(np.diff(x, axis=0), axis=1)):
        own = 6 * k + np.arange(12)
        M[own, own] += 0.5 * ALLOY.rho * 0.014**2 * length * np.tile([1.0, 1.0, 1.0, *radii], 2)
    return M


def bent_line() -> Array:
    return np.array([[0.0, 0, 0], [0.1, 0, 0], [0.2, 0.02, 0], [0.25, 0.1, 0.05], [0.25, 0.15, 0.15], [0.3, 0.2, 0.2]])


@pytest.fixture(scope="module")
def line() -> tuple[Array, FEModel, sp.csr_array, Array]:
    x = bent_line()
    fe, G = own_beams(x)
    return x, fe, G, (G.T @ fe.K @ G).toarray()


def read(path: Path, x: Array, K: Array) -> SixUnknownsModel:
    model = read_matrices(*write(path, x, K, lumps(x)), SI, 6)
    assert isinstance(model, SixUnknownsModel)
    return model


@pytest.mark.parametrize("alone", [True, False])
def test_a_frame_of_beams_has_the_geometric_stiffness_of_its_files_under_any_load(line, alone, tmp_path) -> None:
    x, fe, G, K = line
    model, rng = read(tmp_path, x, K), np.random.default_rng(5)
    solver = FreeBodySolver(model)
    u = solver.static_response(inertia_of(model, list(rng.normal(size=(5, len(model.x), 3)))))
    given = turned_stiffness(fe, G, by_node(model, u))
    for k, own in enumerate(given):
        sp.save_npz(tmp_path / f"kg-{k}.npz", sp.csr_array(1e6 * own + (0 if alone else 1) * K))
    stressed = read_geometric_stiffness(model, sorted(tmp_path.glob("kg-*.npz")), SI[:2])
    share, y = rng.normal(size=5), rng.normal(size=(len(K), 3))
    shapes = np.asarray(model.T @ y[order(model)]).reshape(-1, 3, 3)
    (found,) = reduced_geometric_stiffness(stressed, (u @ share)[:, :, None], shapes)
    wanted = y.T @ np.einsum("k,kij->ij", share, given) @ y
    assert np.abs(found - wanted).max() < 1e-5 * np.abs(wanted).max()


@pytest.mark.parametrize("drawn", [rectangular_section(0.02, 0.03), box_section(0.03, 0.02, 0.002)])
@pytest.mark.parametrize("is_stiff", [False, True])
def test_sections_by_numbers_have_the_geometric_stiffness_of_drawn_ones(drawn: Section, is_stiff: bool) -> None:
    """By a transverse force, whatever share of the area resists shear: it is force and moment that stiffen."""
    about_y, about_z = drawn.moments * drawn.bending**2
    k_y, k_z = (0.0, 0.0) if is_stiff else drawn.shear_areas(ALLOY.nu)
    x, ends = np.array([(0.0, 0, 0), (0.2, 0, 0), (0.5, 0, 0)]), np.array([(0, 1), (1, 2)])
    axes, of, found = np.repeat(np.eye(3)[None], 2, axis=0), np.zeros(2, int), []
    for section in (drawn, numbered_section(drawn.area, (about_y, about_z), drawn.torsion, (k_y, k_z))):
        fe = assemble(extrude(Beams(x, ends, axes, (section,), of, {}, {})), 1, ALLOY)
        G, y = moved_by_nodes(fe, x), np.zeros((18, 1))
        y[6:, 0] = np.linalg.solve((G.T @ fe.K @ G).toarray()[6:, 6:], np.r_[np.zeros(7), 1000.0, 300.0, np.zeros(3)])
        found.append(turned_stiffness(fe, G, y)[0])
    assert np.abs(found[1] - found[0]).max() < 1e-8 * np.abs(found[0]).max()


@pytest.mark.parametrize("folded", [False, True])
def test_shells_whose_normals_turn_freely_are_read_with_their_geometric_stiffness(folded: bool, tmp_path: Path) -> None:
    """Nothing resists a turn about a flat shell's normal, along an axis or obliquely: it follows its neighbours."""
    x = np.array([(i, j, folded * max(i - 2, 0)) for i in range(5) for j in range(4)]) * 0.05
    cells = np.array([[k, k + 4, k + 5, k + 1] for k in range(16) if k % 4 < 3])
    sheet = Sheet(
        x, cells, np.full((12, 4), 0.004), {"all": np.arange(12)}, {}, {}, ("bottom", "top"), np.zeros(12), None
    )
    fe = assemble(thicken(sheet), 1, ALLOY)
    x = fe.discretisation.mesh.midsurface.nodes  # type: ignore[union-attr]
    G = moved_by_nodes(fe, x)
    K, M = ((G.T @ A @ G).toarray() for A in (fe.K, sp.kron(fe.m, sp.eye_array(3))))
    model = read_matrices(*write(tmp_path, x, K, M), SI, 6)
    assert isinstance(model, SixUnknownsModel)
    solver, rng = FreeBodySolver(model), np.random.default_rng(5)
    assert solver.modes(4).omega == pytest.approx(FreeBodySolver(fe).modes(4).omega, rel=1e-3)  # masses are lumped
    u = solver.static_response(inertia_of(model, list(rng.normal(size=(2, len(model.x), 3)))))
    given = turned_stiffness(fe, G, by_node(model, u))
    for k, own in enumerate(given):
        sp.save_npz(tmp_path / f"kg-{k}.npz", sp.csr_array(1e6 * own))
    stressed = read_geometric_stiffness(model, sorted(tmp_path.glob("kg-*.npz")), SI[:2])
    shapes = np.asarray(model.T @ rng.normal(size=(model.T.shape[1], 3))).reshape(-1, 3, 3)  # type: ignore[union-attr]
    y, share = by_node(model, shapes), rng.normal(size=2)
    (found,) = reduced_geometric_stiffness(stressed, (u @ share)[:, :, None], shapes)
    wanted = y.T @ np.einsum("k,kij->ij", share, given) @ y
    assert np.abs(found - wanted).max() < 1e-10 * np.abs(wanted).max()


def clamped(model: SixUnknownsModel, y: Array) -> Array:
    """Return unknowns of the model by displacement and rotation (6 n - 6, k) of all nodes but the first, at rest."""
    return np.concatenate([np.zeros((6, y.shape[1])), y])[order(model)]


def order(model: SixUnknownsModel) -> Array:
    n = len(model.labels)
    return (6 * np.arange(n)[:, None] + np.arange(6)).reshape(n, 2, 3).swapaxes(0, 1).ravel()


def by_node(model: SixUnknownsModel, u: Array) -> Array:
    """Return displacement and rotation of each node (6 n, k) by the displacements of points (n_points, 3, k)."""
    y = np.empty((6 * len(model.labels), u.shape[2]))
    y[order(model)] = model.unknowns(u)
    return y


def test_files_that_are_no_geometric_stiffness_are_refused_with_the_figure(line, tmp_path) -> None:
    x, fe, G, K = line
    model, rng = read(tmp_path, x, K), np.random.default_rng(6)
    u = FreeBodySolver(model).static_response(inertia_of(model, list(rng.normal(size=(1, len(model.x), 3)))))
    (own,) = turned_stiffness(fe, G, by_node(model, u))
    grounded, flat = own.copy(), own.copy()
    grounded[0, 0] += 1e-2 * np.abs(own).max()
    flat[2::6] = flat[:, 2::6] = 0.0  # as if a stress stiffened motions in a plane alone
    for faulty, message in ((grounded, "a translation has a force of"), (flat, "a rotation doesn't turn its load by")):
        sp.save_npz(tmp_path / "kg.npz", sp.csr_array(faulty))
        with pytest.raises(AccuracyError, match=f"kg.npz: no geometric stiffness: of its largest entry .*{message}"):
            read_geometric_stiffness(model, [tmp_path / "kg.npz"], SI[:2])


def test_rotations_that_the_body_has_not_are_refused_by_node(tmp_path) -> None:
    x, K, M = np.zeros((4, 3)), np.zeros((24, 24)), np.zeros((24, 24))
    x[1, 0] = x[2, 1] = x[3, 2] = 1.0
    for i in range(4):  # a truss of four points, which don't turn
        M[6 * i : 6 * i + 3, 6 * i : 6 * i + 3] = np.eye(3)
        for j in range(i):
            e = (x[i] - x[j]) / np.linalg.norm(x[i] - x[j])
            own = np.concatenate([6 * i + np.arange(3), 6 * j + np.arange(3)])
            K[np.ix_(own, own)] += 1e6 * np.kron([[1, -1], [-1, 1]], np.outer(e, e))
    model = read_matrices(*write(tmp_path, x, K, M), SI, 6)
    assert not model.rigid_by_node().reshape(4, 6, 6)[:, 3:].any()  # of which a support could choose none
    A = np.zeros_like(K)
    A[9:12, 9:12] = 1.0
    sp.save_npz(tmp_path / "kg.npz", sp.csr_array(A))
    with pytest.raises(InputError, match=r"kg\.npz: node 101 turns in it, and not in the stiffness"):
        read_geometric_stiffness(model, [tmp_path / "kg.npz"], SI[:2])


def test_a_turning_blade_has_the_frequencies_of_wright_by_the_textbooks_matrices(tmp_path) -> None:
    """Flapping of a uniform cantilever on no hub (Wright, Smith, Thresher & Wang, J Appl Mech 49, 1982).

    K and K_G are Przemieniecki's (1968), whose axial force is that of lumped masses.
    """
    n, L, EI, mass = 40, 1.0, 100.0, 1.0
    x = np.column_stack([np.linspace(0, L, n + 1), np.zeros((n + 1, 2))])
    h, share = L / n, np.full(n + 1, mass / n)
    share[[0, -1]] /= 2
    K, M, N = np.zeros((6 * n + 6,) * 2), np.zeros((6 * n + 6,) * 2), np.cumsum((share * x[:, 0])[::-1])[::-1][1:]
    K_G = np.zeros_like(K)
    bending = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2]])
    bending = np.concatenate([bending, [[-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]]]) * EI / h**3
    pulled = np.array([[36, 3 * h, -36, 3 * h], [3 * h, 4 * h**2, -3 * h, -(h**2)]])
    pulled = np.concatenate([pulled, [[-36, -3 * h, 36, -3 * h], [3 * h, -(h**2), -3 * h, 4 * h**2]]]) / (30 * h)
    for k in range(n):
        for across, turned, sign in ((1, 5, 1.0), (2, 4, -1.0)):
            own, s = 6 * k + np.array([across, turned, across + 6, turned + 6]), np.array([1.0, sign, 1.0, sign])
            K[np.ix_(own, own)] += s[:, None] * bending * s
            K_G[np.ix_(own, own)] += s[:, None] * pulled * s * N[k]
        for axis, stiffness in ((0, 1e8), (3, 1e3)):
            own = 6 * k + np.array([axis, axis + 6])
            K[np.ix_(own, own)] += stiffness / h * np.array([[1, -1], [-1, 1]])
        M[6 * k : 6 * k + 3, 6 * k : 6 * k + 3] = share[k] * np.eye(3)
    M[-6:-3, -6:-3] = share[-1] * np.eye(3)
    M[np.diag_indices(len(M))] += np.tile(np.repeat([0.0, 1e-6], 3), n + 1)
    model = read_matrices(*write(tmp_path, x, K, M), SI, 6)
    sp.save_npz(tmp_path / "kg.npz", sp.csr_array(K_G))
    stressed = read_geometric_stiffness(model, [tmp_path / "kg.npz"], SI[:2])
    omega2, modes = eigh(K[6:, 6:], M[6:, 6:], subset_by_index=[0, 7])
    spin = np.zeros(6 * n + 6)
    spin[::6] = share * x[:, 0]
    still = np.linalg.solve(K[6:, 6:], spin[6:])
    u, shapes = ((stressed.T @ clamped(stressed, y)).reshape(-1, 3, y.shape[1]) for y in (still[:, None], modes))
    (one,) = reduced_geometric_stiffness(stressed, u, shapes)
    unit = np.sqrt(EI / mass / L**3)
    for rate, wanted in zip(range(7), [3.5160, 3.6816, 4.1373, 4.7973, 5.5850, 6.4495, 7.3604], strict=True):
        omega = np.sqrt(np.linalg.eigvalsh(np.diag(omega2) + (rate * unit) ** 2 * one)) / unit
        assert omega[:2] == pytest.approx(wanted, rel=1e-3)


def test_a_scene_of_matrices_stiffens_as_the_beam_that_they_are_of(tmp_path) -> None:
    """A bar on a hinge at 60 rad/s by its matrices and their K_G under the loads of the export, beside itself.

    Its masses are lumped on 33 nodes, by which frequencies are 2e-4, 2e-4 and 1.3e-3 lower.
    """
    n = 32
    x = np.column_stack([np.linspace(0, 0.8, n + 1), np.zeros((n + 1, 2))])
    fe, G = own_beams(x)
    K = (G.T @ fe.K @ G).toarray()
    files: dict[str, Any] = dict(
        zip(("stiffness", "mass", "nodes"), map(str, write(tmp_path, x, K, lumps(x))), strict=True)
    )
    markers = {"root": {"nodes": [100]}, "tip": {"nodes": [100 + n]}}
    files |= {"unit": "m", "unknowns": 6}
    scene = turning({"matrices": files, "marker": markers})
    part = fmd.load(scene).run.parts["bar"]
    loads = np.stack([*stiffening_cases(part.fe, part.model.solver, part.markers).values()], axis=2)
    u = part.model.solver.static_response(loads)
    for k, own in enumerate(turned_stiffness(fe, G, by_node(part.fe, u))):
        sp.save_npz(tmp_path / f"kg-{k}.npz", sp.csr_array(own))
    files["geometric_stiffness"] = str(tmp_path / "kg-*.npz")
    section = {"type": "rectangle", "width": "14 mm", "height": "14 mm"}
    bar = {"shape": "profile", "length": "0.8 m", "section": section, "mesh": {"size": "25 mm"}}
    bar |= {"E": ALLOY.E, "nu": ALLOY.nu, "rho": ALLOY.rho, "marker": {"root": {"face": "x-"}, "tip": {"face": "x+"}}}
    found, wanted = (rotating_table(fmd.load(each).run, 60.0) for each in (scene, turning(bar)))
    ratio = np.divide(found["rotating_frequencies_hz"][:3], wanted["rotating_frequencies_hz"][:3])
    assert ratio == pytest.approx([1.0, 1.0, 1.0], abs=2e-3)


def turning(body: dict[str, Any]) -> dict[str, Any]:
    return {
        "title": "Bar on a hinge",
        "body": {"bar": body | {"modes": {"count": 6, "boundary": "joint"}}},
        "joint": {"hub": {"type": "revolute", "parent": "ground", "child": "bar.root", "axis": [0, 0, 1]}},
        "drive": {"spin": {"type": "motion", "joint": "hub", "angle": {"formula": "60*t", "unit": "rad"}}},
        "simulation": {
            "duration": "10 ms",
            "output_step": "1 ms",
            "tip": "bar.tip",
            "stiffening": "on",
            "run": [{"integrator": "runge-kutta"}],
        },
    }


def test_load_cases_of_a_deck_of_beams_are_forces_and_moments_that_calculix_answers_alike(tmp_path) -> None:
    """A bent line of Timoshenko's beams in mm: CalculiX's B31, which are solids, have its displacements to 2 %."""
    if shutil.which("ccx") is None:
        pytest.skip("CalculiX isn't installed")
    corner = np.array([[0.0, 0, 0], [0.2, 0, 0], [0.2, 0.2, 0.0]])
    x = np.concatenate([a + s[:, None] * (b - a) for a, b in pairwise(corner) for s in [np.arange(12) / 12]])
    x = np.concatenate([x, corner[2:]])
    fe, G = own_beams(x)
    K = (G.T @ fe.K @ G).toarray()
    files = dict(zip(("stiffness", "mass"), map(str, write(tmp_path, x, 1e-3 * K, lumps(x), 1e-3)), strict=False))
    nodes = [f"{100 + k},{a},{b},{c}" for k, (a, b, c) in enumerate(1e3 * x)]
    cells = [f"{k + 1},{100 + k},{101 + k}" for k in range(len(x) - 1)]
    deck = ["*NODE", *nodes, "*ELEMENT,TYPE=B31,ELSET=E", *cells, "*MATERIAL,NAME=M", "*ELASTIC", "70000.,.3"]
    deck += ["*BEAM SECTION,ELSET=E,MATERIAL=M,SECTION=RECT", "14.,14.", "0.,0.,1.", ""]
    (tmp_path / "line.inp").write_text("\n".join(deck))
    files |= {"nodes": str(tmp_path / "line.inp"), "unit": "mm", "stiffness_unit": "N/mm", "unknowns": 6}
    run = fmd.load(turning({"matrices": files, "marker": {"root": {"nodes": [100]}, "tip": {"nodes": [124]}}})).run
    path = tmp_path / "cases.inp"
    assert write_format(run, "load-cases", "bar", path) == [path]
    path.write_text(path.read_text().replace("*NODE FILE", "*NODE FILE,OUTPUT=2D"))  # else of the solids' nodes
    subprocess.run(["ccx", "cases"], cwd=tmp_path, check=True, capture_output=True, timeout=60)
    model = run.parts["bar"].given_model
    fields = read_stress(model, tmp_path / "cases.frd", tmp_path / "line.inp", (1e-3, 1e9)).fields
    assert fields is not None
    R = np.linalg.qr(rigid_motions(x).reshape(-1, 6))[0]
    solver = FreeBodySolver(model)
    for k, load in enumerate(stiffening_cases(model, solver, run.parts["bar"].markers).values()):
        own = solver.static_response(load[:, :, None])[: len(x), :, 0].ravel()
        apart, size = (u - R @ (R.T @ u) for u in (own - fields.displacement[:, :, k].ravel(), own))
        assert np.abs(apart).max() < 0.02 * np.abs(size).max()
