"""What a run leaves behind: pictures, charts and films as the scene lists them, the motion, the summary."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.cache import Cache, stage_key
from pipeline.checks import Array, InputError
from pipeline.files import whole_file
from pipeline.folders import cache_folder
from pipeline.frequencies import frequency_table
from pipeline.stages import Pipeline

if TYPE_CHECKING:
    from pipeline.recovery.motion import Motion
    from pipeline.render.pictures import Surface
    from pipeline.scene import Chart, Film, ModePictures, StressPicture

# Quantity of a chart: axis label, curves, names of the components.
_QUANTITIES: dict[str, tuple[str, Callable[[Motion], Array], tuple[str, ...]]] = {
    "com_position": ("position [m]", lambda motion: motion.com_position, ("x", "y", "z")),
    "com_velocity": ("velocity [m/s]", lambda motion: motion.com_velocity, ("x", "y", "z")),
    "com_angular_velocity": ("angular velocity [rad/s]", lambda motion: motion.com_angular_velocity, ()),
    "tip_deflection": ("deflection [m]", lambda motion: motion.tip_deflection, ()),
    "joint_angle": ("angle [rad]", lambda motion: motion.joint_angle, ()),
    "joint_rate": ("rate [rad/s]", lambda motion: motion.joint_rate, ()),
    "modal_coordinates": ("modal coordinate [kg^½ m]", lambda motion: motion.q, ()),
    "energy": ("energy [J]", lambda motion: np.stack(motion.energies, axis=1), ("kinetic", "strain")),
}


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
    motions = run.motions  # refuses or diverges before anything is written
    try:
        folder.mkdir(parents=True, exist_ok=True)
        files = [_write_motion(motions, folder)]
        if pictures and run.scene.output:
            files += run.timed("pictures", lambda: _draw_all(run, folder))
        summary = summarise(run, files)
        with whole_file(folder / "summary.json") as part:
            part.write_text(json.dumps(summary, indent=1, allow_nan=False) + "\n")
    except OSError as error:
        raise InputError("--out", "", str(folder), f"can't be written: {error.strerror or error}") from error
    return summary


def summarise(run: Pipeline, files: list[str]) -> dict[str, Any]:
    """Everything that a run has to tell, in plain numbers."""
    from pipeline import __version__

    first = run.motion
    plain_seconds = first.trajectory.seconds
    kinetic, strain = first.energies
    integrations = [
        {
            "integrator": motion.trajectory.integrator,
            "step_s": motion.trajectory.step,
            "substeps": motion.trajectory.substeps,
            "seconds": motion.trajectory.seconds,
            "ratio_to_plain": motion.trajectory.seconds / plain_seconds,
            "evaluations": motion.trajectory.evaluations,
            "fast_evaluations": motion.trajectory.fast_evaluations,
            "tip_difference_m": float(np.linalg.norm(motion.tip_position - first.tip_position, axis=1).max()),
            "tip_deflection_difference_m": float(np.abs(motion.tip_deflection - first.tip_deflection).max()),
        }
        for motion in run.motions.values()
    ]
    summary = {
        "scene": run.scene.name,
        "version": __version__,
        **frequency_table(run),
        "pinned_frequencies_hz": run.body.frequencies_hz.tolist(),
        "coupling": run.body.coupling,
        "mass_kg": run.body.gram.mass,
        "largest_stable_step_s": 2.0 / run.rotor.highest_frequency,
        "integrations": integrations,
        "final": {
            "time_s": float(first.times[-1]),
            "joint_angle_rad": float(first.joint_angle[-1]),
            "joint_rate_rad_s": float(first.joint_rate[-1]),
            "tip_deflection_m": float(first.tip_deflection[-1]),
            "kinetic_energy_j": float(kinetic[-1]),
            "strain_energy_j": float(strain[-1]),
        },
        "peak_tip_deflection_m": float(np.abs(first.tip_deflection).max()),
        "files": files,
    }
    time, node, value = run.stress.worst()
    place = run.body.x[run.stress.nodes[node]]
    summary["worst_stress"] = {"time_s": time, "von_mises_pa": value, "position_m": place.tolist()}
    summary |= {
        "seconds": dict(run.log.seconds),
        "stages_run": list(run.log.run),
        "stages_cached": list(run.log.cached),
        "stages_skipped": run.log.skipped,
    }
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


def _write_motion(motions: dict[str, Motion], folder: Path) -> str:
    from pipeline.recovery.motion import motion_dataset

    with whole_file(folder / "motion.nc") as part:
        motion_dataset(motions).to_netcdf(part, engine="scipy")
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
    from pipeline.render.charts import Curve, draw_chart

    label, quantity, components = _QUANTITIES[output.quantity]
    curves = {name: quantity(motion) for name, motion in run.motions.items()}
    first = curves[next(iter(curves))]
    if components:  # a planar motion has nothing to show across its plane
        moving = np.abs(first).max(axis=0) > 1e-9 * np.abs(first).max()
        components = tuple(name for name, moves in zip(components, moving, strict=True) if moves)
        curves = {name: values[:, moving] for name, values in curves.items()}
    elif first.ndim == 2:
        components = tuple(f"mode {k + 1}" for k in range(first.shape[1]))
    draw_chart(
        run.motion.times,
        [Curve(name, values) for name, values in curves.items()],
        folder / output.file,
        title=output.title or output.quantity.replace("_", " "),
        ylabel=label,
        component_labels=components,
    )
    return [output.file]


def _surface(run: Pipeline) -> Surface:
    from pipeline.render.pictures import Surface

    topology = run.surface
    return Surface(run.body.x[topology.nodes], topology.triangles, topology.edges)


def _draw_modes(run: Pipeline, output: ModePictures, folder: Path) -> list[str]:
    from pipeline.render.pictures import draw_mode

    surface, modes, files = _surface(run), run.modes, []
    for k, frequency in enumerate(modes.frequencies_hz):
        name = output.file.format(mode=k + 1)
        family = "" if run.scene.body[output.body].modes.family == "any" else run.scene.body[output.body].modes.family
        draw_mode(
            surface,
            modes.shapes[run.surface.nodes, :, k],
            folder / name,
            title=f"{run.scene.title}: free mode {k + 1}, {frequency:.1f} Hz" + (f" ({family})" if family else ""),
            scale=output.scale or 1.0,
        )
        files.append(name)
    return files


def _draw_stress(run: Pipeline, output: StressPicture, folder: Path) -> list[str]:
    from pipeline.render.pictures import draw_stress

    time, _, _ = run.stress.worst()
    frame = int(np.searchsorted(run.motion.times, time))
    draw_stress(
        _surface(run),
        run.body.shapes[run.surface.nodes] @ run.motion.q[frame],
        run.stress.von_mises(time),
        folder / output.file,
        title=f"{run.scene.title}: worst instant, t = {1e3 * time:.1f} ms",
        scale=output.scale,
        size=output.size,
    )
    return [output.file]


def _draw_film(run: Pipeline, output: Film, folder: Path) -> list[str]:
    from pipeline.recovery.stress import von_mises
    from pipeline.render.film import draw_film

    motion, surface, shapes = run.motion, _surface(run), run.body.shapes[run.surface.nodes]
    chosen = np.unique(np.linspace(0, len(motion.times) - 1, output.frames).round().astype(int))

    def points(k: int) -> Array:
        return motion.turned(surface.points + output.scale * (shapes @ motion.q[k]), k)

    stress = [von_mises(run.stress.modal @ motion.q[k]) for k in chosen]
    corners = np.stack([np.concatenate([(p := points(k)).min(axis=0), p.max(axis=0)]) for k in chosen])
    low, high = corners[:, :3].min(axis=0), corners[:, 3:].max(axis=0)
    bounds = np.stack([np.minimum(low, 0.0), np.maximum(high, 0.0)], axis=1).ravel()

    def frames() -> Iterator[tuple[float, Array, Array]]:
        for k, value in zip(chosen, stress, strict=True):
            yield float(motion.times[k]), points(k), value

    scaled = f", deformation × {output.scale:g}" if output.scale != 1 else ""
    with run.monitor(output.file) as advance:
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
