"""Envelope and fatigue of a body's surface over a motion: pictures, surfaces for ParaView, tables of worst nodes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.files import number_texts, write_table
from fmd.core.limits.shown import DECADES
from fmd.fem.surface import surface_normals
from fmd.output.mechanism_view import body_surface
from fmd.output.output_kinds import OutputKind, read_body
from fmd.output.views import camera_of
from fmd.recovery.fatigue import (
    FatigueLaw,
    FatigueLife,
    fatigue_by_critical_plane,
    fatigue_by_findley,
    fatigue_by_signed_von_mises,
)
from fmd.recovery.stress import StressHistory
from fmd.render.calls import Drawer, draw_here
from fmd.render.colours import stress_limits

if TYPE_CHECKING:
    from fmd.accuracy.error_budget import Budget
    from fmd.scene.stress_outputs import Envelope, Fatigue, SurfaceField
    from fmd.stages.pipeline import Pipeline

AnyField = TypeVar("AnyField", bound="SurfaceField")

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def write_envelope(run: Pipeline, output: Envelope, folder: Path) -> list[str]:
    """Write an envelope as a surface for ParaView, or as a table of the worst nodes, and return the file's name."""
    found = run.envelope_of(output.body)
    columns = {
        "largest_von_mises_pa": found.von_mises,
        "largest_von_mises_at_s": found.times[:, 0],
        "largest_principal_pa": found.principal_1,
        "largest_principal_at_s": found.times[:, 1],
        "smallest_principal_pa": found.principal_3,
        "smallest_principal_at_s": found.times[:, 2],
    }
    values, _ = found.measure(output.component)
    order = np.argsort(values if output.component == "principal 3" else -values, kind="stable")
    return _write_field(run, output, folder, columns, order[: output.count])


def draw_envelope(run: Pipeline, output: Envelope, folder: Path, draw: Drawer = draw_here) -> list[str]:
    """Draw an envelope, its worst value labelled with its time."""
    values, times = run.envelope_of(output.body).measure(output.component)
    weights = -values if output.component == "principal 3" else values
    worst = int(weights.argmax())
    low, high = stress_limits(values)
    name = {"von Mises": "largest von Mises stress", "principal 1": "largest principal stress"}
    quantity = name.get(output.component, "smallest principal stress")
    draw(
        "pictures.draw_field",
        body_surface(run, output.body),
        values * 1e-6,
        folder / output.file,
        title=output.title or f"{run.scene.title}: {quantity} at any time",
        quantity=f"{output.component} [MPa]",
        limits=(low * 1e-6, high * 1e-6),
        weights=weights - weights.min(),
        label=f"{_number(values[worst] * 1e-6)} MPa at {_number(1e3 * times[worst])} ms",
        camera=camera_of(run, _turned_round(output) if output.component == "principal 3" else output),
    )
    return [output.file]


def find_fatigue(run: Pipeline, output: Fatigue) -> FatigueLife:
    """Assess the fatigue that an output asks for: of the worst nodes, or of all down to a life that is as good as none.

    Outputs that ask for the same share it.
    """
    asked = output.model_dump_json(include={"body", "sn", "stress", "findley", "planes", "mean_stress", "count"})
    key = f"fatigue {asked} {_share(output)}"
    if key not in run.results:
        run.results[key] = _assess(run, output, run.stress_of(output.body), fatigue_law(output))
    found: FatigueLife = run.results[key]
    return found


def life_interval(run: Pipeline, output: Fatigue, error: float) -> list[float | None]:
    """Return the repeats to failure of the worst node, at least and at most, if stress is off by a share of itself.

    A stress that is off by less than a share e of the true one lies between ``1 − e`` and ``1 + e`` times that.
    """
    worst = find_fatigue(run, output).worst(1)
    lives = [life_at(run, output, worst, share) if share > 0.0 else 0.0 for share in (1.0 - error, 1.0 + error)]
    return [life if math.isfinite(life) else None for life in lives]


