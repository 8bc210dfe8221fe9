"""Beams: closed forms of Timoshenko's cantilever, stress at corners, frames, rotors by hand and in the textbook."""

import numpy as np
import pytest
from scipy.linalg import eigh

from fmd.core.arrays import Array, IntArray
from fmd.core.rotations import rigid_motions
from fmd.fem.assembly import assemble
from fmd.fem.beams import Beams, extrude
from fmd.fem.links import Linked, LinkedFace, LumpedMass, link_points
from fmd.fem.markers import face_marker
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.fem.sections import RoundSection, Section, box_section, i_section, rectangular_section, round_section
from fmd.recovery.patch_stress import patch_stress
from fmd.recovery.stress import modal_stress, point_stress
from fmd.reduction.body import supported_body
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.rotating import rotating_modes
from fmd.reduction.stiffening import stiffen_body
from tests.reduction.test_links import rotor_frequencies

STEEL = Material(200e9, 0.3, 7850.0)
SECTIONS = {
    "round": round_section(0.02),
    "tube": round_section(0.02, 0.012),
    "rectangle": rectangular_section(0.02, 0.03),
    "box": box_section(0.04, 0.06, 0.004),
    "I": i_section(0.04, 0.06, 0.004, 0.006),
}
# Area, ∫ z² dA, ∫ y² dA, J, by formulas of the whole shapes and of what is cut out of them.
EXACT = {
    "round": np.pi * np.array([0.02**2 / 4, 0.02**4 / 64, 0.02**4 / 64, 0.02**4 / 32]),
    "tube": np.pi * np.array([(0.02**2 - 0.012**2) / 4, *2 * [(0.02**4 - 0.012**4) / 64], (0.02**4 - 0.012**4) / 32]),
    "rectangle": np.array([6e-4, 0.02 * 0.03**3 / 12, 0.03 * 0.02**3 / 12, 0.196 * 0.03 * 0.02**3]),
    "box": np.array(
        [
            0.04 * 0.06 - 0.032 * 0.052,
            (0.04 * 0.06**3 - 0.032 * 0.052**3) / 12,
            (0.06 * 0.04**3 - 0.052 * 0.032**3) / 12,
            4 * (0.036 * 0.056) ** 2 / (2 * (0.036 + 0.056) / 0.004),
        ]
    ),
    "I": np.array(
        [
            0.04 * 0.06 - 0.036 * 0.048,
            (0.04 * 0.06**3 - 0.036 * 0.048**3) / 12,
            (2 * 0.006 * 0.04**3 + 0.048 * 0.004**3) / 12,
            (2 * 0.04 * 0.006**3 + 0.054 * 0.004**3) / 3,
        ]
    ),
}


def beams(place: Array, sections: tuple[Section, ...], of: IntArray | None = None) -> SolidMesh:
    """Beams along x between given places, with faces at both ends."""
    n = len(place) - 1
    x = np.column_stack([place, np.zeros((n + 1, 2))])
    ends = np.stack([np.arange(n), np.arange(1, n + 1)], axis=1)
    faces = {"x-": np.array([0]), "x+": np.array([n])} | {str(k): np.array([k]) for k in range(1, n)}
    numbers = np.zeros(n, dtype=int) if of is None else of
    return extrude(Beams(x, ends, np.tile(np.eye(3), (n, 1, 1)), sections, numbers, {"all": np.arange(n)}, faces))


def clamp(fe: FEModel, node: int) -> IntArray:
    owner = fe.discretisation.mesh.midsurface.owner  # type: ignore[union-attr]
    return np.asarray((3 * np.flatnonzero(owner == node)[:, None] + np.arange(3)).ravel())


