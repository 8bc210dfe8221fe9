"""Geometric stiffness: against closed forms of stressed solids and beams, and what it does to a turning body."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from scipy.linalg import eigvalsh

from fmd.core.arrays import EPSILON, Array
from fmd.fem.assembly import assemble
from fmd.fem.geometric_stiffness import reduced_geometric_stiffness
from fmd.fem.markers import Marker, face_marker
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.meshes.bar import hexahedral_bar
from fmd.reduction.body import FlexibleBody, MarkerShapes, _pinned, floating_body, reduced_body
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.inertia import inertia_integrals
from fmd.reduction.mode_families import modes_of_family
from fmd.reduction.stiffening import stiffen_body

X, Y, Z = np.eye(3)
LENGTH, DEPTH = 1.0, 0.01
ROD = Material(E=70e9, nu=0.0, rho=2700.0)
LINE_MASS = ROD.rho * DEPTH**2
# η = Ω √(ρA L⁴/EI) and the first flapping frequency of a cantilever on a hub of no radius, in the same units
# (Wright, Smith, Thresher & Wang, J Appl Mech 49, 1982; Hodges & Rutkowski, AIAA Journal 19, 1981)
ETA = np.array([0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0])
FLAP = np.array([3.5160, 4.1373, 5.5850, 7.3604, 9.2568, 11.2023, 13.1702])
UNIT_RATE = np.sqrt(ROD.E * DEPTH**2 / 12 / ROD.rho) / LENGTH**2


class Rod(NamedTuple):
    """A slender rod of square section and its bodies clamped at the root, bending along z and along y."""

    fe: FEModel
    solver: FreeBodySolver
    root: Marker
    clamp: Array
    flap: FlexibleBody
    lag: FlexibleBody


@pytest.fixture(scope="module")
def rod() -> Rod:
    mesh = SolidMesh(*hexahedral_bar(LENGTH, DEPTH, DEPTH, (40, 1, 1)))
    fe = assemble(mesh, 2, ROD)
    solver = FreeBodySolver(fe)
    root = face_marker(fe.discretisation, mesh.faces["x-"])
    clamp = root.columns(len(fe.x), np.eye(3))
    bodies = []
    for family in ("out-of-plane bending", "in-plane bending"):
        modes = modes_of_family(solver, fe, 6, family, Z, clamp)
        bodies.append(reduced_body(fe, modes.omega, modes.shapes, {"root": root}, "root", np.zeros((0, 3))))
    return Rod(fe, solver, root, clamp, *bodies)


def centrifugal(body: FlexibleBody, axis: Array) -> Array:
    """Modal block of D = Σ (δ_ab − e_a e_b) G[a, b]."""
    return np.asarray(np.einsum("ab,abij->ij", np.eye(3) - np.outer(axis, axis), body.integrals.G)[1:, 1:])


def with_shapes(body: FlexibleBody, fe: FEModel, shapes: Array) -> FlexibleBody:
    """The same body, moving by given fields that leave its joint at rest."""
    n = shapes.shape[2]
    still = {name: MarkerShapes(at.position, np.zeros((3, n)), np.zeros((3, n))) for name, at in body.markers.items()}
    integrals = inertia_integrals(body.x, fe.m, shapes)
    return replace(body, shapes=shapes, omega=np.ones(n), integrals=integrals, markers=still)


def parabola(fe: FEModel) -> Array:
    """Deflections x² along y and along z, of a line; shape (n_nodes, 3, 2) [1/m]."""
    return np.asarray(fe.x[:, :1, None] ** 2 * np.eye(3)[None, :, 1:])


# Stressed solids -----------------------------------------------------------------------------------------------


def test_uniform_stress_and_slopes_give_their_product_times_the_volume(distorted: FEModel) -> None:
    """∫ σ_ab ∂_a φ·∂_b ψ dV is V σ_ab A_ia B_ib for u, φ, ψ linear in x, on any mesh of any element."""
    rng = np.random.default_rng(0)
    slopes, strain = rng.standard_normal((4, 3, 3)), rng.standard_normal((2, 3, 3))
    u, shapes = (np.einsum("kia,na->nik", linear, distorted.x) for linear in (strain, slopes))
    found = reduced_geometric_stiffness(distorted, u, shapes)
    lam, mu = distorted.material.lame
    volume = 1.2 * 1.0 * 0.8
    for k in range(2):
        small = (strain[k] + strain[k].T) / 2
        stress = lam * np.trace(small) * np.eye(3) + 2 * mu * small
        exact = volume * np.einsum("ab,jia,lib->jl", stress, slopes, slopes)
        assert np.abs(found[k] - exact).max() < 1e-10 * np.abs(exact).max()


def test_a_bar_in_tension_resists_slope_as_a_string_does(small_bar: FEModel) -> None:
    # N ∫ w' v' dx for w = x², v = x³ − L x²: 4/3 N L³ and so on; Poisson's ratio contracts the bar, no stress across
    force, length, area = 1000.0, 0.3, 0.04 * 0.02
    nu = small_bar.material.nu
    centre = small_bar.x - [0.15, 0, 0]
    u = force / (small_bar.material.E * area) * centre * [1, -nu, -nu]
    deflections = np.stack([small_bar.x[:, 0], small_bar.x[:, 0] ** 2], axis=1)
    shapes = np.zeros((len(small_bar.x), 3, 4))
    shapes[:, 1, :2] = shapes[:, 2, 2:] = deflections
    (found,) = reduced_geometric_stiffness(small_bar, u[:, :, None], shapes)
    string = force * np.array([[length, length**2], [length**2, 4 / 3 * length**3]])
    assert found == pytest.approx(np.kron(np.eye(2), string), rel=1e-9, abs=1e-9 * force * length)


def test_more_elements_than_fit_into_one_part_are_summed_too(steel: Material) -> None:
    # 27 · 4 · 3 = 324 elements; uniform tension and a rotation about z: σ V
    fe = assemble(SolidMesh(*hexahedral_bar(0.3, 0.04, 0.02, (27, 4, 3))), 1, steel)
    u = fe.x * [1e-3, -0.3e-3, -0.3e-3]
    (found,) = reduced_geometric_stiffness(fe, u[:, :, None], np.cross(Z, fe.x)[:, :, None])
    assert found[0, 0] == pytest.approx(steel.E * 1e-3 * 0.3 * 0.04 * 0.02, rel=1e-10)


# The stress of the inertia loads -------------------------------------------------------------------------------


@pytest.mark.parametrize("about", [np.eye(3), np.eye(3)[:2], np.zeros((0, 3))], ids=["clamp", "hinge", "ball"])
@pytest.mark.parametrize("axis", [Z, None], ids=["planar", "spatial"])
def test_a_rod_on_its_joint_has_the_tension_of_what_lies_outside(rod: Rod, about: Array, axis: Array | None) -> None:
    """N = ρA (L² − x²)/2 for a unit rate, N = ρA (L − x) for a unit acceleration, and K_G = ∫ N w'² dx with w = x²."""
    body = with_shapes(rod.lag, rod.fe, parabola(rod.fe))
    stiff = stiffen_body(body, rod.fe, rod.solver, rod.root.columns(len(rod.fe.x), about), axis)
    spin = LINE_MASS * 4 / 15 * LENGTH**5
    taken = centrifugal(body, Z) - centrifugal(stiff, Z)
    assert taken == pytest.approx(spin * np.eye(2), rel=2e-3, abs=1e-4 * spin)
    weight = LINE_MASS * LENGTH**4 / 3
    assert -stiff.integrals.displacement2[0] == pytest.approx(weight * np.eye(2), rel=1e-3, abs=1e-4 * weight)