def life_at(run: Pipeline, output: Fatigue, place: IntArray, stronger: float = 1.0) -> float:
    """Return the repeats to failure of one node, shape (1,) among the surface's; infinite without damage.

    ``stronger`` is how many times as large a stress the material bears.
    """
    stress = run.stress_of(output.body)
    alone = StressHistory(stress.nodes[place], stress.modal[place], stress.times, stress.q)
    damage = float(_assess(run, output, alone, fatigue_law(output).stronger(stronger)).damage[0])
    return 1.0 / damage if damage > 0.0 else math.inf


def _assess(run: Pipeline, output: Fatigue, stress: StressHistory, law: FatigueLaw) -> FatigueLife:
    if output.stress == "signed von Mises":
        return fatigue_by_signed_von_mises(stress, law, output.count, _share(output))
    surface = run.wholes[output.body].surface
    normals = surface_normals(run.node_positions(output.body), surface)[np.isin(surface.nodes, stress.nodes)]
    assess = fatigue_by_findley if output.stress == "findley" else fatigue_by_critical_plane
    return assess(stress, normals, law, output.count, _share(output), output.planes)


def _share(output: Fatigue) -> float:
    """Part of the largest damage down to which that of all nodes is wanted."""
    return 1.0 if output.file.endswith(".csv") else 10.0**-DECADES


def fatigue_law(output: Fatigue) -> FatigueLaw:
    """Return the S–N curve and the correction for mean stress of an output."""
    sn, mean = output.sn, output.mean_stress
    beyond = sn.slope if sn.slope_beyond is None else math.inf if sn.slope_beyond == "infinite" else sn.slope_beyond
    correction, constant = "none", 0.0
    if mean is not None and mean.goodman is not None:
        correction, constant = "goodman", mean.goodman
    elif mean is not None and mean.fkm is not None:
        correction, constant = "fkm", mean.fkm
    return FatigueLaw(sn.amplitude, sn.cycles, sn.slope, float(beyond), correction, constant, output.findley)


def write_fatigue(run: Pipeline, output: Fatigue, folder: Path) -> list[str]:
    """Write lives as a surface for ParaView, or as a table of the worst nodes, and return the file's name."""
    found, duration = find_fatigue(run, output), float(np.ptp(run.motion.times))
    repeats = found.repeats
    columns = {"damage": np.maximum(found.damage, found.floor), "repeats_to_failure": repeats}
    columns |= {"life_s": repeats * duration, "largest_von_mises_pa": run.envelope_of(output.body).von_mises}
    if output.file.endswith(".vtu"):
        columns["log10_repeats_to_failure"] = np.log10(repeats)
    if len(found.normals):
        columns |= {f"plane_normal_{axis}": values for axis, values in zip("xyz", found.normals.T, strict=True)}
    return _write_field(run, output, folder, columns, found.worst(output.count))


def draw_fatigue(run: Pipeline, output: Fatigue, folder: Path, draw: Drawer = draw_here) -> list[str]:
    """Draw the lives of all nodes, short ones in warm colours, and label the shortest."""
    found = find_fatigue(run, output)
    lives = np.log10(found.repeats)
    worst = int(found.damage.argmax())
    endless = not found.damage[worst] > 0.0
    low = 0.0 if endless else math.floor(lives[worst])
    label = "no damage anywhere" if endless else f"{_number(found.repeats[worst])} repeats"
    draw(
        "pictures.draw_field",
        body_surface(run, output.body),
        np.zeros(len(lives)) + DECADES if endless else lives,
        folder / output.file,
        title=output.title or f"{run.scene.title}: life by {output.stress}",
        quantity="log₁₀ of the repeats to failure",
        limits=(low, low + DECADES),
        weights=np.ones(len(lives)) if endless else found.damage,
        label=label,
        camera=camera_of(run, _turned_round(output)),
    )
    return [output.file]


def _turned_round(output: AnyField) -> AnyField:
    """Return a picture whose colour map runs backwards: what is small and bad has the colours of high stress."""
    name = output.colour_map
    return output.model_copy(update={"colour_map": name.removesuffix("_r") if name.endswith("_r") else f"{name}_r"})


