"""Flexible bodies in a scene file: material, modes and places of each, and the shape of a bar."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from pipeline.core.units import PositiveDensity, PositiveLength, PositiveStress
from pipeline.scene.places import MarkerPlace, NamedElement, Support
from pipeline.scene.reading import FaultError, SceneTable, suggest_name
from pipeline.scene.values import Count, Name, Number, Place


def _poisson(nu: float) -> float:
    if not nu > -1:
        raise ValueError("must be above -1; most metals have about 0.3")
    if not nu < 0.5:
        raise ValueError("must be below 0.5 (0.5 is incompressible); 0.499 works")
    return nu


Poisson = Annotated[Annotated[float, Field(strict=True)], AfterValidator(_poisson)]


class BarMesh(SceneTable):
    """How a body is divided into elements.

    Parameters
    ----------
    element : str
        The elements' shape.
    order : int
        Polynomial order of the displacement in an element.
    divisions : tuple of int, optional
        Elements along x, y and z; for hexahedra.
    size : float, optional
        Edge length of an element [m]; for tetrahedra.
    """

    element: Literal["hexahedron", "tetrahedron"] = "hexahedron"
    order: Annotated[int, Field(strict=True, ge=1, le=2)] = 2
    divisions: tuple[Count, Count, Count] | None = None
    size: PositiveLength | None = None

    @model_validator(mode="after")
    def _divided_one_way(self) -> BarMesh:
        if self.element == "hexahedron":
            if self.size is not None:
                raise FaultError("belongs to tetrahedra; hexahedra take divisions, e.g. [48, 4, 2]", "size")
            if self.divisions is None:
                raise FaultError("is missing: hexahedra along x, y and z, e.g. [48, 4, 2]", "divisions")
        else:
            if self.divisions is not None:
                raise FaultError("belongs to hexahedra; tetrahedra take a size, e.g. '5 mm'", "divisions")
            if self.size is None:
                raise FaultError("is missing: the edge length of a tetrahedron, e.g. '5 mm'", "size")
        return self


class ModeSettings(SceneTable):
    """Which modes describe a body's deformation.

    Parameters
    ----------
    count : int
        How many, above the rigid-body modes.
    family : str
        The kind of motion that they are chosen from.
    boundary : str
        How the body is held while it vibrates, besides its supports: not at all, at the marker of the joint that
        carries it, or at its interface, whose static deflections are added (Craig & Bampton).
    interface : tuple of str
        The markers of the interface; all, if none is named.
    enrich : str
        What is added: the static responses to inertia loads and joint forces (``"inertia"``), or four generations of
        load-dependent vectors, each the responses to the inertia of the one before (``"ritz"``).
    damping : float
        Damping ratio of every mode.
    solver : str
        What factorises: the fastest that is installed, CHOLMOD, SciPy's SuperLU, or PETSc over several processes.
    ranks : int, optional
        How many processes, with ``slepc``.
    """

    count: Count
    family: Literal["any", "in-plane bending", "out-of-plane bending", "torsion", "axial"] = "any"
    boundary: Literal["free", "joint", "interface"] = "free"
    interface: tuple[Place, ...] = ()
    enrich: Literal["none", "inertia", "ritz"] = "none"
    damping: Annotated[Number, Field(ge=0.0, lt=1.0)] = 0.0
    solver: Literal["auto", "cholesky", "superlu", "slepc"] = "auto"
    ranks: Annotated[int, Field(strict=True, ge=1, le=100_000)] | None = None

    @model_validator(mode="after")
    def _ranks_of_slepc(self) -> ModeSettings:
        if self.ranks is not None and self.solver != "slepc":
            raise FaultError("belongs to solver = 'slepc'; the others are one process", "ranks")
        return self

    @model_validator(mode="after")
    def _of_an_interface(self) -> ModeSettings:
        if self.boundary != "interface" and self.interface:
            raise FaultError('belongs to boundary = "interface"', "interface")
        if self.boundary == "interface" and self.family != "any":
            raise FaultError("can't be chosen: deflections by an interface are of every kind", "family")
        return self


class Solid(SceneTable):
    """What every flexible body has, whatever its shape.

    Parameters
    ----------
    E : float
        Young's modulus [Pa].
    nu : float
        Poisson's ratio.
    rho : float
        Density [kg/m³].
    modes, marker, element
        Its modes, and its markers and named elements by name.
    support : tuple of Support
        What of it can't move in its frame.
    """

    E: PositiveStress
    nu: Poisson
    rho: PositiveDensity
    modes: ModeSettings
    marker: dict[Name, MarkerPlace] = Field(default_factory=dict)
    support: tuple[Support, ...] = ()
    element: dict[Name, NamedElement] = Field(default_factory=dict)

    @property
    def faces(self) -> tuple[str, ...] | None:
        """Names of the shape's faces; ``None`` if they are known only once there is a mesh."""
        raise NotImplementedError

    @property
    def parts(self) -> tuple[str, ...] | None:
        """Names of its mesh's parts; ``None`` likewise."""
        raise NotImplementedError

    @model_validator(mode="after")
    def _on_a_mesh(self) -> Solid:
        for name, marker in self.marker.items():
            if marker.nodes is not None:
                raise FaultError("belong to a body that is given by its matrices", "marker", name, "nodes")
        return self

    @model_validator(mode="after")
    def _on_its_faces(self) -> Solid:
        faces, parts = self.faces, self.parts
        for name, marker in self.marker.items():
            unknown = [face for face in marker.faces if faces is not None and face not in faces]
            if unknown:
                message = f"no such face; {suggest_name(unknown[0], faces or (), 'the faces')}"
                raise FaultError(message, "marker", name, "face")
        for number, support in enumerate(self.support):
            for face in support.faces:
                if faces is not None and face not in faces:
                    raise FaultError(
                        f"no such face; {suggest_name(face, faces, 'the faces')}", "support", number, "face"
                    )
        for number, name in enumerate(self.modes.interface):
            if name not in self.marker:
                message = f"no such marker; {suggest_name(name, self.marker, 'the markers')}"
                raise FaultError(message, "modes", "interface", number)
        if self.modes.boundary == "interface" and not self.marker:
            raise FaultError("has no marker to be an interface; give the body one", "modes", "boundary")
        if self.modes.boundary == "joint" and self.support:
            raise FaultError("can't stand beside supports, which hold the body at its joint", "modes", "boundary")
        for name, element in self.element.items():
            if parts is not None and element.part not in (None, *parts):
                message = f"no such part; {suggest_name(str(element.part), parts, 'the parts')}"
                raise FaultError(message, "element", name, "part")
        return self


class Bar(Solid):
    """A straight bar with a rectangular section.

    Parameters
    ----------
    length, depth, width : float
        Extent along x, y and z [m].
    mesh
        Its elements.
    """

    shape: Literal["bar"]
    length: PositiveLength
    depth: PositiveLength
    width: PositiveLength
    mesh: BarMesh

    @property
    def faces(self) -> tuple[str, ...]:
        """``"x-"`` is where x is least."""
        return ("x-", "x+", "y-", "y+", "z-", "z+")

    @property
    def parts(self) -> tuple[str, ...]:
        """The whole."""
        return ("bar",)