def test_a_rod_that_floats_has_the_tension_of_its_halves(rod: Rod) -> None:
    # nothing holds it: N = ρA (L²/4 − s²)/2 about its middle, and no tension at all from linear acceleration
    middle = face_marker(rod.fe.discretisation, np.flatnonzero(rod.fe.discretisation.mesh.points[:, 1] < -0.0049))
    modes = modes_of_family(rod.solver, rod.fe, 2, "in-plane bending", Z)
    free = floating_body(rod.fe, modes.omega, modes.shapes, {"side": middle}, "side")
    s = rod.fe.x[:, :1, None] - LENGTH / 2
    body = with_shapes(free, rod.fe, s**2 * np.eye(3)[None, :, 1:])
    stiff = stiffen_body(body, rod.fe, rod.solver, None, Z)
    # ∫ ρA (a² − s²)/2 (2s)² ds over ±a with a = L/2
    exact = LINE_MASS * 8 / 15 * (LENGTH / 2) ** 5
    assert centrifugal(body, Z) - centrifugal(stiff, Z) == pytest.approx(exact * np.eye(2), rel=2e-3, abs=1e-3 * exact)
    assert np.abs(stiff.integrals.displacement2).max() < 1e-9 * exact


def test_a_hinge_that_is_accelerated_lets_the_body_turn(small_bar: FEModel) -> None:
    """Independent path: the rigid body's own equation of motion, d'Alembert's loads, and a dense solution.

    Held at its side by a hinge about z it turns at J α = z·(r_c × m e) under a load ρ e; the joint bears the rest.
    """
    fe = small_bar
    side = face_marker(fe.discretisation, fe.discretisation.mesh.faces["y+"])
    solver = FreeBodySolver(fe)
    pairs = solver.modes(6)
    body = reduced_body(fe, pairs.omega, pairs.shapes, {"side": side}, "side", Z[None])
    stiff = stiffen_body(body, fe, solver, side.columns(len(fe.x), np.array([X, Y])), Z)
    r = fe.x - side.position
    inertia = np.cross(Z, r).ravel() @ (fe.M @ np.cross(Z, r).ravel())
    for a, e in enumerate(np.eye(3)):
        load = fe.m @ np.tile(e, (len(r), 1))
        rate = Z @ np.cross(r, load).sum(axis=0) / inertia
        load = load - rate * (fe.m @ np.cross(Z, r))
        torque = np.cross(r, load).sum(axis=0)
        assert abs(torque[2]) < 1e-12  # none is left for the hinge
        load = load - side.columns(len(r), np.eye(3)) @ np.concatenate([load.sum(axis=0), torque])
        u = np.linalg.lstsq(fe.K.toarray(), load.ravel(), rcond=1e-13)[0]
        exact = reduced_geometric_stiffness(fe, u.reshape(-1, 3, 1), body.shapes)[0]
        assert np.abs(-stiff.integrals.displacement2[a] - exact).max() < 1e-6 * np.abs(exact).max()


