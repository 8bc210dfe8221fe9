"""Laminates: plates of three-dimensional elasticity, coupling of bending and stretch, turned axes, isotropic stacks."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pytest
from scipy.linalg import eigh, expm, null_space
from scipy.optimize import brentq

from fmd.core.arrays import Array
from fmd.core.rotations import rotation_matrix
from fmd.fem.assembly import assemble
from fmd.fem.cells.shape import skfem_quadrature
from fmd.fem.elements import shape_functions
from fmd.fem.geometric_stiffness import geometric_stiffness, quadratic_strain_load
from fmd.fem.laminate import Lamina, Laminate, Ply
from fmd.fem.layered import Layered
from fmd.fem.material import Material
from fmd.fem.strain import TENSOR, strains
from fmd.recovery.patch_stress import energy_errors
from fmd.recovery.plies import modal_ply_stress
from fmd.reduction.eigen import FreeBodySolver
from tests.fem.sheets import ShellProblem, shell_mesh, unit_grid

CARBON = Lamina(25e9, 1e9, 0.25, 0.5e9, 0.5e9, 0.2e9, 1500.0)  # Pagano's, E2 = 1 GPa
CORE = Lamina(0.04e9, 0.04e9, 0.25, 0.016e9, 0.06e9, 0.06e9, 100.0)  # of his sandwich
ALUMINIUM = Material(70e9, 0.3, 2700.0)
both = pytest.mark.parametrize("element", ["quadrilateral", "triangle"])


def stack(lamina: Lamina, thickness: float, *degrees: float) -> Laminate:
    return Laminate(tuple(Ply(lamina, thickness / len(degrees), np.radians(a)) for a in degrees))


def layered(laminate: Laminate, n_elements: int, direction: tuple[float, ...] | Array = (1.0, 0.0, 0.0)) -> Layered:
    return Layered(laminate, np.tile(direction, (n_elements, 1)))


class QuarterPlate(ShellProblem):
    """A simply supported square plate of unit side by its quarter 0 … 0.5, whose edges slide along their normal."""

    def __init__(self, n: int, laminate: Laminate, element: str = "quadrilateral") -> None:
        p, cells = unit_grid(n, n, element)
        x = np.column_stack([0.5 * p, 0 * p[:, 0]])
        super().__init__(x, cells, laminate.thickness, layered(laminate, len(cells)))
        self.n = n
        for axis in (0, 1):
            self.mirror(axis)
            edge = np.flatnonzero(x[:, axis] == 0.5)
            self.hold(edge, (2, 1 - axis))
            self.hold_tips(edge, (1 - axis,))

    def bend(self) -> Array:
        """Return displacements of all points under the pressure cos(πx) cos(πy)."""
        k, d = np.pi, 0.5 / self.n
        along = np.cos(k * self.x[:, :2]) * 2 * (1 - np.cos(k * d)) / (k**2 * d)  # ∫ N cos(kx) of linear N
        along[self.x[:, :2] == 0] /= 2
        f = self.load()
        f[self.n_points :, 2] = along.prod(axis=1)
        return self.solve_all(f)

    def first_frequency(self) -> float:
        """Return the lowest angular frequency."""
        T, C = self.fe.T, np.vstack([row.toarray() for row in self._held])
        Z = null_space(C, rcond=1e-9)
        K, M = (Z.T @ (T.T @ A @ T).toarray() @ Z for A in (self.fe.K, self.fe.M))
        return float(eigh(K, M, eigvals_only=True, subset_by_index=[0, 0])[0] ** 0.5)


class Elastic(NamedTuple):
    """A ply of three-dimensional elasticity along its plate's axes."""

    C: Array  # (3, 3): stiffness of stretches xx, yy, zz
    G: Array  # (3,): shear moduli xz, yz, xy
    thickness: float


def elastic(lamina: Lamina, thickness: float, turned: bool = False, E3: float | None = None) -> Elastic:
    """Return a ply whose contractions 12, 13, 23 of a pull along 1 or 2 are 0.25, with E3 = E2 by default.

    With a given E3 it is the pull along 3 that contracts by 0.25, as Pagano's core has it.
    """
    E1, E2, nu = lamina.E1, lamina.E2, 0.25
    third = [-nu / E1, -nu / E2] if E3 is None else [-nu / E3, -nu / E3]
    C = np.linalg.inv([[1 / E1, -nu / E1, third[0]], [-nu / E1, 1 / E2, third[1]], [*third, 1 / (E3 or E2)]])
    order = [1, 0, 2] if turned else [0, 1, 2]
    return Elastic(C[np.ix_(order, order)], np.array([lamina.G13, lamina.G23, lamina.G12])[order], thickness)


