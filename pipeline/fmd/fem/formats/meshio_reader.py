"""Reader of meshio's formats in another process, whose `main` gets the names of the mesh and of the arrays to write.

meshio prints, ends the program on some faults, never returns from some files that are cut off, and trusts a header for
the memory to allocate. The other process has a limit on time and memory and returns the mesh as arrays in a file.
"""

import contextlib
import io
import json
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from fmd.core.arrays import IntArray
from fmd.core.limits.files import MOST_TAGS
from fmd.core.limits.patience import READING_BYTES, READING_BYTES_PER_BYTE, READING_SECONDS, READING_SECONDS_PER_MB
from fmd.core.limits.shown import LONGEST_MESSAGE
from fmd.core.processes import ChildError, run_child
from fmd.fem.cells.table import complete_dimensions, is_solid
from fmd.fem.formats.raw_mesh import MeshFileError, RawMesh


def read_by_meshio(path: Path) -> RawMesh:
    """Read a mesh in any of meshio's formats.

    Raises
    ------
    MeshFileError
        meshio doesn't understand the file, or it would take too much time or memory.
    """
    size = path.stat().st_size
    seconds = READING_SECONDS + READING_SECONDS_PER_MB * size / 1e6
    with tempfile.TemporaryDirectory(prefix="fmd-") as folder:
        arrays = Path(folder) / "arrays.npz"
        environment = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        memory = READING_BYTES + READING_BYTES_PER_BYTE * size
        command = f"{__name__}:main", str(path.resolve()), str(arrays)
        try:
            run_child(*command, seconds=seconds, memory=memory, environment=environment)
        except ChildError as error:
            if error.late:
                raise MeshFileError(f"couldn't be read in {seconds:.0f} s; is it cut off?") from None
            raise MeshFileError(f"is damaged, or in a form that meshio doesn't read: {error}") from None
        return _load_arrays(arrays)


def _load_arrays(arrays: Path) -> RawMesh:
    """Load the mesh that the other process saved."""
    with np.load(arrays, allow_pickle=False) as file:
        meta = json.loads(bytes(file["meta"]))
        blocks = [(kind, file[f"cells {k}"]) for k, kind in enumerate(meta["kinds"])]
        return RawMesh(
            file["points"],
            blocks,
            {name: [file[f"cell set {s} {k}"] for k in range(len(blocks))] for s, name in enumerate(meta["cell_sets"])},
            {name: file[f"point set {s}"] for s, name in enumerate(meta["point_sets"])},
        )


def main(arguments: list[str]) -> str | None:
    """Read the first argument's file and write arrays to the second; return a message if that can't be done."""
    source, target = map(Path, arguments)
    quiet, said = io.StringIO(), ""
    try:
        with contextlib.redirect_stdout(quiet), contextlib.redirect_stderr(quiet):
            _save_arrays(_read(source), target)
    except MeshFileError as error:
        said = str(error)
    except MemoryError:
        said = "it asks for more memory than a file of its size can need"
    except (Exception, SystemExit) as error:
        said = f"{type(error).__name__}: {error}" if str(error) and not isinstance(error, SystemExit) else ""
        said = said or " ".join(quiet.getvalue().split()) or type(error).__name__
    if said:
        target.unlink(missing_ok=True)
        return " ".join(said.split())[:LONGEST_MESSAGE]
    return None