@pytest.mark.parametrize("axis", [Z, np.array([-0.92, 0.33, 0.2])], ids=["along the face", "askew"])
def test_a_face_on_a_hinge_turns_about_its_axis_alone(small_bar: FEModel, axis: Array) -> None:
    """By the joint: to the second order, too, though turned places ``½ θ × (θ × r)`` have a mean rotation across it."""
    fe, e = small_bar, axis / np.linalg.norm(axis)
    side = face_marker(fe.discretisation, fe.discretisation.mesh.faces["y+"])
    solver, across = FreeBodySolver(fe), np.linalg.svd(np.eye(3) - np.outer(e, e))[0][:, :2].T
    hinge = side.columns(len(fe.x), across)
    pairs = solver.modes(6)
    body = reduced_body(fe, pairs.omega, pairs.shapes, {"side": side}, "side", e[None])
    stiff = stiffen_body(body, fe, solver, hinge, moving={"side": side})
    turns = stiff.markers["side"].displacement2[3:] / np.outer(body.omega, body.omega)
    assert np.abs(np.tensordot(across, turns, 1)).max() < 1e-8 * np.abs(np.tensordot(e, turns, 1)).max()


def test_stiffness_that_is_not_asked_for_is_not_there(rod: Rod) -> None:
    stiff = stiffen_body(rod.lag, rod.fe, rod.solver, rod.clamp, Z, linear=False)
    assert stiff.integrals.displacement2.shape == (3, 0, 0)
    assert stiff.integrals.stiffening.shape == (3, 3, 6, 6)
    assert rod.lag.integrals.stiffening.shape == (3, 3, 0, 0)
    assert stiff.integrals.S is rod.lag.integrals.S
    assert np.array_equal(
        stiff.integrals.G[:, :, 0], rod.lag.integrals.G[:, :, 0]
    )  # positions themselves are what they were


