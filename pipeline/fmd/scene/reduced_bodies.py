"""Flexible bodies that another program has reduced, read from its files."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from fmd.scene.bodies import Deformable, ModeSettings
from fmd.scene.orientation import Orientation
from fmd.scene.places import NamedElement, Support
from fmd.scene.reading import SceneTable
from fmd.scene.values import Name, Number, SourceFile, Text


class BodyFile(SceneTable):
    """A file that holds a reduced body of another program, in SI units.

    Parameters
    ----------
    file : str
        Standard input data (``.SID_FEM``), modal data of MBDyn (``.fem``) or of Exudyn's
        ``ObjectFFRFreducedOrderInterface`` (``.npz``), or our own NetCDF (``.nc``), relative to the scene's file.

    Examples
    --------
    ::

        [body.arm.body]
        file = "arm.SID_FEM"
    """

    file: SourceFile


class ReducedModes(SceneTable):
    """Damping of a body that was reduced by another program; its shapes are those of its file.

    Parameters
    ----------
    damping : float
        Damping ratio of every mode in place of the file's own damping, which 0 keeps.

    Examples
    --------
    ::

        [body.arm.modes]
        damping = 0.01
    """

    damping: Annotated[Number, Field(ge=0.0, lt=1.0)] = 0.0

    @property
    def boundary(self) -> Literal["free"]:
        """The file tells how the body was held."""
        return "free"

    @property
    def family(self) -> Literal["any"]:
        """All of the file's modes are taken."""
        return "any"

    @property
    def enrich(self) -> Literal["none"]:
        """Nothing can be added to the file's modes."""
        return "none"

    @property
    def interface(self) -> tuple[str, ...]:
        """The file tells no interface."""
        return ()

    @property
    def solver(self) -> Literal["auto"]:
        """Nothing is factorised."""
        return "auto"

    @property
    def ranks(self) -> None:
        """Nothing is factorised."""

    @property
    def count(self) -> int:
        """Known once the file is read."""
        return 0


AnyModes = ModeSettings | ReducedModes
"""The shapes that describe a body's deformation, computed or of its file."""


class FileNode(Orientation):
    """A named place on a reduced body, where joints and loads act and motion is recorded, with axes of its own.

    Parameters
    ----------
    node : str or tuple of str
        Label of the file's node, or labels of three or more whose mean motion is meant.

    Examples
    --------
    ::

        [body.arm.marker]
        root = { node = "1" }
        tip = { node = ["17", "18", "19"] }
    """

    node: Text | Annotated[tuple[Text, ...], Field(min_length=1, max_length=10_000)]

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the nodes."""
        return (self.node,) if isinstance(self.node, str) else self.node

    @property
    def where(self) -> dict[str, object]:
        """Place of the marker as plain data, for hashing."""
        return {"node": self.labels}

    @property
    def attachment(self) -> Literal["averaged"]:
        """The mean motion of its nodes."""
        return "averaged"

    @property
    def face(self) -> None:
        """There is no mesh."""


class ReducedPart(Deformable):
    """A body that another program has reduced: it has motion and, if its file has it, stress, but no mesh.

    Parameters
    ----------
    shape : str
        Kind of body; ``body`` alone says it, too.
    body : BodyFile
        The file.
    modes : ReducedModes
        Damping, where it isn't the file's.
    marker : dict of str to FileNode
        Places for joints and loads, by name.

    Examples
    --------
    ::

        [body.arm]
        body = { file = "arm.SID_FEM" }
        marker = { root = { node = "1" }, tip = { node = "2" } }
    """

    shape: Literal["reduced"]
    body: BodyFile
    modes: ReducedModes = ReducedModes()
    marker: dict[Name, FileNode]

    @property
    def element(self) -> dict[str, NamedElement]:
        """Empty, since there is no mesh."""
        return {}

    @property
    def support(self) -> tuple[Support, ...]:
        """Empty, since there is no mesh."""
        return ()
