"""Consistent mass of beams as points inside of them, which move by the shape functions of Timoshenko's beam.

Three stations of Gauss's rule along each beam have four points each, with the moments of inertia of the section. They
move as the beam's axis and its sections do between the ends (Przemieniecki, Theory of Matrix Structural Analysis, 1968,
section 11.6), so ``Tᵀ M T`` is the consistent mass with rotary inertia; each turns in second order with its section.
"""

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.rotations import rigid_motions
from fmd.fem.arms import Arms, join_arms, second_of_rigid
from fmd.fem.beams import BeamLine
from fmd.fem.material import AnyMaterial, Material
from fmd.fem.shell_model import ShellModel

_STATIONS = 0.5 + 0.5 * np.sqrt(0.6) * np.arange(-1, 2)  # exact to the fifth degree
_CORNERS = np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])


@dataclass(frozen=True)
class _Numbers:
    """Mass [kg], radii of inertia of y and z (n, 2) [m], and ``12 E I / (k G A L²)`` across y and z (n, 2) of beams."""

    mass: Array
    radii: Array
    shear: Array


def carry_beam_mass(model: ShellModel, line: BeamLine) -> ShellModel:
    """Return the model of beams whose mass is that of points inside of them, behind all other points."""
    assert model.T is not None
    assert model.arms is not None
    _, cell = np.unique(line.beam, return_index=True)
    numbers = _numbers(line, model.material, cell)
    axes, length, start = line.axes[cell], line.length[cell], line.start[cell]
    n_beams, n_points, n_nodes = len(cell), len(model.x), len(line.nodes)
    move, turn = _motions(axes, length, _offsets(line, cell), numbers.shear)
    r = np.einsum("ekb,ebc->ekc", _CORNERS * numbers.radii[:, None], axes[:, 1:])
    r = np.repeat(r, 3, axis=0).reshape(-1, 3)  # of the four points at each station
    middles = start[:, None] + _STATIONS[:, None] * length[:, None, None] * axes[:, None, 0]
    x = np.repeat(middles.reshape(-1, 3), 4, axis=0) + r
    station = np.repeat(np.arange(3 * n_beams), 4)
    moved = move[station] + rigid_motions(r)[:, :, 3:] @ turn[station]
    # displacements of nodes by those of all points, and behind them rotations
    nodes = 3 * (len(line.owner) + np.arange(n_nodes))[:, None] + np.arange(3)
    unit = (np.ones(3 * n_nodes), (np.arange(3 * n_nodes), nodes.ravel()))
    shown = sp.csr_array(sp.vstack([sp.csr_array(unit, shape=(3 * n_nodes, 3 * n_points)), model.arms.turn]))
    columns = _columns(line.ends, n_nodes)
    T = sp.vstack([model.T, _sparse(moved, columns[station // 3], 6 * n_nodes) @ (shown @ model.T)])
    turned = _sparse(turn, columns[np.arange(3 * n_beams) // 3], 6 * n_nodes) @ shown
    n_all = n_points + len(x)
    arms = Arms(n_points + np.arange(len(x)), station, _widened(turned, n_all), second_of_rigid(r))
    K = sp.csr_array(model.K, copy=True)
    K.resize((3 * n_all, 3 * n_all))
    weights = np.einsum("e,s->es", numbers.mass, np.array([5.0, 8.0, 5.0]) / 18).ravel()[station] / 4
    return replace(
        model,
        K=K,
        m=sp.csr_array(sp.diags_array(np.concatenate([np.zeros(n_points), weights]))),
        positions=np.concatenate([model.x, x]),
        T=sp.csr_array(T),
        arms=join_arms(replace(model.arms, turn=_widened(model.arms.turn, n_all)), arms),
    )


def _numbers(line: BeamLine, material: AnyMaterial, cell: IntArray) -> _Numbers:
    """Return what the motion and the mass of each beam depend on, given a cell of each."""
    found = _Numbers(np.zeros(len(cell)), np.zeros((len(cell), 2)), np.zeros((len(cell), 2)))
    everything = np.arange(len(cell))
    for own, mine in material.over(cell):
        assert isinstance(own, Material)
        for k in np.unique(line.of[cell]):
            section = line.sections[k]
            chosen = np.intersect1d(everything[mine], np.flatnonzero(line.of[cell] == k))
            moments = (section.moments * section.bending**2)[::-1]  # ∫ y² and ∫ z²
            L = line.length[cell[chosen], None]
            line_mass = own.rho * section.area + section.line_mass
            found.mass[chosen] = line_mass * L[:, 0]
            found.radii[chosen] = np.sqrt(own.rho * moments / line_mass)
            stiffness = own.E / (2 * (1 + own.nu)) * section.area * section.shear_areas(own.nu)
            found.shear[chosen] = 12 * own.E * moments / (stiffness * L**2)
    return found


def _offsets(line: BeamLine, cell: IntArray) -> Array:
    """Return the places of the centroids at both ends from their nodes, shape (n_beams, 2, 3) [m]."""
    first = line.start[cell]
    last = first + line.length[cell, None] * line.axes[cell, 0]
    return np.stack([first, last], axis=1) - line.nodes[line.ends]


def _motions(axes: Array, length: Array, offsets: Array, shear: Array) -> tuple[Array, Array]:
    """Return displacement and rotation at the stations by those of the nodes, both (3 n_beams, 3, 12).

    Columns are displacement and rotation of the first node, then of the second.
    """
    n, L, one = len(axes), length[:, None], np.ones_like(length)[:, None]
    move, turn = np.zeros((2, n, 3, 3, 2, 2, 3))  # station, of, end, displacement or rotation, by
    for end in (0, 1):
        s = (1 - _STATIONS if end == 0 else _STATIONS) * one  # 1 at the end
        sign = 1.0 if end == 0 else -1.0
        for a, p in ((1, shear[:, :1]), (2, shear[:, 1:])):
            b, turns = 3 - a, 3.0 - 2.0 * a  # a deflection along y turns about z, one along z about −y
            move[:, :, a, end, 0, a] = (3 * s**2 - 2 * s**3 + p * s) / (1 + p)
            move[:, :, a, end, 1, b] = turns * sign * L * (s**2 - s**3 + p / 2 * (s - s**2)) / (1 + p)
            turn[:, :, b, end, 0, a] = turns * -sign * 6 * (s - s**2) / (L * (1 + p))
            turn[:, :, b, end, 1, b] = (3 * s**2 - 2 * s + p * s) / (1 + p)
        move[:, :, 0, end, 0, 0] = turn[:, :, 0, end, 1, 0] = s
    arms = rigid_motions(offsets.reshape(-1, 3))[:, :, 3:].reshape(n, 2, 3, 3)
    found = []
    for of in (move, turn):
        whole = np.einsum("eba,esbkdc,ecf->esakdf", axes, of, axes)
        whole[..., 1, :] += np.einsum("esakc,ekcf->esakf", whole[..., 0, :], arms)
        found.append(whole.reshape(3 * n, 3, 12))
    return found[0], found[1]


def _columns(ends: IntArray, n_nodes: int) -> IntArray:
    """Return the places of displacement and rotation of each beam's nodes, shape (n_beams, 12)."""
    three = np.arange(3)
    each = [3 * ends[:, :1] + three, 3 * n_nodes + 3 * ends[:, :1] + three]
    return np.concatenate([*each, 3 * ends[:, 1:] + three, 3 * n_nodes + 3 * ends[:, 1:] + three], axis=1)


def _sparse(blocks: Array, columns: IntArray, n: int) -> sp.csr_array:
    """Return the matrix (3 k, n) of blocks (k, 3, 12) at columns (k, 12)."""
    rows = np.broadcast_to(np.arange(3 * len(blocks)).reshape(-1, 3, 1), blocks.shape)
    place = rows.ravel(), np.broadcast_to(columns[:, None], blocks.shape).ravel()
    return sp.csr_array((blocks.ravel(), place), shape=(3 * len(blocks), n))


def _widened(A: sp.csr_array, n_points: int) -> sp.csr_array:
    """Return a matrix by displacements of points with columns of further points."""
    wide = sp.csr_array(A, copy=True)
    wide.resize((A.shape[0], 3 * n_points))
    return wide