@pytest.mark.parametrize("axis", [Z, Y, np.array([1.0, -2.0, 2.0])], ids=["z", "y", "oblique"])
def test_one_planar_load_does_what_the_six_products_do(small_bar: FEModel, axis: Array) -> None:
    e = axis / np.linalg.norm(axis)
    solver = FreeBodySolver(small_bar)
    root = face_marker(small_bar.discretisation, small_bar.discretisation.mesh.faces["x-"])
    clamp = root.columns(len(small_bar.x), np.eye(3))
    pairs = solver.modes(8, clamp)
    body = reduced_body(small_bar, pairs.omega, pairs.shapes, {"root": root}, "root", np.zeros((0, 3)))
    planar, spatial = (stiffen_body(body, small_bar, solver, clamp, plane) for plane in (axis, None))
    taken = centrifugal(body, e) - centrifugal(spatial, e)
    assert np.abs(centrifugal(planar, e) - centrifugal(spatial, e)).max() < 1e-7 * np.abs(taken).max()
    assert (
        np.abs(planar.integrals.displacement2 - spatial.integrals.displacement2).max()
        < 1e-7 * np.abs(spatial.integrals.displacement2).max()
    )
    for stiff in (planar, spatial):
        G = stiff.integrals.G
        assert np.abs(G - G.transpose(1, 0, 3, 2)).max() < 1e-12 * np.abs(G).max()
        M = stiff.integrals.mass_matrix(np.eye(1, 9)[0])
        assert np.abs(M[6:, 6:] - np.eye(8)).max() < 1e-8


@pytest.mark.parametrize(("axis", "linear", "count"), [(Z, False, 2), (Z, True, 5), (None, False, 9), (None, True, 12)])
def test_only_loads_that_the_motion_has_are_solved_for(
    small_bar: FEModel, monkeypatch: pytest.MonkeyPatch, axis: Array | None, linear: bool, count: int
) -> None:
    solver, solved = FreeBodySolver(small_bar), []
    root = face_marker(small_bar.discretisation, small_bar.discretisation.mesh.faces["x-"])
    clamp = root.columns(len(small_bar.x), np.eye(3))
    pairs = solver.modes(2, clamp)
    body = reduced_body(small_bar, pairs.omega, pairs.shapes, {"root": root}, "root", np.zeros((0, 3)))
    solver.remembered_response(clamp)  # as the basis has
    response = FreeBodySolver.static_response

    def counted(self: FreeBodySolver, loads: Array, *held: Array) -> Array:
        solved.append(loads.shape[-1])
        return response(self, loads, *held)

    monkeypatch.setattr(FreeBodySolver, "static_response", counted)
    stiffen_body(body, small_bar, solver, clamp, axis, linear)
    assert sum(solved) == count


# Markers -------------------------------------------------------------------------------------------------------


BESIDE = np.array([0.02, -0.01, 0.015])  # of the tip's middle, where a marker that turns with it is


@pytest.fixture(scope="module")
def loaded_beam() -> tuple[FlexibleBody, FlexibleBody]:
    """A clamped beam that moves by its static responses to a force and a torque each way at its tip, and stiffened."""
    mesh = SolidMesh(*hexahedral_bar(LENGTH, 0.02, 0.02, (40, 2, 2)))
    fe = assemble(mesh, 2, Material(E=70e9, nu=0.3, rho=2700.0))
    solver = FreeBodySolver(fe)
    markers = {
        name: face_marker(fe.discretisation, mesh.faces[f"x{side}"]) for name, side in (("root", "-"), ("tip", "+"))
    }
    markers["beside"] = face_marker(fe.discretisation, mesh.faces["x+"], centre=markers["tip"].position + BESIDE)
    clamp, loads = (markers[name].columns(len(fe.x), np.eye(3)) for name in ("root", "tip"))
    loads = loads[:, :, [1, 5, 2, 4, 3]].reshape(-1, 5)
    held = clamp.reshape(len(loads), -1)
    loads = loads - held @ np.linalg.lstsq(fe.rigid_modes.T @ held, fe.rigid_modes.T @ loads, rcond=None)[0]
    bent = _pinned(fe, solver.static_response(loads.reshape(-1, 3, 5)), markers["root"], np.zeros((0, 3)))
    bent /= np.abs(bent).max(axis=(0, 1))
    x = fe.x - markers["root"].position
    body = FlexibleBody(
        x=x,
        shapes=bent,
        omega=np.ones(5),
        axis=Z,
        joint="root",
        markers={
            name: MarkerShapes(at.position - markers["root"].position, at.translation(bent), at.rotation(bent))
            for name, at in markers.items()
        },
        integrals=inertia_integrals(x, fe.m, bent),
        coupling=0.0,
    )
    return body, stiffen_body(body, fe, solver, clamp, moving=markers)