@pytest.mark.parametrize("name", SECTIONS)
def test_a_cantilever_has_the_flexibility_and_stress_of_timoshenkos_beam(name: str) -> None:
    """Tip loads: L/EA, L/GJ, L³/3EI + L/kGA and L²/2EI; stress N/A, M c/I at the corners of the root."""
    section, (A, I_y, I_z, J), L = SECTIONS[name], EXACT[name], 0.3
    fe = assemble(beams(np.array([0.0, 0.1, 0.3]), (section,)), 1, STEEL)
    assert fe.mass == pytest.approx(7850 * A * L, rel=1e-9)
    mesh = fe.discretisation.mesh
    load = face_marker(fe.discretisation, mesh.faces["x+"]).columns(len(fe.x), np.eye(3))
    u = FreeBodySolver(fe, fixed=clamp(fe, 0)).static_response(load)
    found = np.einsum("iak,ial->kl", load, u)
    E, G = 200e9, 200e9 / 2.6
    k_y, k_z = section.shear_areas(0.3)
    exact = np.diag(
        [
            L / (E * A),
            L**3 / (3 * E * I_z) + L / (k_y * G * A),
            L**3 / (3 * E * I_y) + L / (k_z * G * A),
            L / (G * J),
            L / (E * I_y),
            L / (E * I_z),
        ]
    )
    exact[1, 5] = exact[5, 1] = L**2 / (2 * E * I_z)
    exact[2, 4] = exact[4, 2] = -(L**2) / (2 * E * I_y)
    size = np.sqrt(exact.diagonal())
    error = (found - exact) / np.outer(size, size)
    error[3, 3] /= 4 if name == "rectangle" else 1  # of J, a formula's 0.4 %
    assert np.abs(error).max() < 1e-3 if name == "rectangle" else np.abs(error).max() < 1e-7
    root = np.flatnonzero(np.abs(mesh.points[:, 0]) < 1e-9)
    y, z = mesh.points[root, 1], mesh.points[root, 2]
    stress = modal_stress(fe.discretisation, STEEL, u, root)[:, 0]
    wanted = np.stack([np.full(len(root), 1 / A), -L * y / I_z, -L * z / I_y, 0 * y, z / I_y, -y / I_z], axis=1)
    assert np.abs(stress - wanted).max(axis=0) == pytest.approx(0.0, abs=2e-4 * L / I_z * 0.03)
    fitted = patch_stress(fe.discretisation, STEEL, u, int(root[0]))[0]  # stress that is a product of x and y or z
    assert fitted == pytest.approx(stress[0], abs=1e-6 * np.abs(stress).max())


def test_shear_of_a_rectangle_is_a_parabola_and_its_torsion_has_the_stress_of_a_ring_in_a_tube() -> None:
    fe = assemble(beams(np.array([0.0, 0.5]), (SECTIONS["rectangle"],)), 1, STEEL)
    load = face_marker(fe.discretisation, fe.discretisation.mesh.faces["x+"]).columns(len(fe.x), np.eye(3))
    u = FreeBodySolver(fe, fixed=clamp(fe, 0)).static_response(load)
    middle = point_stress(fe.discretisation, STEEL, u, np.array([[0.25, 0.0, 0.0]]))[0]
    assert middle[5, 1] == pytest.approx(1.5 / 6e-4)  # xy by a force along y: 3 F / 2 A
    assert middle[4, 2] == pytest.approx(1.5 / 6e-4)
    tube = assemble(beams(np.array([0.0, 0.5]), (SECTIONS["tube"],)), 1, STEEL)
    load = face_marker(tube.discretisation, tube.discretisation.mesh.faces["x+"]).columns(len(tube.x), np.eye(3))
    u = FreeBodySolver(tube, fixed=clamp(tube, 0)).static_response(load)
    nodes = np.arange(len(tube.discretisation.x))
    shear = modal_stress(tube.discretisation, STEEL, u, nodes)[:, [4, 5], 3]
    assert np.linalg.norm(shear, axis=1).max() == pytest.approx(0.01 / EXACT["tube"][3], rel=8e-3)  # on a polygon


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_a_round_section_has_cowpers_coefficients_from_the_full_circle_to_the_thin_ring(nu: float) -> None:
    """Cowper, J Appl Mech 33 (1966): ``6 (1 + ν)/(7 + 6 ν)``, and ``2 (1 + ν)/(4 + 3 ν)`` of a thin wall."""
    assert round_section(0.1).shear_areas(nu) == pytest.approx(np.full(2, 6 * (1 + nu) / (7 + 6 * nu)), rel=1e-12)
    thin = round_section(0.1, 0.1 * (1 - 1e-9)).shear_areas(nu)
    assert thin == pytest.approx(np.full(2, 2 * (1 + nu) / (4 + 3 * nu)), rel=1e-8)


