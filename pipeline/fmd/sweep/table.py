"""A sweep's table: one row a point as CSV, one dimension a varied key as NetCDF."""

from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.files import whole_file, write_table
from fmd.core.netcdf import NetcdfVariable, write_netcdf
from fmd.core.units import parse_quantity
from fmd.output.error_columns import NOT_COMPARED, write_errors
from fmd.scene.toml_files import parse_value
from fmd.sweep.points import Variation
from fmd.sweep.study import Sweep

Leaf = float | str | None
Place = tuple[str | int, ...]

# Of a summary: equal at all points, names of files, and figures that the first run repeats.
_LEFT_OUT = {"scene", "version", "files", "stages_run", "stages_cached", "stages_skipped", "reference_hz"}
_LEFT_OUT |= {"mode_numbers", "final", "tip", "stated_errors", "error_budget", "contact_errors", "results", "times_s"}
_ERROR = "error"  # last step of the place of a figure's error
_NAMES = {"integrations": "run"}  # as in the scene: simulation.run.0
_DIMENSIONS = {
    "run_number": "run", "frequencies_hz_number": "mode", "relative_error_number": "mode",
    "position_m_number": "axis", "deflection_m_number": "axis",
}  # fmt: skip
_UNITS = {
    "_rad_s": "rad/s", "_hz": "Hz", "_pa": "Pa", "_kg": "kg", "_rad": "rad", "_m": "m", "_s": "s", "_j": "J",
    "seconds": "s",
}  # fmt: skip