def test_a_bent_and_twisted_beam_draws_in_its_tip_as_a_rod_of_directors(
    loaded_beam: tuple[FlexibleBody, FlexibleBody],
) -> None:
    """Independent path: r' = R e_x with R = exp(θ̃) and curvatures of the first order alone, by quadrature.

    So ``θ₂' = ½ θ × θ'`` and ``r₂' = ½ θ × (θ × e_x) + θ₂ × e_x``. Fibres of a twisted section that are longer by
    ½ s² φ'² at a distance s of its middle shorten it besides, by ½ I_p/A φ'² (Wagner, NACA TM 807, 1936).
    """
    body, stiff = loaded_beam
    s = np.linspace(0.0, LENGTH, 4001)
    turn = body.markers["tip"].rotation
    by_force, by_torque = (s - s**2 / (2 * LENGTH)) / (LENGTH / 2), s / LENGTH
    profiles = np.array([by_force, by_torque, by_force, by_torque, by_torque])
    theta = turn[:, :, None] * profiles
    slope = np.gradient(theta, s, axis=-1, edge_order=2)

    def integral(f: Array) -> Array:
        steps = (f[..., 1:] + f[..., :-1]) / 2 * np.diff(s)
        return np.concatenate([np.zeros((*f.shape[:-1], 1)), np.cumsum(steps, axis=-1)], axis=-1)

    turned = integral(np.einsum("abc,bjs,cls->ajls", EPSILON, theta, slope) / 2)
    moved = np.einsum("ajs,ls->ajls", theta, theta[0]) - X[:, None, None, None] * np.einsum(
        "ajs,als->jls", theta, theta
    )
    moved = integral(moved / 2 + np.einsum("abc,bjls,c->ajls", EPSILON, turned, X))
    exact = np.concatenate([moved[..., -1], turned[..., -1]])
    exact = exact + exact.swapaxes(1, 2)
    exact[0, 4, 4] -= 0.02**2 / 6 * turn[0, 4] ** 2 / LENGTH
    found = stiff.markers["tip"].displacement2
    for k in range(6):
        assert np.abs(found[k] - exact[k]).max() < 2e-3 * np.abs(exact[k]).max()
    assert not stiff.markers["root"].displacement2.size  # it doesn't move in the frame


def test_a_marker_beside_the_middle_of_its_face_goes_round_with_it(
    loaded_beam: tuple[FlexibleBody, FlexibleBody],
) -> None:
    """Independent path: a rigid triad, whose point at c has the second-order displacement d₂ + θ₂ × c + ½ θ × (θ × c).

    With θ × (θ × c) = θ (θ·c) − c θ².
    """
    markers = loaded_beam[1].markers
    tip, turn = markers["tip"].displacement2, markers["tip"].rotation
    along = np.einsum("aj,l->ajl", turn, BESIDE @ turn)
    rolled = 0.5 * (along + along.swapaxes(1, 2)) - np.einsum("a,jl->ajl", BESIDE, turn.T @ turn)
    exact = tip[:3] + np.einsum("abc,bjl,c->ajl", EPSILON, tip[3:], BESIDE) + rolled
    found = markers["beside"].displacement2
    assert np.abs(found[:3] - exact).max() < 1e-9 * np.abs(rolled).max()
    assert np.abs(found[3:] - tip[3:]).max() < 1e-9 * np.abs(tip[3:]).max()


# What it does to a turning body --------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", [Z, None], ids=["planar", "spatial"])
def test_a_turning_cantilever_flaps_as_published(rod: Rod, axis: Array | None) -> None:
    body = stiffen_body(rod.flap, rod.fe, rod.solver, rod.clamp, axis, linear=False)
    D = centrifugal(body, Z)
    found = [np.sqrt(eigvalsh(np.diag(body.omega**2) - (eta * UNIT_RATE) ** 2 * D)[0]) / UNIT_RATE for eta in ETA]
    assert found == pytest.approx(FLAP, rel=2e-3)


