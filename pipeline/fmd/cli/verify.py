"""``fmd verify``: the verification suite."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from fmd.cli.options import Json, NoCache, print_json
from fmd.cli.tables import open_console, print_table
from fmd.core.cache import Cache

if TYPE_CHECKING:
    from fmd.verification.suite import Outcome


def verify(
    cases: list[str] | None = None,
    /,
    *,
    out: Path = Path("out/verification"),
    no_cache: NoCache = False,
    json: Json = False,
) -> None:
    """Published and closed-form results beside ours; ends with status 3 if one is out of its tolerance.

    Parameters
    ----------
    cases
        Names of cases or of subjects, e.g. fv52 or contact; all by default.
    out
        Folder for the table as CSV and JSON.
    """
    from fmd.verification.suite import require_tolerances, verify_cases

    outcomes, summary = verify_cases(cases or (), out, Cache(None) if no_cache else None)
    if json:
        print_json(summary)
    else:
        _print_outcomes(outcomes)
        open_console().print(f"{', '.join(summary['files'])} in {out}/")
    require_tolerances(outcomes)


def _print_outcomes(outcomes: Sequence[Outcome]) -> None:
    """Print published figures beside ours, case by case."""
    console = open_console()
    for outcome in outcomes:
        case = outcome.case
        if outcome.error:
            console.print(f"{case.name} FAILED: {outcome.error}")
            continue
        if outcome.skipped:
            console.print(f"{case.name} skipped: {outcome.skipped}")
            continue
        columns = {"quantity": "{}", "ours": "{:.6g}", "published": "{:.6g}", "difference": "{}", "allowed": "{:.2g} %"}
        rows = []
        for figure in outcome.figures:
            difference = f"{100 * figure.difference:+.2g} %" + ("" if figure.holds else " OUT")
            rows.append((figure.quantity, figure.ours, figure.published, difference, 100 * figure.tolerance))
        print_table(f"{case.name}: {case.title} ({case.source})", columns, rows)
    n_skipped = sum(bool(one.skipped) for one in outcomes)
    n_figures, n_wrong = sum(len(one.figures) for one in outcomes), sum(not one.holds for one in outcomes)
    console.print(
        f"{n_figures} figures of {len(outcomes) - n_skipped} cases in {sum(one.seconds for one in outcomes):.1f} s"
        + (f", {n_wrong} cases out of tolerance" if n_wrong else ", all within their tolerances")
        + (f", {n_skipped} skipped" if n_skipped else "")
    )
