"""Stress of a laminate's plies in their own axes over a motion, and how near it comes to their strength.

The index by maximum stress is the largest share of a strength. Tsai and Hill's (Azzi & Tsai, Experimental Mechanics 5,
1965) is ``(σ₁²/X² − σ₁σ₂/X² + σ₂²/Y² + τ₁₂²/S²)^½``, X and Y by the signs of σ₁ and σ₂: at 1 a ply fails, at 0.5
it bears twice the load.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.memory import PLIES_AT_ONCE
from fmd.core.limits.recovery import INSIDE_PLY
from fmd.fem.layered import Layered

if TYPE_CHECKING:
    from fmd.fem.joined import AnySpace
    from fmd.fem.laminate import Laminate
    from fmd.fem.material import AnyMaterial
    from fmd.fem.space import Discretisation, Member

PLY_STRESSES = ("11", "22", "23", "13", "12")
FAILURE_INDICES = ("maximum stress", "Tsai-Hill")
_KEYS = ("Xt", "Xc", "Yt", "Yc", "S")
StressOfPlies = Callable[["Discretisation", "Layered", Array, IntArray], Array]
"""Gives the stress of shapes in the middle of elements as `modal_ply_stress` does."""


@dataclass(frozen=True)
class PlyExtremes:
    """Extremes over time in the middle of elements of one laminate, at the lower and the upper face of each ply."""

    laminate: Laminate
    elements: IntArray  # (n_elements,): their numbers among the body's shells
    # (n_elements, n_plies, 2): ``"11 max"``, ``"11 min"`` … [Pa], and ``FAILURE_INDICES``, NaN in plies without
    # strengths
    values: dict[str, Array]
    frames: dict[str, IntArray]  # (n_elements, n_plies, 2): number of the output time of each


def modal_ply_stress(space: Discretisation, material: Layered, shapes: Array, elements: IntArray) -> Array:
    """Return the stress of shapes in the middle of elements at both faces of each ply, (n_elements, n_plies, 2, 5, n).

    Components are 11, 22, 23, 13, 12 [Pa per unit of the shape].
    """
    from fmd.fem.strain import strains  # with scikit-fem, which names of plies don't need

    zeta = places_of_plies(material.laminate)
    middle = space.kind.corners.mean(axis=0)[:2]
    X = np.stack([*(np.full_like(zeta, each) for each in middle), zeta])
    strain = strains(space, material, shapes[: len(space.x)], X, elements)
    stress = material.ply_stress(space, X, elements, strain)
    return stress.reshape(len(elements), len(material.laminate.plies), 2, *stress.shape[2:])


def places_of_plies(laminate: Laminate) -> Array:
    """Return the places of the lower and the upper face of each ply, just within it, from 0 to 1, (2 n_plies,)."""
    inside = INSIDE_PLY * np.diff(laminate.ends)
    return np.stack([laminate.ends[:-1] + inside, laminate.ends[1:] - inside], axis=1).ravel()


def extremes_of_laminates(
    space: AnySpace,
    material: AnyMaterial,
    shapes: Array,
    q: Array,
    body: Any,
    stress: StressOfPlies = modal_ply_stress,
) -> list[PlyExtremes]:
    """Return the extremes of each laminate of a body, in whose table ``lamina`` have strengths, over a motion."""
    own = shells_of(space)
    everything = np.arange(len(own.space.element_nodes))
    return [
        ply_extremes(own.space, laid, everything[mine], own.of_shapes(shapes), q, _strengths(body, laid), stress)
        for laid, mine in own.material(material).over(slice(None))
        if isinstance(laid, Layered)
    ]


def shells_of(space: AnySpace) -> Member:
    """Return the shells of a body, which alone have layers."""
    return next(own for own in space.members if own.space.kind.from_middle is not None)


def _strengths(body: Any, material: Layered) -> list[Array]:
    """Return Xt, Xc, Yt, Yc and S of each ply, NaN where the scene has none [Pa]."""
    given = [body.lamina[ply.name].strength for ply in material.laminate.plies]
    return [np.array([getattr(own, key) if own else np.nan for key in _KEYS]) for own in given]


def ply_extremes(
    space: Discretisation,
    material: Layered,
    elements: IntArray,
    shapes: Array,
    q: Array,
    strengths: Sequence[Array],
    stress: StressOfPlies = modal_ply_stress,
) -> PlyExtremes:
    """Return the extremes of elements of one laminate over a motion q (n_times, n).

    Each ply has the strengths Xt, Xc, Yt, Yc, S, NaN if unknown [Pa].
    """
    strength = np.array(strengths)[:, None, :, None]
    batches = max(1, len(elements) * len(q) * len(material.laminate.plies) // PLIES_AT_ONCE)
    found = [
        [_over_time(measure) for measure in _measures(modal @ q.T, strength)]
        for part in np.array_split(elements, batches)
        for modal in [stress(space, material, shapes, part)]
    ]
    names = [f"{c} {end}" for c in PLY_STRESSES for end in ("max", "min")] + [*FAILURE_INDICES]
    joined = [[np.concatenate(each) for each in zip(*own, strict=True)] for own in zip(*found, strict=True)]
    values = {name: own[0] for name, own in zip(names, joined, strict=True)}
    frames = {name: own[1] for name, own in zip(names, joined, strict=True)}
    return PlyExtremes(material.laminate, elements, values, frames)


def _measures(stress: Array, strength: Array) -> Iterator[tuple[Array, int]]:
    """Yield quantities of stress (n_elements, n_plies, 2, 5, n_times), and 1 or −1 for their largest or smallest."""
    for k in range(len(PLY_STRESSES)):
        yield stress[..., k, :], 1
        yield stress[..., k, :], -1
    Xt, Xc, Yt, Yc, S = (strength[..., k, :] for k in range(5))
    one, two, shear = stress[..., 0, :], stress[..., 1, :], stress[..., 4, :]
    along, across, aside = one / np.where(one > 0, Xt, Xc), two / np.where(two > 0, Yt, Yc), shear / S
    yield np.maximum(np.maximum(np.abs(along), np.abs(across)), np.abs(aside)), 1
    coupled = one * two / np.where(one > 0, Xt, Xc) ** 2
    yield np.sqrt(np.maximum(along**2 - coupled + across**2 + aside**2, 0.0)), 1


def _over_time(measure: tuple[Array, int]) -> tuple[Array, IntArray]:
    values, sign = measure
    frame = (sign * values).argmax(axis=-1)
    return np.take_along_axis(values, frame[..., None], axis=-1)[..., 0], frame
