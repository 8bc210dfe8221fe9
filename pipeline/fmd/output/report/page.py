"""One web page of all results of a run, which needs no network."""

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from fmd.accuracy.error_budget import allowed_seconds
from fmd.accuracy.solved_scene import SolvedScene
from fmd.core.files import refusing, whole_file
from fmd.core.html import scaled
from fmd.core.limits.shown import BRIEF_DOUBTS
from fmd.output.report.contents import (
    collect_tables,
    draw_few_pictures,
    draw_pictures,
    list_uncertainties,
    versions_table,
)
from fmd.output.stated_errors import key_results
from fmd.output.summary import summarise_solved

_PACKAGE = "fmd.output.report"


def write_report(
    solved: SolvedScene, path: Path, overrides: Sequence[str] = (), budget: bool = True, brief: bool = False
) -> None:
    """Compute all that a scene lists, and write it as one page, or the answer on one sheet, with or without errors.

    The file, in a folder that is made if it is missing, appears whole or not at all. Its last line repeats the values
    that were set on the command line.

    Raises
    ------
    InputError
        The file can't be written.
    """
    make = make_brief if brief else make_page
    write_page(path, lambda: make(solved, overrides, budget))


def write_page(path: Path, make: Callable[[], str]) -> None:
    """Write a page whole or not at all, in a folder that is made if it is missing.

    Raises
    ------
    InputError
        The file can't be written, which is found before anything is computed.
    """
    with refusing("--out", path), whole_file(path) as part:
        part.touch()
        part.write_text(make(), encoding="utf-8")


def make_page(solved: SolvedScene, overrides: Sequence[str] = (), budget: bool = True) -> str:
    """Make the page's text; the arguments are those of `write_report`."""
    run = solved.run
    if run.scene.moves:
        run.motions  # noqa: B018 - refuses or diverges before anything is drawn
    pictures = run.store.compute("pictures", lambda: draw_pictures(run))
    summary = summarise_solved(solved, (), budget, allowed_seconds(run))
    return render_page(
        "page.html",
        **pictures,
        **collect_tables(run, summary),
        overrides=overrides,
        date=f"{datetime.now(UTC):%Y-%m-%d}",
        scene_table=solved.scene._repr_html_(),
        versions_table=versions_table(),
    )


def make_brief(solved: SolvedScene, overrides: Sequence[str] = (), budget: bool = True) -> str:
    """Make the text of one page for those who decide: the question, the answer with its interval, pictures, doubts."""
    run = solved.run
    pictures = run.store.compute("pictures", lambda: draw_few_pictures(run))
    summary = summarise_solved(solved, (), budget, allowed_seconds(run))
    doubts = list_uncertainties(summary)
    return render_page(
        "brief.html",
        title=run.scene.title,
        source=run.scene.source,
        scene=run.scene.name,
        figures=key_results(summary),
        pictures=pictures,
        doubts=doubts[:BRIEF_DOUBTS],
        has_errors=budget,
        n_more=max(len(doubts) - BRIEF_DOUBTS, 0),
        overrides=overrides,
        date=f"{datetime.now(UTC):%Y-%m-%d}",
        scene_table=solved.scene._repr_html_(),
    )


def render_page(template: str, **contents: Any) -> str:
    """Return the text of a page of this package, with its style and the viewer's script."""
    resources = files(_PACKAGE)
    environment = Environment(
        loader=PackageLoader(_PACKAGE, "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["scaled"] = scaled
    return environment.get_template(template).render(
        **contents,
        style=(resources / "page.css").read_text(encoding="utf-8"),
        script=(resources / "viewer.js").read_text(encoding="utf-8"),
    )
