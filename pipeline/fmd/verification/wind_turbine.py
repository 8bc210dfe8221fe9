"""Cases of standard input data from beam data: tower and blade of NREL's 5-MW wind turbine, beside welib's numbers."""

from importlib.resources import files

import numpy as np

from fmd.core.arrays import Array
from fmd.core.cache import Cache
from fmd.reduction.formats.sid_terms import Taylor, sid_terms
from fmd.reduction.inertia import InertiaIntegrals, inertia_integrals
from fmd.reduction.modal_data import ModalData
from fmd.verification.case import Figure, VerificationCase, make_figures

_LENGTH, _HUB, _NODES = 61.5, 1.5, 17  # of the blade [m], and points that OpenFAST integrates it by
# Coefficients of the powers 2 to 6 of the first flap, second flap and first edge mode, from the table's head.
_FLAP_1 = (0.0622, 1.7254, -3.2452, 4.7131, -2.2555)
_FLAP_2 = (-0.5809, 1.2067, -15.5349, 29.7347, -13.8255)
_EDGE_1 = (0.3627, 2.5337, -3.5772, 2.376, -0.6952)
_CLOSE = 1e-9  # of numbers printed to ten digits


def _read_table(name: str) -> Array:
    text = files("fmd.models").joinpath("verification", name).read_text(encoding="utf-8").splitlines()
    rows = [line for line in text if line[0].isdigit()]
    return np.array([[float(item) for item in line.split(",")] for line in rows]).T


def hermite(s: Array, length: float) -> tuple[Array, Array, Array]:
    """Cubic shape functions of a beam element at places s in [0, 1], their slopes and curvatures, (n_places, 4) each.

    The unknowns are deflection and slope of both ends of an element of a length [m].
    """
    L = length
    w = np.stack([1 - 3 * s**2 + 2 * s**3, L * (s - 2 * s**2 + s**3), 3 * s**2 - 2 * s**3, L * (s**3 - s**2)], axis=1)
    slope = np.stack([6 * s**2 - 6 * s, L * (1 - 4 * s + 3 * s**2), 6 * s - 6 * s**2, L * (3 * s**2 - 2 * s)], axis=1)
    bend = np.stack([12 * s - 6, L * (6 * s - 4), 6 - 12 * s, L * (6 * s - 2)], axis=1)
    return w, slope / L, bend / L**2


def _tower_terms() -> tuple[float, dict[str, Taylor], dict[str, Taylor]]:
    """Mass and terms of a clamped Euler–Bernoulli beam with its first mode both ways; the last, stiffened by spin."""
    from scipy.linalg import eigh

    fraction, mass, stiffness = _read_table("nrel-5mw-tower.csv")
    z = fraction * 87.6  # of the tower [m]
    s, weight = (a + b for a, b in zip(np.polynomial.legendre.leggauss(5), ((1.0, 0.0)), strict=True))
    s, weight = 0.5 * s, 0.5 * weight
    n = len(z)
    M, K = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 2 * n))
    points, masses, rows, slopes, forces = [], [], [], [], np.zeros(n)
    for e, L in enumerate(np.diff(z)):
        w, slope, bend = hermite(s, L)
        own = slice(2 * e, 2 * e + 4)
        here, EI = ((1 - s) * a[e] + s * a[e + 1] for a in (mass, stiffness))
        dm = here * weight * L
        M[own, own] += np.einsum("q,qi,qj->ij", dm, w, w)
        K[own, own] += np.einsum("q,qi,qj->ij", EI * weight * L, bend, bend)
        place = z[e] + s * L
        forces[e] += dm @ (place * (1 - s))
        forces[e + 1] += dm @ (place * s)
        points.append(place)
        masses.append(dm)
        rows.append((own, w))
        slopes.append((own, slope, weight * L))
    _, shapes = eigh(K[2:, 2:], M[2:, 2:])
    first = np.concatenate([[0.0, 0.0], shapes[:, 0] / shapes[-2, 0]])
    x = np.concatenate(points)[:, None] * np.array([0.0, 0.0, 1.0])
    Phi = np.zeros((len(x), 3, 2))
    Phi[:, 0, 0] = Phi[:, 1, 1] = np.concatenate([w @ first[own] for own, w in rows])
    integrals = inertia_integrals(x, np.diag(np.concatenate(masses)), Phi)
    tension = np.cumsum(forces[::-1])[::-1][1:]  # in an element by unit spin: what acts on the nodes beyond it
    stiff = sum(N * ds @ (slope @ first[own]) ** 2 for N, (own, slope, ds) in zip(tension, slopes, strict=True))
    KG = np.zeros((3, 3, 2, 2))
    KG[2, 2] = stiff * np.eye(2)
    G = integrals.G.copy()
    G[:, :, 1:, 1:] -= KG
    bend_stiffness = float(first @ K @ first) * np.eye(2)
    plain = ModalData(integrals, bend_stiffness, np.zeros((2, 2)), {})
    spun = ModalData(InertiaIntegrals(G, integrals.S, integrals.mass, KG), bend_stiffness, np.zeros((2, 2)), {})
    return integrals.mass, sid_terms(plain), sid_terms(spun)


