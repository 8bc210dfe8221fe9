"""Flexibility of faces with more points than are followed at once: columns are found as points first come near."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.cache import Cache
from fmd.core.errors import AccuracyError
from fmd.core.limits import contact as limits

Responder = Callable[[IntArray, Array], Array]  # displacements of nodes by forces on them, (3 n, k) each


def motions_of_all(
    nodes: IntArray, x: Array, shapes: Array, respond: Responder, W: Array
) -> tuple[Array, Array, Array, float]:
    """Return what is to be known of all points before a march, without the flexibility between them.

    That are each one's own flexibility (n,), the stiffness of all of them held, and W (n, 3, n_modes), whose ``W Wᵀ``
    is the modes' part, where that leaves less than `LEAST_FLEXIBILITY` scaled down, and the share of such directions.

    Raises
    ------
    AccuracyError
        Forces that hold all points weren't found.
    """
    n, own, at = len(nodes), np.empty((len(nodes), 3, 3)), limits.COLUMNS_AT_ONCE // 3
    for first in range(0, n, at):
        some = np.arange(first, min(first + at, n))
        own[some] = _columns(nodes, respond, some)[np.arange(len(some)), some]
    E = _motions(x, shapes)
    held = _hold(nodes, respond, E, own)
    W = W.reshape(3 * n, -1)
    of_modes = np.linalg.lstsq(E, W)[0]
    parts, U = np.linalg.eigh(of_modes.T @ (E.T @ held) @ of_modes)
    kept = np.clip(parts, 0.0, 1.0 - limits.LEAST_FLEXIBILITY)
    W = W @ U * np.sqrt(kept / np.where(parts > 0.0, parts, 1.0))
    Y = held.T @ W
    V = W.reshape(n, 3, -1)
    soft = np.asarray(np.linalg.eigvalsh(own - V @ V.transpose(0, 2, 1))[:, -1], dtype=float)
    stiffness = E.T @ held + Y / (1.0 - kept) @ Y.T
    return soft, stiffness, V, float((parts > kept).sum()) / (3 * n)


def stiffness_of_all(x: Array, shapes: Array, held: Array, J: Array) -> Array:
    """Return the stiffness ``Jᵀ G⁻¹ J`` of all points held, of velocities that are the body's and its modes'."""
    C = np.linalg.lstsq(_motions(x, shapes), J.reshape(3 * len(x), -1))[0]
    return np.asarray(C.T @ held @ C)


def _motions(x: Array, shapes: Array) -> Array:
    """Return displacements of points by a rigid motion and by modes, (3 n, 6 + n_modes)."""
    turns = np.cross(np.eye(3)[None], x[:, None]).transpose(0, 2, 1)
    moves = np.broadcast_to(np.eye(3), turns.shape)
    return np.concatenate([moves, turns, shapes], axis=2).reshape(3 * len(x), -1)


def _columns(nodes: IntArray, respond: Responder, some: IntArray) -> Array:
    """Return how unit forces on some of the points move all, (k, n, 3, 3)."""
    f = np.zeros((len(nodes), 3, len(some), 3))
    f[some, :, np.arange(len(some))] = np.eye(3)
    moved = respond(nodes, f.reshape(3 * len(nodes), -1))
    return moved.reshape(f.shape).transpose(2, 0, 1, 3)


def _hold(nodes: IntArray, respond: Responder, E: Array, own: Array) -> Array:
    """Return forces by which points, and no modes, move by E (3 n, k), by conjugate gradients."""
    inverse, x, r = np.linalg.inv(own), np.zeros(E.shape), E.copy()

    def soften(r: Array) -> Array:
        return np.asarray(inverse @ r.reshape(len(nodes), 3, -1), dtype=float).reshape(r.shape)

    p = z = soften(r)
    works = least = (r * z).sum(axis=0)
    for _ in range(limits.CONJUGATE_ROUNDS):
        moved = respond(nodes, p)
        step = works / np.maximum((p * moved).sum(axis=0), np.finfo(float).tiny)
        x, r = x + step * p, r - step * moved
        z = soften(r)
        before, works = works, (r * z).sum(axis=0)
        if (works <= limits.HELD_RESIDUAL**2 * least).all():
            return np.asarray(x)
        p = z + works / np.maximum(before, np.finfo(float).tiny) * p
    raise AccuracyError(f"forces that hold {len(nodes)} points of contact weren't found; larger elements help")


class Columns:
    """Residual flexibility of a body's points, a column of it when one is first asked for.

    ``responder`` makes what finds displacements of nodes by forces on them; columns are kept in a store under a name.
    """

    def __init__(self, nodes: IntArray, W: Array, responder: Callable[[], Responder], cache: Cache | None, name: str):
        self._nodes, self._W, self._responder, self._cache, self._name = nodes, W, responder, cache, name
        self._known: dict[int, Array] = {}
        self.functions: list[Any] = []  # that kernels call by their addresses

    @cached_property
    def _respond(self) -> Responder:
        return self._responder()

    def between(self, numbers: IntArray) -> Array:
        """Return the flexibility between some points, (k, 3, k, 3)."""
        if not len(numbers):
            return np.zeros((0, 3, 0, 3))
        new = [k for k in numbers.tolist() if k not in self._known and not self._stored(k)]
        for first in range(0, len(new), limits.COLUMNS_AT_ONCE // 3):
            some = np.array(new[first : first + limits.COLUMNS_AT_ONCE // 3])
            for k, column in zip(some.tolist(), _columns(self._nodes, self._respond, some), strict=True):
                self._known[k] = column.copy()
                if self._cache is not None:
                    self._cache.save(f"{self._name}-{k}", self._known[k])
        W = self._W[numbers].reshape(3 * len(numbers), -1)
        whole = np.stack([self._known[k][numbers] for k in numbers.tolist()], axis=2).reshape(len(W), len(W))
        most, used = limits.COLUMNS_KEPT // (72 * len(self._nodes)), set(numbers.tolist())
        for k in [k for k in self._known if k not in used][: max(0, len(self._known) - most)]:
            del self._known[k]
        return np.asarray(0.5 * (whole + whole.T) - W @ W.T).reshape(len(numbers), 3, len(numbers), 3)

    def _stored(self, k: int) -> bool:
        """Take a column from the store; false if it isn't there."""
        column = None if self._cache is None else self._cache.load(f"{self._name}-{k}", "Array")
        if column is not None:
            self._known[k] = column
        return column is not None


