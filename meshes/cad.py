"""Mesher of CAD files, whose `main` is run in a process of its own.

Gmsh's OpenCASCADE may crash on a damaged file or never return; a separate process can be stopped.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fmd.meshes.cad_child import CadError, end_after, report
from fmd.meshes.cad_mesh import CadMesh, save
from fmd.meshes.cad_midsurface import replace_by_midsurface
from fmd.meshes.cad_morph import carry_nodes
from fmd.meshes.cad_names import Names, import_entities, name_pieces, names_of_entities
from fmd.meshes.cad_places import describe_part, find_centre, name_faces_by_place, name_of_face
from fmd.meshes.gmsh_session import gmsh_model

SUFFIXES = (".step", ".stp", ".iges", ".igs", ".brep")
_MOST_ELEMENTS = 3_000_000
_AROUND = 12  # elements around a full circle, at least
_TURNED = 1e-4  # distance between centres of faces that one turn carries into each other, of that between the faces
# Gmsh's numbers of tetrahedra and triangles of an order, and their nodes: the tetrahedron's in VTK's order.
_TETRAHEDRA = {1: (4, [0, 1, 2, 3]), 2: (11, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8])}
_TRIANGLES = {1: (2, 3), 2: (9, 6)}
_POWERS = np.array([2, 1, 1, 1])  # of the unit of length, in a face's area and centre


class ScriptValues(NamedTuple):
    """Unit of a script of Gmsh, and dimensions in this unit by the names of its parameters."""

    unit: float = 1.0  # [m]
    values: Mapping[str, float] = MappingProxyType({})  # dimensions that the part has
    made_at: Mapping[str, float] = MappingProxyType({})  # dimensions at which it is meshed; nodes are carried to values


def mesh_cad(
    path: Path,
    size: float,
    order: int,
    begin: Callable[[float], None] = lambda elements: None,
    sector: tuple[int, str, str] | None = None,
    script: ScriptValues | None = None,
) -> CadMesh:
    """Mesh the solids in a CAD file (STEP, IGES, BREP, or a script of Gmsh); solids that touch share their nodes.

    Edges have a size [m], smaller around bores and fillets, and order 1, or 2 to follow curved faces. ``begin`` is
    called with the number of elements that are expected, before the mesh is made. A sector has the number of those
    around z in the whole body, and the names of two faces of this one that a turn carries into each other; they are
    meshed alike. A script has its unit and dimensions.

    Raises
    ------
    CadError
        The file has no solid or no such faces, the size would give too many elements, or the nodes of a mesh can't be
        carried to other dimensions.
    """
    given = script or ScriptValues()
    unit, size = given.unit, size / given.unit
    with gmsh_model("cad") as gmsh:
        names, whole = _open(gmsh, path, given.made_at)
        expected = _volume(gmsh) / (0.117851 * size**3)  # volume of the regular tetrahedron of unit edge
        _require_few(expected, size * unit)
        _set_options(
            gmsh,
            MeshSizeMax=size,
            MeshSizeMin=0.2 * size,  # smallest element by curvature over the given size
            MeshSizeFromCurvature=_AROUND,
            ElementOrder=order,
            HighOrderOptimize=1,
        )
        area = sum(gmsh.model.occ.getMass(2, tag) for tag in whole)
        begin(expected + area / size**2)
        if sector is not None:
            _mesh_alike(gmsh, sector[0], [_surfaces_named(names, whole, name) for name in sector[1:]])
        gmsh.model.mesh.generate(3)
        mesh, place = _read_out(gmsh, order, names, whole)
        points = mesh.points
        if given.values != given.made_at:
            gmsh.model.add("changed")
            _open(gmsh, path, given.values)
            points = carry_nodes(gmsh, "cad", "changed", points, mesh.cells, place)
            gmsh.model.setCurrent("changed")
        centres = {name: x * unit**_POWERS for name, x in _find_centres(gmsh, names, whole).items()}
        return mesh._replace(points=unit * points, centres=centres, volume=unit**3 * _volume(gmsh))


def mesh_sheet(
    path: Path, size: float, thickness: float, target: Path, begin: Callable[[float], None] = lambda elements: None
) -> None:
    """Mesh the surfaces in a CAD file, or the midsurface of its solid, with quadrilaterals, and write Gmsh's own file.

    Surfaces that touch share nodes. Edges have a size [m], smaller where curves are round, a solid's walls a thickness
    [m]. Physical groups are the surfaces, by number ``face-1`` …, name and colour, and the curves that bound one
    surface alone, ``edge-1`` …. Beside the ``.msh`` file is a ``.json`` of a solid, as `_replace_solid` returns.
    ``begin`` is as in `mesh_cad`.

    Raises
    ------
    CadError
        The file has no surface, a solid with other walls, or the size would give too many elements.
    """
    with gmsh_model("cad") as gmsh:
        surfaces = import_entities(gmsh, path, 2)
        if gmsh.model.getEntities(3):
            if surfaces:
                raise CadError("it has solids beside surfaces; export one of them")
            solid = _replace_solid(gmsh, path, thickness)
            target.with_suffix(".json").write_text(json.dumps(solid), encoding="utf-8")
        elif not surfaces:
            raise CadError("there is no surface in it")
        names = name_pieces(gmsh, path, surfaces) if surfaces else {}
        expected = sum(gmsh.model.occ.getMass(2, tag) for _, tag in gmsh.model.getEntities(2)) / size**2
        _require_few(expected, size)
        _group_sheet(gmsh, names)
        _set_options(
            gmsh,
            MeshSizeMax=2 * size,  # each element is divided by four
            MeshSizeFromCurvature=_AROUND / 2,
            RecombineAll=1,
            SubdivisionAlgorithm=1,
            MshFileVersion=4.1,
        )
        begin(expected)
        gmsh.model.mesh.generate(2)
        gmsh.write(str(target))


def _replace_solid(gmsh: Any, path: Path, thickness: float) -> dict[str, Any]:
    """Replace a solid by its midsurface; return its ``volume`` [m³] and names of faces that aren't in it, ``lost``."""
    names = names_of_entities(gmsh, path)
    whole = _name_by_place(gmsh, names)
    try:
        volume, lost = replace_by_midsurface(gmsh, thickness)
    except ValueError as error:
        raise CadError(str(error)) from error
    return {"volume": volume, "lost": list(dict.fromkeys(name_of_face(tag, whole, names) for tag in lost))}


