"""Pictures, charts and films of a run, drawn as the scene's outputs ask for."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.core.arrays import Array, IntArray
from pipeline.core.errors import InputError
from pipeline.core.units import unit_ratio
from pipeline.output.curves import curves_of
from pipeline.recovery.stress import StressHistory, choose_frames, stress_measure
from pipeline.render.calls import Drawer, draw_here
from pipeline.render.camera import FILM_PIXELS, PIXELS, SHEET_PIXELS, Camera
from pipeline.render.chart_data import Band, Curve
from pipeline.render.colours import stress_limits
from pipeline.render.film_frames import FilmedMotion

if TYPE_CHECKING:
    from pipeline.render.surface import Surface
    from pipeline.scene.outputs import Chart
    from pipeline.scene.pictures import BodyPicture, Film, MeshPicture, ModePictures, ModeSheet, StressPicture
    from pipeline.stages.pipeline import Pipeline


def draw_chart(run: Pipeline, output: Chart, folder: Path, draw: Drawer = draw_here) -> list[str]:
    """Draw a quantity over time."""
    label, curves, components = curves_of(run, output)
    band = None
    if output.band is not None:
        low, high = (unit_ratio("Pa", output.unit or "MPa") * value for value in output.band)
        band = Band(low, high, output.band_title)
    draw(
        "charts.draw_chart",
        run.motion.times,
        [Curve(name, values) for name, values in curves.items()],
        folder / output.file,
        title=output.title or output.quantity.replace("_", " "),
        ylabel=label,
        component_labels=components,
        band=band,
    )
    return [output.file]


def draw_mesh(run: Pipeline, output: MeshPicture, folder: Path, draw: Drawer = draw_here) -> list[str]:
    """Draw a body's mesh, its parts in colours."""
    from pipeline.fem.formats.export import part_numbers

    part = run.wholes[output.body]
    names = [f"{name} ({len(cells):,} elements)".replace(",", " ") for name, cells in part.mesh.parts.items()]
    title = output.title or f"{run.scene.title}: {len(part.mesh.cells):,} elements".replace(",", " ")
    triangles = part_numbers(part.mesh)[part.surface_elements] - 1
    surface, camera = _surface(run, output.body), _camera(run, output)
    draw("pictures.draw_mesh", surface, triangles, names, folder / output.file, title=title, camera=camera)
    return [output.file]


def draw_modes(
    run: Pipeline,
    output: ModePictures,
    folder: Path,
    draw: Drawer = draw_here,
    numbers: Iterable[int] | None = None,
) -> list[str]:
    """Draw a picture of each mode, or of those with the given numbers, from 1."""
    part = run.wholes[output.body]
    surface, modes, files = _surface(run, output.body), part.modes, []
    held = "free" if part.shape.modes.boundary == "free" else "held"
    family = "" if part.shape.modes.family == "any" else f" ({part.shape.modes.family})"
    chosen = (
        range(len(modes.omega)) if numbers is None else sorted({n - 1 for n in numbers} & {*range(len(modes.omega))})
    )
    for k in chosen:
        frequency = modes.frequencies_hz[k]
        name = output.file.format(mode=k + 1)
        draw(
            "pictures.draw_mode",
            surface,
            modes.shapes[part.surface.nodes, :, k],
            folder / name,
            title=f"{output.title or run.scene.title}: {held} mode {k + 1}, {frequency:.1f} Hz{family}",
            scale=output.scale or 1.0,
            camera=_camera(run, output),
        )
        files.append(name)
    return files


def draw_mode_sheet(run: Pipeline, output: ModeSheet, folder: Path, draw: Drawer = draw_here) -> list[str]:
    """Draw the first modes in one picture."""
    part = run.wholes[output.body]
    hertz = part.modes.frequencies_hz[: output.count]
    draw(
        "mode_sheet.draw_mode_sheet",
        _surface(run, output.body),
        part.modes.shapes[part.surface.nodes][..., : len(hertz)],
        [f"mode {k + 1}, {frequency:.1f} Hz" for k, frequency in enumerate(hertz)],
        folder / output.file,
        title=output.title or f"{run.scene.title}: elastic modes",
        scale=output.scale,
        camera=_camera(run, output, SHEET_PIXELS),
    )
    return [output.file]


def draw_stress(run: Pipeline, output: StressPicture, folder: Path, draw: Drawer = draw_here) -> list[str]:
    """Draw a body's stress at the worst instant."""
    stress = run.stress_of(output.body)
    time, _, _ = stress.worst()
    frame = int(np.searchsorted(stress.times, time))
    draw(
        "pictures.draw_stress",
        _surface(run, output.body),
        run.deform(output.body, np.array([frame]), stress.nodes)[0],
        stress.measure_at(np.array([frame]), stress_measure(output.component))[0],
        folder / output.file,
        title=f"{output.title or run.scene.title}: worst instant, t = {1e3 * time:.1f} ms",
        scale=output.scale,
        quantity=_quantity(output.component),
        camera=_camera(run, output),
    )
    return [output.file]


