"""Envelope and fatigue of a body's surface over a motion: pictures, surfaces for ParaView, tables of worst nodes."""

import math
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from fmd.accuracy.requested_stress import EXTREMES
from fmd.core.arrays import Array, IntArray
from fmd.core.files import number_texts, write_table
from fmd.core.limits.shown import DECADES
from fmd.fem.surface import surface_normals
from fmd.output.error_columns import NOT_STATED, write_errors
from fmd.output.mechanism_view import body_surface
from fmd.output.output_kinds import OutputKind, read_body
from fmd.output.pictures import camera_of
from fmd.output.variable_errors import VariableErrors
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
from fmd.scene.stress_outputs import Envelope, Fatigue, SurfaceField
from fmd.stages.pipeline import Pipeline

AnyField = TypeVar("AnyField", bound="SurfaceField")

_OF_LIVES = f"{NOT_STATED}a table (.csv) has an interval for each of the worst nodes"
_BY_INTERVAL = "columns repeats_at_least and repeats_at_most hold it"

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def write_envelope(run: Pipeline, output: Envelope, folder: Path) -> list[str]:
    """Write an envelope as a surface for ParaView, or as a table of the worst nodes, and its errors beside it.

    The error of an extreme is that of the largest, or smallest, on the body.
    """
    found, stated = run.envelope_of(output.body), VariableErrors(run)
    columns, errors = dict[str, Array](), list[tuple[str, str, float | str]]()
    for component, quantity in EXTREMES.items():
        values, times = found.measure(component)
        name = quantity.removesuffix(" stress").replace(" ", "_").lower()
        columns |= {f"{name}_pa": values, f"{name}_at_s": times}
        errors.append((f"{name}_pa", "Pa", stated.of_quantity(f"{output.body}, {quantity}")))
        errors.append((f"{name}_at_s", "s", f"{NOT_STATED}times of extremes aren't compared, their sizes are"))
    values, _ = found.measure(output.component)
    order = np.argsort(values if output.component == "principal 3" else -values, kind="stable")
    _write_field(run, output, folder, columns, order[: output.count])
    return [output.file, write_errors(errors, folder / output.file)]


def draw_envelope(run: Pipeline, output: Envelope, folder: Path, draw: Drawer = draw_here) -> None:
    """Draw an envelope, its worst value labelled with its time."""
    values, times = run.envelope_of(output.body).measure(output.component)
    weights = -values if output.component == "principal 3" else values
    worst = int(weights.argmax())
    low, high = stress_limits(values)
    quantity = EXTREMES[output.component]
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


def find_fatigue(run: Pipeline, output: Fatigue) -> FatigueLife:
    """Assess the fatigue that an output asks for: of the worst nodes, or of all down to a life that is as good as none.

    Outputs that ask for the same share it.
    """
    asked = output.model_dump_json(include={"body", "sn", "stress", "findley", "planes", "mean_stress", "count"})
    key = f"fatigue {asked} {_share(output)}"
    if key not in run.results:
        run.results[key] = _assess(run, output, run.at_vibrations.stress_of(output.body), fatigue_law(output))
    found: FatigueLife = run.results[key]
    return found


def life_intervals(run: Pipeline, output: Fatigue, nodes: IntArray, error: float) -> Array:
    """Return the repeats to failure of nodes, at least and at most, if stress is off by a share of itself, (n, 2).

    A stress that is off by less than a share e of the true one lies between ``1 − e`` and ``1 + e`` times that. Nodes
    (n,) are places among those of the surface; without damage they bear infinitely many.
    """
    shares = (1.0 - error, 1.0 + error)
    lives = [lives_at(run, output, nodes, share) if share > 0.0 else np.zeros(len(nodes)) for share in shares]
    return np.column_stack(lives)


