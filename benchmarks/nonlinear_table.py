"""Tables of modes with derivatives beside pieces and linear modes: a row a model, a column a load."""

from __future__ import annotations

from table_format import Row, format_ratio, format_seconds, markdown, read_rows


def nonlinear_modes(case: str) -> str:
    """Tabulate errors and times of a case of ``nonlinear_modes.csv``, the deflection over the length in the head."""
    models: dict[tuple[str, str], dict[str, Row]] = {}
    loads: dict[str, str] = {}
    for row in read_rows("nonlinear_modes"):
        if row["case"] == case:
            models.setdefault((row["model"], row["coordinates"]), {})[row["load"]] = row
            loads.setdefault(row["load"], f"{row['load']}: {100 * float(row['deflection']):.2g} %")
    rows = ([*model, *map(_cell, at.values())] for model, at in models.items())
    return markdown(("model", "coordinates", *loads.values()), rows)


def _cell(row: Row) -> str:
    return f"{format_ratio(float(row['error_percent']))} %, {format_seconds(float(row['seconds']))}"
