"""A flexible body as multibody programs' files hold it: inertia integrals, modal matrices, nodes with shapes."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.fem.surface import SurfaceTopology
from fmd.reduction.body import FlexibleBody, MarkerShapes
from fmd.reduction.inertia import InertiaIntegrals


@dataclass(frozen=True)
class ModalData:
    """Inertia, stiffness and damping of a body in a floating frame, for modal coordinates of any kind and scale."""

    integrals: InertiaIntegrals  # inertia integrals, those along all axes, about the frame's origin
    K: Array  # (n, n): modal stiffness
    D: Array  # (n, n): modal damping
    # Nodes by label, about the frame's origin. Rotations are NaN where a file doesn't tell them.
    nodes: Mapping[str, MarkerShapes]
    notes: tuple[str, ...] = ()  # what a file says that can't be right, and what was taken instead
    in_own_frame: bool = False  # true if the integrals hold geometric stiffening, and so in this frame alone
    is_separable: bool = True  # true if the geometric stiffening can be taken out again; some files tell its sum alone
    surface: SurfaceTopology | None = None  # outer surface, whose nodes are places among ``nodes``
    # (n_surface, 6, n): stress of each modal coordinate at the surface's nodes: xx, yy, zz, yz, xz, xy [Pa per unit]
    stress: Array | None = None

    @property
    def n(self) -> int:
        """Number of modal coordinates."""
        return len(self.K)

    @property
    def M(self) -> Array:
        """Modal mass in the reference state, shape (n, n)."""
        M: Array = np.einsum("aaij->ij", self.integrals.G)[1:, 1:]
        return np.asarray(M + np.einsum("aaij->ij", self.integrals.stiffening)) if self.integrals.stiffening.size else M


def modal_data(body: FlexibleBody, damping: float | Array = 0.0) -> ModalData:
    """Gather a reduced body's data, with the modes' damping relative to critical; its markers are the nodes."""
    integrals, markers = body.integrals, dict(body.markers)
    second = (
        integrals.stiffening,
        integrals.displacement2,
        integrals.rotation2,
        *(marker.displacement2 for marker in markers.values()),
    )
    ratios = body.damping if body.damping.size and not np.any(damping) else damping
    K, D = np.diag(body.omega**2), np.diag(2 * ratios * body.omega)
    return ModalData(integrals, K, D, markers, in_own_frame=any(term.any() for term in second))


def without_stiffening(data: ModalData) -> ModalData:
    """Return a body's data without its geometric stiffening, for programs that have no place for it."""
    integrals = data.integrals
    G = integrals.G.copy()
    if integrals.stiffening.size:
        G[:, :, 1:, 1:] += integrals.stiffening
    nodes = {name: MarkerShapes(node.position, node.translation, node.rotation) for name, node in data.nodes.items()}
    return replace(data, integrals=InertiaIntegrals(G, integrals.S, integrals.mass), nodes=nodes, in_own_frame=False)


def function_products(data: ModalData) -> Array:
    """Mass products of 1, x_a and φ_ja with one another, mode by mode, without stiffening; shape (4 + 3 n, 4 + 3 n)."""
    integrals, n = data.integrals, data.n
    G = integrals.G.copy()
    if integrals.stiffening.size:
        G[:, :, 1:, 1:] += integrals.stiffening
    products = np.empty((4 + 3 * n, 4 + 3 * n))
    products[1:, 1:] = G.transpose(2, 0, 3, 1).reshape(3 + 3 * n, 3 + 3 * n)
    products[0, 0], products[0, 1:] = integrals.mass, integrals.S.T.ravel()
    products[1:, 0] = products[0, 1:]
    return products


def integrals_of(products: Array, turns: Array) -> Array:
    """Integrals ``G[a, b]`` (3, 3, …) from what equations of motion take of them, as files hold it.

    Products (6, …) are ``Σ_ab W_ab G[a, b]`` of two rates, xx, yy, zz, xy, yz, xz, with ``W = ω ωᵀ − ω²``, and turns
    (3, …) ``ε_abc G[b, c]``.
    """
    G = np.zeros((3, 3, *products.shape[1:]))
    trace = -0.5 * products[:3].sum(axis=0)
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        G[a, a] = trace + products[a]
        mixed = products[3 + (a + 1) % 3]
        G[b, c], G[c, b] = 0.5 * (mixed + turns[a]), 0.5 * (mixed - turns[a])
    return G


def rate_products(G: Array) -> Array:
    """Sums ``Σ_ab W_ab G[a, b]``, ``W = ω ωᵀ − ω²``, for the rates' products xx, yy, zz, xy, yz, xz; shape (6, …)."""
    trace = np.einsum("aa...->...", G)
    mixed = [G[a, b] + G[b, a] for a, b in ((0, 1), (1, 2), (0, 2))]
    return np.stack([*(G[a, a] - trace for a in range(3)), *mixed])


def rate_turns(G: Array) -> Array:
    """Sums ``ε_abc G[b, c]``, shape (3, …)."""
    return np.stack([G[1, 2] - G[2, 1], G[2, 0] - G[0, 2], G[0, 1] - G[1, 0]])
