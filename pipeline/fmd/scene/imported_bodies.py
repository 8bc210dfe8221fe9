"""Flexible bodies that come from files: their mesh from another program, from CAD, or their matrices."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from fmd.core.units import PositiveDensity, PositiveLength, PositiveStress
from fmd.scene.bodies import Deformable, ModeSettings, Poisson, Solid, check_formulation
from fmd.scene.places import MarkerPlace, NamedElement, Support
from fmd.scene.reading import FaultError, SceneTable, UnknownNameError
from fmd.scene.values import Formulation, LengthUnit, Name, Order, PartName, SourceFile, UnitCheck


class MeshFile(SceneTable):
    """A mesh that another program made: Abaqus, Nastran, Gmsh, MED, VTK and more.

    Parameters
    ----------
    file : str
        The file, relative to the scene's; its suffix gives the format.
    unit : str
        The file's unit of length.
    order : int, optional
        Polynomial order of the displacement in an element; the file's own by default. 2 on a file of order 1 adds nodes
        in the middle of straight edges.
    formulation : str
        Strain of linear hexahedra: enhanced by terms that let them bend (``"enhanced"``), or that of the displacement
        alone (``"plain"``), which is too stiff in bending.
    repair : bool
        True to mend faults of the mesh where that is safe; else they are listed and refused.

    Examples
    --------
    ::

        [body.bracket.mesh]
        file = "bracket.inp"
        unit = "mm"
    """

    file: SourceFile
    unit: LengthUnit
    order: Order | None = None
    formulation: Formulation = "enhanced"
    repair: bool = False

    @model_validator(mode="after")
    def _plain_if_linear(self) -> MeshFile:
        check_formulation(self.formulation, self.order)
        return self


class CadFile(SceneTable):
    """A CAD file whose solids are meshed with tetrahedra that follow its curved faces.

    Parameters
    ----------
    cad : str
        A STEP, IGES or BREP file, relative to the scene's.
    size : float
        Edge length of an element [m]; around bores and fillets elements are smaller.
    order : int
        Polynomial order of the displacement in an element.

    Examples
    --------
    ::

        [body.bracket.mesh]
        cad = "bracket.step"
        size = "5 mm"
    """

    cad: SourceFile
    size: PositiveLength
    order: Order = 2


class Substance(SceneTable):
    """Material of one of a body's parts, where it differs from that of the whole body.

    Parameters
    ----------
    E : float
        Young's modulus [Pa].
    nu : float
        Poisson's ratio.
    rho : float
        Density [kg/m³].

    Examples
    --------
    ::

        [body.bracket.material.bush]
        E = "110 GPa"
        nu = 0.34
        rho = "8700 kg/m^3"
    """

    E: PositiveStress
    nu: Poisson
    rho: PositiveDensity


class Imported(Solid):
    """Keys of a body whose mesh or shape comes from a file, beside those of every flexible body.

    Faces and parts are known once the file is read; ``fmd mesh`` prints their names.

    Parameters
    ----------
    material : dict of str to Substance
        Materials of single parts, by the part's name.
    """

    material: dict[PartName, Substance] = Field(default_factory=dict)

    @property
    def faces(self) -> None:
        """Unknown until the file is read."""

    @property
    def parts(self) -> None:
        """Unknown until the file is read."""


class MeshedPart(Imported):
    """A body whose mesh is read from a file; the file's surfaces and sets are its faces and parts.

    Parameters
    ----------
    shape : str
        Kind of body; ``mesh`` alone says it, too.
    mesh : MeshFile
        The file and its unit.

    Examples
    --------
    ::

        [body.bracket]
        mesh = { file = "bracket.inp", unit = "mm" }
        E = "70 GPa"
        nu = 0.33
        rho = "2700 kg/m^3"
        modes = { count = 6 }
        marker = { bore = { face = "bore" } }
    """

    shape: Literal["mesh"]
    mesh: MeshFile


class CadPart(Imported):
    """A body whose shape is read from a CAD file; solids that touch share their nodes.

    The file's solids are its parts; its faces have their names in STEP, their colour ``"#ff0000"`` and a number
    ``face-7``.

    Parameters
    ----------
    shape : str
        Kind of body; ``mesh`` alone says it, too.
    mesh : CadFile
        The file and the size of the elements.

    Examples
    --------
    ::

        [body.bracket]
        mesh = { cad = "bracket.step", size = "5 mm" }
        E = "70 GPa"
        nu = 0.33
        rho = "2700 kg/m^3"
        modes = { count = 6, boundary = "joint" }
        marker = { bore = { near = ["31 mm", "20 mm", "4 mm"] } }
    """

    shape: Literal["cad"]
    mesh: CadFile

    def of_order(self, order: int) -> dict[str, Any]:
        """Return the changes for elements of another order."""
        return {"mesh": self.mesh.model_copy(update={"order": order})}

    def resized(self, factor: float) -> dict[str, Any]:
        """Return the changes for a mesh with about ``factor`` times the elements each way."""
        return {"mesh": self.mesh.model_copy(update={"size": self.mesh.size / factor})}


class MatrixFiles(SceneTable):
    """Files that hold a body's matrices as another program wrote them, three displacements a node.

    Parameters
    ----------
    stiffness, mass : str
        Matrix of the free body, relative to the scene's file: Matrix Market, SciPy's ``.npz``, or what
        Abaqus writes: rows of node, direction, node, direction, value, or of row, column, value.
    nodes : str
        Rows of a node's number, x, y and z, in the order of the matrices.
    unit : str
        Unit of length of ``nodes``.
    stiffness_unit : str
        Unit of the stiffness matrix.
    mass_unit : str
        Unit of the mass matrix.

    Examples
    --------
    ::

        [body.beam.matrices]
        stiffness = "K.mtx"
        mass = "M.mtx"
        nodes = "nodes.csv"
        unit = "mm"
        stiffness_unit = "N/mm"
        mass_unit = "t"
    """

    stiffness: SourceFile
    mass: SourceFile
    nodes: SourceFile
    unit: LengthUnit
    stiffness_unit: Annotated[str, UnitCheck("N/m")] = "N/m"
    mass_unit: Annotated[str, UnitCheck("kg")] = "kg"


class MatrixPart(Deformable):
    """A body without a mesh, given by its matrices: it has modes and motion, but no stress and no picture.

    Parameters
    ----------
    shape : str
        Kind of body; ``matrices`` alone says it, too.
    matrices : MatrixFiles
        The files of the matrices and nodes.
    modes : ModeSettings
        Modes that describe the deformation.
    marker : dict of str to MarkerPlace
        Places for joints and loads, by name; each on ``nodes`` or in a ``plane``.

    Examples
    --------
    ::

        [body.beam]
        matrices = { stiffness = "K.mtx", mass = "M.mtx", nodes = "nodes.csv", unit = "m" }
        modes = { count = 10 }
        marker = { root = { nodes = [17, 18, 19, 25] }, tip = { plane = "x = 340 mm" } }
    """

    shape: Literal["matrices"]
    matrices: MatrixFiles
    modes: ModeSettings
    marker: dict[Name, MarkerPlace]

    @property
    def element(self) -> dict[str, NamedElement]:
        """Empty, since there is no mesh."""
        return {}

    @property
    def support(self) -> tuple[Support, ...]:
        """Empty, since there is no mesh."""
        return ()

    @model_validator(mode="after")
    def _on_nodes(self) -> MatrixPart:
        for name, marker in self.marker.items():
            if marker.nodes is None and marker.plane is None:
                wrong = next(iter(marker.where))
                raise FaultError(
                    "needs a mesh; give nodes, their numbers, or plane, e.g. 'x = 0'", "marker", name, wrong
                )
        for number, name in enumerate(self.modes.interface):
            if name not in self.marker:
                raise UnknownNameError("marker", name, self.marker, "the markers", "modes", "interface", number)
        return self