def crossed(lamina: Lamina, h: float, degrees: tuple[int, ...]) -> list[Elastic]:
    """Return plies of one material and thickness at 0 or 90 degrees, h thick together."""
    return [elastic(lamina, h / len(degrees), bool(turned)) for turned in degrees]


def elasticity(plies: Sequence[Elastic], square: float = 0.0) -> Array:
    """Return P (6, 6) from the lower to the upper face of a plate of unit side in three-dimensional elasticity.

    States are amplitudes of u, v, w, σzz, τxz, τyz over a half sine each way (Pagano, J Compos Mater 4, 1970).
    ``square`` is density times squared frequency.
    """
    a, P = np.pi, np.eye(6)
    for c, (Gx, Gy, G12), thickness in plies:
        plane = c[:2, :2] - np.outer(c[:2, 2], c[2, :2]) / c[2, 2] + G12 * (1 - np.eye(2))
        M = np.zeros((6, 6))
        M[[0, 1], 2], M[0, 4], M[1, 5] = -a, 1 / Gx, 1 / Gy
        M[2, :2], M[2, 3], M[3, 2], M[3, 4:] = a * c[:2, 2] / c[2, 2], 1 / c[2, 2], -square, a
        M[4:, :2] = a**2 * (plane + G12 * np.eye(2)) - square * np.eye(2)
        M[4:, 3] = -a * c[:2, 2] / c[2, 2]
        P = expm(M * thickness) @ P
    return np.asarray(P)


def elastic_stress(plies: Sequence[Elastic], ply: int) -> dict[str, float]:
    """Return amplitudes of stress at the upper face of a ply, under a load of 1 on one face of the plate."""
    lower = np.linalg.solve(elasticity(plies)[3:, :3], [1.0, 0.0, 0.0])
    u, v, _, zz, xz, yz = elasticity(plies[: ply + 1])[:, :3] @ lower
    c, stretch = plies[ply].C, -np.pi * np.array([u, v])
    plane = c[:2, :2] @ stretch + c[:2, 2] * (zz - c[2, :2] @ stretch) / c[2, 2]
    return {"xx": plane[0], "yy": plane[1], "xy": plies[ply].G[2] * np.pi * (u + v), "xz": xz, "yz": yz}


def sandwich(h: float) -> list[Elastic]:
    """Return Pagano's sandwich, faces of a tenth of the thickness, with its core in two halves."""
    faces, core = [elastic(CARBON, 0.1 * h)], elastic(CORE, 0.4 * h, E3=0.5e9)
    return [*faces, core, core, *faces]