def lives_at(run: Pipeline, output: Fatigue, nodes: IntArray, stronger: float = 1.0) -> Array:
    """Return the repeats to failure of nodes by their places among those of the surface; infinite without damage.

    ``stronger`` is how many times as large a stress the material bears.
    """
    stress, order = run.at_vibrations.stress_of(output.body), np.argsort(nodes)
    places = nodes[order]
    alone = StressHistory(stress.nodes[places], stress.modal[places], stress.times, stress.q)
    damage = np.empty(len(nodes))
    damage[order] = _assess(run, output, alone, fatigue_law(output).stronger(stronger)).damage
    return np.asarray(np.divide(1.0, damage, out=np.full(len(nodes), math.inf), where=damage > 0.0))


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
    """Write lives as a surface for ParaView, or as a table of the worst nodes, and their errors beside it.

    The table has the lives' intervals, which follow from the error of the largest stress.
    """
    found, duration = find_fatigue(run, output), float(np.ptp(run.motion.times))
    repeats, worst = found.repeats, found.worst(output.count)
    columns = {"damage": np.maximum(found.damage, found.floor), "repeats_to_failure": repeats}
    stated, largest = VariableErrors(run), f"{output.body}, {EXTREMES['von Mises']}"
    share, of_life = stated.share_of_quantity(largest), _OF_LIVES
    if isinstance(share, str):
        of_life = share
    elif output.file.endswith(".csv"):
        ends = np.full((len(repeats), 2), np.nan)
        ends[worst] = life_intervals(run, output, worst, share)
        columns |= {"repeats_at_least": ends[:, 0], "repeats_at_most": ends[:, 1]}
        of_life = _BY_INTERVAL
    columns |= {"life_s": repeats * duration, "largest_von_mises_pa": run.envelope_of(output.body).von_mises}
    units = {"damage": "1", "repeats_to_failure": "1", "life_s": "s"}
    errors: list[tuple[str, str, float | str]] = [(name, unit, of_life) for name, unit in units.items()]
    errors.append(("largest_von_mises_pa", "Pa", stated.of_quantity(largest)))
    if output.file.endswith(".vtu"):
        columns["log10_repeats_to_failure"] = np.log10(repeats)
    if len(found.normals):
        columns |= {f"plane_normal_{axis}": values for axis, values in zip("xyz", found.normals.T, strict=True)}
    _write_field(run, output, folder, columns, worst)
    return [output.file, write_errors(errors, folder / output.file)]


def draw_fatigue(run: Pipeline, output: Fatigue, folder: Path, draw: Drawer = draw_here) -> None:
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
    share = VariableErrors(run).share_of_quantity(f"{output.body}, {EXTREMES['von Mises']}")
    interval = None if isinstance(share, str) else life_intervals(run, output, np.array([k]), share)[0].tolist()
    worst = {
        "body": output.body,
        "damage": float(life.damage[k]),
        "repeats_to_failure": repeats,
        "repeats_interval": interval and [life if math.isfinite(life) else None for life in interval],
        **({"why": f"error of the largest stress {share}"} if isinstance(share, str) else {}),
        "life_s": None if repeats is None else repeats * float(np.ptp(run.motion.times)),
        "nodes": len(life.nodes),
        "assessed_nodes": int(life.assessed.sum()),
        **_place(run, output.body, k),
    }
    return {"fatigue": {output.file: worst}}


def _place(run: Pipeline, body: str, k: int) -> dict[str, Any]:
    """Return number and place of a surface's node, in the part's own coordinates."""
    node = int(run.wholes[body].surface.nodes[k])
    return {"node": node, "position_m": (_origin(run, body) + run.node_positions(body)[node]).tolist()}


def _origin(run: Pipeline, body: str) -> Array:
    """Return the place of a body's joint in the part's own coordinates, shape (3,) [m]."""
    return run.bodies[run.frame_of(body)].origin


def _write_field(
    run: Pipeline, output: Envelope | Fatigue, folder: Path, columns: dict[str, Array], worst: IntArray
) -> None:
    """Write columns of values at a surface's nodes: all as a mesh, or some as a table."""
    surface, file = run.wholes[output.body].surface, output.file
    points = (_origin(run, output.body) + run.node_positions(output.body))[surface.nodes]
    if file.endswith(".vtu"):
        from fmd.fem.formats.export import write_surface

        write_surface(points, surface.triangles, columns | {"node": surface.nodes.astype(float)}, folder / file)
        return
    header = ["node", "x_m", "y_m", "z_m", *columns]
    table = np.column_stack([points, *columns.values()])
    numbers = number_texts(table[worst])
    write_table(folder / file, header, ([node, *row] for node, row in zip(surface.nodes[worst], numbers, strict=True)))


def _number(value: float) -> str:
    """Write a number in three digits, a large one by a power of ten."""
    if value and not 1e-3 <= abs(value) < 1e5:
        mantissa, _, exponent = f"{value:.2e}".partition("e")
        return f"{mantissa}·10{str(int(exponent)).translate(_RAISED)}".replace("-", "−")
    return f"{value:.3g}".replace("-", "−")


_READS = read_body("surface", "stress", "body")

KINDS = {
    "envelope": OutputKind(draw_envelope, write_envelope, reads=_READS, summarise=summarise_envelope),
    "fatigue": OutputKind(draw_fatigue, write_fatigue, reads=_READS, summarise=summarise_fatigue),
}
