"""Stress and failure indices of a laminate's plies: a table of their extremes, or a picture of the worst index."""

from pathlib import Path
from typing import Any

import numpy as np

from fmd.accuracy.ply_stress import ACROSS, has_plies, ply_row
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.files import number_texts, write_table
from fmd.output.error_columns import NOT_STATED, write_errors
from fmd.output.mechanism_view import body_surface
from fmd.output.output_kinds import OutputKind, read_body
from fmd.output.pictures import camera_of
from fmd.output.variable_errors import VariableErrors
from fmd.recovery.plies import FAILURE_INDICES, PLY_STRESSES, PlyExtremes, extremes_of_laminates, shells_of
from fmd.render.calls import Drawer, draw_here
from fmd.render.colours import stress_limits
from fmd.scene.stress_outputs import Plies
from fmd.stages.pipeline import Pipeline

_COLUMNS = {
    **{f"stress_{c}_{end}_pa": f"{c} {end}" for c in PLY_STRESSES for end in ("max", "min")},
    "maximum_stress_index": "maximum stress",
    "tsai_hill_index": "Tsai-Hill",
}


def write_plies(run: Pipeline, output: Plies, folder: Path) -> list[str]:
    """Write the extremes of each ply at its faces over elements and times, and where Tsai and Hill's index is most."""
    rows = []
    for number, found in enumerate(find_plies(run, output.body), start=1):
        for k, ply in enumerate(found.laminate.plies):
            for side, face in enumerate(("lower", "upper")):
                own = {column: found.values[name][:, k, side] for column, name in _COLUMNS.items()}
                extremes = [values.min() if "_min_" in column else values.max() for column, values in own.items()]
                known = np.isfinite(own["tsai_hill_index"]).all()
                worst = int(own["tsai_hill_index" if known else "stress_11_max_pa"].argmax())
                name = "Tsai-Hill" if known else "11 max"
                time = run.motion.times[found.frames[name][worst, k, side]]
                element, x = _place(run, output.body, found, worst)
                figures = next(number_texts(np.array([[np.degrees(ply.angle), *extremes, time, *x]])))
                rows.append([str(number), str(k + 1), face, ply.name, *figures, str(element)])
    header = ["laminate", "ply", "face", "material", "angle_deg", *_COLUMNS, "at_s", "x_m", "y_m", "z_m", "element"]
    write_table(folder / output.file, header, rows)
    stated = VariableErrors(run)
    errors: list[tuple[str, str, float | str]] = []
    for column, name in _COLUMNS.items():
        across = name.startswith(("23", "13"))
        error = NOT_STATED + ACROSS if across else stated.of_quantity(ply_row(output.body, name))
        errors.append((column, "Pa" if column.endswith("_pa") else "1", error))
    return [output.file, write_errors(errors, folder / output.file)]


def draw_plies(run: Pipeline, output: Plies, folder: Path, draw: Drawer = draw_here) -> None:
    """Draw the largest index of all plies at any time, the worst element's labelled."""
    part = run.wholes[output.body]
    nodal = np.zeros(len(part.space.x))
    for found in find_plies(run, output.body):
        own = _require_indices(run, output, found).max(axis=(1, 2))
        shells = shells_of(part.space)
        np.maximum.at(nodal, shells.first + shells.space.element_nodes[found.elements], own[:, None])
    values = nodal[part.surface.nodes]
    worst = summarise_plies(run, output)["plies"][output.body][output.index]
    ply = f"ply {worst['ply']} ({worst['material']}, {worst['angle_deg']:.3g}°), {worst['face']} face"
    draw(
        "pictures.draw_field",
        body_surface(run, output.body),
        values,
        folder / output.file,
        title=output.title or f"{run.scene.title}: {output.index} index of the worst ply at any time",
        quantity=f"{output.index} index",
        limits=stress_limits(values),
        weights=values,
        label=f"{worst['value']:.3g} in {ply}, at {1e3 * worst['time_s']:.4g} ms",
        camera=camera_of(run, output),
    )


def find_plies(run: Pipeline, body: str) -> list[PlyExtremes]:
    """Return the extremes of a body's laminates over the first run's motion, found once.

    Raises
    ------
    InputError
        The body has no layers, is in pieces, or is touched.
    """
    key = f"plies {body}"
    if key not in run.results:
        part, motion = run.wholes[body], run.motion
        mend = None
        if body not in run.parts:
            mend = "is in pieces, and the stress of plies is that of bodies in one piece; pieces = 1"
        elif not has_plies(part):
            mend = "has no layers, whose plies have stress of their own; type = 'envelope' is of every body"
        elif run.contact_deformation(body, motion) is not None:
            mend = "is touched, and what contacts deform isn't in the stress of plies"
        if mend is not None:
            raise InputError(run.scene.file, f"body.{body}", None, mend)
        run.results[key] = extremes_of_laminates(
            part.space, part.material, part.body.shapes, motion.modal(body), part.shape
        )
    found: list[PlyExtremes] = run.results[key]
    return found


def _require_indices(run: Pipeline, output: Plies, found: PlyExtremes) -> Array:
    """Return an output's index, (n_elements, n_plies, 2), which all plies must have."""
    index = found.values[output.index]
    for k, ply in enumerate(found.laminate.plies):
        if np.isnan(index[:, k]).any():
            problem = "is missing: failure indices take Xt, Xc, Yt, Yc and S of each ply"
            raise InputError(run.scene.file, f"body.{output.body}.lamina.{ply.name}.strength", None, problem)
    return index


def _place(run: Pipeline, body: str, found: PlyExtremes, place: int) -> tuple[int, Array]:
    """Return the body's number of an element, and its middle in the part's own coordinates, shape (3,) [m]."""
    own, element = shells_of(run.wholes[body].space), int(found.elements[place])
    return own.first_element + element, own.space.x[own.space.element_nodes[element]].mean(axis=0)


def summarise_plies(run: Pipeline, output: Plies) -> dict[str, dict[str, Any]]:
    """Return the worst ply of a body by each failure index, of those with strengths."""
    worst: dict[str, Any] = {}
    for found in find_plies(run, output.body):
        for name in FAILURE_INDICES:
            index = found.values[name]
            if np.isnan(index).all():
                continue
            place, k, side = (int(each) for each in np.unravel_index(np.nanargmax(index), index.shape))
            value, ply = float(index[place, k, side]), found.laminate.plies[k]
            if value > worst.get(name, {"value": -1.0})["value"]:
                element, x = _place(run, output.body, found, place)
                worst[name] = {
                    "value": value,
                    "ply": k + 1,
                    "face": ("lower", "upper")[side],
                    "material": ply.name,
                    "angle_deg": float(np.degrees(ply.angle)),
                    "time_s": float(run.motion.times[found.frames[name][place, k, side]]),
                    "element": element,
                    "position_m": x.tolist(),
                }
    return {"plies": {output.body: worst}}


KINDS = {"plies": OutputKind(draw_plies, write_plies, reads=read_body("body", "surface"), summarise=summarise_plies)}
