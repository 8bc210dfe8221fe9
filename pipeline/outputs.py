"""What a run leaves behind: pictures, charts and films as the scene lists them, the motion, the summary."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.cache import Cache, stage_key
from pipeline.checks import Array, InputError
from pipeline.files import whole_file
from pipeline.folders import cache_folder
from pipeline.stages import Pipeline
from pipeline.summary import summarise

if TYPE_CHECKING:
    from pipeline.render.pictures import Surface
    from pipeline.scene import Chart, Film, ModePictures, StressPicture


def write_results(run: Pipeline, folder: Path, pictures: bool) -> dict[str, Any]:
    """Compute what the scene asks for and write it into ``folder``; return the summary.

    Parameters
    ----------
    run : Pipeline
        Of the scene.
    folder : Path
        Made if it is missing; each file appears whole or not at all.
    pictures : bool
        Whether to draw; without, neither PyVista nor Matplotlib is loaded.

    Raises
    ------
    InputError
        The folder can't be written, or this machine can't draw.
    """
    if pictures and run.scene.output:
        _require_drawing(run.scene.file)
    run.motions  # noqa: B018 - refuses or diverges before anything is written
    try:
        folder.mkdir(parents=True, exist_ok=True)
        files = [_write_motion(run, folder)]
        if pictures and run.scene.output:
            files += run.keeper.timed("pictures", lambda: _draw_all(run, folder))
        summary = summarise(run, files)
        with whole_file(folder / "summary.json") as part:
            part.write_text(json.dumps(summary, indent=1, allow_nan=False) + "\n")
    except OSError as error:
        raise InputError("--out", "", str(folder), f"can't be written: {error.strerror or error}") from error
    return summary


def _require_drawing(file: str) -> None:
    """Refuse to draw where VTK would take the process down; a machine that has drawn once isn't asked again."""
    cache = Cache(cache_folder() / "stages")
    key = stage_key("drawing", None, ("pipeline/render/probe.py",), ("pyvista", "vtk"))
    if cache.load(key):
        return
    from pipeline.render.probe import rendering_problem

    problem = rendering_problem()
    if problem is not None:
        raise InputError(file, "output", None, f"this machine can't draw: {problem} (or run with --no-pictures)")
    cache.save(key, True)


def _write_motion(run: Pipeline, folder: Path) -> str:
    motions: dict[str, Any] = dict(run.motions)
    if run.is_rotor:
        from pipeline.recovery.motion import motion_dataset

        dataset = motion_dataset(motions)
    else:
        from pipeline.recovery.chain_motion import chain_dataset

        dataset = chain_dataset(motions, run.chain.units)
    with whole_file(folder / "motion.nc") as part:
        dataset.to_netcdf(part, engine="scipy")
    return "motion.nc"


def _draw_all(run: Pipeline, folder: Path) -> list[str]:
    files: list[str] = []
    for output in run.scene.output:
        match output.type:
            case "chart":
                files += _draw_chart(run, output, folder)
            case "modes":
                files += _draw_modes(run, output, folder)
            case "stress":
                files += _draw_stress(run, output, folder)
            case "film":
                files += _draw_film(run, output, folder)
    return files


def _draw_chart(run: Pipeline, output: Chart, folder: Path) -> list[str]:
    from pipeline.quantities import curves_of
    from pipeline.render.charts import Curve, draw_chart

    label, curves, components = curves_of(run, output)
    draw_chart(
        run.first_motion.times,
        [Curve(name, values) for name, values in curves.items()],
        folder / output.file,
        title=output.title or output.quantity.replace("_", " "),
        ylabel=label,
        component_labels=components,
    )
    return [output.file]


def _surface(run: Pipeline, body: str) -> Surface:
    from pipeline.render.pictures import Surface

    topology = run.parts[body].surface
    return Surface(run.bodies[body].x[topology.nodes], topology.triangles, topology.edges)


def _draw_modes(run: Pipeline, output: ModePictures, folder: Path) -> list[str]:
    from pipeline.render.pictures import draw_mode

    part = run.parts[output.body]
    surface, modes, files = _surface(run, output.body), part.modes, []
    held = "free" if part.shape.modes.boundary == "free" else "held"
    for k, frequency in enumerate(modes.frequencies_hz):
        name = output.file.format(mode=k + 1)
        family = "" if part.shape.modes.family == "any" else part.shape.modes.family
        draw_mode(
            surface,
            modes.shapes[part.surface.nodes, :, k],
            folder / name,
            title=f"{run.scene.title}: {held} mode {k + 1}, {frequency:.1f} Hz" + (f" ({family})" if family else ""),
            scale=output.scale or 1.0,
        )
        files.append(name)
    return files


def _draw_stress(run: Pipeline, output: StressPicture, folder: Path) -> list[str]:
    from pipeline.render.pictures import draw_stress

    stress = run.stress_of(output.body)
    time, _, _ = stress.worst()
    frame = int(np.searchsorted(stress.times, time))
    draw_stress(
        _surface(run, output.body),
        run.bodies[output.body].shapes[stress.nodes] @ stress.q[frame],
        stress.von_mises(time),
        folder / output.file,
        title=f"{run.scene.title}: worst instant, t = {1e3 * time:.1f} ms",
        scale=output.scale,
        size=output.size,
    )
    return [output.file]


def _draw_film(run: Pipeline, output: Film, folder: Path) -> list[str]:
    from pipeline.recovery.stress import von_mises
    from pipeline.render.film import draw_film

    motion, surface, history = run.first_motion, _surface(run, output.body), run.stress_of(output.body)
    shapes = run.bodies[output.body].shapes[history.nodes]
    chosen = np.unique(np.linspace(0, len(motion.times) - 1, output.frames).round().astype(int))

    def points(k: int) -> Array:
        return motion.placed(output.body, surface.points + output.scale * (shapes @ history.q[k]), k)

    stress = [von_mises(history.modal @ history.q[k]) for k in chosen]
    corners = np.stack([np.concatenate([(p := points(k)).min(axis=0), p.max(axis=0)]) for k in chosen])
    low, high = corners[:, :3].min(axis=0), corners[:, 3:].max(axis=0)
    bounds = np.stack([np.minimum(low, 0.0), np.maximum(high, 0.0)], axis=1).ravel()

    def frames() -> Iterator[tuple[float, Array, Array]]:
        for k, value in zip(chosen, stress, strict=True):
            yield float(motion.times[k]), points(k), value

    scaled = f", deformation × {output.scale:g}" if output.scale != 1 else ""
    with run.keeper.monitor(output.file) as advance:
        done = 0

        def on_frame() -> None:
            nonlocal done
            done += 1
            advance(done / len(chosen))

        draw_film(
            surface,
            frames(),
            len(chosen),
            folder / output.file,
            title=run.scene.title + scaled,
            bounds=bounds,
            clim_pa=(0.0, max(float(value.max()) for value in stress) or 1.0),
            rate=output.rate,
            size=output.size,
            on_frame=on_frame,
        )
    return [output.file]
