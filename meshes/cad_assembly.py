"""Solids of a CAD file as parts of an assembly: names, volume, inertia, round faces, and a STEP file of each."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from fmd.meshes.cad import whole_faces
from fmd.meshes.cad_child import CadError, end_after, report
from fmd.meshes.cad_names import import_entities, names_of_entities
from fmd.meshes.cad_places import ROUND, look_at_cylinder
from fmd.meshes.gmsh_session import gmsh_model


def describe_assembly(path: Path, folder: Path) -> list[dict[str, Any]]:
    """Describe the solids of a CAD file where they stand, and write each to a STEP file of its own, ``0.step`` ….

    Each has ``name``, empty without one, ``volume`` [m³], ``centre`` [m], ``inertia`` about it for a density of 1 [m⁵],
    and ``cylinders``, each with ``what``, ``middle``, ``axis``, ``radius`` and ``length``.

    Raises
    ------
    CadError
        The file has no solid.
    """
    with gmsh_model("cad") as gmsh:
        solids = import_entities(gmsh, path, 3)
        if not solids:
            raise CadError("there is no solid in it; export the assembly as solids, not as surfaces")
        names, whole = names_of_entities(gmsh, path), whole_faces(gmsh)
        parts = [_describe(gmsh, tag, names.get((3, tag), []), whole) for _, tag in solids]
        gmsh.option.setNumber("Geometry.OCCExportOnlyVisible", 1)
        gmsh.model.setVisibility(gmsh.model.getEntities(), 0)
        for number, solid in enumerate(solids):
            gmsh.model.setVisibility([solid], 1, recursive=True)
            gmsh.write(str(folder / f"{number}.step"))
            gmsh.model.setVisibility([solid], 0, recursive=True)
    return parts


def _describe(gmsh: Any, tag: int, names: list[str], whole: dict[int, int]) -> dict[str, Any]:
    groups: dict[int, list[int]] = {}
    for _, surface in gmsh.model.getBoundary([(3, tag)], oriented=False):
        if gmsh.model.getType(2, surface) in ROUND:
            groups.setdefault(whole[surface], []).append(surface)
    found = [seen for tags in groups.values() if (seen := look_at_cylinder(gmsh, tags, [tag])) is not None]
    return {
        "name": next(iter(names), ""),
        "volume": gmsh.model.occ.getMass(3, tag),
        "centre": list(gmsh.model.occ.getCenterOfMass(3, tag)),
        "inertia": np.reshape(gmsh.model.occ.getMatrixOfInertia(3, tag), (3, 3)).tolist(),
        "cylinders": [seen._asdict() | {"middle": seen.middle.tolist(), "axis": seen.axis.tolist()} for seen in found],
    }


def main(arguments: list[str]) -> str | None:
    """Describe an assembly; return an error message or ``None``.

    Arguments are file, file to write, seconds for it, seconds for each element, of which there are none, and folder of
    the parts.
    """
    source, target, seconds, _, folder = arguments
    end_after(float(seconds))
    found = Path(target)
    return report(lambda: _write(describe_assembly(Path(source), Path(folder)), found))


def _write(parts: list[dict[str, Any]], target: Path) -> None:
    target.write_text(json.dumps(parts), encoding="utf-8")