def _read(path: Path) -> RawMesh:
    """Read a mesh by meshio, and mend the faults of meshio 5.3."""
    import meshio
    from meshio import _mesh
    from meshio.gmsh import _gmsh41

    complete_dimensions(_mesh.topological_dimension)

    # If only some entities are in physical groups, meshio 5.3 makes fewer arrays than blocks and then refuses them.
    def mesh(points: Any, cells: Any, *, cell_data: Any, cell_sets: Any, **rest: Any) -> meshio.Mesh:
        whole = {name: arrays for name, arrays in cell_data.items() if len(arrays) == len(cells)}
        named = {name: sets for name, sets in cell_sets.items() if not name.startswith("gmsh:")}
        return meshio.Mesh(points, cells, cell_data=whole, cell_sets=named, **rest)

    _gmsh41.Mesh = mesh
    with path.open("rb") as stream:  # other programs write .msh too
        file_format = "gmsh" if path.suffix == ".msh" and stream.read(100).lstrip().startswith(b"$") else None
    with warnings.catch_warnings():
        # NumPy stops reading at text that isn't a number, with a mere warning.
        warnings.filterwarnings("error", message=".*could not be read to its end")
        found = meshio.read(path, file_format)
    points = np.asarray(found.points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise MeshFileError(f"its points have {points.shape[-1]} coordinates; a solid's have three")
    blocks = []
    for block in found.cells:
        cells = np.asarray(block.data)
        if cells.dtype.kind not in "iu" or cells.ndim != 2:
            raise MeshFileError(f"it has cells of kind {block.type}, which aren't read")
        blocks.append((block.type, cells.astype(np.int64)))
    raw = RawMesh(points, blocks)
    raw.point_sets = {name: np.asarray(chosen, dtype=np.int64) for name, chosen in found.point_sets.items()}
    for name, sets in found.cell_sets.items():
        raw.cell_sets[name] = [np.asarray([] if s is None else s, dtype=np.int64).ravel() for s in sets]
    _add_tags(raw, found)
    return raw


def _add_tags(raw: RawMesh, found: Any) -> None:
    """Turn tags, families and integer cell data into sets with the file's names."""
    names = {
        (int(np.ravel(value)[0]), int(np.ravel(value)[1]) if np.size(value) > 1 else None): name
        for name, value in found.field_data.items()
        if np.size(value) in (1, 2) and np.asarray(value).dtype.kind in "iuf"
    }
    families = getattr(found, "cell_tags", {})  # MED's groups by family
    for key, arrays in found.cell_data.items():
        values = [np.asarray(array) for array in arrays]
        if any(v.ndim != 1 or v.dtype.kind not in "iu" for v in values):
            continue
        for tag in _few(values):
            curve = key == "gmsh:physical" and (tag, 1) in names
            for dimension in (1, 2, 3) if curve else (2, 3):
                chosen = [
                    np.flatnonzero(v == tag) if _dimension(kind) == dimension else np.empty(0, dtype=np.int64)
                    for (kind, _), v in zip(raw.blocks, values, strict=True)
                ]
                if any(len(c) for c in chosen):
                    for name in _tag_names(key, int(tag), dimension, names, families):
                        _add(raw.cell_sets, name, chosen)
    tags = found.point_data.get("point_tags")
    for family, groups in getattr(found, "point_tags", {}).items():
        for name in groups:
            points = np.flatnonzero(np.asarray(tags) == family)
            raw.point_sets[name] = np.union1d(raw.point_sets.get(name, points), points)


def _few(values: list[Any]) -> list[int]:
    """Return the different values, or none if there are too many."""
    tags = sorted({int(tag) for v in values for tag in np.unique(v)[: MOST_TAGS + 1]})
    return tags if len(tags) <= MOST_TAGS else []


def _tag_names(
    key: str, tag: int, dimension: int, names: dict[tuple[int, int | None], str], families: dict[int, list[str]]
) -> list[str]:
    """Return the names of the set that a value of the cell data ``key`` stands for."""
    what = ("curve", "surface", "volume")[dimension - 1]
    match key:
        case "cell_tags":
            return families.get(tag, [])
        case "gmsh:physical":
            return [names.get((tag, dimension), f"physical-{what}-{tag}")] if tag else []
        case "gmsh:geometrical":
            return [f"{what}-{tag}"]
        case _ if (tag, None) in names:  # as our own .vtu files have it: a field datum with the part's number
            return [names[tag, None]]
    return [f"{key}-{tag}"]


def _add(sets: dict[str, list[IntArray]], name: str, chosen: list[IntArray]) -> None:
    before = sets.get(name)
    sets[name] = chosen if before is None else [np.union1d(a, b) for a, b in zip(before, chosen, strict=True)]


def _dimension(kind: str) -> int:
    if is_solid(kind):
        return 3
    return 2 if kind.startswith(("triangle", "quad")) else 1


def _save_arrays(raw: RawMesh, target: Path) -> None:
    """Save a mesh as plain arrays for `_load_arrays`."""
    arrays: dict[str, Any] = {"points": raw.points}
    arrays |= {f"cells {k}": cells for k, (_, cells) in enumerate(raw.blocks)}
    for s, sets in enumerate(raw.cell_sets.values()):
        arrays |= {f"cell set {s} {k}": chosen for k, chosen in enumerate(sets)}
    arrays |= {f"point set {s}": chosen for s, chosen in enumerate(raw.point_sets.values())}
    meta = {
        "kinds": [kind for kind, _ in raw.blocks],
        "cell_sets": list(raw.cell_sets),
        "point_sets": list(raw.point_sets),
    }
    arrays["meta"] = np.frombuffer(json.dumps(meta).encode(), dtype=np.uint8)
    np.savez(target, **arrays)
