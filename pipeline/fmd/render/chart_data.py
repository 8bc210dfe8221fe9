"""Curves and bands of values as charts take them."""

from __future__ import annotations

from dataclasses import dataclass

from fmd.core.arrays import Array, read_only


@dataclass(frozen=True, slots=True)
class Curve:
    """A quantity of one run over time.

    Attributes
    ----------
    label : str
        The run's name in the legend.
    values : ndarray, shape (n_times,) or (n_times, n_components)
        The quantity in the unit of the chart's ``ylabel``.
    errors : tuple of float
        Stated error of each component, not a number where there is none; empty without any.
    """

    label: str
    values: Array
    errors: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.values.ndim not in (1, 2) or self.values.size == 0:
            raise ValueError(f"curve {self.label!r} has shape {self.values.shape}, expected (any,) or (any, any)")
        read_only(self.values)

    @property
    def columns(self) -> Array:
        """The values, shape (n_times, n_components)."""
        return self.values.reshape(len(self.values), -1)


@dataclass(frozen=True, slots=True)
class Band:
    """A range of values, in the unit of the chart's ``ylabel``, shaded under the curves."""

    low: float
    high: float
    label: str


@dataclass(frozen=True, slots=True)
class HistoryFrame:
    """A quantity over time with its components.

    Attributes
    ----------
    name, unit : str
        Its name and SI unit.
    columns : ndarray, shape (n_times, n_components)
        Values.
    components : tuple of str
        Names of the components, if there are several.
    error : float, optional
        Largest error over time.
    """

    name: str
    unit: str
    columns: Array
    components: tuple[str, ...] = ()
    error: float | None = None
