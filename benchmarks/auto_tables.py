"""Tables of what ``auto`` chooses, tells and takes, and of random scenes."""

from __future__ import annotations

from statistics import median

from table_format import format_ratio, format_seconds, markdown, read_rows

LONG = 60.0  # seconds of a run


def auto_choice() -> str:
    """Run time of ``auto`` over the best method's at the same true error."""
    rows = read_rows("auto_choice")
    body = [
        [
            f"random {row['scene']}" if row["scene"].isdigit() else row["scene"],
            row["method"],
            f"{float(row['error']):.1e}",
            format_seconds(float(row["seconds"])),
            f"{row['best']}, {format_seconds(float(row['best_seconds']))}",
            format_ratio(float(row["ratio"])),
            f"{row['wanted_best']}, {format_seconds(float(row['wanted_seconds']))}",
            format_ratio(float(row["wanted_ratio"])),
        ]
        for row in rows
    ]
    middle = [f"{median(float(row[key]) for row in rows):.2g}" for key in ("ratio", "wanted_ratio")]
    body.append(["median", "", "", "", "", middle[0], "", middle[1]])
    head = ["scene", "chosen", "true error", "`auto`", "best at that error", "ratio", "best at 1e-3", "ratio"]
    return markdown(head, body)


def auto_error() -> str:
    """Tabulate the true errors of random scenes beside those that ``auto`` wants and tells, by method."""
    rows = read_rows("auto_error")
    lines = []
    for method in (*sorted({row["method"] for row in rows}), "all"):
        own = [row for row in rows if method in (row["method"], "all")]
        told, true, wanted = ([float(row[key]) for row in own] for key in ("told", "true", "wanted"))
        pairs = list(zip(told, true, strict=True))
        above = [sum(b > a for a, b in zip(wanted, true, strict=True))]
        above += [sum(b > factor * a for a, b in pairs) for factor in (1, 3)]
        middle = median(a / b for a, b in pairs if b > 0)
        lines.append([method, str(len(own)), *map(str, above), format_ratio(middle)])
    head = ("method", "scenes", "true above wanted", "true above told", "above 3 × told", "told / true, median")
    return markdown(head, lines)


def truth() -> str:
    """Tabulate what random scenes state, truly have and refuse, by their kind."""
    rows = read_rows("truth")
    lines = []
    for kind in (*sorted({row["kind"] for row in rows}), "all"):
        own = [row for row in rows if kind in (row["kind"], "all")]
        compared = [row for row in own if row["outcome"] == "compared"]
        quantities, covered, wrong = (
            sum(int(row[key]) for row in compared) for key in ("quantities", "covered", "wrong")
        )
        outcomes = [str(sum(row["outcome"] == outcome for row in own)) for outcome in ("refused", "traceback")]
        long = sum(float(row["seconds"]) > LONG for row in own)
        share = f"{100 * covered / quantities:.1f} % of {quantities}"
        lines.append([kind, str(len(own)), str(len(compared)), *outcomes, share, str(wrong), str(long)])
    head = ("kind", "scenes", "compared", "refused", "tracebacks", "true below stated", "wrong", "over 60 s")
    return markdown(head, lines)
