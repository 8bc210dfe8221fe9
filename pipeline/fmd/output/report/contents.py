"""Contents of the page of all results: figures, pictures and tables as its template takes them."""

import base64
import csv
import platform
import tempfile
from collections.abc import Iterator
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from fmd.accuracy.error_estimates import SOURCES, percent
from fmd.core.html import facts, scaled
from fmd.core.limits.shown import BRIEF_PICTURES, REPORTED_DIGITS, REPORTED_MODES, REPORTED_ROWS, TICKS_OF_BAR
from fmd.core.version import __version__
from fmd.output.notebook import draw_inline
from fmd.output.output_kinds import OutputKind, kind_of
from fmd.output.pictures import camera_of, chart_title
from fmd.output.report.view3d import collect_view
from fmd.output.stated_errors import ERROR_COLUMNS, error_cells, key_figures, run_time, worst_details
from fmd.render.camera import Camera
from fmd.stages.division import part_of
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


_MEANT = {"mesh": "the mesh", "modes": "the modes", "time": "the integration", "model": "the model"}
_PACKAGES = ("numpy", "scipy", "gmsh", "scikit-fem", "llvmlite", "pyvista", "vtk", "matplotlib")


def draw_pictures(run: Pipeline) -> dict[str, Any]:
    """Draw the mechanism in motion, the first modes, the scene's charts, and all else that its outputs show."""
    moves = run.scene.moves
    return {
        "motion": _collect_motion(run) if moves else None,
        "modes": _draw_modes(run) if run.wholes and run.part.has_mesh else [],
        "charts": [*_draw_charts(run)] if moves else [],
        "shown": [*show_outputs(run)] if moves else [],
    }


def draw_few_pictures(run: Pipeline) -> list[dict[str, str]]:
    """Draw the worst instant and the first of the scene's charts and other pictures, or its first modes."""
    return [*islice(_draw_in_turn(run), BRIEF_PICTURES)]


def _draw_in_turn(run: Pipeline) -> Iterator[dict[str, str]]:
    """Yield pictures, the most telling first; each is drawn when it is asked for."""
    if run.scene.moves:
        yield _draw_still(run)
        yield from _draw_charts(run)
        yield from (picture for output in show_outputs(run) for picture in output["pictures"])
    if run.wholes and run.part.has_mesh:
        yield from _draw_modes(run)


def list_uncertainties(summary: dict[str, Any]) -> list[str]:
    """List what a run's error budget says of its key figures, and all warnings, as sentences."""
    found = []
    for row in summary.get("error_budget", {}).get("rows", ()):
        parts = {source: row[source] for source in SOURCES if isinstance(row[source], float)}
        if row["total"] is not None and parts:
            most = max(parts, key=lambda source: parts[source])
            found.append(f"{row['quantity']}: within {percent(row['total'])} %, most of it by {_MEANT.get(most, most)}")
        elif row["total"] is None:
            found.append(f"{row['quantity']}: no error is stated, {row['why'].removeprefix('not estimated: ')}")
    return [*found, *(warning["text"] for warning in summary.get("warnings", ()))]


def collect_tables(run: Pipeline, summary: dict[str, Any]) -> dict[str, Any]:
    """Collect the key figures and the rows of all tables from a run's summary."""
    cached = summary.get("stages_cached", ())
    return {
        "title": run.scene.title,
        "source": run.scene.source,
        "scene": run.scene.name,
        "figures": key_figures(summary),
        "frequencies": _frequencies(summary, part_of(run.part.name) or run.part.name) if run.wholes else None,
        "integrations": _integrations(summary) if "integrations" in summary else None,
        "budget": _budget(summary["error_budget"]) if "error_budget" in summary else None,
        "stages": [
            (name, f"{seconds:.3f}", "from the cache" if name in cached else "")
            for name, seconds in summary["seconds"].items()
        ],
    }


def versions_table() -> str:
    """Make the table of versions and of the machine, as HTML."""
    from joblib import cpu_count

    versions = [("fmd", __version__), ("Python", platform.python_version())]
    versions += [(package, version(package)) for package in _PACKAGES]
    machine = f"{platform.system()}, {platform.machine()}, {cpu_count()} cores"
    return facts([*versions, ("machine", machine)], "versions")


