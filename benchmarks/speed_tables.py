"""Tables of a step's time beside an earlier version's, and of the time that compiling takes."""

from __future__ import annotations

from table_format import Row, format_ratio, format_seconds, markdown, read_rows


def march_speed() -> str:
    """Tabulate the time of a step, or of an adaptive method's evaluation, and the earlier version's over it."""
    cells: dict[str, dict[str, Row]] = {}
    for row in read_rows("march_speed"):
        cells.setdefault(row["method"], {})[row["scene"]] = row
    scenes = list(dict.fromkeys(row["scene"] for row in read_rows("march_speed")))

    def cell(row: Row | None) -> str:
        if row is None:
            return "–"
        return f"{format_seconds(1e-9 * float(row['now_ns']))}, {format_ratio(float(row['ratio']))} ×"

    return markdown(("method", *scenes), ([name, *(cell(rows.get(s)) for s in scenes)] for name, rows in cells.items()))


def march_flops() -> str:
    """Tabulate the operations of a step of central differences and their rate beside a dense product's."""
    cells = []
    for row in read_rows("march_speed"):
        if row["flops"]:
            rate = float(row["gflop_s"])
            product = f"{rate / float(row['of_dgemm']):.0f}"
            cells.append([row["scene"], row["coordinates"], f"{int(row['flops']):,}", f"{rate:.2g}", product])
    return markdown(("mechanism", "coordinates", "operations a step", "Gflop/s", "a dense product's, same run"), cells)


def compiling() -> str:
    """Tabulate the time for tracing and compiling all that a scene's first run marches with."""
    rows = (
        [row["scene"], row["coordinates"], row["functions"], f"{row['seconds']} s"] for row in read_rows("compiling")
    )
    return markdown(("scene", "coordinates", "functions", "processor time"), rows)


def variants() -> str:
    """Tabulate scenes marched in a second, one by one by the earlier version and in lanes."""
    rows = (
        [row["scene"], row["steps"], row["before_per_s"], row["now_per_s"], f"{row['ratio']} ×"]
        for row in read_rows("variants")
    )
    return markdown(("scene", "steps of each", "earlier version", "in lanes", "ratio"), rows)
