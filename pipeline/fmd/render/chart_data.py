"""Curves and bands of values as charts take them."""

from fmd.core.arrays import Array, read_only
from fmd.core.data_classes import dataclass


@dataclass(frozen=True, slots=True)
class Curve:
    """A quantity of one run over time."""

    label: str  # the run's name in the legend
    values: Array  # (n_times,) or (n_times, n_components): the quantity in the unit of the chart's ``ylabel``
    # Stated error of each component, not a number where there is none; empty without any.
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
    """A quantity over time with its components."""

    name: str  # the quantity's name
    unit: str  # its SI unit
    columns: Array  # (n_times, n_components): values
    components: tuple[str, ...] = ()  # names of the components, if there are several
    error: float | None = None  # largest error over time
