"""Flexible bodies that another program has reduced: their files, units and places."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from fmd.core.units import PositiveMass
from fmd.scene.imported_bodies import Meshless
from fmd.scene.modes import ReducedModes
from fmd.scene.orientation import Orientation
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.values import LengthUnit, MassUnit, Name, SourceFile, Text, UnitCheck


class BodyFile(SceneTable):
    """A file that holds a reduced body of another program.

    Units, nodes and mass belong to superelements; other files are in SI units and have all of that.

    Example:

        [body.arm.body]
        file = "arm.SID_FEM"
    """

    # Standard input data (``.SID_FEM``), modal data of MBDyn (``.fem``) or of Exudyn's
    # ``ObjectFFRFreducedOrderInterface`` (``.npz``), our own NetCDF (``.nc``), or a superelement: Nastran's as DMIG
    # (``.pch``), OUTPUT4 or OUTPUT2 (``.op4``, ``.op2``), Abaqus' substructure (``.mtx``), relative to the scene.
    file: SourceFile
    # Places of the boundary's nodes: a deck of Nastran or Abaqus, or rows of number, x, y, z. Of OUTPUT4 and OUTPUT2
    # the ``.pch`` of that run, whose EXTRN lists the unknowns.
    nodes: SourceFile | None = None
    unit: LengthUnit = "m"  # Unit of length of nodes and matrices.
    stiffness_unit: Annotated[str, UnitCheck("N/m")] = "N/m"  # Unit of the stiffness matrix.
    mass_unit: MassUnit = "kg"  # Unit of the mass matrix.
    mass: PositiveMass | None = None  # Mass of the whole body, which the mass matrix is to have [kg].
    # Displacements of points within by the superelement's unknowns, three rows a point, or six with rotations: Matrix
    # Market (``.mtx``), ``.npz``, or Nastran's OUTPUT4 or OUTPUT2 (``.op4``, ``.op2``).
    recovery: SourceFile | None = None
    recovery_nodes: SourceFile | None = None  # Those points, as ``nodes``.

    def _check(self) -> None:
        if (self.recovery is None) != (self.recovery_nodes is None):
            missing = "recovery" if self.recovery is None else "recovery_nodes"
            raise FaultError("is missing: recovery and recovery_nodes belong together", missing)


class FileNode(Orientation):
    """A named place on a reduced body, where joints and loads act and motion is recorded, with axes of its own.

    Example:

        [body.arm.marker]
        root = { node = "1" }
        tip = { node = ["17", "18", "19"] }
    """

    attachment: ClassVar[str] = "averaged"
    face: ClassVar[None] = None

    # Label of the file's node, or labels of three or more whose mean motion is meant.
    node: Text | Annotated[tuple[Text, ...], Field(min_length=1, max_length=10_000)]

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the nodes."""
        return (self.node,) if isinstance(self.node, str) else self.node

    @property
    def where(self) -> dict[str, object]:
        """Place of the marker as plain data, for hashing."""
        return {"node": self.labels}


class ReducedPart(Meshless):
    """A body that another program has reduced: it has motion and, if its file has it, stress, but no mesh.

    Example:

        [body.arm]
        body = { file = "arm.SID_FEM" }
        marker = { root = { node = "1" }, tip = { node = "2" } }
    """

    file_keys = ("body", "file", "nodes", "recovery", "recovery_nodes")

    shape: Literal["reduced"]  # Kind of body; ``body`` alone says it, too.
    body: BodyFile  # The file.
    modes: ReducedModes = ReducedModes()  # Damping, where it isn't the file's.
    marker: dict[Name, FileNode]  # Places for joints and loads, by name.
