"""Pictures, charts and films of a run, drawn as the scene's outputs ask for."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.core.arrays import IntArray
from fmd.core.errors import InputError, as_input_error
from fmd.core.units import unit_ratio
from fmd.output.curves import curves_of, errors_of_curve
from fmd.output.instants import choose_instants, find_worst
from fmd.output.mechanism_view import body_surface, view_mechanism
from fmd.output.output_kinds import OutputKind, Reads, key_of, read_body
from fmd.recovery.stress import stress_measure
from fmd.render.calls import Drawer, draw_here
from fmd.render.camera import FILM_PIXELS, PIXELS, SHEET_PIXELS, Camera
from fmd.render.chart_data import Band, Curve
from fmd.render.colours import film_limits
from fmd.stages.division import part_of

if TYPE_CHECKING:
    from fmd.render.moving_bodies import MovingMechanism
    from fmd.scene.outputs import Chart
    from fmd.scene.pictures import (
        BodyPicture,
        Film,
        MechanismPicture,
        MechanismView,
        MeshPicture,
        ModePictures,
        ModeSheet,
        PictureSettings,
        StressPicture,
    )
    from fmd.stages.pipeline import Pipeline


def camera_of(run: Pipeline, output: PictureSettings, size: tuple[int, int] | None = None) -> Camera:
    """Return a picture's camera, of ``size`` unless the scene gives one; by default of a still picture's."""
    angles = None if output.camera is None else (np.degrees(output.camera[0]), np.degrees(output.camera[1]))
    settings: dict[str, Any] = {"focus": output.focus, "extent": output.extent, "zoom": output.zoom}
    with as_input_error(run.scene.file, "output", output.colour_map):
        return Camera(angles=angles, size=output.size or size or PIXELS, colour_map=output.colour_map, **settings)


def draw_chart(run: Pipeline, output: Chart, folder: Path, draw: Drawer = draw_here) -> None:
    """Draw a quantity over time."""
    label, curves, components = curves_of(run, output)
    stated = errors_of_curve(run, output)
    band = None
    if output.band is not None:
        low, high = (unit_ratio("Pa", output.unit or "MPa") * value for value in output.band)
        band = Band(low, high, output.band_title)
    draw(
        "charts.draw_chart",
        run.motion.times,
        [Curve(name, values, () if k else stated) for k, (name, values) in enumerate(curves.items())],
        folder / output.file,
        title=output.title or chart_title(output),
        ylabel=label,
        component_labels=components,
        band=band,
    )


def chart_title(chart: Chart) -> str:
    """Return the title of a chart that the scene gives none: its quantity, and what that is of."""
    of = chart.joint or chart.marker or chart.element or chart.body
    words = chart.quantity.replace("com_", "centre of mass: ").replace("_", " ")
    return words[:1].upper() + words[1:] + (f" of {of}" if of else "")


def draw_mesh(run: Pipeline, output: MeshPicture, folder: Path, draw: Drawer = draw_here) -> None:
    """Draw a body's mesh, its parts in colours."""
    from fmd.fem.formats.export import part_numbers

    part = run.wholes[output.body]
    names = [f"{name} ({len(cells):,} elements)".replace(",", " ") for name, cells in part.mesh.parts.items()]
    title = output.title or f"{_name(output)}: {part.mesh.n_cells:,} elements".replace(",", " ")
    triangles = part_numbers(part.mesh)[part.surface_elements] - 1
    surface, camera = body_surface(run, output.body), camera_of(run, output)
    draw("pictures.draw_mesh", surface, triangles, names, folder / output.file, title=title, camera=camera)


def draw_modes(
    run: Pipeline,
    output: ModePictures,
    folder: Path,
    draw: Drawer = draw_here,
    numbers: Iterable[int] | None = None,
) -> list[str]:
    """Draw a picture of each mode, or of those with the given numbers, from 1."""
    part = run.wholes[output.body]
    surface, modes, files = body_surface(run, output.body), part.modes, []
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
            title=f"{output.title or _name(output)}: {held} mode {k + 1}, {frequency:.1f} Hz{family}",
            scale=output.scale or 1.0,
            camera=camera_of(run, output),
        )
        files.append(name)
    return files


def draw_mode_sheet(run: Pipeline, output: ModeSheet, folder: Path, draw: Drawer = draw_here) -> None:
    """Draw the first modes in one picture."""
    part = run.wholes[output.body]
    hertz = part.modes.frequencies_hz[: output.count]
    draw(
        "mode_sheet.draw_mode_sheet",
        body_surface(run, output.body),
        part.modes.shapes[part.surface.nodes][..., : len(hertz)],
        [f"mode {k + 1}, {frequency:.1f} Hz" for k, frequency in enumerate(hertz)],
        folder / output.file,
        title=output.title or f"{_name(output)}: elastic modes",
        scale=output.scale,
        camera=camera_of(run, output, SHEET_PIXELS),
    )