class SweepTable:
    """Figures of a sweep's points, as rows or as arrays over the varied keys."""

    def __init__(self, sweep: Sweep) -> None:
        self.sweep = sweep
        self._why: dict[Place, str] = {}  # of figures without an error
        self._units: dict[str, str] = {}  # of results, by their names
        self._figures = [dict(self._figures_of(record.summary)) for record in sweep.records]

    def _figures_of(self, summary: dict[str, Any]) -> Iterator[tuple[Place, Leaf]]:
        """Yield a summary's figures by their places, each with its error behind it if one is stated."""
        stated = summary.get("stated_errors", {})
        for place, value in _leaves(summary):
            if place[0] in _LEFT_OUT or "rounds" in place:
                continue
            yield place, value
            if isinstance(value, str | bool | None):
                continue
            name = _dotted(place).replace("run.0.final.", "final.")  # the end of the first run has its errors once
            error = stated.get(name, stated.get(name.rpartition(".")[0], NOT_COMPARED))
            if isinstance(error, str):
                self._why.setdefault(place, error)
            else:
                yield (*place, _ERROR), error
        for name, own in results_of(summary):
            self._units[name] = own["unit"]
            for figure in ("value", "smallest", "largest", "rms"):
                if figure in own:
                    place = (name,) if figure == "value" else (name, figure)
                    yield place, own[figure]
                    if isinstance(own["error"], str):
                        self._why.setdefault(place, own["error"])
                    else:
                        yield (*place, _ERROR), own["error"]

    @property
    def results(self) -> dict[str, tuple[str, list[str]]]:
        """Unit and columns of each result that was asked for, by its name."""
        there = {_dotted(place) for place in self.places}
        columns = {name: [name, f"{name}.smallest", f"{name}.largest"] for name in self._units}
        return {name: (self._units[name], [each for each in columns[name] if each in there]) for name in columns}

    @cached_property
    def places(self) -> list[Place]:
        """Places of all figures in the summaries, e.g. ``("run", 0, "seconds")``."""
        return list(dict.fromkeys(place for figures in self._figures for place in figures))

    @cached_property
    def _axes(self) -> list[tuple[str, dict[str, Leaf], str]]:
        """Each varied key, its values by their texts, and their unit."""
        axes = ((each, *axis_values(each)) for each in self.sweep.variations)
        return [(each.key, dict(zip(each.values, values, strict=True)), unit) for each, values, unit in axes]

    @cached_property
    def rows(self) -> list[dict[str, Leaf]]:
        """One row a point: varied values, as SI numbers where they are quantities, status, message, figures."""
        names = [f"{key} [{unit}]" if unit else key for key, _, unit in self._axes]
        columns = {place: _dotted(place) for place in self.places}
        return [
            {name: own[value] for name, (_, own, _), value in zip(names, self._axes, point.values, strict=True)}
            | {"status": record.status, "message": record.message}
            | {column: figures.get(place) for place, column in columns.items()}
            for point, record, figures in zip(self.sweep.points, self.sweep.records, self._figures, strict=True)
        ]

    def write_csv(self, path: Path) -> None:
        """Write the rows as CSV, with an empty cell where a point lacks a figure."""
        write_table(path, [*self.rows[0]], (row.values() for row in self.rows))

    @property
    def variables(self) -> list[NetcdfVariable]:
        """Figures over a dimension for each varied key and each list (``run``, ``mode`` ...); NaN or "" if missing.

        Those of a design are over one dimension ``point`` in place of the keys, whose values are coordinates along it.
        """
        pairs = zip(self.sweep.variations, self._axes, strict=True)
        values = {each.key: (tuple(own[text] for text in each.values), unit) for each, (_, own, unit) in pairs}
        is_grid = self.sweep.is_grid
        axes = tuple(values) if is_grid else ("point",)
        shape = tuple(len(numbers) for numbers, _ in values.values())[: len(axes)]
        along: dict[str, str | float] = {} if is_grid else {"coordinates": " ".join(values)}
        inner, data = self._inner_sizes(), list[NetcdfVariable]()
        for key, (numbers, unit) in values.items():
            axis = np.array(numbers, dtype=None if isinstance(numbers[0], str) else float)
            data.append(NetcdfVariable(key, (key,) if is_grid else axes, axis, {"units": unit} if unit else {}))
        for name in ("status", "message"):
            texts = np.array([getattr(record, name) for record in self.sweep.records], dtype=str)
            data.append(NetcdfVariable(name, axes, texts.reshape(shape), along))
        for name, places in self._variables().items():
            dimensions = _inner_dimensions(places[0])
            is_text = any(isinstance(figures.get(place), str) for figures in self._figures for place in places)
            full = (len(self._figures), *(inner[dimension] for dimension in dimensions))
            array = np.full(full, "", dtype=object) if is_text else np.full(full, np.nan)
            for number, figures in enumerate(self._figures):
                for place in places:
                    if (value := figures.get(place)) is not None:
                        array[(number, *(step for step in place if isinstance(step, int)))] = value
            array = (array.astype(str) if is_text else array).reshape(*shape, *full[1:])
            data.append(NetcdfVariable(name, (*axes, *dimensions), array, self._attributes(name, places) | along))
        histories = self._histories().items()
        return data + [
            NetcdfVariable(name, (*axes, "sample"), rows.reshape(*shape, rows.shape[1]), along | {"units": unit})
            for name, (rows, unit) in histories
        ]

    def _histories(self) -> dict[str, tuple[Array, str]]:
        """Return the histories that were kept, rows of output times a point, and these; NaN where one ended. Units."""
        found = [
            {"time_s": record.summary["times_s"]}
            | {name: own["history"] for name, own in results_of(record.summary) if "history" in own}
            if "times_s" in record.summary
            else {}
            for record in self.sweep.records
        ]
        n_times = max((len(own.get("time_s", ())) for own in found), default=0)
        data: dict[str, tuple[Array, str]] = {}
        for name in dict.fromkeys(name for own in found for name in own):
            array = np.full((len(found), n_times), np.nan)
            for row, own in zip(array, found, strict=True):
                row[: len(own.get(name, ()))] = own.get(name, ())
            unit = self._units.get(name, "s")
            label = name if name == "time_s" else f"{name}.history"
            data[label] = array, unit
        return data

    @property
    def errors(self) -> list[tuple[str, str, str]]:
        """Name and unit of each figure, and which column has its error, or why none is stated."""
        found = []
        for place in (place for place in self.places if place[-1] != _ERROR):
            name = _dotted(place)
            if place in self._why or (*place, _ERROR) in self.places:
                found.append((name, self._unit(place), self._error_of([place], name)))
        return found

    def _error_of(self, places: Sequence[Place], name: str) -> str:
        """Return where the errors of some figures are, or why none is stated."""
        if any((*place, _ERROR) in self.places for place in places):
            return f"{name}.{_ERROR} has it"
        return next((self._why[place] for place in places if place in self._why), "")

    def _unit(self, place: Place) -> str:
        if place[0] in self._units:
            return self._units[str(place[0])]
        name = _dotted(place).removesuffix(f".{_ERROR}")
        return next((unit for suffix, unit in _UNITS.items() if name.endswith(suffix)), "")

    def _attributes(self, name: str, places: Sequence[Place]) -> dict[str, str | float]:
        found = {"units": self._unit(places[0]), "error": self._error_of(places, name)}
        return {key: text for key, text in found.items() if text}

    def write_netcdf(self, path: Path) -> None:
        """Write the figures as NetCDF."""
        with whole_file(path) as part:
            write_netcdf(part, self.variables)

    def _variables(self) -> dict[str, list[Place]]:
        """Group the places that differ only by their numbers in lists: each group is one variable."""
        groups: dict[str, list[Place]] = {}
        for place in self.places:
            groups.setdefault(_dotted(tuple(step for step in place if isinstance(step, str))), []).append(place)
        return groups

    def _inner_sizes(self) -> dict[str, int]:
        sizes: dict[str, int] = {}
        for place in self.places:
            numbers = [step for step in place if isinstance(step, int)]
            for dimension, number in zip(_inner_dimensions(place), numbers, strict=True):
                sizes[dimension] = max(sizes.get(dimension, 0), number + 1)
        return sizes


