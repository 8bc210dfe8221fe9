"""Flexible bodies that come from files: their mesh from another program, from CAD, or their matrices."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from pipeline.core.units import PositiveDensity, PositiveLength, PositiveStress, unit_ratio
from pipeline.scene.bodies import ModeSettings, Poisson, Solid
from pipeline.scene.places import MarkerPlace, NamedElement, Support
from pipeline.scene.reading import FaultError, SceneTable, suggest_name
from pipeline.scene.values import Name, Place


def _unit(si: str, unit: str) -> str:
    unit_ratio(si, unit)
    return unit


File = Annotated[str, Field(min_length=1, max_length=1000)]
LengthUnit = Annotated[str, AfterValidator(partial(_unit, "m"))]


class MeshFile(SceneTable):
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


class CadFile(SceneTable):
    """A CAD file's solids, meshed with tetrahedra that follow its curved faces.

    Parameters
    ----------
    cad : str
        STEP, IGES or BREP, relative to the scene's file.
    size : float
        Edge length of an element [m]; around bores and fillets they are smaller.
    order : int
        Polynomial order of the displacement in an element.
    """

    cad: File
    size: PositiveLength
    order: Annotated[int, Field(strict=True, ge=1, le=2)] = 2


class Substance(SceneTable):
    """What one of a body's parts is made of: ``E`` [Pa], ``nu`` and ``rho`` [kg/m³]."""

    E: PositiveStress
    nu: Poisson
    rho: PositiveDensity


class Imported(Solid):
    """A part that comes from a file; its faces and parts are known once that is read.

    Parameters
    ----------
    material : dict of str to Substance
        What parts are made of, by their names, if not of what the whole body is.
    """

    material: dict[Place, Substance] = Field(default_factory=dict)

    @property
    def faces(self) -> None:
        """Known once the file is read."""

    @property
    def parts(self) -> None:
        """Known once the file is read."""


class MeshedPart(Imported):
    """A part whose mesh is read from a file; its faces and parts are the file's surfaces and sets."""

    shape: Literal["mesh"]
    mesh: MeshFile


class CadPart(Imported):
    """A part whose shape is read from a CAD file; its parts are the file's solids, sharing nodes where they touch."""

    shape: Literal["cad"]
    mesh: CadFile


class MatrixFiles(SceneTable):
    """A body's matrices as another program has written them, three displacements a node.

    Parameters
    ----------
    stiffness, mass : str
        Matrix Market, SciPy's ``.npz`` or Abaqus' rows of node, direction, node, direction, value; relative to the
        scene's file.
    nodes : str
        Rows of a node's number, x, y, z; in the matrices' order.
    unit, stiffness_unit, mass_unit : str
        The files' units of length, stiffness and mass.
    """

    stiffness: File
    mass: File
    nodes: File
    unit: LengthUnit
    stiffness_unit: Annotated[str, AfterValidator(partial(_unit, "N/m"))] = "N/m"
    mass_unit: Annotated[str, AfterValidator(partial(_unit, "kg"))] = "kg"


class MatrixPart(SceneTable):
    """A part without a mesh: its matrices give modes and motion, but no stress and no picture.

    Parameters
    ----------
    matrices
        Its files.
    modes, marker
        Its modes, and its markers by name, on nodes or in a plane.
    """

    shape: Literal["matrices"]
    matrices: MatrixFiles
    modes: ModeSettings
    marker: dict[Name, MarkerPlace]

    @property
    def element(self) -> dict[str, NamedElement]:
        """It has none."""
        return {}

    @property
    def support(self) -> tuple[Support, ...]:
        """It has none."""
        return ()

    @model_validator(mode="after")
    def _on_nodes(self) -> MatrixPart:
        for name, marker in self.marker.items():
            if marker.nodes is None and marker.plane is None:
                wrong = "face" if marker.face is not None else "near"
                raise FaultError(
                    "needs a mesh; give nodes, their numbers, or plane, e.g. 'x = 0'", "marker", name, wrong
                )
        for number, name in enumerate(self.modes.interface):
            if name not in self.marker:
                message = f"no such marker; {suggest_name(name, self.marker, 'the markers')}"
                raise FaultError(message, "modes", "interface", number)
        return self
