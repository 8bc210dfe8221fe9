"""``fmd mesh``: the mesh of a part, from a scene or from the part's own file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from fmd.cli.inputs import DEFAULTS, Options, read_quantity
from fmd.cli.options import Repair, print_json
from fmd.core.errors import InputError

if TYPE_CHECKING:
    from fmd.fem.joined import AnyMesh

_MOTION = ("reference", "drive", "coupler", "spring", "bushing", "bearing", "simulation", "accuracy")
_SPARE = (("output",), ("output", *_MOTION), ("output", *_MOTION, "joint", "ground"))

Source = Annotated[str, Parameter(help="Ready scene, TOML file, or a CAD or mesh file alone.")]


def mesh(
    scene: Source,
    *,
    out: Path | None = None,
    size: str | None = None,
    unit: str | None = None,
    repair: Repair = False,
    options: Options = DEFAULTS,
) -> None:
    """Mesh alone: counts, volume, mass, names of faces and the smallest scaled Jacobian.

    Parameters
    ----------
    out
        File to write the mesh to, in the format of its suffix: .vtu, .msh, .inp ...
    size
        Edge length of an element, e.g. 3mm, of a CAD file alone; some 4000 elements without.
    unit
        Unit of length of a mesh file alone, e.g. mm.
    """
    path = Path(scene)
    if path.suffix and path.suffix != ".toml":
        found, figures = _read_file(path, size, unit, options.set_, repair)
    else:
        for option, value in (("--size", size), ("--unit", unit)):
            if value is not None:
                mend = "belongs to a CAD or mesh file alone; a scene has it in body.NAME.mesh"
                raise InputError(option, "", value, mend)
        pipeline = options.solve(scene, repair=repair, spare=_SPARE)
        found, part = pipeline.mesh, pipeline.part
        figures = _figures(found, part.order, {"mass_kg": part.mass})
    if out is not None:
        from fmd.fem.formats.export import write_mesh

        write_mesh(found, out)
    if options.json:
        print_json(figures)
        return
    for key, value in figures.items():
        print(f"{key.replace('_', ' '):15s} {value}")


def _read_file(
    path: Path, size: str | None, unit: str | None, overrides: list[str] | None, repair: bool
) -> tuple[AnyMesh, dict[str, Any]]:
    """Mesh a CAD file, or read a mesh file, without a scene."""
    from fmd.core.units import unit_ratio
    from fmd.stages.meshing.cad_files import choose_element_size, describe_cad_file, is_cad_file, mesh_cad_file

    if overrides:
        raise InputError("--set", "", overrides[0], "belongs to a scene; a CAD file alone takes --size")
    if is_cad_file(path):
        if unit is not None or repair:
            option, value = ("--unit", unit) if unit is not None else ("--repair", None)
            raise InputError(option, "", value, "belongs to a mesh file; a CAD file says its unit itself")
        if size is None:
            edge = choose_element_size(describe_cad_file(path))
        else:
            edge = read_quantity("--size", size, "length", above_zero=True)
        found = mesh_cad_file(path, edge, 2)
        return found, _figures(found, found.order, {"size_m": edge})
    from fmd.fem.formats.import_mesh import read_mesh

    if size is not None:
        raise InputError("--size", "", size, "belongs to a CAD file; this file has its mesh")
    if not path.is_file():
        raise InputError(str(path), "", None, "no such file")
    if path.suffix.lower() in (".urdf", ".mjcf"):
        mend = f"is a robot, no mesh; fmd new {path.stem}.toml --from {path} writes a scene, whose parts are meshed"
        raise InputError(str(path), "", None, mend)
    if unit is None:
        mend = f"is missing: {path.name} has lengths without one; --unit mm, for instance"
        raise InputError("--unit", "", None, mend)
    try:
        ratio = unit_ratio(unit, "m")
    except ValueError:
        raise InputError("--unit", "", unit, "isn't a unit of length; mm works") from None
    found = read_mesh(path, ratio, repair)
    return found, _figures(found, found.order, {})


def _figures(mesh: AnyMesh, order: int, more: dict[str, Any]) -> dict[str, Any]:
    """Return counts, sizes and quality of a mesh, with units in the keys."""
    return {
        "nodes": len(mesh.points),
        "elements": mesh.n_cells,
        "parts": {name: len(cells) for name, cells in mesh.parts.items()},
        "faces": list(mesh.faces),
        "element_type": mesh.cell_type,
        "order": order,
        "volume_m3": mesh.volume,
        **more,
        "min_quality": float(mesh.quality.min()),
        "notes": list(mesh.notes),
    }