@pytest.mark.parametrize(
    ("plies", "ratio", "published"),
    [  # square plates: σxx at the face, σyy, σxy there, over (a/h)², τxz and τyz in the middle over a/h
        ("0/90/0", 4, (0.801, 0.534, 0.0511, 0.256, 0.2172)),
        ("0/90/0", 10, (0.590, 0.285, 0.0289, 0.357, 0.1228)),
        ("0/90/0", 100, (0.539, 0.181, 0.0213, 0.395, 0.0828)),
        ("sandwich", 4, (1.556, 0.2595, 0.1437, 0.239, 0.1072)),
        ("sandwich", 10, (1.153, 0.1104, 0.0707, 0.300, 0.0527)),
    ],
)
def test_elasticity_has_paganos_published_stress(plies: str, ratio: int, published: tuple[float, ...]) -> None:
    """Tables of Pagano (1970); σyy of 0/90/0 is at the upper face of the middle ply."""
    h = 1 / ratio
    laid = sandwich(h) if plies == "sandwich" else crossed(CARBON, h, (0, 0, 90, 90, 0, 0))
    face, middle = (elastic_stress(laid, ply) for ply in (len(laid) - 1, len(laid) // 2 - 1))
    across = face["yy"] if plies == "sandwich" else elastic_stress(laid, 3)["yy"]
    found = [face["xx"] * h**2, across * h**2, face["xy"] * h**2, middle["xz"] * h, middle["yz"] * h]
    assert np.abs(found) == pytest.approx(published, rel=2e-3, abs=1e-4)


@pytest.mark.parametrize(("ratio", "within"), [(4, 0.085), (10, 0.015), (20, 0.01), (100, 0.01)])
def test_a_cross_ply_plate_bends_as_in_three_dimensional_elasticity(ratio: float, within: float) -> None:
    """Deflection of the middle surface; transverse shear corrected by 5/6 leaves it 10 % too small at 10."""
    plate = QuarterPlate(8, stack(CARBON, 1 / ratio, 0, 90, 90, 0))
    w = plate.bend()[plate.n_points :, 2].max()
    lower = np.linalg.solve(elasticity(crossed(CARBON, 1 / ratio, (0, 90, 90, 0)))[3:, :3], [1.0, 0.0, 0.0])
    middle = elasticity(crossed(CARBON, 0.5 / ratio, (0, 90)))[:, :3] @ lower
    assert w == pytest.approx(abs(middle[2]), rel=within)


@pytest.mark.parametrize("degrees", [(0, 90), (0, 90, 90, 0)])
@pytest.mark.parametrize("E1", [10e9, 40e9])
def test_a_cross_ply_plate_vibrates_as_in_three_dimensional_elasticity(degrees: tuple[int, ...], E1: float) -> None:
    """At a/h = 5, where the faces are free of traction for one frequency near that of the shell."""
    lamina = Lamina(E1, 1e9, 0.25, 0.6e9, 0.6e9, 0.5e9, 1000.0)
    omega = QuarterPlate(8, stack(lamina, 0.2, *degrees)).first_frequency()

    def traction(share: float) -> float:
        return float(
            np.linalg.det(elasticity(crossed(lamina, 0.2, degrees), 1000.0 * (share * omega) ** 2)[3:, :3] / 1e9)
        )

    assert brentq(traction, 0.9, 1.1) == pytest.approx(1.0, abs=0.025)


def test_stress_of_plies_is_that_of_three_dimensional_elasticity() -> None:
    """At a/h = 20, where σxx at the face is 0.543 (a/h)² of the load: in the plane and across, at faces of plies."""
    n, degrees = 8, (0, 90, 90, 0)
    plate = QuarterPlate(n, stack(CARBON, 1 / 20, *degrees))
    u, space, material = plate.bend()[:, :, None], plate.fe.discretisation, plate.fe.material
    assert isinstance(material, Layered)
    middle, along_y, along_x, corner = 0, n - 1, n * (n - 1), n * n - 1
    found = modal_ply_stress(space, material, u, np.array([middle, along_y, along_x, corner]))[..., 0]
    near, far = np.cos(np.pi / 32), np.sin(np.pi * 15 / 32)  # the middles of these elements
    outer, third, second = (elastic_stress(crossed(CARBON, 1 / 20, degrees), ply) for ply in (3, 2, 1))
    stress = {
        "xx": (found[0, 3, 1, 0] / near**2, outer, 0.06),
        "yy": (found[0, 2, 1, 0] / near**2, third, 0.05),
        "xy": (found[3, 3, 1, 4] / far**2, outer, 0.05),
        "xz": (found[2, 1, 1, 2] / (near * far), second, 0.05),
        "yz": (found[1, 1, 1, 3] / (near * far), second, 0.15),
    }
    ratios = {name: abs(value / exact[name]) - 1 for name, (value, exact, _) in stress.items()}
    assert all(abs(ratios[name]) < within for name, (_, _, within) in stress.items()), ratios


def test_force_along_a_strip_of_two_crossed_plies_bends_it() -> None:
    """ε = D N / (A D − B²), κ = −B N / (A D − B²) of plies without contraction, all constant along the strip."""
    lamina = Lamina(100e9, 10e9, 0.0, 5e9, 5e9, 4e9, 1500.0)
    h, L, N = 2e-3, 0.2, 3e3
    p, cells = unit_grid(10, 2, "quadrilateral")
    x = np.column_stack([L * p[:, 0], 0.04 * p[:, 1], 0 * p[:, 0]])
    strip = ShellProblem(x, cells, h, layered(stack(lamina, h, 0, 90), len(cells)))
    root, tip = (np.flatnonzero(x[:, 0] == at) for at in (0.0, L))
    strip.hold(root, (0, 2))
    strip.hold(root[:1], (1,))
    strip.hold_tips(root, (0,))
    f = strip.load()
    f[strip.n_points + tip, 0] = N * 0.04 * np.array([0.25, 0.5, 0.25])
    u = strip.solve(f)[tip]
    A, B, D = (100e9 + 10e9) * h / 2, (10e9 - 100e9) * h**2 / 8, (100e9 + 10e9) * h**3 / 24
    assert u[:, 0] == pytest.approx(D * N / (A * D - B**2) * L, rel=1e-9)
    assert u[:, 2] == pytest.approx(B * N / (A * D - B**2) * L**2 / 2, rel=1e-9)
    assert [own[0, 0] for own in stack(lamina, h, 0, 90).plane] == pytest.approx([A, B, D], rel=1e-12)


@both
def test_a_stack_of_one_isotropic_material_is_the_plain_shell(element: str) -> None:
    G = ALUMINIUM.lame[1]
    lamina = Lamina(ALUMINIUM.E, ALUMINIUM.E, ALUMINIUM.nu, G, G, G, ALUMINIUM.rho)
    laminate = Laminate(tuple(Ply(lamina, t, a) for t, a in ((1e-3, 0.3), (3e-3, 1.0), (2e-3, -0.7))))
    p, cells = unit_grid(5, 3, element)
    p[7:-7] += np.random.default_rng(2).uniform(-0.03, 0.03, p[7:-7].shape)
    mesh = shell_mesh(np.column_stack([p, 0 * p[:, 0]]), cells, laminate.thickness)
    plain, plies = (assemble(mesh, 1, material) for material in (ALUMINIUM, layered(laminate, len(cells))))
    u = FreeBodySolver(plain).modes(3).shapes
    for one, other in (
        (plain.K.toarray(), plies.K.toarray()),
        (plain.m.toarray(), plies.m.toarray()),
        (geometric_stiffness(plain, u)[2].toarray(), geometric_stiffness(plies, u)[2].toarray()),
        (quadratic_strain_load(plain, u[..., 0])[0], quadratic_strain_load(plies, u[..., 0])[0]),
        (energy_errors(plain.discretisation, ALUMINIUM, u), energy_errors(plies.discretisation, plies.material, u)),
    ):
        assert np.abs(one - other).max() < 1e-10 * np.abs(one).max()


@both
@pytest.mark.parametrize(
    ("bend", "within"), [(0.0, 3 * (1e-12,)), (0.02, (1e-6, 1e-4, 5e-4)), (0.2, (2e-4, 5e-4, 1e-2))]
)
def test_plies_summed_beforehand_have_the_energies_of_each_by_itself(
    element: str, bend: float, within: tuple[float, ...]
) -> None:
    """Thickness over radius is ``bend``: energies of flat elements are exact, those of curved ones nearly."""
    heavy = Lamina(70e9, 70e9, 0.3, 27e9, 27e9, 27e9, 4000.0)
    plies = [Ply(own, 0.005, np.radians(a)) for own, a in ((heavy, 0), (CARBON, 45), (CARBON, -60), (CARBON, 90))]
    laminate = Laminate(tuple(plies))
    p, cells = unit_grid(6, 4, element)
    p[8:-8] += np.random.default_rng(2).uniform(-0.03, 0.03, p[8:-8].shape)
    x = np.column_stack([p, 0 * p[:, 0]])
    if bend:
        radius = laminate.thickness / bend
        angle = min(1.0, 1.0 / radius) * p[:, 0]
        x = np.column_stack([radius * np.sin(angle), p[:, 1], radius * np.cos(angle)])
    fe = assemble(shell_mesh(x, cells, laminate.thickness), 1, layered(laminate, len(cells)))
    space, material = fe.discretisation, fe.material
    assert isinstance(material, Layered)
    assert fe.T is not None
    u = (fe.T @ np.random.default_rng(3).standard_normal((fe.T.shape[1], 2))).reshape(-1, 3, 2)[: len(space.x)]
    plane = "RefQuad" if element == "quadrilateral" else "RefTri"
    (XY, w_plane), (Z, w_line) = (
        skfem_quadrature(cell, n) for cell, n in ((plane, space.kind.stiffness_order), ("RefLine", 4))
    )
    size = np.diff(laminate.ends)[:, None]
    places, w = (laminate.ends[:-1, None] + size * Z).ravel(), np.kron((size * w_line).ravel(), w_plane)
    X, each = np.concatenate([np.tile(XY, len(places)), np.repeat(places, len(w_plane))[None]]), np.arange(len(cells))
    strain = strains(space, material, u, X, each)
    stress = material.stress(space, X, each, strain)
    g, det = space.gradients(X, each)
    slopes = np.einsum("eqia,eibn->eqabn", g, u[space.element_nodes])
    N, _ = shape_functions(space.kind.element, X)
    moved = np.einsum("iq,eibn->eqbn", N, u[space.element_nodes])
    density = np.array([ply.lamina.rho for ply in plies])[laminate.ply_at(X[2])]
    flat = u.reshape(-1, 2)
    n = len(flat)
    K_G = geometric_stiffness(fe, u)[0]
    pulled = np.einsum("eqabn,eqac,eqcbm,eq->nm", slopes, stress[:, :, TENSOR, 0], slopes, det * w, optimize=True)
    for (found, expected), share in zip(
        (
            (flat.T @ (fe.K[:n, :n] @ flat), np.einsum("eqan,eqam,eq->nm", strain, stress, det * w)),
            (flat.T @ (fe.M[:n, :n] @ flat), np.einsum("eqbn,eqbm,eq->nm", moved, moved, det * w * density)),
            (sum(u[:, b].T @ (K_G @ u[:, b]) for b in range(3)), pulled),
        ),
        within,
        strict=True,
    ):
        assert np.abs(found - expected).max() < share * np.abs(expected).max()


@both
def test_turned_layers_direction_and_body_are_one_laminate(element: str) -> None:
    """An angle of 30° is that of the direction; a body turned with its direction is the same body."""
    p, cells = unit_grid(4, 3, element)
    x = np.column_stack([p, 0.3 * p[:, 0] ** 2])
    laminate, Q = stack(CARBON, 0.01, 0, 40, 90), rotation_matrix(np.array([[0.3, -0.7, 0.4]]))[0]
    more = stack(CARBON, 0.01, 30, 70, 120)
    flat = np.column_stack([p, 0 * p[:, 0]])
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)

    def omega(x: Array, laminate: Laminate, direction: tuple[float, ...] | Array = (1.0, 0.0, 0.0)) -> Array:
        fe = assemble(shell_mesh(x, cells, 0.01), 1, layered(laminate, len(cells), direction))
        return FreeBodySolver(fe).modes(3).omega

    # Bending modes, by which shear is corrected, are along and across the direction: not quite the same shear.
    assert omega(flat, more) == pytest.approx(omega(flat, laminate, (c, s, 0.7)), rel=2e-4)
    assert omega(x @ Q.T, laminate, Q[:, 0]) == pytest.approx(omega(x, laminate), rel=1e-9)
    turned = np.roll(cells[:, ::-1], 1, axis=1)
    over = assemble(shell_mesh(x, turned, 0.01), 1, layered(laminate.turned_over(), len(cells)))
    assert FreeBodySolver(over).modes(3).omega == pytest.approx(omega(x, laminate), rel=1e-9)


def test_a_direction_along_the_normal_is_refused() -> None:
    p, cells = unit_grid(2, 2, "quadrilateral")
    mesh = shell_mesh(np.column_stack([p, 0 * p[:, 0]]), cells, 0.01)
    with pytest.raises(ValueError, match="is along the normal of 4 elements; take another direction"):
        assemble(mesh, 1, layered(stack(CARBON, 0.01, 0), len(cells), (0.0, 0.0, 1.0)))


@pytest.mark.parametrize(
    ("change", "message"), [({"E2": 0.0}, "moduli and a density above 0"), ({"nu12": 6.0}, r"nu12 = 6")]
)
def test_plies_that_no_material_has_are_refused(change: dict[str, float], message: str) -> None:
    own = {key: getattr(CARBON, key) for key in ("E1", "E2", "nu12", "G12", "G13", "G23", "rho")}
    with pytest.raises(ValueError, match=message):
        Lamina(**own | change)
