"""Words for errors that aren't stated, and the table of a file's columns with the error of each.

What writes them in a sweep's own process loads nothing of what computes errors.
"""

from collections.abc import Sequence
from pathlib import Path

from fmd.core.files import write_table
from fmd.core.limits.shown import DIGITS

NO_BUDGET = "no error budget was made; fmd run makes one without --no-budget, fmd sweep with --budget"
NOT_STATED = "not stated: "
NOT_COMPARED = NOT_STATED + "the error budget doesn't compare it"


def write_errors(errors: Sequence[tuple[str, str, float | str]], file: Path) -> str:
    """Write names, units and errors of a file's columns as a table beside it, and return the table's name."""
    beside = file.with_name(f"{file.name.removesuffix('.csv')}-errors.csv")
    rows = ([name, unit, *_cells(error)] for name, unit, error in errors)
    write_table(beside, ["column", "unit", "error", "why not"], rows)
    return beside.name


def _cells(error: float | str) -> list[str]:
    """Return an error and an empty text, or an empty text and why it is not stated."""
    return ["", error] if isinstance(error, str) else [f"{error:.{DIGITS}g}", ""]
