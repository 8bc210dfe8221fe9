"""``fmd mesh``: the mesh of a part."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pipeline.cli.inputs import open_pipeline
from pipeline.cli.options import Json, NoCache, Repair, SceneName, Set, print_json
from pipeline.stages.pipeline import Pipeline


def mesh(
    scene: SceneName,
    *,
    out: Path | None = None,
    set_: Set = None,
    repair: Repair = False,
    no_cache: NoCache = False,
    json: Json = False,
) -> None:
    """Mesh alone: counts, volume, mass and the smallest scaled Jacobian.

    Parameters
    ----------
    out
        File to write the mesh to, in the format of its suffix: .vtu, .msh, .inp ...
    """
    pipeline = open_pipeline(scene, set_, no_cache, repair)
    if out is not None:
        from pipeline.fem.formats.export import write_mesh

        write_mesh(pipeline.mesh, out)
    figures = _figures(pipeline)
    if json:
        print_json(figures)
        return
    for key, value in figures.items():
        print(f"{key.replace('_', ' '):15s} {value}")


def _figures(pipeline: Pipeline) -> dict[str, Any]:
    """Return counts, sizes and quality of the first part's mesh, with units in the keys."""
    part, mesh = pipeline.part, pipeline.mesh
    return {
        "nodes": len(mesh.points),
        "elements": len(mesh.cells),
        "parts": {name: len(cells) for name, cells in mesh.parts.items()},
        "faces": list(mesh.faces),
        "element_type": mesh.cell_type,
        "order": part.order,
        "volume_m3": mesh.volume,
        "mass_kg": part.mass,
        "min_quality": float(mesh.quality.min()),
        "notes": list(mesh.notes),
    }
