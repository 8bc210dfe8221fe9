"""Rows of numbers that a march notes of a mechanism's contacts at its output times, and what stands where in them."""

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from fmd.contact.histories import N_VALUES, ContactHistory, read_history
from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass


class RecordedBody(Protocol):
    """A body that touches, as a record needs it: its name, those of its contacts, numbers of points and modes."""

    @property
    def body(self) -> str:
        """The link's name."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its contacts."""

    @property
    def wears(self) -> bool:
        """True if a contact in its list wears faces."""

    @property
    def travels(self) -> bool:
        """True if a grid follows a contact along its face."""

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of points and of modes."""


@dataclass(frozen=True)
class ContactRecord:
    """Values of contacts at output times, and the forces on points, frames and modes of the bodies that touch."""

    bodies: Sequence[RecordedBody]
    rows: Array  # (n_times, n_values): what `fmd.contact.sums.note_values` has filled, a row for each output time

    @classmethod
    def width(cls, bodies: Sequence[RecordedBody]) -> int:
        """Return how many values a row has."""
        return int(cls._counts(bodies).sum())

    @staticmethod
    def _counts(bodies: Sequence[RecordedBody]) -> IntArray:
        """Return how many values of each kind each body has, shape (n_bodies, 8).

        These are contacts', pressures, forces, pushes, modal forces, slips, volumes lost by wear, and, if grids travel,
        places.
        """
        sizes = [(N_VALUES * len(body.names), *body.sizes) for body in bodies]
        wears, travels = any(body.wears for body in bodies), any(body.travels for body in bodies)
        return np.array(
            [(values, n, 3 * n, 6, modes, n, n * wears, 3 * n * travels) for values, n, modes in sizes], dtype=np.int64
        )

    def _part(self, kind: int) -> list[Array]:
        """Return the values of one kind, by body, shapes (n_times, any)."""
        counts = self._counts(self.bodies)
        first = int(counts[:, :kind].sum())
        ends = first + np.cumsum(counts[:, kind])
        return np.split(self.rows[:, first : ends[-1]], ends[:-1] - first, axis=1)

    @classmethod
    def signs(cls, bodies: Sequence[RecordedBody], modes: Sequence[Array]) -> Array:
        """Return the signs of a row's values, (n_values,), by those of bodies' modal coordinates, (n_modes,) each."""
        counts = cls._counts(bodies)
        ones = [np.ones(int(count)) for count in counts.T.ravel()]
        ones[4 * len(bodies) : 5 * len(bodies)] = modes
        return np.concatenate(ones)

    @property
    def histories(self) -> Mapping[str, ContactHistory]:
        """Contacts by name."""
        found: dict[str, ContactHistory] = {}
        for body, values in zip(self.bodies, self._part(0), strict=True):
            own = values.reshape(len(self.rows), len(body.names), N_VALUES)
            found |= {name: read_history(own[:, k]) for k, name in enumerate(body.names)}
        return found

    @property
    def pressures(self) -> Mapping[str, Array]:
        """Pressures at the points of bodies [Pa], shapes (n_times, n_points), by their names."""
        return self._by_body(1)

    @property
    def forces(self) -> Mapping[str, Array]:
        """Forces on the points of bodies, in their axes [N], shapes (n_times, n_points, 3), by their names."""
        return {name: own.reshape(len(self.rows), own.shape[1] // 3, 3) for name, own in self._by_body(2).items()}

    @property
    def pushes(self) -> Mapping[str, Array]:
        """Force and moment on bodies' frames, in their axes [N, N m], shapes (n_times, 6), by their names."""
        return self._by_body(3)

    @property
    def modal(self) -> Mapping[str, Array]:
        """Forces on bodies' modes, shapes (n_times, n_modes), by their names."""
        return self._by_body(4)

    @property
    def slips(self) -> Mapping[str, Array]:
        """Ways that the points of bodies have slipped [m], shapes (n_times, n_points), by their names."""
        return self._by_body(5)

    @property
    def worn(self) -> Mapping[str, Array]:
        """Volumes that points of bodies have lost by wear [m³], shapes (n_times, n_points), by their names.

        The second shapes are 0 where no contact wears.
        """
        return self._by_body(6)

    @property
    def places(self) -> Mapping[str, Array]:
        """Undeformed places of points in their bodies' frames [m], shapes (n_times, n_points, 3), by bodies' names.

        The second shapes are 0 where no grid travels.
        """
        return {name: own.reshape(len(self.rows), own.shape[1] // 3, 3) for name, own in self._by_body(7).items()}

    def _by_body(self, kind: int) -> dict[str, Array]:
        return {body.body: own for body, own in zip(self.bodies, self._part(kind), strict=True)}
