"""Formulas and independent methods that the cases are compared with where no number is printed."""

import itertools

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.special import ellipj, ellipk

from fmd.core.arrays import Array
from fmd.fem.material import Material


def timoshenko_free(length: float, depth: float, material: Material, count: int) -> Array:
    """Bending frequencies of a free rectangular Timoshenko beam [Hz], shape (count,).

    Zeros of ``2 − 2 cosh bα cos bβ + b/√(1 − b²r²s²) (b²r²(r² − s²)² + 3r² − s²) sinh bα sin bβ`` below the cut-off
    (Huang, J Appl Mech 28, 1961), with Cowper's shear factor (J Appl Mech 33, 1966).
    """
    r2, s2, unit = _timoshenko(length, depth, material)

    def equation(b: float) -> float:
        root = np.sqrt((r2 - s2) ** 2 + 4 / b**2)
        alpha, beta = b * np.sqrt((root - r2 - s2) / 2), b * np.sqrt((root + r2 + s2) / 2)
        rest = b / np.sqrt(1 - b**2 * r2 * s2) * (b**2 * r2 * (r2 - s2) ** 2 + 3 * r2 - s2)
        return float(2 / np.cosh(alpha) - 2 * np.cos(beta) + rest * np.tanh(alpha) * np.sin(beta))

    trial = np.linspace(1.0, 0.999 / np.sqrt(r2 * s2), 2000)
    sign = np.sign([equation(b) for b in trial])
    roots = [brentq(equation, trial[k], trial[k + 1]) for k in np.flatnonzero(np.diff(sign))]
    return np.array(roots[:count]) * unit


def timoshenko_supported(length: float, depth: float, material: Material, count: int) -> Array:
    """Bending frequencies of a simply supported rectangular Timoshenko beam [Hz], shape (count,).

    Shapes are ``sin(n π x/L)``, with ``bβ = n π`` (Huang, J Appl Mech 28, 1961).
    """
    r2, s2, unit = _timoshenko(length, depth, material)
    a = (np.pi * np.arange(1, count + 1)) ** 2
    middle = 1 + a * (r2 + s2)  # r²s² b⁴ − (1 + a (r² + s²)) b² + a² = 0
    return np.asarray(np.sqrt(2 * a**2 / (middle + np.sqrt(middle**2 - 4 * r2 * s2 * a**2))) * unit)


def _timoshenko(length: float, depth: float, material: Material) -> tuple[float, float, float]:
    """Return Huang's r² and s², and the frequency [Hz] that his b is a multiple of."""
    nu, r2 = material.nu, depth**2 / 12 / length**2
    shear = 10 * (1 + nu) / (12 + 11 * nu) / (2 * (1 + nu))
    return r2, r2 / shear, float(np.sqrt(material.E / material.rho * r2) / length / (2 * np.pi))


def supported_plate(side: float, thickness: float, material: Material, m: int, n: int) -> float:
    """Bending frequency (m, n) of a simply supported square plate by the exact theory of elasticity [Hz].

    The edges are held across and along themselves. The plate vibrates as waves of ``k = π √(m² + n²)/a`` do in an
    endless one: ``4 k² p q tanh(q h/2) = (q² + k²)² tanh(p h/2)``, ``p² = k² − ω²/c_L²``, ``q² = k² − ω²/c_T²``
    (Rayleigh and Lamb; Srinivas, Rao & Rao, J Sound Vib 12, 1970).
    """
    lam, mu = material.lame
    fast, slow = np.sqrt((lam + 2 * mu) / material.rho), np.sqrt(mu / material.rho)
    k, h = np.pi * np.hypot(m, n) / side, thickness

    def equation(omega: float) -> float:
        p, q = np.sqrt(k**2 - (omega / fast) ** 2), np.sqrt(k**2 - (omega / slow) ** 2)
        return float(4 * k**2 * p * q * np.tanh(q * h / 2) - (q**2 + k**2) ** 2 * np.tanh(p * h / 2))

    return float(brentq(equation, 1e-3 * slow * k, 0.95 * slow * k)) / (2 * np.pi)


def plate_shear(side: float, material: Material, m: int, n: int) -> float:
    """Frequency (m, n) of in-plane shear of a simply supported square plate, ``c_T √(m² + n²)/2a`` [Hz]."""
    return float(np.sqrt(material.lame[1] / material.rho) * np.hypot(m, n) / (2 * side))