def test_beams_of_any_direction_are_free_and_have_the_inertia_of_their_sections() -> None:
    rng = np.random.default_rng(5)
    x = rng.uniform(-1, 1, (5, 3))
    ends = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [1, 4], [2, 4]])
    along = x[ends[:, 1]] - x[ends[:, 0]]
    length = np.linalg.norm(along, axis=1)
    e = along / length[:, None]
    y = np.cross(e, rng.standard_normal((6, 3)))
    y /= np.linalg.norm(y, axis=1)[:, None]
    axes = np.stack([e, y, np.cross(e, y)], axis=1)
    section = SECTIONS["rectangle"]
    fe = assemble(extrude(Beams(x, ends, axes, (section,), np.zeros(6, int), {}, {})), 1, STEEL)
    R = rigid_motions(fe.x).reshape(-1, 6)
    assert np.abs(fe.K @ R).max() < 1e-9 * abs(fe.K).max()
    A, I_y, I_z, _ = EXACT["rectangle"]
    J = np.zeros((3, 3))
    for k, (a, b) in enumerate(x[ends]):
        m, c = 7850 * A * length[k], (a + b) / 2
        own = 7850 * length[k] * np.diag([I_y + I_z, I_y + A * length[k] ** 2 / 12, I_z + A * length[k] ** 2 / 12])
        J += axes[k].T @ own @ axes[k] + m * (c @ c * np.eye(3) - np.outer(c, c))
    assert (R.T @ fe.M @ R)[3:, 3:] == pytest.approx(J, rel=1e-9, abs=1e-9 * np.abs(J).max())
    assert FreeBodySolver(fe).modes(3).n_rigid == 6


def hand_beam(L: float, section: tuple[float, float, float]) -> tuple[Array, Array, Array]:
    """Return K, M and G/Ω of a Timoshenko beam in one complex plane, of v + i w and the slope at both ends.

    With rotary inertia: Przemieniecki 1968, 5.6 and 11.6; the gyroscopic matrix is twice the rotary mass (Nelson 1980).
    """
    A, second, shear = section
    E, G, rho = 200e9, 200e9 / 2.6, 7850.0
    p = 12 * E * second / (shear * G * A * L**2)
    K = (
        E
        * second
        / (L**3 * (1 + p))
        * np.array([[12, 6 * L, -12, 6 * L], [6 * L, (4 + p) * L**2, -6 * L, (2 - p) * L**2]] * 2)
    )
    K[2:] = K[:2][:, [2, 3, 0, 1]]
    K[2:, [1, 3]] *= -1
    K[2, [0, 2]], K[2, [1, 3]] = K[0, [2, 0]], -K[0, [3, 1]]
    K[3] = K[:, 3]
    K[3, 3] = K[1, 1]
    a = 13 / 35 + 7 / 10 * p + p**2 / 3
    b = (11 / 210 + 11 / 120 * p + p**2 / 24) * L
    c = 9 / 70 + 3 / 10 * p + p**2 / 6
    d = (13 / 420 + 3 / 40 * p + p**2 / 24) * L
    f = (1 / 105 + p / 60 + p**2 / 120) * L**2
    g = (1 / 140 + p / 60 + p**2 / 120) * L**2
    M = rho * A * L / (1 + p) ** 2 * np.array([[a, b, c, -d], [b, f, d, -g], [c, d, a, -b], [-d, -g, -b, f]])
    s, t = 6 / 5, (1 / 10 - p / 2) * L
    q, r = (2 / 15 + p / 6 + p**2 / 3) * L**2, (1 / 30 + p / 6 - p**2 / 6) * L**2
    N = rho * second / (L * (1 + p) ** 2) * np.array([[s, t, -s, t], [t, q, -t, -r], [-s, -t, s, -t], [t, -r, -t, q]])
    return K, M + N, 2 * N


