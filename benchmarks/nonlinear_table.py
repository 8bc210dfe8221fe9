"""Tables of modes with derivatives beside pieces and linear modes: a row a model, a column a load."""

from __future__ import annotations

from table_format import Row, format_seconds, markdown, read_rows


def nonlinear_modes(case: str) -> str:
    """Tabulate errors and times of a case of ``nonlinear_modes.csv``, the deflection over the length in the head."""
    models: dict[tuple[str, str], dict[str, Row]] = {}
    loads: dict[str, str] = {}
    for row in read_rows("nonlinear_modes"):
        if row["case"] == case:
            models.setdefault((row["model"], row["coordinates"]), {})[row["load"]] = row
            loads.setdefault(row["load"], f"{row['load']}: {100 * float(row['deflection']):.2g} %")
    rows = (
        [
            *model,
            *(f"{float(row['error_percent']):.2g} %, {format_seconds(float(row['seconds']))}" for row in at.values()),
        ]
        for model, at in models.items()
    )
    return markdown(("model", "coordinates", *loads.values()), rows)
