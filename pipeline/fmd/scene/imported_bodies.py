"""Flexible bodies that come from files: their mesh, their shape from CAD, their matrices, or all of them reduced."""

import json
from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from fmd.core.limits.mesh import MOST_HALVINGS
from fmd.core.units import Length, PositiveDensity, PositiveLength, PositiveStress
from fmd.scene.bodies import Deformable, DividedMesh, FaceLink, MassOnLink, SectorMesh, TiedFace, require_interface
from fmd.scene.layers import Layerable
from fmd.scene.matrix_files import MatrixFiles
from fmd.scene.modes import ModeSettings
from fmd.scene.places import MarkerPlace, NamedElement, Support
from fmd.scene.reading import FaultError, SceneTable, UnknownNameError
from fmd.scene.values import ForceUnit, LengthUnit, MassUnit, Name, Order, PartName, Poisson, SourceFile


class MeshFile(DividedMesh, SectorMesh):
    """A mesh that another program made: Abaqus, Nastran, Ansys, Gmsh, MED, VTK and more.

    Example:

        [body.bracket.mesh]
        file = "bracket.inp"
        unit = "mm"
    """

    file: SourceFile  # The file, relative to the scene's; its suffix gives the format.
    unit: LengthUnit  # The file's unit of length.
    # Polynomial order of the displacement in an element; the file's own by default. 2 on a file of order 1 adds nodes
    # in the middle of straight edges.
    order: Order | None = None
    repair: bool = False  # True to mend faults of the mesh where that is safe; else they are listed and refused.
    mass_unit: MassUnit | None = None  # The file's unit of mass, if it has lumped masses; kg in a file in metres.
    force_unit: ForceUnit | None = None  # The file's unit of force, if it has springs; N in a file in metres.
    # Thickness [m]: the file's triangles and quadrilaterals are shells. ``"deck"`` takes it from the deck's sections,
    # ``"layers"`` from the body's ``layers``. Solids and beams of the file are parts of the body beside them.
    shell: PositiveLength | Literal["deck", "layers"] | None = None
    # Thickness of single parts of shells [m], by name, where it differs from ``shell``.
    thickness: dict[PartName, PositiveLength] = Field(default_factory=dict)
    # Number of times that each shell of the file is divided into four, on a curved midsurface.
    halvings: Annotated[int, Field(strict=True, ge=0, le=MOST_HALVINGS)] = 0
    # ``"deck"``: the lines of a deck of Nastran, Abaqus or Ansys are beams, with the deck's sections.
    beam: Literal["deck"] | None = None
    # Faces of solid parts that stay together without common nodes, and nodes of shells and beams that follow a face of
    # solids.
    tie: tuple[TiedFace, ...] = ()

    def _check(self) -> None:
        if (self.shell is not None or self.beam is not None) and self.order == 2:
            raise FaultError("is of solids: shells have three or four nodes, beams two", "order")
        if (self.shell is not None or self.beam is not None) and self.cyclic is not None:
            raise FaultError("is of solids, not of shells or beams", "cyclic")
        if self.halvings and self.shell is None:
            raise FaultError("divides shells; without mesh.shell, as shell = '2 mm', nothing is", "halvings")