def test_two_deep_beams_have_the_mass_of_przemienieckis() -> None:
    """Half of the shear number in the mass would change the frequencies by 8e-4 and 2 %."""
    d, L = 0.04, 0.06
    fe = assemble(beams(np.array([0.0, L, 2 * L]), (round_section(d),)), 1, STEEL)
    found = FreeBodySolver(fe, fixed=clamp(fe, 0)).modes(6).omega
    K, M = np.zeros((2, 6, 6))
    for k in (0, 2):
        own = slice(k, k + 4)
        for whole, part in zip((K, M), hand_beam(L, (np.pi * d**2 / 4, np.pi * d**4 / 64, 7.8 / 8.8)), strict=False):
            whole[own, own] += part
    exact = np.sqrt(eigh(K[2:, 2:], M[2:, 2:], eigvals_only=True))
    for omega, near in zip(exact[:2], (1e-5, 1e-3), strict=True):  # the stations integrate the mass to order 5
        assert np.abs(found - omega).min() < near * omega


STEPS = ((0.2, 0.02), (0.15, 0.035), (0.25, 0.025))  # length and diameter of a shaft's pieces [m]
DISC = 3.0, 0.01, 0.018  # mass, inertia across and along the axis
RATE = 500.0  # [rad/s]


def hand_rotor(n: int) -> Array:
    """Return ω in fixed axes of the stepped shaft on pins with a disc at its second step, forward positive."""
    pieces = [(L / n, d) for L, d in STEPS for _ in range(n)]
    size = 2 * (len(pieces) + 1)
    K, M, G = (np.zeros((size, size)) for _ in range(3))
    for k, (L, d) in enumerate(pieces):
        own = slice(2 * k, 2 * k + 4)
        A, second = np.pi * d**2 / 4, np.pi * d**4 / 64
        for whole, part in zip((K, M, G), hand_beam(L, (A, second, 7.8 / 8.8)), strict=True):
            whole[own, own] += part
    at = 2 * 2 * n
    M[at, at] += DISC[0]
    M[at + 1, at + 1] += DISC[1]
    G[at + 1, at + 1] += DISC[2]
    kept = np.setdiff1d(np.arange(size), [0, size - 2])
    K, M, G = (each[np.ix_(kept, kept)] for each in (K, M, G))
    whole = np.block([[0 * K, np.eye(len(K))], [-np.linalg.solve(M, K), np.linalg.solve(M, 1j * RATE * G)]])
    values = np.sort((np.linalg.eigvals(whole) / 1j).real)
    return np.asarray(values[np.argsort(np.abs(values))][:6])


def spun(n: int) -> Array:
    """Return the frequencies of the same rotor of this package's beams in axes that turn [rad/s]."""
    starts = np.cumsum([0.0, *(L for L, _ in STEPS)])
    place = np.interp(np.arange(3 * n + 1) / n, np.arange(4), starts)
    mesh = beams(place, tuple(round_section(d) for _, d in STEPS), np.repeat(np.arange(3), n))
    owner = mesh.midsurface.owner  # type: ignore[union-attr]
    fe = assemble(mesh, 1, STEEL)
    link = LinkedFace(face_marker(fe.discretisation, mesh.faces[str(2 * n)], rigid=True), np.array([0.35, 0.0, 0.0]))
    disc = LumpedMass("disc", DISC[0], link.at, np.diag([DISC[2], DISC[1], DISC[1]]))
    model = link_points(fe, Linked({"disc": link}, [disc]))
    first, last = 3 * len(mesh.points), 3 * (len(mesh.points) + 3 * n)
    upper = (owner == 0) & (np.abs(mesh.points[:, 1]) < 1e-9) & (mesh.points[:, 2] > 1e-3)  # across y it can't turn
    fixed = np.array([first, first + 1, first + 2, last + 1, last + 2, 3 * np.flatnonzero(upper)[0] + 1])
    solver = FreeBodySolver(model, fixed=fixed)
    pairs = solver.modes(24)
    markers = {"foot": face_marker(fe.discretisation, mesh.faces["x-"])}
    body = supported_body(model, pairs.omega, pairs.shapes, markers, "foot", np.zeros((0, 3)))
    whole = stiffen_body(body, model, solver, None, moving=markers, elements=False)
    found = rotating_modes(whole, np.array([1.0, 0.0, 0.0]), RATE)
    assert found.growth.max() < 1e-6
    return np.asarray(2 * np.pi * found.frequencies_hz)


