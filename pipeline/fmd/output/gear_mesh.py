"""Static mesh of two spur gears as a chart, a table and figures with their errors by the mesh."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from fmd.contact.gear_pair import GearMeshAnswer, mesh_gears
from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.files import write_table
from fmd.core.html import scaled
from fmd.core.involute import GearPair
from fmd.core.limits.contact import COARSER_GEARS
from fmd.output.output_kinds import OutputKind, ResponseKind
from fmd.scene.gears import GearMesh, GearTeethMesh, find_pair
from fmd.scene.scene import Scene
from fmd.scene.variants import refine_meshes
from fmd.stages.pipeline import Pipeline

_NAMES = {
    "transmission_error_m": ("mean transmission error", "m"),
    "peak_to_peak_m": ("its variation", "m"),
    "mesh_stiffness_n_per_m": ("mean stiffness", "N/m"),
    "pair_stiffness_n_per_m": ("largest stiffness of one pair", "N/m"),
    "pinion_root_stress_pa": ("largest stress at the pinion's roots", "Pa"),
    "wheel_root_stress_pa": ("largest stress at the wheel's roots", "Pa"),
    "pressure_pa": ("largest pressure between flanks", "Pa"),
}

_TOO_COARSE = "errors of gears aren't stated: there are too few elements to compare with fewer; more of them help"


@dataclass(frozen=True)
class MeshedGears:
    """Two gears in mesh, and the same on coarser elements."""

    pair: GearPair
    load: float  # force along the line of action [N]
    fine: GearMeshAnswer
    coarse: GearMeshAnswer | None

    @property
    def figures(self) -> dict[str, float]:
        """Figures of the mesh, by their names in the summary."""
        return _figures(self.fine)

    @property
    def errors(self) -> dict[str, float | None]:
        """Errors of the figures: what coarser elements and half of the angles change, more than what is left."""
        if self.coarse is None:
            return dict.fromkeys(_NAMES)
        coarse, half = _figures(self.coarse), _figures(self.fine, every=2)
        return {name: abs(x - coarse[name]) + abs(x - half[name]) for name, x in self.figures.items()}

    @property
    def angle(self) -> Array:
        """Angle of the pinion since the last pair came into contact, shape (n,) [rad]."""
        return np.asarray((self.fine.s - self.pair.path[0]) / self.pair.pinion.base_radius)


def _figures(found: GearMeshAnswer, every: int = 1) -> dict[str, float]:
    """Return figures of all angles, or of every second one."""
    values = (
        found.error[::every].mean(),
        np.ptp(found.error[::every]),
        found.stiffness[::every].mean(),
        found.single[::every].max(),
        *found.root_stress[:, ::every].max(axis=(1, 2)),
        found.pressure[::every].max(),
    )
    return dict(zip(_NAMES, map(float, values), strict=True))


def compute_gear_mesh(run: Pipeline, output: GearMesh) -> MeshedGears:
    """Compute the static mesh of two gears, and the same with fewer elements each way."""
    names = output.pinion, output.wheel

    def mesh(of: Pipeline) -> tuple[GearPair, float, GearMeshAnswer]:
        pinion, _, pair = find_pair(*names, output.distance, of.scene.body)
        load, both = output.torque / pair.pinion.base_radius, [of.wholes[name].tooth_flexibility for name in names]
        return pair, load, mesh_gears(pair, both, pinion.width, load, output.points)

    def meshed(scene: Scene) -> list[GearTeethMesh]:
        return [gear.mesh for gear in find_pair(*names, output.distance, scene.body)[:2]]

    coarser = refine_meshes(run.scene, 1.0 / COARSER_GEARS)
    if coarser is None or any(x == y for x, y in zip(meshed(coarser), meshed(run.scene), strict=True)):
        return MeshedGears(*mesh(run), None)
    return MeshedGears(*mesh(run), mesh(run.variant(coarser))[2])


def write_gear_mesh(run: Pipeline, output: GearMesh, found: MeshedGears, folder: Path, chart: bool) -> dict[str, Any]:
    """Write the chart and the table of two gears in mesh; return their summary."""
    path, pair, mesh = folder / output.file, found.pair, found.fine
    table = path.with_suffix(".csv")
    pairs = range(mesh.forces.shape[1])
    header = ["pinion_angle_deg", "transmission_error_um", "stiffness_N_per_um"]
    header += [
        f"{name}_{k + 1}" for name in ("share", "pinion_root_MPa", "wheel_root_MPa", "pressure_MPa") for k in pairs
    ]
    columns = [np.degrees(found.angle), 1e6 * mesh.error, 1e-6 * mesh.stiffness]
    values = (mesh.forces / found.load, *(1e-6 * mesh.root_stress), 1e-6 * mesh.pressure)
    rows = np.column_stack([*columns, *values])
    write_table(table, header, ([f"{x:.9g}" for x in row] for row in rows))
    files = [table.name]
    if chart:
        from fmd.render.gear_chart import draw_gear_mesh

        title = output.title or f"{run.scene.title}: {output.pinion} and {output.wheel}, {scaled(output.torque, 'N m')}"
        draw_gear_mesh(np.degrees(found.angle), [*rows.T[1:]], pairs, path, title=title)
        files.insert(0, path.name)
    return {
        "contact_ratio": pair.contact_ratio,
        "distance_m": pair.distance,
        "working_pressure_angle_rad": pair.alpha,
        "backlash_m": pair.backlash,
        "load_n": found.load,
        **found.figures,
        "errors": found.errors,
        "warnings": [] if found.coarse else [_TOO_COARSE],
        "files": files,
    }


def tabulate_gear_mesh(summary: dict[str, Any]) -> dict[str, Any]:
    """Return the table of the figures of two gears in mesh."""
    rows = [(name, *_with_error(summary, key, unit)) for key, (name, unit) in _NAMES.items()]
    return {"header": ("figure", "value", "error by mesh and angles"), "rows": rows}


def describe_gear_mesh(summary: dict[str, Any]) -> list[str]:
    """Return the lines that a run writes of two gears in mesh."""
    first = (
        f"{summary['files'][0]}: contact ratio {summary['contact_ratio']:.4g}, load {scaled(summary['load_n'], 'N')}"
    )
    lines = [f"{name} {' ± '.join(_with_error(summary, key, unit))}" for key, (name, unit) in _NAMES.items()]
    return [first, *(", ".join(lines[k : k + 2]) for k in range(0, len(lines), 2))]


def _with_error(summary: dict[str, Any], key: str, unit: str) -> tuple[str, str]:
    error = summary["errors"][key]
    return scaled(summary[key], unit), "not stated" if error is None else scaled(error, unit, 3)


def _read(_run: Pipeline, output: GearMesh) -> Iterator[tuple[str, str]]:
    """Iterate over the stages of both gears."""
    for body in (output.pinion, output.wheel):
        yield from ((stage, body) for stage in ("mesh", "assembly", "teeth"))


KINDS = {
    "gear-mesh": OutputKind(
        response=ResponseKind(compute_gear_mesh, write_gear_mesh, tabulate_gear_mesh, describe_gear_mesh),
        reads=_read,
        charted=True,
    )
}
