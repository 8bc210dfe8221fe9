"""Numbers and tables as HTML for notebooks and reports."""

from collections.abc import Iterable, Sequence
from html import escape

_PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))


def scaled(value: float | None, unit: str = "", digits: int = 4) -> str:
    """Write a number with the prefix that fits its size, e.g. ``1.728 MPa`` for ``scaled(1.728e6, "Pa")``."""
    if value is None:
        return "–"
    factor, prefix = prefix_for(value, unit)
    return f"{value / factor:.{digits}g} {prefix}{'' if unit == '1' else unit}".rstrip()


def prefix_for(value: float, unit: str) -> tuple[float, str]:
    """Return the factor and the prefix of a unit that fit a value's size, e.g. 1e6 and ``M``."""
    if not value or unit in ("", "1", "rad", "rad/s", "Hz", "kg"):  # units without prefixes
        return 1.0, ""
    fitting = [(f, p) for f, p in _PREFIXES if abs(value) >= 0.9995 * f and not (unit == "s" and f > 1)]
    return fitting[0] if fitting else (1.0, "")  # below a nano, powers of ten are easier to read


def table(header: Sequence[str], rows: Iterable[Sequence[object]], caption: str = "") -> str:
    """Write a table with words in the first column and numbers in the others; all text is escaped."""
    head = "".join(f"<th>{escape(name)}</th>" for name in header)
    body = "".join("<tr>" + "".join(_cell(value, k) for k, value in enumerate(row)) + "</tr>" for row in rows)
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    return f"<table>{title}" + (f"<thead><tr>{head}</tr></thead>" if header else "") + f"<tbody>{body}</tbody></table>"


def _cell(value: object, column: int) -> str:
    if column == 0:
        return f'<th scope="row" style="text-align:left">{escape(str(value))}</th>'
    return f'<td style="text-align:right">{escape(str(value))}</td>'


def facts(rows: Iterable[tuple[str, str]], caption: str = "") -> str:
    """Write a table of two columns, names and their texts; all text is escaped."""
    lines = "".join(
        f'<tr><th scope="row" style="text-align:left">{escape(name)}</th>'
        f'<td style="text-align:left">{escape(text)}</td></tr>'
        for name, text in rows
    )
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    return f"<table>{title}<tbody>{lines}</tbody></table>"