def test_a_stepped_rotor_with_a_disc_whirls_as_one_of_przemienieckis_beams() -> None:
    fixed_axes = hand_rotor(12)
    exact = np.abs(fixed_axes - RATE)
    found = spun(6)
    nearest = np.array([found[np.abs(found - one).argmin()] for one in exact])
    assert np.abs((nearest - exact) / fixed_axes)[:4].max() < 3e-5
    assert np.abs((nearest - exact) / fixed_axes).max() < 2e-4


def test_a_disc_on_a_spinning_shaft_has_the_frequencies_of_the_textbook() -> None:
    """At 600 rad/s 369.03, 724.13, 1201.05 and 1307.89 rad/s by bending alone, and with shear as the closed form."""
    L, d, mass, across, polar, rate = 0.3, 0.02, 5.0, 0.02, 0.04, 600.0
    mesh = beams(np.array([0.0, 0.1, 0.2, L]), (round_section(d),))
    fe = assemble(mesh, 1, Material(200e9, 0.3, 1e-4))
    link = LinkedFace(face_marker(fe.discretisation, mesh.faces["x+"], rigid=True), np.array([L, 0.0, 0.0]))
    disc = LumpedMass("disc", mass, link.at, np.diag([polar, across, across]))
    model = link_points(fe, Linked({"disc": link}, [disc]))
    solver = FreeBodySolver(model, fixed=clamp(fe, 0))
    pairs = solver.modes(6)
    markers = {"foot": face_marker(fe.discretisation, mesh.faces["x-"])}
    body = supported_body(model, pairs.omega, pairs.shapes, markers, "foot", np.zeros((0, 3)))
    whole = stiffen_body(body, model, solver, None, moving=markers, elements=False)
    found = 2 * np.pi * rotating_modes(whole, np.array([1.0, 0.0, 0.0]), rate).frequencies_hz
    EI, kGA = 200e9 * np.pi * d**4 / 64, 7.8 / 8.8 * 200e9 / 2.6 * np.pi * d**2 / 4
    F = np.array([[L**3 / (3 * EI), L**2 / (2 * EI)], [L**2 / (2 * EI), L / EI]])
    bent = np.sort(np.abs(rotor_frequencies(F, mass, across, polar, rate) - rate))
    assert bent == pytest.approx([369.03, 724.13, 1201.05, 1307.89], abs=0.005)
    F[0, 0] += L / kGA
    exact = np.abs(rotor_frequencies(F, mass, across, polar, rate) - rate)
    assert all(np.abs(found - omega).min() < 1e-6 * omega for omega in exact)
    assert all(np.abs(found - omega).min() < 3e-3 * omega for omega in bent)


# Targets of National Agency for Finite Element Methods and Standards, Selected Benchmarks for Natural Frequency, 1987.
NAFEMS = Material(200e9, 0.3, 8000.0)


def test_the_pin_ended_double_cross_has_the_frequencies_of_nafems_fv2() -> None:
    """Eight arms of 5 m × 0.125 m in a plane, pinned at their ends, four elements each."""
    n, angle = 4, np.pi / 4 * np.arange(8)
    out = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    x = np.concatenate([np.zeros((1, 3)), *(5.0 / n * k * out for k in range(1, n + 1))])
    ends = np.array([(8 * (k - 1) + a + 1 if k else 0, 8 * k + a + 1) for a in range(8) for k in range(n)])
    along, up = np.repeat(out, n, axis=0), np.tile([0.0, 0.0, 1.0], (8 * n, 1))
    axes = np.stack([along, np.cross(up, along), up], axis=1)
    section = rectangular_section(0.125, 0.125)
    fe = assemble(extrude(Beams(x, ends, axes, (section,), np.zeros(8 * n, int), {}, {})), 1, NAFEMS)
    n_points = len(fe.discretisation.mesh.points)
    pins = n_points + 8 * (n - 1) + 1 + np.arange(8)
    in_plane = 3 * np.arange(n_points + len(x)) + 2  # all of it
    fixed = np.concatenate([(3 * pins[:, None] + np.arange(2)).ravel(), in_plane])
    hertz = FreeBodySolver(fe, fixed=fixed).modes(16).omega / (2 * np.pi)
    assert hertz == pytest.approx([11.336, *[17.709] * 7, 45.345, *[57.390] * 7], rel=6e-3)


