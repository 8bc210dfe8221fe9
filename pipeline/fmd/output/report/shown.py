"""Pictures and tables of a scene's outputs on the page, whatever their type."""

from __future__ import annotations

import base64
import csv
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fmd.core.limits.shown import REPORTED_ROWS
from fmd.output.exports import write_file
from fmd.output.pictures import DRAWINGS
from fmd.scene.outputs import is_drawn

if TYPE_CHECKING:
    from fmd.stages.pipeline import Pipeline

# The page shows these in places of their own; films are what its view plays.
_ELSEWHERE = ("chart", "modes", "mode sheet", "film")


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
            title = getattr(output, "title", "") or f"{output.type}: {output.file}"
            if output.type == "frf":
                pictures, tables = _show_response(run, output, folder)
            else:
                make = DRAWINGS[output.type].draw if is_drawn(output) else write_file
                files = [folder / file for file in make(run, output, folder)]
                pictures = [file for file in files if file.suffix == ".png"]
                tables = [_read_table(file) for file in files if file.suffix == ".csv"]
            images = [image_of(picture.read_bytes(), title) for picture in pictures]
            found.append(
                {"title": title[:1].upper() + title[1:], "pictures": images, "table": tables[0] if tables else None}
            )
    return found


def _show_response(run: Pipeline, output: Any, folder: Path) -> tuple[list[Path], list[dict[str, Any]]]:
    """Draw a frequency response, and list its poles."""
    from fmd.output.responses import compute_scene_response, write_scene_response

    summary = write_scene_response(run, output, compute_scene_response(run, output), folder, chart=True)
    pairs = zip(summary["poles_hz"], summary["damping"], strict=True)
    rows = [(k, f"{hertz:.5g}", f"{damping:.3g}") for k, (hertz, damping) in enumerate(pairs, start=1)]
    left_out = max(len(rows) - REPORTED_ROWS, 0)
    table = {"header": ("pole", "Hz", "damping ratio"), "rows": rows[:REPORTED_ROWS], "left_out": left_out}
    return [folder / file for file in summary["files"] if file.endswith(".png")], [table]


def image_of(png: bytes, text: str) -> dict[str, str]:
    """Return a picture as the page's template takes it."""
    return {"text": text, "png": base64.b64encode(png).decode()}


def _read_table(path: Path) -> dict[str, Any]:
    """Read the first rows of a CSV file."""
    with path.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    return {"header": header, "rows": rows[:REPORTED_ROWS], "left_out": max(len(rows) - REPORTED_ROWS, 0)}
