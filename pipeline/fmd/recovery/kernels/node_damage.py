"""Damage of nodes by histories of their stress: signed von Mises, normal stress on planes, or Findley's parameter."""

from __future__ import annotations

import math

from fmd.core.arrays import Array, IntArray
from fmd.kernels.kernel import inner, kernel
from fmd.recovery.kernels.extremes import principal_stresses
from fmd.recovery.kernels.rainflow import findley_damage, history_damage


@inner
def signed_von_mises(xx: float, yy: float, zz: float, yz: float, xz: float, xy: float) -> float:
    """Return the von Mises stress with the sign of the principal stress that is the largest by size."""
    a, b, c = xx - yy, yy - zz, zz - xx
    square = 0.5 * (a * a + b * b + c * c) + 3.0 * (yz * yz + xz * xz + xy * xy)
    trace = xx + yy + zz
    # σ₁ + σ₃ is the trace less σ₂, which is within a third of the von Mises stress of the mean stress.
    if 4.0 * trace * trace <= square:
        largest, _, smallest = principal_stresses(xx, yy, zz, yz, xz, xy)
        trace = largest + smallest
    return math.copysign(math.sqrt(square), trace)


@kernel
def sign_von_mises(tensors: Array, histories: Array) -> None:
    """Fill histories (n_nodes, n_frames) with the signed von Mises stress of tensors (n_nodes, 6, n_frames)."""
    for node in range(tensors.shape[0]):
        s = tensors[node]
        for k in range(tensors.shape[2]):
            histories[node, k] = signed_von_mises(s[0, k], s[1, k], s[2, k], s[3, k], s[4, k], s[5, k])


@kernel
def damage_of_histories(histories: Array, law: Array, room: Array, damage: Array) -> None:
    """Fill the damage (n_nodes,) of histories (n_nodes, n); law and room are those of `history_damage`."""
    for node in range(histories.shape[0]):
        damage[node] = history_damage(histories[node], law, room)


@kernel
def damage_of_planes(
    tensors: Array, directions: Array, law: Array, history: Array, room: Array, damage: Array, planes: IntArray
) -> None:
    """Fill the largest damage (n_nodes,) by the normal stress on any plane, and the plane's number (n_nodes,).

    Tensors (n_nodes, 3, n) are of stress in the surface [Pa]: along its two axes, and the shear stress between them,
    from which directions ``cos² α, sin² α, 2 sin α cos α`` (n_planes, 3) give a plane's normal stress. History (n,) and
    room (5, n) are to work in.
    """
    n = tensors.shape[2]
    for node in range(tensors.shape[0]):
        damage[node], planes[node] = -1.0, 0
        xx, yy, xy = tensors[node, 0], tensors[node, 1], tensors[node, 2]
        for plane in range(directions.shape[0]):
            a, b, c = directions[plane, 0], directions[plane, 1], directions[plane, 2]
            for k in range(n):
                history[k] = a * xx[k] + b * yy[k] + c * xy[k]
            own = history_damage(history, law, room)
            if own > damage[node]:
                damage[node], planes[node] = own, plane


@kernel
def damage_by_findley(
    tensors: Array, directions: Array, law: Array, work: Array, room: Array, damage: Array, planes: IntArray
) -> None:
    """Fill the largest damage (n_nodes,) by Findley's parameter on any plane, and the plane's number (n_nodes,).

    Planes 2i stand on the surface, planes 2i + 1 lean by the angle at which a stress along i alone is worst; both have
    the azimuth i. Of the shear stress of a leaning plane three directions are counted. Tensors and directions
    (n_azimuths, 3) are as for `damage_of_planes`; work (4, n) and room (5, n) are to work in.
    """
    n = tensors.shape[2]
    along, shear, across, slipping = work[0], work[1], work[2], work[3]
    lean = 0.25 * math.pi + 0.5 * math.atan(law[6])
    s, c = math.sin(lean), math.cos(lean)
    for node in range(tensors.shape[0]):
        damage[node], planes[node] = -1.0, 0
        xx, yy, xy = tensors[node, 0], tensors[node, 1], tensors[node, 2]
        for azimuth in range(directions.shape[0]):
            a, b, d = directions[azimuth, 0], directions[azimuth, 1], directions[azimuth, 2]
            for k in range(n):
                along[k] = a * xx[k] + b * yy[k] + d * xy[k]
                shear[k] = 0.5 * d * (yy[k] - xx[k]) + (a - b) * xy[k]
                across[k] = s * s * along[k]
            own = findley_damage(shear, along, law, room)
            if own > damage[node]:
                damage[node], planes[node] = own, 2 * azimuth
            for turn in range(-1, 2):  # in the surface's normal plane, and 45° to either side
                share = math.sqrt(0.5) if turn else 1.0
                for k in range(n):
                    slipping[k] = s * share * (c * along[k] + turn * shear[k])
                own = findley_damage(slipping, across, law, room)
                if own > damage[node]:
                    damage[node], planes[node] = own, 2 * azimuth + 1