def test_a_cantilever_with_masses_beside_its_end_has_the_frequencies_of_nafems_fv4() -> None:
    """10 m long, 0.5 m thick, with 10 t and 1 t two metres to both sides of its end."""
    mesh = beams(np.linspace(0, 10, 6), (round_section(0.5),))
    fe = assemble(mesh, 1, NAFEMS)
    end = np.array([10.0, 0.0, 0.0])
    link = LinkedFace(face_marker(fe.discretisation, mesh.faces["x+"], rigid=True), end)
    masses = [
        LumpedMass("end", m, end + np.array([0.0, y, 0.0]), np.zeros((3, 3))) for m, y in ((1e4, 2.0), (1e3, -2.0))
    ]
    model = link_points(fe, Linked({"end": link}, masses))
    hertz = FreeBodySolver(model, fixed=clamp(fe, 0)).modes(6).omega / (2 * np.pi)
    assert hertz == pytest.approx([1.723, 1.727, 7.413, 9.972, 18.155, 26.957], rel=1.1e-2)


def test_a_deep_simply_supported_beam_has_the_frequencies_of_nafems_fv5() -> None:
    """10 m × 2 m × 2 m: 42.649, 125.00, 148.31 and 284.55 Hz; its J is the polar moment, ours Roark's."""
    n = 10
    mesh = beams(np.linspace(0, 10, n + 1), (rectangular_section(2.0, 2.0),))
    fe = assemble(mesh, 1, NAFEMS)
    first, last = 3 * len(mesh.points), 3 * (len(mesh.points) + n)
    upper = (np.abs(mesh.points[:, :2]) < 1e-9).all(axis=1) & (mesh.points[:, 2] > 0.1)
    fixed = np.array([first, first + 1, first + 2, last + 1, last + 2, 3 * np.flatnonzero(upper)[0] + 1])
    hertz = FreeBodySolver(fe, fixed=fixed).modes(9).omega / (2 * np.pi)
    torsion = np.sqrt(200e9 / 2.6 * mesh.midsurface.sections[0].torsion / (8000 * 8 / 3)) / 40  # type: ignore[union-attr]
    assert hertz[[0, 1, 3, 4, 5]] == pytest.approx([42.649, 42.649, 125.0, 148.31, 148.31], rel=1.5e-3)
    assert hertz[[7, 8]] == pytest.approx([284.55, 284.55], rel=1e-2)
    assert hertz[2] == pytest.approx(torsion, rel=2e-3)


@pytest.mark.parametrize(
    "section",
    [
        round_section(0.03),
        round_section(0.03, 0.026),
        rectangular_section(0.02, 0.05),
        box_section(0.04, 0.06, 0.003),
        i_section(0.05, 0.08, 0.004, 0.006),
    ],
)
def test_strain_of_shear_and_twist_has_the_resultant_and_the_energy_of_the_section(section: Section) -> None:
    s, w = np.polynomial.legendre.leggauss(6)
    s, total, turned = 0.5 + 0.5 * s, np.zeros((2, 2)), np.zeros(2)
    for a, wa in zip(s, w / 2, strict=True):
        for b, wb in zip(s, w / 2, strict=True):
            x = section.points[section.quads]
            N = np.array([(1 - a) * (1 - b), a * (1 - b), a * b, (1 - a) * b])
            p, q = np.array([b - 1, 1 - b, b, -b]) @ x, np.array([a - 1, -a, a, 1 - a]) @ x
            weight = wa * wb * (p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0])
            shapes = section.shear_shapes(N @ x, 0.3)
            total += weight @ shapes, weight @ shapes**2
            twist, square = section.twisting(N @ x)[:, 0], weight * ((N @ x) ** 2).sum(axis=1)
            turned += square @ twist, square @ twist**2
    share = section.shear_areas(0.3) * section.area
    assert total[1] == pytest.approx(share, rel=1e-9)
    assert total[0] == pytest.approx(share, rel=1e-9)  # even strain of that energy had 1/√κ of it
    assert turned[0] == pytest.approx(section.torsion, rel=1e-9 if not isinstance(section, RoundSection) else 3e-3)