def _require_few(expected: float, size: float) -> None:
    if expected > _MOST_ELEMENTS:
        raise CadError(f"a size of {size:g} m gives about {expected:.1e} elements; {_MOST_ELEMENTS:.0e} are the most")


def _set_options(gmsh: Any, **values: float) -> None:
    """Set options of Gmsh's mesher."""
    for option, value in values.items():
        gmsh.option.setNumber(f"Mesh.{option}", value)


def _group_sheet(gmsh: Any, names: Names) -> None:
    """Make physical groups of surfaces and of the curves at their rims."""
    groups: dict[tuple[int, str], list[int]] = {}
    for number, (_, tag) in enumerate(gmsh.model.getEntities(2), start=1):
        for name in dict.fromkeys([f"face-{number}", *names.get((2, tag), [])]):
            groups.setdefault((2, name), []).append(tag)
    rims = [tag for _, tag in gmsh.model.getEntities(1) if len(gmsh.model.getAdjacencies(1, tag)[0]) == 1]
    groups |= {(1, f"edge-{number}"): [tag] for number, tag in enumerate(rims, start=1)}
    for (dimension, name), tags in groups.items():
        gmsh.model.addPhysicalGroup(dimension, tags, name=name)


def _surfaces_named(names: Names, whole: Mapping[int, int], name: str) -> list[int]:
    """Return the surfaces of a face's name, in which upper and lower case may differ."""
    of = {tag: [f"face-{number}", *names.get((2, tag), [])] for tag, number in whole.items()}
    found = [tag for tag, own in of.items() if name.casefold() in map(str.casefold, own)]
    if not found:
        known = ", ".join(dict.fromkeys(each for own in of.values() for each in own))
        raise CadError(f"no face is named {name!r}, as mesh.cuts wants; the faces: {known}")
    return found


