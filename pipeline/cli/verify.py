"""``fmd verify``."""

from __future__ import annotations

from pathlib import Path

from pipeline.cli.options import Json, NoCache, print_json


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
        Names of cases, e.g. fv52; all by default.
    out
        Folder for the table as CSV and JSON.
    """
    from pipeline.core.cache import Cache
    from pipeline.verification.suite import carry_out, require_within

    found, summary = carry_out(cases or (), out, Cache(None) if no_cache else None)
    if json:
        print_json(summary)
    else:
        from pipeline.cli.tables import print_verification

        print_verification(found, out, summary["files"])
    require_within(found)
