"""Values of a contact that kernels fill, and what they mean over time."""

from typing import Any, NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.contact import LOST_ENERGY, MADE_ENERGY

FORCE, IMPULSE, MOMENT, AREA, PRESSURE = 0, 3, 6, 9, 10
"""Places of a contact's values: vectors in space, then numbers."""
ENERGY, FRICTION, DAMPED, ERROR, BEGIN, END, BORDER = 11, 12, 13, 14, 15, 16, 17
"""Places of those of energies and times, and of a mark that the border of a grid has been pressed."""
MOST_FORCE, MOST_AREA, MOST_PRESSURE = 18, 19, 20
"""Places of the largest values at any step since the output time before."""
SLIP, MEAN_SLIP = 21, 22
"""Places of the longest way that a point has slipped, and of the mean by areas of those that have."""
WORN, MOST_WORN = 23, 24
"""Places of the volume that each of both faces has lost by wear and of its largest depth; NaN without wear or areas."""
FORCE_AT, PRESSURE_AT = 25, 26
"""Places of the times of the largest force and pressure since the output time before."""
N_VALUES = 27


class ContactHistory(NamedTuple):
    """A contact at the output times; all vectors are in space, on the body."""

    force: Array  # (n_times, 3) [N]
    impulse: Array  # (n_times, 3): since the start [N s]
    moment: Array  # (n_times, 3): about the plane's position [N m]
    area: Array  # (n_times,): of the points that are pressed [m²]
    peak_pressure: Array  # (n_times,) [Pa]
    energy: Array  # (n_times,): of the deflection that the modes leave out [J]
    friction_work: Array  # (n_times,): heat since the start [J]
    damping_work: Array  # (n_times,): heat by damping since the start [J]
    slip: Array  # (n_times,): longest way that a pressed point has slipped since the start [m]
    mean_slip: Array  # (n_times,): mean of those that have, by their areas [m]
    energy_error: Array  # (n_times,): energy that contact's steps have made since the start [J]
    span: tuple[float | None, float | None]  # first and last time of contact [s]; None without
    beyond_grid: bool  # it has reached the border of its near field's grid
    wear_volume: Array  # (n_times,): lost by each of both faces since the start [m³]; NaN without wear
    wear_depth: Array  # (n_times,): largest depth of that at points that have areas [m]; NaN without these
    tops: Array  # (n_times, 3): largest force [N], area [m²], pressure [Pa] then and at all steps since the time before
    tops_at: Array  # (n_times, 2): times of that force and that pressure, if they aren't 0 [s]

    def lost_part(self, kinetic: Array) -> float:
        """Return the largest energy that steps made or lost, over the largest that they had to do with.

        That is the bodies' kinetic energy (n_times,), what the contact stores, or what it turns into heat: of bodies
        that are set down or at rest kinetic energy alone is next to nothing.
        """
        return self._part(np.abs(self.energy_error), kinetic)

    def keeps_energy(self, kinetic: Array) -> bool:
        """Return true if steps neither lost nor made much of that energy; bodies have kinetic energy (n_times,)."""
        return self.lost_part(kinetic) <= LOST_ENERGY and self._part(self.energy_error, kinetic) <= MADE_ENERGY

    def _part(self, energy: Array, kinetic: Array) -> float:
        energies = kinetic, self.energy, self.friction_work, self.damping_work
        scale = max(float(np.abs(own).max()) for own in energies)
        return float(energy.max()) / scale if scale else 0.0

    @property
    def largest(self) -> tuple[float, float, float]:
        """Largest force [N], area [m²] and pressure [Pa] at any step or output time."""
        force, area, pressure = np.nanmax(self.tops, axis=0)
        return float(force), float(area), float(pressure)

    @property
    def wears(self) -> bool:
        """True if its faces wear."""
        return not np.isnan(self.wear_volume[-1])

    @property
    def figures(self) -> dict[str, Any]:
        """Figures for a summary: first and last time of contact, sums, and largest values at any step."""
        begin, end = self.span
        force, area, pressure = self.largest
        worn = {"wear_volume_m3": self.wear_volume[-1], "largest_wear_depth_m": self.wear_depth[-1]}
        return {
            "begin_s": begin,
            "end_s": end,
            "impulse_n_s": self.impulse[-1].tolist(),
            "largest_force_n": force,
            "largest_pressure_pa": pressure,
            "largest_area_m2": area,
            "largest_slip_m": float(self.slip[-1]),
            "mean_slip_m": float(self.mean_slip[-1]),
            "friction_work_j": float(self.friction_work[-1]),
            "damping_work_j": float(self.damping_work[-1]),
            "energy_error_j": float(self.energy_error[-1]),
            **{key: float(own) for key, own in worn.items() if not np.isnan(own)},
        }


def read_history(v: Array) -> ContactHistory:
    """Return a contact's history of its values, shape (n_times, N_VALUES)."""
    begin, end = (float(v[-1, place]) if np.isfinite(v[-1, place]) else None for place in (BEGIN, END))
    return ContactHistory(
        force=v[:, FORCE : FORCE + 3],
        impulse=v[:, IMPULSE : IMPULSE + 3],
        moment=v[:, MOMENT : MOMENT + 3],
        area=v[:, AREA],
        peak_pressure=v[:, PRESSURE],
        energy=v[:, ENERGY],
        friction_work=v[:, FRICTION],
        damping_work=v[:, DAMPED],
        slip=v[:, SLIP],
        mean_slip=v[:, MEAN_SLIP],
        energy_error=v[:, ERROR],
        span=(begin, end),
        beyond_grid=bool(v[-1, BORDER] > 0.0),
        wear_volume=v[:, WORN],
        wear_depth=v[:, MOST_WORN],
        tops=v[:, MOST_FORCE : MOST_PRESSURE + 1],
        tops_at=v[:, FORCE_AT : PRESSURE_AT + 1],
    )
