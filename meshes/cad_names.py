"""Solids and faces of a CAD file as Gmsh imports them, and their names: labels, colours, names in STEP."""

import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from fmd.meshes.cad_script import SUFFIX as SCRIPT
from fmd.meshes.cad_script import run_script
from fmd.meshes.gmsh_session import import_cad

Names = dict[tuple[int, int], list[str]]
"""Names of entities by dimension and tag."""

_SURFACES = {
    "PLANE": "Plane",
    "CYLINDRICAL_SURFACE": "Cylinder",
    "CONICAL_SURFACE": "Cone",
    "SPHERICAL_SURFACE": "Sphere",
    "TOROIDAL_SURFACE": "Torus",
}


def import_entities(
    gmsh: Any, path: Path, dimension: int, values: Mapping[str, float] = MappingProxyType({})
) -> list[tuple[int, int]]:
    """Import a CAD file with its labels into the current model, and return its entities of a dimension.

    A script is run with values of its parameters.
    """
    if path.suffix.lower() == SCRIPT:
        run_script(gmsh, path, values)
        return [(each, tag) for each, tag in gmsh.model.getEntities(dimension)]
    gmsh.option.setNumber("Geometry.OCCImportLabels", 1)
    return [entity for entity in import_cad(gmsh, path) if entity[0] == dimension]


def name_pieces(gmsh: Any, path: Path, entities: list[tuple[int, int]]) -> Names:
    """Cut solids or surfaces along one another if they are several, and return the names of all entities."""
    names = names_of_entities(gmsh, path)
    return _fragment(gmsh, entities, names) if len(entities) > 1 else names


def names_of_entities(gmsh: Any, path: Path) -> Names:
    """Return the names of each solid and face: the end of its label, its colour, its name in STEP or in a script."""
    names: Names = {}
    for entity in [*gmsh.model.getEntities(2), *gmsh.model.getEntities(3)]:
        own = []
        label = gmsh.model.getEntityName(*entity).rpartition("/")[2].strip()
        if label and "STEP translator" not in label:
            own.append(label)
        colour = gmsh.model.getColor(*entity)
        if entity[0] == 2 and tuple(colour) != (0, 0, 255, 0):
            own.append("#{:02x}{:02x}{:02x}".format(*colour[:3]))
        groups = gmsh.model.getPhysicalGroupsForEntity(*entity)
        own += filter(None, (gmsh.model.getPhysicalName(entity[0], group) for group in groups))
        names[entity] = own
    if path.suffix.lower() not in (".step", ".stp"):
        return names
    text = re.sub(r"\s*\n\s*", "", path.read_text(encoding="utf-8", errors="replace"))
    solids, bodies = gmsh.model.getEntities(3), re.findall(r"MANIFOLD_SOLID_BREP\s*\(\s*'([^']*)'", text)
    if len(solids) == len(bodies):
        for solid, name in zip(solids, bodies, strict=True):
            names[solid] += [name.strip()] if name.strip() else []
    faces, given = gmsh.model.getEntities(2), _step_faces(text)
    kinds = [gmsh.model.getType(*face) for face in faces]
    # Gmsh keeps the file's order of faces. STEP's names are used only if the types of surface agree.
    if len(given) == len(faces) and all(kind in (None, k) for (_, kind), k in zip(given, kinds, strict=True)):
        for face, (name, _) in zip(faces, given, strict=True):
            if name and name not in names[face]:
                names[face].append(name)
    return names


def _step_faces(text: str) -> list[tuple[str, str | None]]:
    """Return name and type of surface of each face, shell by shell; ``None`` for free-form surfaces."""
    entity = dict(re.findall(r"#(\d+)\s*=\s*([A-Z_0-9]+\s*\([^;]*\))\s*;", text))
    faces: list[tuple[str, str | None]] = []
    for shell in entity.values():
        if not re.match(r"(CLOSED|OPEN)_SHELL", shell):
            continue
        for number in re.findall(r"#(\d+)", shell):
            face = re.match(r"ADVANCED_FACE\s*\(\s*'([^']*)'.*#(\d+)\s*,[^#]*\)$", entity.get(number, ""))
            if face is None:
                return []
            surface = re.match(r"[A-Z_]+", entity.get(face[2], "?"))
            faces.append((face[1].strip(), _SURFACES.get(surface[0]) if surface else None))
    return faces


def _fragment(gmsh: Any, entities: list[tuple[int, int]], names: Names) -> Names:
    """Cut solids or surfaces along one another so that they share faces or edges; pieces keep their names."""
    named = [entity for entity, own in names.items() if entity[0] == 2 and own]
    _, pieces = gmsh.model.occ.fragment(entities, named)
    gmsh.model.occ.synchronize()
    kept: Names = {}
    for entity, into in zip([*entities, *named], pieces, strict=True):
        for piece in into:
            kept[piece] = list(dict.fromkeys(kept.get(piece, []) + names[entity]))
    return kept
