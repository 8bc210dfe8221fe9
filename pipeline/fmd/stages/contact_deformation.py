"""Deflections and stress by which contacts deform a body beside its modes."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.recovery.stress import StressHistory, element_stress, modal_stress
from fmd.recovery.stress_below import largest_stress_below

if TYPE_CHECKING:
    from fmd.contact.flexibility import ResidualFields
    from fmd.contact.touching_body import ContactPoints
    from fmd.recovery.motion import Motion
    from fmd.stages.part import FlexiblePart


@dataclass(frozen=True)
class ContactDeformation:
    """Fields of displacement by forces of contact in a motion, without the part that modes have."""

    part: FlexiblePart
    points: ContactPoints
    places: Array  # (n_times, n_points, 3): of grids that travel [m]; (n_times, 0, 3) without any
    fields: ResidualFields  # the fields, and how much of each there is at the output times

    @cached_property
    def _surface_stress(self) -> Array:
        return modal_stress(self.part.space, self.part.material, self.fields.shapes, self.part.surface.nodes)

    def add_stress(self, history: StressHistory) -> StressHistory:
        """Return the stress on the body's surface by modes and by these fields.

        Under a grid there is more than elements show: those nodes are no place of the largest.
        """
        modal = np.concatenate([history.modal, self._surface_stress], axis=2)
        q, limitless = np.concatenate([history.q, self.fields.sizes], axis=1), history.limitless
        under = np.isin(history.nodes, self.points.under_grids(self.places))
        under &= not under.all()
        return replace(history, modal=modal, q=q, limitless=under if limitless is None else limitless | under)

    def displacements(self, nodes: IntArray, frames: IntArray) -> Array:
        """Return the displacements of nodes at output times, shape (n_nodes, 3, n_frames) [m]."""
        return np.asarray(self.fields.shapes[nodes] @ self.fields.sizes[frames].T)

    def stress_below(self, face: str, motion: Motion) -> tuple[float, float]:
        """Return the largest von Mises stress below a face's grid [Pa], and its depth [m].

        That is of a half-space, at the instant of the motion at which the pressure is largest.
        """
        touched, points, grid = motion.touched, self.points, self.points.grids[face]
        assert touched is not None
        assert points.elastic is not None  # or the face has no grid
        own, (_, nu) = points.faces[face], points.elastic
        frame = int(touched.pressures[self.part.name][:, own].max(axis=1).argmax())
        x = points.x[own] if not self.places.shape[1] else self.places[frame]
        axes = grid.axes_about(x)
        forces = touched.forces[self.part.name][frame, own] @ axes.T
        return largest_stress_below(x @ axes[1:].T, grid.cell, forces, nu)

    def nodal_stress(self, frame: int) -> Array:
        """Return the stress at all nodes at an output time, shape (n_nodes, 6) [Pa]."""
        field = (self.fields.shapes @ self.fields.sizes[frame])[..., None]
        return modal_stress(self.part.space, self.part.material, field, np.arange(len(self.part.space.x)))[..., 0]

    def element_stress(self, number: int) -> Array:
        """Return the stress in the middle of a named element by its place among these, (6, n_times) [Pa]."""
        part, chosen = self.part, np.array([list(self.part.elements.values())[number]])
        sides = part.element_sides[number : number + 1]
        found = element_stress(part.space, part.material, self.fields.shapes, chosen, sides)
        return np.asarray(found[0] @ self.fields.sizes.T)