def growing_function(bodies: Sequence[Columns | None], first: IntArray, rows: IntArray, shape: tuple[int, ...]) -> int:
    """Return the address of what fills a table's rows of G, of that shape, for the nodes wanted; 0 if all have them.

    Bodies have nodes and rows from ``first`` and ``rows`` (n_bodies + 1,) on. Its first mark becomes 1, 0 where columns
    weren't found, and -1 where the nodes wanted are too many.
    """

    def grow(*places: int) -> None:
        size = int(first[-1])
        wanted, row, column = (view_at(at, ctypes.c_int64, (size,)) for at in places[:3])
        asked, G = wanted.copy(), view_at(places[3], ctypes.c_double, shape)
        wanted[0] = 0
        for body, at, end, begin, room in zip(bodies, first, first[1:], rows, np.diff(rows), strict=False):
            numbers, own = np.flatnonzero(asked[at:end]), slice(at, end)
            if body is None or not len(numbers):
                continue
            if len(numbers) > room:
                wanted[0] = -1
                return
            both = np.flatnonzero((asked[own] > 0) | (column[own] >= 0))
            numbers = both if len(both) <= room else numbers
            k = np.arange(len(numbers))
            row[own] = column[own] = -1
            G[begin + k, : len(k)] = body.between(numbers).transpose(0, 2, 1, 3)
            row[own][numbers], column[own][numbers] = begin + k, k
        wanted[0] = 1

    many = [body for body in bodies if body is not None]
    if not many:
        return 0
    function = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4)(grow)
    many[0].functions.append(function)
    return int(ctypes.cast(function, ctypes.c_void_p).value or 0)


def view_at(place: int, kind: Any, shape: tuple[int, ...]) -> Any:
    """Return an array of a kernel, by where its entries begin."""
    return np.ctypeslib.as_array(ctypes.cast(place, ctypes.POINTER(kind)), shape)
