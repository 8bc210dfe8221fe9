"""Flexible bodies that come from files: their mesh from another program, from CAD, or their matrices."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from pipeline.scene_file import Table
from pipeline.scene_shapes import Solid
from pipeline.units import unit_ratio


def _unit_of_length(unit: str) -> str:
    unit_ratio("m", unit)
    return unit


File = Annotated[str, Field(min_length=1, max_length=1000)]
LengthUnit = Annotated[str, AfterValidator(_unit_of_length)]


class FileMesh(Table):
    """A mesh that another program made.

    Parameters
    ----------
    file : str
        Its file, relative to the scene's; the suffix tells the format.
    unit : str
        The file's unit of length.
    order : int, optional
        Polynomial order of the displacement in an element; the file's own by default. 2 on a file of order 1 adds nodes
        in the middle of straight edges.
    repair : bool
        Whether what is wrong with it is mended where that is safe.
    """

    file: File
    unit: LengthUnit
    order: Annotated[int, Field(strict=True, ge=1, le=2)] | None = None
    repair: bool = False


class MeshedPart(Solid):
    """A part whose mesh is read from a file; its faces and parts are the file's surfaces and sets."""

    shape: Literal["mesh"] = "mesh"
    mesh: FileMesh

    @property
    def faces(self) -> None:
        """Known once the file is read."""

    @property
    def parts(self) -> None:
        """Known once the file is read."""


def with_shape(body: object) -> object:
    """Add the shape that a body's mesh tells by itself."""
    if isinstance(body, dict) and "shape" not in body:
        mesh = body.get("mesh")
        if isinstance(mesh, dict) and "file" in mesh:
            return body | {"shape": "mesh"}
    return body