class CadFile(SectorMesh):
    """A CAD file whose solids are meshed with tetrahedra that follow its curved faces, or which is meshed as a shell.

    Example:

        [body.bracket.mesh]
        cad = "bracket.step"
        size = "5 mm"
    """

    # A STEP, IGES or BREP file, relative to the scene's, or a script of Gmsh, ``.geo``, with
    # ``SetFactory("OpenCASCADE")``.
    cad: SourceFile
    size: PositiveLength  # Edge length of an element [m]; around bores and fillets elements are smaller.
    order: Order = 2  # Polynomial order of the displacement in an element; 1 of shells.
    # Thickness [m]: the file's surfaces are the midsurfaces of shells, or its solid has walls of this thickness.
    # ``"layers"`` takes it from the body's ``layers``.
    shell: PositiveLength | Literal["layers"] | None = None
    # Thickness of single surfaces [m], by name, where it differs from ``shell``.
    thickness: dict[PartName, PositiveLength] = Field(default_factory=dict)
    unit: LengthUnit | None = None  # A script's unit of length; m by default.
    # Dimensions [m] that the script has by ``DefineConstant``; others keep the script's values.
    parameter: dict[Name, Length] = Field(default_factory=dict)
    # Dimensions [m] at which the part is meshed; its nodes are carried to those of ``parameter``, so that elements stay
    # the same. By default it is meshed at ``parameter``.
    made_at: dict[Name, Length] = Field(default_factory=dict)

    @property
    def is_script(self) -> bool:
        """True for a script of Gmsh, which may have dimensions."""
        return self.cad.lower().endswith(".geo")

    @property
    def first(self) -> dict[str, float]:
        """Dimensions at which it is meshed [m]."""
        return self.parameter | self.made_at

    @model_validator(mode="before")
    @classmethod
    def _linear_if_shell(cls, table: Any) -> Any:
        return {"order": 1} | table if isinstance(table, dict) and table.get("shell") is not None else table

    def _check(self) -> None:
        if self.shell is not None and self.order == 2:
            raise FaultError("is of solids: shells have four nodes", "order")
        if self.shell is not None and self.is_script:
            raise FaultError("is of other CAD files: scripts are of solids", "shell")
        for key in ("unit", "parameter"):
            if getattr(self, key) and not self.is_script:
                raise FaultError("is of scripts, bracket.geo: other CAD files have their own", key)
        for name in self.made_at:
            if name not in self.parameter:
                raise UnknownNameError("parameter", name, self.parameter, "the parameters", "made_at", name)
        if self.shell is not None and self.cyclic is not None:
            raise FaultError("is of solids, not of shells", "cyclic")


class Substance(SceneTable):
    """Material of one of a body's parts, where it differs from that of the whole body.

    Example:

        [body.bracket.material.bush]
        E = "110 GPa"
        nu = 0.34
        rho = "8700 kg/m^3"
    """

    E: PositiveStress  # Young's modulus [Pa].
    nu: Poisson  # Poisson's ratio.
    rho: PositiveDensity  # Density [kg/m³].


class Imported(Layerable):
    """Keys of a body whose mesh or shape comes from a file, beside those of every flexible body.

    Faces and parts are known once the file is read; ``fmd mesh`` prints their names.
    """

    material: dict[PartName, Substance] = Field(default_factory=dict)  # Materials of single parts, by the part's name.

    def _check(self) -> None:
        shell = self.mesh.shell  # type: ignore[attr-defined]
        if self.layers and shell != "layers":
            raise FaultError("must be 'layers', which have the thickness of a body with layers", "mesh", "shell")
        if shell == "layers" and not self.layers:
            raise FaultError("takes the thickness of the body's layers, and there are none", "mesh", "shell")
        if self.mesh.thickness and shell in (None, "layers"):  # type: ignore[attr-defined]
            mend = "without mesh.shell, as shell = '2 mm', nothing is" if shell is None else "layers have their own"
            raise FaultError(f"is of parts that are shells; {mend}", "mesh", "thickness")
        if self.layers and self.material:
            raise FaultError("has no effect beside layers, which have the materials of lamina", "material")
        if self.offset and shell in (None, "deck"):
            raise FaultError("is of a shell whose mesh has no sections of its own", "offset")

    @property
    def shell_thickness(self) -> float | None:
        """Thickness of all its shells [m]; ``None`` if a deck has it."""
        shell = self.mesh.shell  # type: ignore[attr-defined]
        return {"layers": self.layered_thickness, "deck": None}.get(shell, shell)

    @property
    def faces(self) -> None:
        """Unknown until the file is read."""

    @property
    def parts(self) -> None:
        """Unknown until the file is read."""


class MeshedPart(Imported):
    """A body whose mesh is read from a file; the file's surfaces and sets are its faces and parts.

    Example:

        [body.bracket]
        mesh = { file = "bracket.inp", unit = "mm" }
        E = "70 GPa"
        nu = 0.33
        rho = "2700 kg/m^3"
        modes = { count = 6 }
        marker = { bore = { face = "bore" } }
    """

    file_keys = ("mesh", "file")
    deck_may_have_links = True

    shape: Literal["mesh"]  # Kind of body; ``mesh`` alone says it, too.
    mesh: MeshFile  # The file and its unit.

    @property
    def has_own_layers(self) -> bool:
        """True if its plies are in the scene, or may be in its deck."""
        return bool(self.layers or (self.lamina and self.mesh.shell == "deck"))

    def resized(self, factor: float) -> dict[str, Any]:
        """Return the changes for fewer halvings of the file's shells."""
        fewer = self.mesh.halvings - (factor <= 0.5)
        return {"mesh": self.mesh.model_copy(update={"halvings": fewer})} if 0 <= fewer != self.mesh.halvings else {}

    def halved(self) -> dict[str, Any]:
        """Return the changes for half the size of the file's shells."""
        mesh = self.mesh
        divided = mesh.shell is not None and mesh.beam is None and not mesh.halvings and self.pieces == 1
        return {"mesh": mesh.model_copy(update={"halvings": 1})} if divided else {}

    @property
    def divided_directions(self) -> int:
        """Two for shells."""
        return 3 if self.mesh.shell is None else 2

    @property
    def is_beam(self) -> bool:
        """True if the file's lines are beams."""
        return self.mesh.beam is not None


