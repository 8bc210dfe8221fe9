"""Formats of flexible bodies, and the data of a body that their writers may ask for."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from fmd.core.arrays import Array, IntArray
    from fmd.core.errors import InputError
    from fmd.fem.model import FEModel
    from fmd.fem.surface import SurfaceTopology
    from fmd.reduction.body import FlexibleBody
    from fmd.reduction.craig_bampton import Superelement
    from fmd.reduction.given_superelement import GivenSuperelement
    from fmd.reduction.modal_data import ModalData
    from fmd.reduction.modes import Modes


class DrawnBody(NamedTuple):
    """A reduced body with what is seen of it."""

    body: FlexibleBody
    surface: SurfaceTopology | None  # its outer surface, if its file or mesh has one
    # (n_surface, 6, n): stress of each modal coordinate at the surface's nodes: xx, yy, zz, yz, xz, xy [Pa per unit]
    stress: Array | None


class LoadCases(NamedTuple):
    """Loads for another program's deck of a body, in its units."""

    deck: str  # text of the deck that holds the body
    labels: IntArray  # (n_nodes,): node numbers
    rigid: Array  # (k n_nodes, 6): rigid motions by k unknowns a node, 3 displacements, or 6 with rotations
    stiffening: dict[str, Array]  # (n_nodes, k): loads that stiffen
    shapes: dict[str, Array]  # (n_nodes, k): loads under which the body deforms as its shapes


class ExportedBody(ABC):
    """A flexible body of a scene as a format's writer sees it; each result is computed when it is asked for."""

    name: str
    gravity: Array  # (3,): gravity of the scene, zero without motion [m/s²]
    stiffened: bool  # true unless the scene turns geometric stiffening off

    @abstractmethod
    def modal_data(self, stiffened: bool) -> ModalData:
        """Return shapes and inertia integrals for any motion in space, with or without the elements' stiffening."""

    @abstractmethod
    def in_space(self) -> DrawnBody:
        """Return the body reduced for any motion in space, without geometric stiffening."""

    @abstractmethod
    def in_scene(self) -> DrawnBody:
        """Return the body as its scene's mechanism has it."""

    @abstractmethod
    def superelement(self) -> Superelement:
        """Return matrices for the motions of the interface and the fixed-interface modes."""

    @abstractmethod
    def full_model(self) -> tuple[FEModel, Modes]:
        """Return the full matrices, and the modes."""

    @abstractmethod
    def load_cases(self) -> LoadCases:
        """Return the loads under which the program of its matrices computes its stress and geometric stiffness."""

    @abstractmethod
    def frequencies_hz(self) -> Array:
        """Return the natural frequencies of the body's modes [Hz]."""

    @abstractmethod
    def fault(self, key: str, problem: str) -> InputError:
        """Return the error of a key of the body, for what a format can't hold."""


class BodyFormat(NamedTuple):
    """How bodies are written and read in one format."""

    # Writes a body's files. It returns their paths, the given one first, or ``None`` if that is all.
    write: Callable[[ExportedBody, Path], list[Path] | None] | None = None
    read: Callable[[Path], ModalData] | None = None  # reads a body that a scene names by its file
    # Reads a body's matrices of boundary nodes and modal coordinates, in the file's units.
    read_superelement: Callable[[Path], GivenSuperelement] | None = None
    second_order: bool = True  # false if displacement of second order has no place in the file


def body_format(name: str) -> BodyFormat:
    """Return the format of a name, ``FORMAT`` of the file NAME_file.py beside this one, loaded on first use."""
    found: BodyFormat = import_module(f"fmd.reduction.formats.{name.replace('-', '_')}_file").FORMAT
    return found
