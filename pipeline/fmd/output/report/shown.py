"""Pictures and tables of a scene's outputs on the page, whatever their type."""

from __future__ import annotations

import base64
import csv
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fmd.core.limits.shown import REPORTED_DIGITS, REPORTED_ROWS
from fmd.output.output_kinds import OutputKind, kind_of

if TYPE_CHECKING:
    from fmd.stages.pipeline import Pipeline


def show_outputs(run: Pipeline) -> Iterator[dict[str, Any]]:
    """Draw the pictures, and write the tables, that a scene lists, and yield what the page shows of them.

    Each has ``title``, ``pictures`` and ``table``, of which one is empty; of histories pictures are a chart.
    """
    with tempfile.TemporaryDirectory(prefix="fmd-") as name:
        folder = Path(name)
        for output in run.scene.output:
            kind = kind_of(output)
            if kind.section != "outputs" or not (kind.charted or output.file.endswith((".png", ".csv"))):
                continue
            title = getattr(output, "title", "") or f"{output.type}: {output.file}"
            shown = output.model_copy(update={"file": "shown.png"}) if kind.charted else output
            pictures, tables = _make(run, shown, kind, folder)
            images = [image_of(picture.read_bytes(), title) for picture in pictures]
            table = tables[0] if tables else None
            yield {"title": title[:1].upper() + title[1:], "pictures": images, "table": table}


def _make(run: Pipeline, output: Any, kind: OutputKind, folder: Path) -> tuple[list[Path], list[dict[str, Any]]]:
    """Make an output; return its pictures, and its tables as the page's template takes them."""
    if kind.response is None:
        files = [folder / file for file in kind.make(run, output, folder)]
        tables = [_read_table(file) for file in files if file.suffix == ".csv"]
    else:
        summary = kind.response.write(run, output, kind.response.compute(run, output), folder, True)
        files, tables = [folder / file for file in summary["files"]], [kind.response.tabulate(summary)]
    for table in tables:
        table["left_out"] = max(len(table["rows"]) - REPORTED_ROWS, 0)
        table["rows"] = [[_short(cell) for cell in row] for row in table["rows"][:REPORTED_ROWS]]
    return [file for file in files if file.suffix == ".png"], tables


def _short(cell: Any) -> Any:
    """Return a number's text with the digits that a page shows, and anything else as it is."""
    try:
        return f"{float(cell):.{REPORTED_DIGITS}g}" if isinstance(cell, str) and not cell.isdecimal() else cell
    except ValueError:
        return cell


def image_of(png: bytes, text: str) -> dict[str, str]:
    """Return a picture as the page's template takes it."""
    return {"text": text, "png": base64.b64encode(png).decode()}


def _read_table(path: Path) -> dict[str, Any]:
    """Read a CSV file."""
    with path.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    return {"header": header, "rows": rows}