def write_tables(table: SweepTable, folder: Path) -> list[str]:
    """Write ``sweep.csv``, ``sweep.nc`` and ``sweep-errors.csv`` into ``folder``; return their names."""
    table.write_csv(folder / "sweep.csv")
    table.write_netcdf(folder / "sweep.nc")
    return ["sweep.csv", "sweep.nc", write_errors(table.errors, folder / "sweep.csv")]


def results_of(summary: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the results that were asked for, by their names, of a summary."""
    for own in summary.get("results", {}).values():
        yield from own.items()


def axis_values(variation: Variation) -> tuple[tuple[Leaf, ...], str]:
    """Return a key's values as SI numbers and their unit if all are numbers or quantities of a kind, else as text."""
    try:
        numbers = [_number(value) for value in variation.values]
    except ValueError:
        return variation.values, ""
    units = {unit for _, unit in numbers}
    return (tuple(value for value, _ in numbers), units.pop()) if len(units) == 1 else (variation.values, "")


def _number(text: str) -> tuple[float, str]:
    value = parse_value(text)
    if isinstance(value, int | float) and not isinstance(value, bool):
        return value, ""
    return parse_quantity(str(value))


def _leaves(value: Any, place: Place = ()) -> Iterator[tuple[Place, Leaf]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _leaves(inner, (*place, _NAMES.get(key, str(key))))
    elif isinstance(value, list):
        for number, inner in enumerate(value):
            yield from _leaves(inner, (*place, number))
    else:
        yield place, value


def _dotted(place: Place) -> str:
    return ".".join(map(str, place))


def _inner_dimensions(place: Place) -> tuple[str, ...]:
    """Name a dimension for each number in a place, after the list that it counts."""
    names = [str(place[0])]
    for step in place[1:]:
        names.append(f"{names[-1]}_number" if isinstance(step, int) else step)
    lists = [name for name, step in zip(names, place, strict=True) if isinstance(step, int)]
    return tuple(_DIMENSIONS.get(name, name) for name in lists)
