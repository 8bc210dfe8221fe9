"""One Gmsh model at a time: silent, on one thread, read out as arrays and always closed."""

import signal
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

_SEWN = 1e-4  # gap between faces over the part's diagonal


class MeshArrays(NamedTuple):
    """A mesh as plain arrays with named parts and faces."""

    points: NDArray[np.float64]  # (n_points, 3): positions [m]
    cells: NDArray[np.int64]  # (n_cells, n_corners): point numbers of each cell in meshio's (VTK's) order
    cell_type: str  # meshio's name of the cells: ``tetra`` or ``hexahedron``
    parts: dict[str, NDArray[np.int64]]  # cell numbers of each named part
    faces: dict[str, NDArray[np.int64]]  # point numbers on each named face
    sectors: int = 1  # number of equal sectors around the z axis; 1 if the mesh is not cyclic


@contextmanager
def gmsh_model(name: str) -> Iterator[Any]:
    """Yield the ``gmsh`` module with an empty model, on one thread so that meshes are reproducible."""
    import gmsh

    gmsh.initialize(["gmsh", "-nt", "1"], readConfigFiles=False, interruptible=False)
    if hasattr(signal, "SIGPIPE") and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGPIPE, signal.SIG_IGN)  # Gmsh has a broken pipe end the process
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.RandomSeed", 1)
        gmsh.model.add(name)
        yield gmsh
    finally:
        gmsh.finalize()


def import_cad(gmsh: Any, path: Path) -> list[tuple[int, int]]:
    """Import a CAD file into the current model, in metres, and return its entities by dimension and tag.

    IGES holds loose faces; those that meet are sewn to solids.
    """
    gmsh.option.setString("Geometry.OCCTargetUnit", "M")
    iges = path.suffix.lower() in (".iges", ".igs")
    if iges:  # OpenCASCADE knows the unit's name only once it has dealt with STEP
        name = gmsh.model.getCurrent()
        gmsh.model.add("unit")
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        with tempfile.TemporaryDirectory(prefix="fmd-") as folder:
            gmsh.write(str(Path(folder) / "unit.step"))
        gmsh.model.remove()
        gmsh.model.setCurrent(name)
    entities = list(gmsh.model.occ.importShapes(str(path)))
    gmsh.model.occ.synchronize()
    if iges and not gmsh.model.getEntities(3):
        box = np.array(gmsh.model.getBoundingBox(-1, -1))
        gmsh.model.occ.healShapes([], _SEWN * float(np.linalg.norm(box[3:] - box[:3])))
        gmsh.model.occ.synchronize()
        entities = list(gmsh.model.getEntities(3)) or entities
    return entities


def read_out(gmsh: Any, faces: Mapping[str, Sequence[int]]) -> MeshArrays:
    """Read the volume mesh of the current model of `gmsh_model`, after ``mesh.generate(3)``, out of Gmsh.

    Faces have names and surface tags; each named physical volume is a part.
    """
    tags, xyz, _ = gmsh.model.mesh.getNodes()
    number = np.full(int(tags.max()) + 1, -1, dtype=np.int64)
    number[tags] = np.arange(tags.size)
    parts: dict[str, NDArray[np.int64]] = {}
    blocks: list[NDArray[np.int64]] = []
    cell_type, n_cells = "", 0
    for dimension, group in gmsh.model.getPhysicalGroups(3):
        part_blocks = []
        for entity in gmsh.model.getEntitiesForPhysicalGroup(dimension, group):
            types, _, nodes = gmsh.model.mesh.getElements(3, entity)
            for element_type, element_nodes in zip(types, nodes, strict=True):
                cell_type = {4: "tetra", 5: "hexahedron"}[int(element_type)]
                n_corners = gmsh.model.mesh.getElementProperties(element_type)[3]
                part_blocks.append(number[element_nodes].reshape(-1, n_corners))
        n_part = sum(len(block) for block in part_blocks)
        parts[gmsh.model.getPhysicalName(dimension, group)] = np.arange(n_cells, n_cells + n_part)
        n_cells += n_part
        blocks += part_blocks
    used, cells = np.unique(np.concatenate(blocks), return_inverse=True)  # an arc's centre is a node of no cell
    number = np.full(len(number), -1, dtype=np.int64)
    number[tags[used]] = np.arange(used.size)
    named = {
        name: np.unique(
            np.concatenate([number[gmsh.model.mesh.getNodes(2, tag, includeBoundary=True)[0]] for tag in surfaces])
        )
        for name, surfaces in faces.items()
    }
    return MeshArrays(xyz.reshape(-1, 3)[used], cells.reshape(-1, blocks[0].shape[1]), cell_type, parts, named)
