"""Tables of parts in pieces, beside bodies in one piece, other programs and modes with derivatives."""

from __future__ import annotations

from table_format import Row, format_ratio, format_seconds, markdown, read_rows

_SMALLEST = 1e-5  # percent that are written


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


def large_deflection() -> str:
    """Tabulate statics of parts in pieces: errors and times."""
    rows = [
        [
            row["case"],
            row["pieces"],
            "no" if row["stiffening"] == "off" else "yes",
            row["coordinates"],
            f"{row['error_percent']} %",
            format_seconds(float(row["seconds"])),
            row["note"],
        ]
        for row in read_rows("large_deflection")
    ]
    return markdown(("case", "pieces", "second order", "coordinates", "error", "warm statics", "beside"), rows)


def pendulum() -> str:
    """Tabulate a slender pendulum in pieces beside Exudyn's beams: errors and times."""
    rows = [
        [
            row["what"],
            row["number"],
            f"{row['step_ms']} ms",
            format_seconds(float(row["seconds"])),
            f"{row['apart_mm']} mm",
        ]
        for row in read_rows("pendulum")
    ]
    return markdown(("model", "pieces or elements", "step", "time", "largest distance of the end"), rows)


def spin_up_pieces() -> str:
    """Tabulate Kane's spin-up in pieces against the stiffened beam in one."""
    rows = [
        [
            row["pieces"],
            "no" if row["stiffening"] == "off" else "yes",
            row["coordinates"],
            f"{row['lag_m']} m",
            f"{row['apart_percent']} %",
            format_seconds(float(row["seconds"])),
        ]
        for row in read_rows("spin_up_pieces")
    ]
    heads = ("pieces", "second order", "coordinates", "largest lag", "largest difference from one piece", "time")
    return markdown(heads, rows)


def piece_sections() -> str:
    """Tabulate errors of a bar in pieces by how sections are weighted."""
    loads = ("bending", "shear force", "torsion", "tension", "frequencies")
    rows = [
        [row["bar"], row["pieces"], row["sections"], *(_percent(float(row[load])) for load in loads)]
        for row in read_rows("piece_sections")
    ]
    return markdown(("bar", "pieces", "sections", *loads), rows)


def _percent(error: float) -> str:
    return f"{error:.2g} %" if abs(error) >= _SMALLEST else "< 10⁻⁵ %"