def draw_film(run: Pipeline, output: Film, folder: Path, draw: Drawer = draw_here) -> list[str]:
    """Film a body's stress in motion."""
    surface, history = _surface(run, output.body), run.stress_of(output.body)
    chosen = choose_frames(len(history.times), output.frames)
    values = history.measure_at(chosen, stress_measure(output.component))
    scaled = f", deformation × {output.scale:g}" if output.scale != 1 else ""
    draw(
        "film.film_motion",
        surface,
        _filmed(run, output, history, chosen, values),
        folder / output.file,
        title=(output.title or run.scene.title) + scaled,
        clim_pa=stress_limits(values),
        rate=output.rate,
        quantity=_quantity(output.component),
        camera=_camera(run, output, FILM_PIXELS),
        hub=not _is_ring(run, output.body),
    )
    return [output.file]


@dataclass(frozen=True)
class Drawing:
    """How one type of output is drawn.

    Attributes
    ----------
    draw : callable
        Has an output of a run drawn into a folder by a `Drawer` and returns the names of its files.
    reads : tuple of str
        Stages of the body that it shows.
    still : bool
        It shows a part, and nothing of its motion.
    """

    draw: Callable[..., list[str]]
    reads: tuple[str, ...] = ()
    still: bool = False


DRAWINGS: dict[str, Drawing] = {
    "chart": Drawing(draw_chart),
    "mesh": Drawing(draw_mesh, ("mesh", "surface", "body"), still=True),
    "modes": Drawing(draw_modes, ("modes", "surface", "body"), still=True),
    "mode sheet": Drawing(draw_mode_sheet, ("modes", "surface", "body"), still=True),
    "stress": Drawing(draw_stress, ("surface", "stress", "body")),
    "film": Drawing(draw_film, ("mesh", "surface", "stress", "body")),
}


def _filmed(run: Pipeline, output: Film, history: StressHistory, chosen: IntArray, values: Array) -> FilmedMotion:
    """Gather a body's motion at some output times for a film, with its rate of rotation as notes."""
    motion, body = run.motion, output.body
    first = run.frame_of(body)
    frame = motion.kinematics.frames[motion.mechanism.number_of(first)]
    if len(run.pieces_of(body)) > 1:  # large rotations: a shape for each frame
        shapes, coordinates = np.moveaxis(run.deform(body, chosen, history.nodes), 0, 2), np.eye(len(chosen))
    else:
        shapes, coordinates = run.bodies[body].shapes[history.nodes], history.q[chosen]
    return FilmedMotion(
        times=motion.times[chosen],
        points=_surface(run, body).points,
        shapes=shapes,
        coordinates=coordinates,
        scale=output.scale,
        origin=frame.origin[chosen],
        rotation=frame.rotation[chosen],
        stress=values,
        notes=tuple(f"{turns * 60 / (2 * np.pi):,.0f} rpm".replace(",", " ") for turns in motion.spin(first)[chosen]),
    )


def _surface(run: Pipeline, body: str) -> Surface:
    from pipeline.render.surface import Surface

    part = run.wholes[body]
    x = part.space.x if not run.scene.moves else run.node_positions(body)  # a part alone isn't reduced
    return Surface(x[part.surface.nodes], part.surface.triangles, part.surface.edges)


def _is_ring(run: Pipeline, body: str) -> bool:
    """Return True if a body surrounds its joint, so that a dot for the hub would lie upon it."""
    return run.wholes[body].mesh.sectors > 1


def _camera(run: Pipeline, output: BodyPicture, size: tuple[int, int] | None = None) -> Camera:
    """Return a picture's camera, of ``size`` unless the scene gives one; by default of a still picture's."""
    angles = None if output.camera is None else (np.degrees(output.camera[0]), np.degrees(output.camera[1]))
    settings: dict[str, Any] = {"focus": output.focus, "extent": output.extent, "zoom": output.zoom}
    try:
        return Camera(angles=angles, size=output.size or size or PIXELS, colour_map=output.colour_map, **settings)
    except ValueError as error:
        raise InputError(run.scene.file, "output", output.colour_map, str(error)) from error


def _quantity(component: str) -> str:
    name = {"von Mises": component}.get(component, component if component.startswith("principal") else f"σ{component}")
    return f"{name} [MPa]"