def _mesh_alike(gmsh: Any, count: int, cuts: Sequence[Sequence[int]]) -> None:
    """Have the surfaces of one cut of a sector meshed as those of the other one that they are turned onto."""
    angle = 2 * np.pi / count
    centres = [np.array([gmsh.model.occ.getCenterOfMass(2, tag) for tag in cut]) for cut in cuts]
    extent = float(np.ptp(np.concatenate(centres), axis=0).max())
    apart = []
    for turn in (angle, -angle):
        c, s = np.cos(turn), np.sin(turn)
        away = np.linalg.norm(
            (centres[0] @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]))[:, None] - centres[1][None], axis=2
        )
        images = away.argmin(axis=1)
        apart.append(float(away.min(axis=1).max()))
        if len(cuts[0]) == len(cuts[1]) == len({*images.tolist()}) and apart[-1] < _TURNED * extent:
            onto = [cuts[1][k] for k in images]
            gmsh.model.mesh.setPeriodic(2, onto, list(cuts[0]), [c, -s, 0, 0, s, c, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1])
            return
    raise CadError(
        f"a turn by {np.degrees(angle):.6g} degrees about z doesn't carry one of mesh.cuts onto the other: centres of "
        f"their faces are up to {min(apart):.3g} m apart then"
    )


def describe_cad(path: Path) -> dict[str, Any]:
    """Describe the part in a CAD file as `describe_part`; raises ``CadError`` if the file has no solid."""
    with gmsh_model("cad") as gmsh:
        names, whole = _open(gmsh, path)
        return describe_part(gmsh, whole, names)


def _open(gmsh: Any, path: Path, values: Mapping[str, float] = MappingProxyType({})) -> tuple[Names, dict[int, int]]:
    """Open a CAD file as the current model, and return the names of its entities and the face of each surface."""
    solids = import_entities(gmsh, path, 3, values)
    if not solids:
        raise CadError("there is no solid in it; export the part as a solid, not as surfaces")
    names = name_pieces(gmsh, path, solids)
    return names, _name_by_place(gmsh, names)


def _name_by_place(gmsh: Any, names: Names) -> dict[int, int]:
    """Add names by their places to those of faces, and return the face of each surface."""
    whole = whole_faces(gmsh)
    taken = {name for own in names.values() for name in own}
    for tag, name in name_faces_by_place(gmsh, whole).items():
        if name not in taken:
            names.setdefault((2, tag), []).append(name)
    return whole


def _volume(gmsh: Any) -> float:
    return float(sum(gmsh.model.occ.getMass(3, tag) for _, tag in gmsh.model.getEntities(3)))