def _tower(_: Cache | None) -> list[Figure]:
    whole, plain, spun = _tower_terms()
    found = {
        "mass [kg]": whole,
        "J_xx [kg m²]": plain["J"].M0[0, 0],
        "Me [kg]": float(np.trace(plain["Me"].M0)) / 2,
        "Ct_x [kg]": plain["Ct"].M0[0, 0],
        "Cr_y [kg m]": plain["Cr"].M0[0, 1],
        "stiffening by ω_x² [kg]": (spun["Oe"].M1 - plain["Oe"].M1)[0, 0, 0],
    }
    published = (347460.2316, 7.198598843e8, 61094.66490, 104625.69072, 6449889.716099, 77201.43393)
    return make_figures(found, found.values(), published, _CLOSE)


def twisted_shapes(z: Array, twist: Array) -> Array:
    """Shapes of a twisted blade: bending about its turning principal axes, integrated twice as ElastoDyn does.

    By the twist (n,) of the axes [rad] at the middles z (n,) of equal elements [m] there are displacements (n, 3, 3) of
    the first and second flap mode and the first edge mode.
    """
    h, powers = z[1] - z[0], np.arange(2, 7)
    terms = powers[:, None] * (powers[:, None] - 1) * (z / _LENGTH) ** (powers[:, None] - 2)
    bends = [np.array(coefficients) @ terms for coefficients in (_FLAP_1, _FLAP_2, _EDGE_1)]
    cos, sin = np.cos(twist), np.sin(twist)
    axes = ((cos, -sin), (cos, -sin), (sin, cos))
    bend = np.zeros((len(z), 3, 3))
    for mode, (curvature, (along, across)) in enumerate(zip(bends, axes, strict=True)):
        bend[:, 0, mode], bend[:, 1, mode] = curvature / _LENGTH**2 * along, curvature / _LENGTH**2 * across
    for _ in range(2):  # half of an element's own share, and all of those below it
        bend = h * (np.cumsum(bend, axis=0) - 0.5 * bend)
    return bend


def _blade(_: Cache | None) -> list[Figure]:
    fraction, twist, mass = _read_table("nrel-5mw-blade.csv")
    z = (np.arange(_NODES) + 0.5) * _LENGTH / _NODES
    masses = np.interp(z / _LENGTH, fraction, mass) * _LENGTH / _NODES
    x = np.zeros((_NODES, 3))
    x[:, 2] = _HUB + z
    shapes = twisted_shapes(z, np.radians(np.interp(z / _LENGTH, fraction, twist)))
    integrals = inertia_integrals(x, np.diag(masses), shapes)
    terms = sid_terms(ModalData(integrals, np.eye(3), np.zeros((3, 3)), {}))
    found = {
        "J_xx [kg m²]": terms["J"].M0[0, 0],
        "J_xz of flap 1 [kg m]": terms["J"].M1[0, 0, 2],
        "Ct of flap 1, x [kg]": terms["Ct"].M0[0, 0],
        "Oe of flap 1, yz [kg m]": terms["Oe"].M0[0, 4],
        "Gr of flap 1, xz [kg m]": terms["Gr"].M0[0, 2],
        "Ge of flaps 1 and 2, z [kg]": terms["Ge"].M0[0, 5],
        "Gr of flap 1 twice, xx [kg]": terms["Gr"].M1[0, 0, 0],
    }
    published = [12319399.637394847, -90430.81196669511, 2056.3643491060693, -14620.057176601025]
    published += [-180861.62393339022, -220.06947247279106, 40.94259631698493]
    return make_figures(found, found.values(), published, _CLOSE)


_SOURCE = "numbers printed by the tests of welib (Branlard), by finite elements and by ElastoDyn's integration"
CASES = (
    VerificationCase("sid-tower", "standard input data of the NREL 5-MW tower", _SOURCE, _tower),
    VerificationCase("sid-blade", "standard input data of the NREL 5-MW blade", _SOURCE, _blade),
)
