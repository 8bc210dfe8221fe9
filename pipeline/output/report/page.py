"""The page: what a run has found, in sections of one HTML file."""

from __future__ import annotations

import base64
import json
import platform
from collections.abc import Sequence
from datetime import UTC, datetime
from html import escape
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.core.errors import InputError
from pipeline.core.files import whole_file
from pipeline.core.html import facts, scaled, table
from pipeline.output.frequencies import frequency_table
from pipeline.output.notebook import Picture, draw_inline
from pipeline.output.report.view3d import view_data
from pipeline.output.summary import summarise
from pipeline.stages.pipeline import Pipeline

_MOST_MODES = 6
_SMALL = [800, 450]  # pixels
_PACKAGES = ("numpy", "scipy", "gmsh", "scikit-fem", "numba", "pyvista", "vtk", "matplotlib")
# Whatever a part's name or a scene's title may hold, the browser fetches nothing.
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"


def write_report(run: Pipeline, path: Path, overrides: Sequence[str] = (), budget: bool = True) -> None:
    """Compute what the scene asks for and write it as one page.

    Parameters
    ----------
    run : Pipeline
        Of the scene.
    path : Path
        The file, in a folder that is made if it is missing; it appears whole or not at all.
    overrides : sequence of str
        Values that were set on the command line, to be told.
    budget : bool
        Whether to estimate the errors of the results.

    Raises
    ------
    InputError
        The file can't be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)  # told at once, not after all is computed
        with whole_file(path) as part:
            part.touch()
            part.write_text(report(run, overrides, budget), encoding="utf-8")
    except OSError as error:
        raise InputError("--out", "", str(path), f"can't be written: {error.strerror or error}") from error


def report(run: Pipeline, overrides: Sequence[str] = (), budget: bool = True) -> str:
    """Make the page; the arguments are those of `write_report`."""
    moves = run.scene.moves
    if moves:
        run.motions  # noqa: B018 - refuses or diverges before anything is drawn
    stress, modes, charts = run.store.compute(
        "pictures", lambda: (_stress(run, moves), _modes(run), _charts(run, moves))
    )
    summary = summarise(run, [], budget) if moves else {**frequency_table(run), "seconds": dict(run.log.seconds)}
    title = escape(run.scene.title)
    resources = files("pipeline.report")
    sections = [
        f"<header><h1>{title}</h1>{_paragraph(run.scene.source)}</header>",
        _key_figures(run, summary),
        stress,
        _frequencies(summary, modes) if run.parts else "",
        charts,
        _errors(summary) if moves else "",
        _stages(summary),
        _made_by(run, overrides),
    ]
    return "\n".join(
        [
            '<!doctype html><html lang="en"><head><meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{title}</title><style>{(resources / 'page.css').read_text()}</style></head><body>",
            *(section for section in sections if section),
            f"<script>{(resources / 'viewer.js').read_text()}</script></body></html>\n",
        ]
    )


def _paragraph(text: str) -> str:
    return f"<p>{escape(text)}</p>" if text else ""


def _key_figures(run: Pipeline, summary: dict[str, Any]) -> str:
    figures: list[tuple[str, str]] = []
    if "frequencies_hz" in summary:
        figures.append(("first frequency", f"{summary['frequencies_hz'][0]:.2f} Hz"))
    for name, body in summary.get("bodies", {}).items():
        figures.append((f"mass of {name}", scaled(body["mass_kg"], "kg")))
    if "worst_stress" in summary:
        figures.append(("largest von Mises stress", scaled(summary["worst_stress"]["von_mises_pa"], "Pa")))
    if "peak_tip_deflection_m" in summary:
        figures.append(("largest tip deflection", scaled(summary["peak_tip_deflection_m"], "m")))
    if "integrations" in summary:
        figures.append(("simulated", scaled(summary["final"]["time_s"], "s")))
        figures.append(("largest stable step", scaled(summary["largest_stable_step_s"], "s", 3)))
    items = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in figures)
    return f'<dl class="figures">{items}</dl>'


def _image(picture: Picture, text: str) -> str:
    return f'<img alt="{escape(text)}" src="data:image/png;base64,{base64.b64encode(picture.png).decode()}">'


def _stress(run: Pipeline, moves: bool) -> str:
    return "".join(_stressed_part(run, name) for name, part in run.parts.items() if part.has_mesh) if moves else ""


def _stressed_part(run: Pipeline, name: str) -> str:
    listed = [output for output in run.scene.output if output.type == "stress" and output.body == name]
    scale = listed[0].scale if listed else 1.0
    data = view_data(run, name, scale)
    still = _image(
        draw_inline(run, "stress", body=name, scale=scale, size=[1280, 720])[0], f"von Mises stress of {name}"
    )
    colours = np.frombuffer(base64.b64decode(data["colours"]), dtype=np.uint8).reshape(-1, 3)[::15]
    strip = ", ".join(f"rgb({r} {g} {b})" for r, g, b in colours.tolist())
    low, high = data["limits"]
    ticks = "".join(f"<span>{low + (high - low) * k / 4:.3g}</span>" for k in range(5))
    most = 2 * scale if scale > 1 else 10
    return (
        f"<section><h2>Stress of {escape(name)} at its worst instant</h2>"
        f"<p>t = {scaled(data['time'], 's')}; the largest is {data['largest']:.4g} MPa. "
        "Drag to turn, wheel to zoom, shift and drag to move, double click to go back.</p>"
        f'<figure class="part">{still}'
        f'<canvas tabindex="0" role="img" aria-label="stress of {escape(name)}, turns with the arrow keys"></canvas>'
        f'<div class="bar"><div class="strip" style="background:linear-gradient(90deg, {strip})"></div>'
        f'<div class="ticks">{ticks}</div><div class="name">von Mises [MPa]</div></div>'
        f'<div class="controls"><label>deformation <input type="range" min="0" max="{most:g}" step="{most / 100:g}" '
        f'value="{scale:g}"><output></output></label>'
        f'<label><input type="checkbox"{" checked" if data["showEdges"] else ""}> element edges</label>'
        f"<button>reset view</button></div>"
        f'<script type="application/json">{json.dumps(data)}</script></figure></section>'
    )


def _modes(run: Pipeline) -> str:

    if not run.parts or not run.part.has_mesh:
        return ""
    drawn = draw_inline(run, "modes", range(1, _MOST_MODES + 1), size=_SMALL)
    named = [f"mode {k + 1}, {run.modes.frequencies_hz[k]:.1f} Hz" for k in range(len(drawn))]
    return "".join(
        f"<figure>{_image(picture, text)}<figcaption>{text}</figcaption></figure>"
        for picture, text in zip(drawn, named, strict=True)
    )


def _charts(run: Pipeline, moves: bool) -> str:

    charts = [output for output in run.scene.output if output.type == "chart"] if moves else []
    images = ""
    for chart in charts:
        settings = chart.model_dump(exclude={"type", "file", "band"}, exclude_defaults=True)
        images += _image(draw_inline(run, "chart", **settings)[0], chart.title or chart.quantity.replace("_", " "))
    return f'<section><h2>Motion</h2><div class="charts">{images}</div></section>' if images else ""


def _frequencies(summary: dict[str, Any], pictures: str) -> str:
    known = zip(summary["reference_hz"], summary["relative_error"], strict=True)
    beside = [(f"{hertz:.1f}", f"{100 * error:+.2f} %") for hertz, error in known]
    rows = [
        (k + 1, f"{hertz:.2f}", *(beside[k] if k < len(beside) else ("", "") if beside else ()))
        for k, hertz in enumerate(summary["frequencies_hz"])
    ]
    header = ("mode", "Hz", "reference Hz", "difference") if beside else ("mode", "Hz")
    note = f"{summary['dofs']} unknowns, {summary['rigid_modes']} rigid-body modes, residual {summary['residual']:.0e}"
    return (
        f'<section><h2>Frequencies and modes</h2><div class="wide">{table(header, rows)}</div>{_paragraph(note)}'
        f'<div class="sheet">{pictures}</div></section>'
    )


def _errors(summary: dict[str, Any]) -> str:
    rows = [
        (
            row["integrator"] + (f" {row['substeps']}:1" if row["substeps"] > 1 else ""),
            scaled(row["step_s"], "s", 3),
            scaled(row["seconds"], "s", 3),
            f"{row['ratio_to_plain']:.2f}",
            f"{row['evaluations']} + {row['fast_evaluations']}",
            scaled(row["stability_margin"], digits=3),
            scaled(row["tip_difference_m"], "m", 3),
        )
        for row in summary["integrations"]
    ]
    header = ("method", "step", "run time", "ratio", "solutions + fast", "limit / step", "tip differs by")
    text = f'<section><h2>Run time and errors</h2><div class="wide">{table(header, rows)}</div>'
    if "error_budget" in summary:
        budget = summary["error_budget"]
        sources = {
            "discretisation": "mesh",
            "truncation": "modes",
            "time": "time",
            "recovery": "stress",
            "total": "stated",
        }
        lines = [
            (row["quantity"], scaled(row["value"], row["unit"]), *(_percent(row[source]) for source in sources))
            for row in budget["rows"]
        ]
        note = (
            f"Error of each result by its source [%]; stated is {budget['safety']:g} times the root of their squares."
        )
        text += f'{_paragraph(note)}<div class="wide">{table(("quantity", "value", *sources.values()), lines)}</div>'
    return text + "</section>"


def _percent(error: float | str | None) -> str:
    if not isinstance(error, float):
        return "–"
    return f"{100 * error:.2g}" if error >= 1e-5 else "< 0.001"


def _stages(summary: dict[str, Any]) -> str:
    cached = summary.get("stages_cached", ())
    rows = [(name, f"{t:.3f}", "from the cache" if name in cached else "") for name, t in summary["seconds"].items()]
    return f"<section><h2>Stages</h2>{table(('stage', 'seconds', ''), rows)}</section>"


def _made_by(run: Pipeline, overrides: Sequence[str]) -> str:
    from joblib import cpu_count

    from pipeline import __version__

    versions = [("fmd", __version__), ("Python", platform.python_version())]
    versions += [(package, version(package)) for package in _PACKAGES]
    machine = f"{platform.system()}, {platform.machine()}, {cpu_count()} cores"
    settings = "".join(f" --set '{escape(text)}'" for text in overrides)
    return (
        f'<section><h2>Scene and versions</h2><div class="pair"><div class="wide">{run.scene._repr_html_()}</div>'
        f"{facts([*versions, ('machine', machine)], 'versions')}</div></section>"
        f"<footer>Made by <code>fmd report {escape(run.scene.name)}{settings}</code> on {datetime.now(UTC):%Y-%m-%d}."
        "</footer>"
    )