def free_box(sizes: tuple[float, float, float], material: Material, count: int, degree: int = 9) -> Array:
    """Frequencies of a free box [Hz] by Rayleigh and Ritz on all polynomials up to a degree.

    Visscher, Migliori, Bell & Reinert, J Acoust Soc Am 90 (1991); here in products of Legendre polynomials.
    """
    nodes, weights = legendre.leggauss(degree + 1)
    values = legendre.legvander(nodes, degree) * np.sqrt(np.arange(degree + 1) + 0.5)
    slopes = legendre.legval(nodes, legendre.legder(np.diag(np.sqrt(np.arange(degree + 1) + 0.5)))).T
    both = (values, slopes)
    one = [[left.T @ (weights[:, None] * right) for right in both] for left in both]
    powers = np.array([lmn for lmn in itertools.product(range(degree + 1), repeat=3) if sum(lmn) <= degree])

    def integral(j: int, k: int) -> Array:
        """∫ ∂_j φ_a ∂_k φ_b over the box, for functions of unit mass at unit density in (-1, 1)³."""
        product = np.ones((len(powers), len(powers)))
        for axis in range(3):
            product *= one[j == axis][k == axis][powers[:, None, axis], powers[None, :, axis]]
        return np.asarray(product * 4 / (sizes[j] * sizes[k]))

    lam, mu = material.lame
    grad = [[integral(j, k) for k in range(3)] for j in range(3)]
    trace = sum(grad[j][j] for j in range(3))
    K = np.block([[lam * grad[i][j] + mu * grad[j][i] + mu * (i == j) * trace for j in range(3)] for i in range(3)])
    squares = eigh(0.5 * (K + K.T), eigvals_only=True, subset_by_index=(6, 5 + count))
    return np.asarray(np.sqrt(squares / material.rho) / (2 * np.pi))


def symmetric_top(moments: tuple[float, float], spin: tuple[float, float], t: Array) -> Array:
    """Angular velocity of Euler's symmetric free body along its axes, (n_times, 3) [rad/s].

    ``moments`` are those across and along the axis of symmetry, ``spin`` its parts along x and that axis at t = 0; the
    part across turns at ``(C − A)/A ω_z`` (Landau & Lifshitz, Mechanics, §36).
    """
    (across, along), (x, z) = moments, spin
    angle = (along - across) / across * z * t
    return np.stack([x * np.cos(angle), x * np.sin(angle), np.full_like(angle, z)], axis=1)


def asymmetric_top(moments: tuple[float, float, float], spin: tuple[float, float], t: Array) -> tuple[Array, float]:
    """Angular velocity of Euler's asymmetric free body along its axes, (n_times, 3) [rad/s], and its period [s].

    ``spin`` are its parts along the axes of the least and the greatest moment at t = 0; that about the middle axis is
    zero then. By Jacobi's elliptic functions, for ``L² > 2 E B`` (Landau & Lifshitz, Mechanics, §37).
    """
    (a, b, c), (x, z) = moments, spin
    energy, momentum2 = 0.5 * (a * x**2 + c * z**2), (a * x) ** 2 + (c * z) ** 2
    pace = np.sqrt((c - b) * (momentum2 - 2 * energy * a) / (a * b * c))
    modulus2 = (b - a) * (2 * energy * c - momentum2) / ((c - b) * (momentum2 - 2 * energy * a))
    sn, cn, dn, _ = ellipj(pace * t, modulus2)
    middle = np.sqrt((2 * energy * c - momentum2) / (b * (c - b)))
    return np.stack([x * cn, middle * sn, z * dn], axis=1), float(4 * ellipk(modulus2) / pace)


def stretched_rod(length: float, material: Material, rate: float) -> tuple[float, float]:
    """Extension of a rod that turns about its end [m], under the load of its undeformed and its deformed shape.

    ``ρ Ω² L³/3E``, and ``(tan kL/kL − 1) L`` with ``k = Ω √(ρ/E)``: the solution of ``E u'' + ρ Ω² (x + u) = 0``.
    """
    kL = rate * np.sqrt(material.rho / material.E) * length
    return kL**2 * length / 3, float(np.tan(kL) / kL - 1) * length