def draw_stress(run: Pipeline, output: StressPicture, folder: Path, draw: Drawer = draw_here) -> None:
    """Draw the stress at the worst instant: of the whole mechanism, or of a body alone in its own frame."""
    names = [output.body] if output.body else [name for name, part in run.wholes.items() if part.has_stress]
    names = names or [name for name, part in run.wholes.items() if part.has_mesh]
    if not names:
        raise InputError(run.scene.file, "body", sorted(run.scene.body), "no flexible body with a mesh: no stress")
    drawn = [name for name in names if run.wholes[name].is_drawn]
    if not drawn:
        body_surface(run, names[0])  # says what it lacks
    body, worst, _ = find_worst(run, drawn)
    run, frame = run.at_instants, np.array([worst])
    stress = run.stress_of(body)
    title = f"{output.title or run.scene.title}: worst instant, t = {1e3 * stress.times[worst]:.6g} ms"
    if output.alone or len(run.scene.body) == 1:
        draw(
            "pictures.draw_stress",
            body_surface(run, body),
            run.deform(body, frame, stress.nodes)[0],
            stress.measure_at(frame, stress_measure(output.component))[0],
            folder / output.file,
            title=title,
            scale=output.scale,
            quantity=_quantity(output.component),
            camera=camera_of(run, output),
        )
        return
    _draw_mechanism(run, output, frame, title, folder, draw)


def draw_mechanism(run: Pipeline, output: MechanismPicture, folder: Path, draw: Drawer = draw_here) -> None:
    """Draw the whole mechanism at one time."""
    times = run.motion.times
    if output.time > times[-1] * (1 + 1e-9):
        message = f"is after the end of the motion at {times[-1]:g} s"
        raise InputError(run.scene.file, key_of(run, output, "time"), output.time, message)
    frame = np.array([int(np.argmin(np.abs(times - output.time)))])
    title = output.title or f"{run.scene.title}: t = {times[frame[0]]:g} s"
    _draw_mechanism(run, output, frame, title, folder, draw)


def _draw_mechanism(
    run: Pipeline, output: StressPicture | MechanismPicture, frame: IntArray, title: str, folder: Path, draw: Drawer
) -> None:
    draw(
        "film.draw_mechanism",
        _view(run, output, frame),
        folder / output.file,
        title=title + _factor(output),
        quantity=_quantity(output.component),
        camera=camera_of(run, output),
        label=True,
    )


def draw_film(run: Pipeline, output: Film, folder: Path, draw: Drawer = draw_here) -> None:
    """Film the mechanism in motion, in the colours of its stress."""
    coloured = [name for name, part in run.wholes.items() if part.has_stress and output.body in (None, name)]
    moving = _view(run.at_instants, output, choose_instants(run, output.frames, coloured))
    stresses = [body.stress for body in moving.bodies if body.stress is not None]
    draw(
        "film.draw_film",
        moving,
        folder / output.file,
        title=(output.title or run.scene.title) + _factor(output),
        clim_pa=film_limits(np.concatenate(stresses, axis=1), output.span) if stresses else None,
        rate=output.rate,
        quantity=_quantity(output.component),
        camera=camera_of(run, output, FILM_PIXELS),
    )


def _view(run: Pipeline, output: MechanismView, chosen: IntArray) -> MovingMechanism:
    if output.body and run.wholes[output.body].has_stress:
        body_surface(run, output.body)  # says what it lacks
    return view_mechanism(
        run, chosen, coloured=output.body, component=output.component, scale=output.scale, alone=output.alone
    )


def _factor(output: MechanismView) -> str:
    return f", deformation × {output.scale:g}" if output.scale != 1 else ""


def _name(output: BodyPicture) -> str:
    """Return a body's name for a title, which the scene's, of its motion, wouldn't suit."""
    return output.body[:1].upper() + output.body[1:]


def _quantity(component: str) -> str:
    name = {"von Mises": component}.get(component, component if component.startswith("principal") else f"σ{component}")
    return f"{name} [MPa]"


def _read_view(*stages: str) -> Reads:
    """Return what iterates over these stages of all bodies that a picture of the mechanism shows."""

    def read(run: Pipeline, output: MechanismView) -> Iterator[tuple[str, str]]:
        for own, part in run.parts.items():
            coloured = output.body in (None, part_of(own) or own)
            if part.has_stress and (coloured or not output.alone):
                yield from ((name, own) for name in stages if coloured or name != "stress")

    return read


_SEEN = _read_view("mesh", "surface", "stress", "body")
_MODES = read_body("modes", "surface", "body")

KINDS = {
    "chart": OutputKind(draw_chart, shown_errors=errors_of_curve, section="charts"),
    "mesh": OutputKind(draw_mesh, reads=read_body("mesh", "surface", "body"), still=True),
    "modes": OutputKind(draw_modes, reads=_MODES, still=True, section="modes"),
    "mode sheet": OutputKind(draw_mode_sheet, reads=_MODES, still=True, section="modes"),
    "stress": OutputKind(draw_stress, reads=_read_view("surface", "stress", "body"), gives_view=("scale",)),
    "mechanism": OutputKind(draw_mechanism, reads=_SEEN),
    "film": OutputKind(draw_film, reads=_SEEN, section="motion", gives_view=("scale", "camera")),
}