def test_lagging_is_flapping_softened_by_the_rate(rod: Rod) -> None:
    # across the axis the centrifugal force has a part along the deflection: ω² is lower by Ω²
    body = stiffen_body(rod.lag, rod.fe, rod.solver, rod.clamp, Z, linear=False)
    D = centrifugal(body, Z)
    for eta, flap in zip(ETA, FLAP, strict=True):
        squared = eigvalsh(np.diag(body.omega**2) - (eta * UNIT_RATE) ** 2 * D)[0] / UNIT_RATE**2
        assert squared == pytest.approx(flap**2 - eta**2, rel=5e-3)


def test_without_stiffening_lagging_loses_its_stiffness(rod: Rod) -> None:
    # the linear floating frame has ω² − Ω², below zero from the first frequency on
    D = centrifugal(rod.lag, Z)
    for rate, sign in ((0.99, 1), (1.01, -1)):
        lowest = eigvalsh(np.diag(rod.lag.omega**2) - (rate * rod.lag.omega[0]) ** 2 * D)[0]
        assert np.sign(lowest) == sign


def test_a_bent_rod_draws_its_mass_in(rod: Rod) -> None:
    """Independent path: inertia about z of an inextensible curve, x(s) = ∫ √(1 − w'²) ds, by quadrature."""
    body = stiffen_body(with_shapes(rod.flap, rod.fe, parabola(rod.fe)), rod.fe, rod.solver, rod.clamp, Z)
    s = np.linspace(0.0, LENGTH, 2001)
    for amplitude in (0.01, 0.05):
        slope = 2 * amplitude * s
        x = np.concatenate([[0.0], np.cumsum(np.sqrt(1 - ((slope[1:] + slope[:-1]) / 2) ** 2) * np.diff(s))])
        drawn = LINE_MASS * np.trapezoid(s**2 - x**2, s)
        p = np.array([1.0, 0.0, amplitude])  # bent along the axis
        found = body.integrals.inertia(np.eye(1, 3)[0])[2, 2] - body.integrals.inertia(p)[2, 2]
        assert found == pytest.approx(drawn, rel=5e-3)
        moved = LINE_MASS * np.trapezoid(s - x, s)  # and its first moment
        M = body.integrals.mass_matrix(p)
        assert body.integrals.mass_matrix(np.eye(1, 3)[0])[5, 1] - M[5, 1] == pytest.approx(moved, rel=5e-3)


def test_a_column_buckles_under_its_own_weight(rod: Rod) -> None:
    """ρ g A L³/EI = 7.837 for a standing column clamped at its foot (Timoshenko & Gere, section 2.12)."""
    body = stiffen_body(rod.flap, rod.fe, rod.solver, rod.clamp, Z)
    hanging = -body.integrals.displacement2[0]  # weight along +x, away from the clamp
    g = 7.837 * ROD.E * DEPTH**4 / 12 / (LINE_MASS * LENGTH**3)
    assert eigvalsh(hanging).min() > 0
    assert eigvalsh(hanging, np.diag(body.omega**2))[-1] == pytest.approx(1 / g, rel=5e-3)


def test_a_hinged_rod_flaps_as_a_turning_beam(rod: Rod) -> None:
    """Independent path: Ritz's method for a beam under tension N, ½ ∫ EI w″² + N w′², in the powers x … x⁹.

    Its lowest solution is the rod's rigid motion w = x at ω = Ω (Southwell & Gough, ARC R&M 766, 1921).
    """
    hinge = rod.root.columns(len(rod.fe.x), np.array([X, Z]))
    modes = modes_of_family(rod.solver, rod.fe, 6, "out-of-plane bending", Z, hinge)
    body = reduced_body(rod.fe, modes.omega, modes.shapes, {"root": rod.root}, "root", Y[None])
    stiff = stiffen_body(body, rod.fe, rod.solver, hinge)
    n = np.arange(1, 10)
    powers = n[:, None] + n
    slopes = np.outer(n, n)
    bending = slopes * np.outer(n - 1, n - 1) / np.maximum(powers - 3, 1)
    string = slopes * (1 / (powers - 1) - 1 / (powers + 1)) / 2
    for ratio in (0.5, 2.0):
        rate = ratio * body.omega[0]
        exact = eigvalsh(UNIT_RATE**2 * bending + rate**2 * string, 1 / (powers + 1))[:3]
        found = eigvalsh(np.diag(body.omega**2) - rate**2 * centrifugal(stiff, Z))[:2]
        assert exact[0] == pytest.approx(rate**2, rel=1e-6)
        assert found == pytest.approx(exact[1:], rel=5e-3)
