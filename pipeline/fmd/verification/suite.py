"""The verification suite: its cases are run one by one, and their figures written as a table."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from math import isfinite
from pathlib import Path
from typing import Any

from fmd.core.cache import Cache
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError, InputError
from fmd.core.files import refusing, write_json, write_table
from fmd.scene.reading import suggest_name
from fmd.verification import bodies, contact, frequencies, functional_mockup, loops, rotation, tops, wind_turbine
from fmd.verification.case import CaseSkipped, Figure, VerificationCase

_PARTS = (frequencies, rotation, tops, loops, bodies, contact, wind_turbine, functional_mockup)
CASES = {case.name: case for part in _PARTS for case in part.CASES}
# A subject is its module's name; ``fmd verify contact`` runs the cases of contact.
SUBJECTS = {part.__name__.rpartition(".")[2].replace("_", "-"): part.CASES for part in _PARTS}


@dataclass(frozen=True)
class Outcome:
    """The result of a case: its figures, or the failed check that ended it."""

    case: VerificationCase
    figures: tuple[Figure, ...]  # its figures; none if it ended in an error
    seconds: float  # run time [s]
    error: str = ""  # the failed check that ended it; empty if it was carried through
    skipped: str = ""  # what it needs and isn't there; empty if it was run

    @property
    def holds(self) -> bool:
        """True if all figures are within their tolerances."""
        return not self.error and all(figure.holds for figure in self.figures)


def choose_cases(names: Sequence[str]) -> list[VerificationCase]:
    """Return the cases with these names, and all of a subject for its name; all cases, if there are no names.

    Raises
    ------
    InputError
        There is neither a case nor a subject with one of the names.
    """
    known = {**{name: (case,) for name, case in CASES.items()}, **SUBJECTS}
    for name in names:
        if name not in known:
            raise InputError("verify", "", name, f"no such case; {suggest_name(name, known, 'cases and subjects')}")
    chosen = {case.name: case for name in names for case in known[name]}
    return list((chosen or CASES).values())


def run_cases(cases: Sequence[VerificationCase], cache: Cache | None = None) -> Iterator[Outcome]:
    """Run cases one after another; a failed check in one doesn't keep the others from running."""
    for case in cases:
        tick = time.perf_counter()
        try:
            outcome = Outcome(case, tuple(case.measure(cache)), 0.0)
        except AccuracyError as failed:
            outcome = Outcome(case, (), 0.0, error=str(failed))
        except CaseSkipped as missing:
            outcome = Outcome(case, (), 0.0, skipped=str(missing))
        yield replace(outcome, seconds=time.perf_counter() - tick)


def tabulate(outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """Make one row for each figure, in plain numbers; a case that ended in an error has one row with the error."""
    rows: list[dict[str, Any]] = []
    for outcome in outcomes:
        head = {"case": outcome.case.name}
        tail = {"source": outcome.case.source, "error": outcome.error}
        for figure in outcome.figures:
            difference = figure.difference if isfinite(figure.difference) else None
            numbers = asdict(figure) | {"ours": figure.ours if isfinite(figure.ours) else None}
            rows.append(head | numbers | {"difference": difference, "holds": figure.holds} | tail)
        if outcome.error:
            nothing = dict.fromkeys(("quantity", "ours", "published", "tolerance", "difference"))
            rows.append(head | nothing | {"holds": False} | tail)
        if outcome.skipped:
            nothing = dict.fromkeys(("quantity", "ours", "published", "tolerance", "difference", "holds"))
            rows.append(head | nothing | tail | {"error": f"skipped: {outcome.skipped}"})
    return rows


def write_rows(rows: list[dict[str, Any]], folder: Path) -> list[str]:
    """Write the table as ``verification.csv`` and ``verification.json``; return the files' names.

    Raises
    ------
    InputError
        The folder can't be written.
    """
    with refusing("--out", folder):
        write_table(folder / "verification.csv", [*rows[0]], (row.values() for row in rows))
        write_json(folder / "verification.json", rows)
    return ["verification.csv", "verification.json"]


def verify_cases(names: Sequence[str], folder: Path, cache: Cache | None) -> tuple[list[Outcome], dict[str, Any]]:
    """Run the cases with these names and write their table; return the outcomes and their summary."""
    outcomes = list(run_cases(choose_cases(names), cache))
    rows = tabulate(outcomes)
    files = write_rows(rows, folder)
    return outcomes, {"rows": rows, "seconds": {one.case.name: one.seconds for one in outcomes}, "files": files}


def require_tolerances(outcomes: Sequence[Outcome]) -> None:
    """Raise ``AccuracyError`` if a figure is out of its tolerance or a case has failed; the message names the first."""
    wrong = [outcome for outcome in outcomes if not outcome.holds]
    if not wrong:
        return
    case = wrong[0].case.name
    more = f" (and {len(wrong) - 1} more cases)" if len(wrong) > 1 else ""
    if wrong[0].error:
        raise AccuracyError(f"case {case} failed: {wrong[0].error}{more}")
    figure = next(figure for figure in wrong[0].figures if not figure.holds)
    raise AccuracyError(
        f"case {case} is out of its tolerance: {figure.quantity} is {figure.ours:.6g}, published "
        f"{figure.published:.6g}; {100 * figure.difference:+.3g} % exceeds {100 * figure.tolerance:.3g} %{more}"
    )