def _read_out(gmsh: Any, order: int, names: Names, whole: Mapping[int, int]) -> tuple[CadMesh, NDArray[np.int64]]:
    """Read the current model's mesh out of Gmsh, without centres and volume, and the number of each node's point."""
    tags, xyz, _ = gmsh.model.mesh.getNodes()
    place = np.full(int(tags.max()) + 1, -1, dtype=np.int64)
    place[tags] = np.arange(tags.size)
    (tetrahedron, own_order), (triangle, n_around) = _TETRAHEDRA[order], _TRIANGLES[order]
    blocks: list[NDArray[np.int64]] = []
    parts: dict[str, NDArray[np.int64]] = {}
    done = 0
    for k, (_, tag) in enumerate(gmsh.model.getEntities(3)):
        nodes = gmsh.model.mesh.getElementsByType(tetrahedron, tag)[1]
        blocks.append(place[nodes].reshape(-1, len(own_order))[:, own_order])
        name = next(iter(names.get((3, tag), [])), f"solid-{k + 1}")
        parts[name if name not in parts else f"{name}-{k + 1}"] = np.arange(done, done + len(blocks[-1]))
        done += len(blocks[-1])
    faces: dict[str, list[NDArray[np.int64]]] = {}
    for name, surfaces in _surfaces_by_name(gmsh, names, whole).items():
        for tag in surfaces:
            nodes = gmsh.model.mesh.getElementsByType(triangle, tag)[1]
            faces.setdefault(name, []).append(np.sort(place[nodes].reshape(-1, n_around)[:, :3], axis=1))
    joined = {name: np.concatenate(rows) for name, rows in faces.items()}
    return CadMesh(xyz.reshape(-1, 3), np.concatenate(blocks), parts, joined, {}, 0.0), place


def _surfaces_by_name(gmsh: Any, names: Names, whole: Mapping[int, int]) -> dict[str, list[int]]:
    surfaces: dict[str, list[int]] = {}
    for _, tag in gmsh.model.getEntities(2):
        for name in [f"face-{whole[tag]}", *names.get((2, tag), [])]:
            surfaces.setdefault(name, []).append(tag)
    return surfaces


def _find_centres(gmsh: Any, names: Names, whole: Mapping[int, int]) -> dict[str, NDArray[np.float64]]:
    found = _surfaces_by_name(gmsh, names, whole)
    return {name: np.array(find_centre(gmsh, tags)) for name, tags in found.items()}


def whole_faces(gmsh: Any) -> dict[int, int]:
    """Return the face of each surface, joining the halves of a bore that many CAD programs write."""
    first = {tag: tag for _, tag in gmsh.model.getEntities(2)}
    kinds = {tag: gmsh.model.getType(2, tag) for tag in first}
    for _, curve in gmsh.model.getEntities(1):
        beside = [int(tag) for tag in gmsh.model.getAdjacencies(1, curve)[0] if int(tag) in first]
        if len(beside) != 2 or kinds[beside[0]] != kinds[beside[1]] or kinds[beside[0]] == "Plane":
            continue
        low, high = gmsh.model.getParametrizationBounds(1, curve)
        x = gmsh.model.getValue(1, curve, [(low[0] + high[0]) / 2])
        a, b = (gmsh.model.getNormal(tag, gmsh.model.getParametrization(2, tag, x)) for tag in beside)
        if abs(float(np.dot(a, b))) > 0.9999:  # cosine between normals
            one, other = sorted(first[tag] for tag in beside)
            first = {tag: one if number == other else number for tag, number in first.items()}
    return first


def main(arguments: list[str]) -> str | None:
    """Mesh a CAD file, or describe it; return an error message or ``None``.

    Arguments are the file, the file to write, seconds for reading, seconds for meshing each element that is expected,
    and, to mesh it, a table in JSON: ``size`` [m] and ``order`` of the elements, or the ``thickness`` of a shell,
    ``sector`` and ``script`` as in `mesh_cad`. The system ends the process when that time is over, as on a damaged
    file.
    """
    source, target, reading, each, *wanted = arguments

    def begin(elements: float) -> None:
        end_after(float(reading) + float(each) * elements)

    def work() -> None:
        given = json.loads(wanted[0]) if wanted else {}
        if "thickness" in given:
            mesh_sheet(Path(source), given["size"], given["thickness"], Path(target), begin)
        elif given:
            sector, script = given.get("sector"), given.get("script")
            mesh = mesh_cad(
                Path(source),
                given["size"],
                given["order"],
                begin,
                tuple(sector) if sector else None,
                ScriptValues(*script) if script else None,
            )
            save(mesh, Path(target))
        else:
            Path(target).write_text(json.dumps(describe_cad(Path(source))), encoding="utf-8")

    begin(0.0)
    return report(work)