def summarise_envelope(run: Pipeline, output: Envelope) -> dict[str, dict[str, Any]]:
    """Return the worst node of an envelope by each measure."""
    found, worst = run.envelope_of(output.body), {}
    for name, sign in (("von Mises", 1), ("principal 1", 1), ("principal 3", -1)):
        values, times = found.measure(name)
        k = int((sign * values).argmax())
        worst[name] = {"value_pa": float(values[k]), "time_s": float(times[k]), **_place(run, output.body, k)}
    return {"envelope": {output.body: worst}}


def summarise_fatigue(run: Pipeline, output: Fatigue) -> dict[str, dict[str, Any]]:
    """Return the worst node of an assessment of fatigue."""
    life = find_fatigue(run, output)
    k = int(life.damage.argmax())
    repeats = 1.0 / float(life.damage[k]) if life.damage[k] > 0.0 else None
    worst = {
        "body": output.body,
        "damage": float(life.damage[k]),
        "repeats_to_failure": repeats,
        "repeats_interval": None,
        "why": "no error budget states the stress",
        "life_s": None if repeats is None else repeats * float(np.ptp(run.motion.times)),
        "nodes": len(life.nodes),
        "assessed_nodes": int(life.assessed.sum()),
        **_place(run, output.body, k),
    }
    return {"fatigue": {output.file: worst}}


def state_life(run: Pipeline, output: Fatigue, summary: dict[str, Any], budget: Budget) -> None:
    """State between what a life in a summary lies, by the error of the largest stress."""
    row = next((row for row in budget.rows if row.name == f"{output.body}, largest von Mises stress"), None)
    life = summary["fatigue"][output.file]
    if row is None or row.is_lower_bound:
        life["why"] = "the error of the largest stress is not whole"
        return
    life["repeats_interval"] = life_interval(run, output, row.total)
    del life["why"]


def _place(run: Pipeline, body: str, k: int) -> dict[str, Any]:
    """Return number and place of a surface's node, in the part's own coordinates."""
    node = int(run.wholes[body].surface.nodes[k])
    return {"node": node, "position_m": (_origin(run, body) + run.node_positions(body)[node]).tolist()}


def _origin(run: Pipeline, body: str) -> Array:
    """Return the place of a body's joint in the part's own coordinates, shape (3,) [m]."""
    return run.bodies[run.frame_of(body)].origin


def _write_field(
    run: Pipeline, output: Envelope | Fatigue, folder: Path, columns: dict[str, Array], worst: IntArray
) -> list[str]:
    """Write columns of values at a surface's nodes: all as a mesh, or some as a table."""
    surface, file = run.wholes[output.body].surface, output.file
    points = (_origin(run, output.body) + run.node_positions(output.body))[surface.nodes]
    if file.endswith(".vtu"):
        from fmd.fem.formats.export import write_surface

        write_surface(points, surface.triangles, columns | {"node": surface.nodes.astype(float)}, folder / file)
        return [file]
    header = ["node", "x_m", "y_m", "z_m", *columns]
    table = np.column_stack([points, *columns.values()])
    numbers = number_texts(table[worst])
    write_table(folder / file, header, ([node, *row] for node, row in zip(surface.nodes[worst], numbers, strict=True)))
    return [file]


def _number(value: float) -> str:
    """Write a number in three digits, a large one by a power of ten."""
    if value and not 1e-3 <= abs(value) < 1e5:
        mantissa, _, exponent = f"{value:.2e}".partition("e")
        return f"{mantissa}·10{str(int(exponent)).translate(_RAISED)}".replace("-", "−")
    return f"{value:.3g}".replace("-", "−")


_READS = read_body("surface", "stress", "body")

KINDS = {
    "envelope": OutputKind(draw_envelope, write_envelope, reads=_READS, summarise=summarise_envelope),
    "fatigue": OutputKind(draw_fatigue, write_fatigue, reads=_READS, summarise=summarise_fatigue, state=state_life),
}
