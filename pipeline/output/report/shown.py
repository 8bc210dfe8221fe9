"""Pictures and tables of a scene's outputs on the page, whatever their type."""

from __future__ import annotations

import base64
import csv
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.output.exports import write_file
from pipeline.output.pictures import DRAWINGS
from pipeline.scene.outputs import is_drawn

if TYPE_CHECKING:
    from pipeline.stages.pipeline import Pipeline

# The page shows these in places of their own; films are what its view plays.
_ELSEWHERE = ("chart", "modes", "mode sheet", "film")
_MOST_ROWS = 40


def show_outputs(run: Pipeline) -> list[dict[str, Any]]:
    """Draw the PNG pictures and write the CSV tables that a scene lists, and return what the page shows of them.

    Returns
    -------
    list of dict
        Of each output ``title``, ``pictures`` and ``table``, of which one is empty.
    """
    found = []
    with tempfile.TemporaryDirectory(prefix="fmd-") as name:
        folder = Path(name)
        for output in run.scene.output:
            if output.type in _ELSEWHERE or not output.file.endswith((".png", ".csv")):
                continue
            files = (
                DRAWINGS[output.type].draw(run, output, folder) if is_drawn(output) else write_file(run, output, folder)
            )
            title = getattr(output, "title", "") or f"{output.type}: {output.file}"
            pictures = [image_of((folder / file).read_bytes(), title) for file in files if file.endswith(".png")]
            tables = [_read_table(folder / file) for file in files if file.endswith(".csv")]
            found.append(
                {"title": title[:1].upper() + title[1:], "pictures": pictures, "table": tables[0] if tables else None}
            )
    return found


def image_of(png: bytes, text: str) -> dict[str, str]:
    """Return a picture as the page's template takes it."""
    return {"text": text, "png": base64.b64encode(png).decode()}


def _read_table(path: Path) -> dict[str, Any]:
    """Read the first rows of a CSV file."""
    with path.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    return {"header": header, "rows": rows[:_MOST_ROWS], "left_out": max(len(rows) - _MOST_ROWS, 0)}