class CadPart(Imported):
    """A body whose shape is read from a CAD file; solids that touch share their nodes.

    The file's solids are its parts; its faces have their names in STEP, their colour ``"#ff0000"`` and a number
    ``face-7``.

    Example:

        [body.bracket]
        mesh = { cad = "bracket.step", size = "5 mm" }
        E = "70 GPa"
        nu = 0.33
        rho = "2700 kg/m^3"
        modes = { count = 6, boundary = "joint" }
        marker = { bore = { near = ["31 mm", "20 mm", "4 mm"] } }
    """

    file_keys = ("mesh", "cad")

    shape: Literal["cad"]  # Kind of body; ``mesh`` alone says it, too.
    mesh: CadFile  # The file and the size of the elements.

    def with_elements_of(self, first: Self) -> Self:
        """Return the part with the elements of another one, which differs in its dimensions."""
        if self.mesh.parameter == first.mesh.parameter:
            return self
        return self.model_copy(update={"mesh": self.mesh.model_copy(update={"made_at": first.mesh.first})})

    @property
    def kept_elements(self) -> str:
        """Key and value, ``mesh.made_at=...``, that keep its elements at other dimensions; empty if none has to."""
        first = ", ".join(f"{key} = {json.dumps(f'{x!r} m')}" for key, x in self.mesh.made_at.items())
        return f"mesh.made_at={{ {first} }}" if first else ""

    def of_order(self, order: int) -> dict[str, Any]:
        """Return the changes for elements of another order."""
        return {} if self.mesh.shell is not None else {"mesh": self.mesh.model_copy(update={"order": order})}

    def resized(self, factor: float) -> dict[str, Any]:
        """Return the changes for a mesh with about ``factor`` times the elements each way."""
        return {"mesh": self.mesh.model_copy(update={"size": self.mesh.size / factor})}


class Meshless(Deformable):
    """A body without a mesh of its own, which has no elements, no links and no supports."""

    element: ClassVar[Mapping[str, NamedElement]] = MappingProxyType({})
    link: ClassVar[Mapping[str, FaceLink]] = MappingProxyType({})
    mass: ClassVar[Mapping[str, MassOnLink]] = MappingProxyType({})
    support: ClassVar[tuple[Support, ...]] = ()


class MatrixPart(Meshless):
    """A body without a mesh, given by its matrices: it has modes and motion, and stress if a file has it.

    Example:

        [body.beam]
        matrices = { stiffness = "K.mtx", mass = "M.mtx", nodes = "nodes.csv", unit = "m" }
        modes = { count = 10 }
        marker = { root = { nodes = [17, 18, 19, 25] }, tip = { plane = "x = 340 mm" } }
    """

    file_keys = ("matrices", "stiffness", "mass", "nodes", "stress", "geometric_stiffness")

    shape: Literal["matrices"]  # Kind of body; ``matrices`` alone says it, too.
    matrices: MatrixFiles  # The files of the matrices and nodes.
    modes: ModeSettings  # Modes that describe the deformation.
    marker: dict[Name, MarkerPlace]  # Places for joints and loads, by name; each on ``nodes`` or in a ``plane``.

    @property
    def may_have_stress(self) -> bool:
        """True if a file tells its stress."""
        return self.matrices.stress is not None

    def _check(self) -> None:
        for name, marker in self.marker.items():
            if marker.nodes is None and marker.plane is None:
                wrong = next(iter(marker.where))
                message = "needs a mesh; give nodes, their numbers, or plane, e.g. 'x = 0'"
                raise FaultError(message, "marker", name, wrong)
        require_interface(self)