def _collect_motion(run: Pipeline) -> dict[str, Any]:
    """Collect the data of the viewer, its colour bar, and the picture that stands for it without WebGL."""
    seen_by, scale = _giving_view(run, "camera"), _scale_of(run)
    view = collect_view(run, scale, camera_of(run, seen_by) if seen_by else Camera())
    stressed = view["worst"] is not None
    colours = np.frombuffer(base64.b64decode(view["colours"]), dtype=np.uint8).reshape(-1, 3)[::15]
    return {
        "view": view,
        "still": _draw_still(run),
        "strip": [f"rgb({r} {g} {b})" for r, g, b in colours.tolist()] if stressed else [],
        "n_ticks": TICKS_OF_BAR,
        "largest_scale": 2 * scale if scale > 1 else 10,
    }


def _draw_still(run: Pipeline) -> dict[str, str]:
    """Draw the mechanism at its worst instant, or at all if nothing is stressed."""
    stressed = any(part.is_drawn for part in run.wholes.values())
    (still,) = draw_inline(run, "stress" if stressed else "mechanism", scale=_scale_of(run), size=[1280, 720])
    return image_of(still.png, f"{run.scene.title} at its worst instant" if stressed else run.scene.title)


def _scale_of(run: Pipeline) -> float:
    """Return the factor of the deformation that is shown."""
    found = _giving_view(run, "scale")
    return float(found.scale) if found else 1.0


def _giving_view(run: Pipeline, key: str) -> Any:
    """Return the first of a scene's outputs that gives the view in motion its scale or camera; ``None`` without one."""
    return next((output for output in run.scene.output if key in kind_of(output).gives_view), None)


def _draw_modes(run: Pipeline) -> list[dict[str, str]]:
    drawn = draw_inline(run, "modes", range(1, REPORTED_MODES + 1), size=[800, 450])  # pixels
    return [
        image_of(picture.png, f"mode {k + 1}, {run.modes.frequencies_hz[k]:.1f} Hz") for k, picture in enumerate(drawn)
    ]


def _draw_charts(run: Pipeline) -> Iterator[dict[str, str]]:
    charts: list[Any] = [output for output in run.scene.output if kind_of(output).section == "charts"]
    for chart in charts:
        settings = chart.model_dump(exclude={"type", "file", "band"}, exclude_defaults=True)
        title = chart.title or chart_title(chart)
        yield image_of(draw_inline(run, chart.type, **settings)[0].png, title)


def _frequencies(summary: dict[str, Any], name: str) -> dict[str, Any]:
    """Frequencies of a body, beside those of the scene's reference if it has one."""
    held = f", {summary['bodies'][name]['boundary']}" if "bodies" in summary else ""  # a part alone is free
    known = zip(summary["reference_hz"], summary["relative_error"], strict=True)
    beside = [(f"{hertz:.1f}", f"{100 * error:+.2f} %") for hertz, error in known]
    return {
        "header": ("mode", "Hz", "reference Hz", "difference") if beside else ("mode", "Hz"),
        "rows": [
            (k + 1, f"{hertz:.2f}", *(beside[k] if k < len(beside) else ("", "") if beside else ()))
            for k, hertz in enumerate(summary["frequencies_hz"])
        ],
        "note": f"{name}{held}; {summary['dofs']} unknowns, "
        f"{summary['rigid_modes']} rigid-body modes, "
        f"residual {summary['residual']:.0e}",
    }


def _integrations(summary: dict[str, Any]) -> dict[str, Any]:
    return {
        "header": (
            "method",
            "step",
            "time of integration alone",
            "ratio",
            "solutions + fast",
            "limit / step",
            "tip differs by",
        ),
        "rows": [
            (
                row["integrator"] + (f" {row['substeps']}:1" if row["substeps"] > 1 else ""),
                scaled(row["step_s"], "s", 3),
                *run_time(row, summary["integrations"][0]),
                f"{row['evaluations']} + {row['fast_evaluations']}",
                scaled(row["stability_margin"], digits=3),
                scaled(row["tip_difference_m"], "m", 3),
            )
            for row in summary["integrations"]
        ],
    }


def _budget(budget: dict[str, Any]) -> dict[str, Any]:
    return {
        "header": ("quantity", "value", *ERROR_COLUMNS),
        "rows": [
            (row["quantity"], scaled(row["value"], row["unit"]), *error_cells(row))
            for row in (*budget["rows"], *worst_details(budget))
        ],
        "note": f"Error of each result by its source [%]; stated is {budget['safety']:g} times the root of their "
        "squares. The better value has the corrections of finer computations, and lies with the true one between the "
        "last two; where an estimate is missing (?), nothing is stated. Of joints and markers the worst are here, "
        "and all in summary.json.",
    }
