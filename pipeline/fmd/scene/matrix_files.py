"""Files of a body that is given by its matrices."""

from typing import Annotated, Literal

from fmd.scene.reading import SceneTable
from fmd.scene.values import LengthUnit, MassUnit, SourceFile, UnitCheck


class MatrixFiles(SceneTable):
    """Files that hold a body's matrices as another program wrote them, three or six unknowns a node.

    Example:

        [body.beam.matrices]
        stiffness = "K.mtx"
        mass = "M.mtx"
        nodes = "nodes.csv"
        unit = "mm"
        stiffness_unit = "N/mm"
        mass_unit = "t"
    """

    # Matrix of the free body, relative to the scene's file: Matrix Market, SciPy's ``.npz``, or what Abaqus writes:
    # rows of node, direction, node, direction, value, or of row, column, value. Of Nastran, OUTPUT4 (``.op4``), OUTPUT2
    # (``.op2``) and DMIG cards (``.pch``); of CalculiX, ``.sti`` and ``.mas``; of Ansys, ``.full``;
    # of Code_Aster, what it prints.
    stiffness: SourceFile
    mass: SourceFile
    # Rows of a node's number, x, y and z, in the order of the matrices; or a deck of Nastran, Abaqus, CalculiX or
    # Ansys.
    nodes: SourceFile
    unit: LengthUnit  # Unit of length of ``nodes``.
    stiffness_unit: Annotated[str, UnitCheck("N/m")] = "N/m"  # Unit of the stiffness matrix.
    mass_unit: MassUnit = "kg"  # Unit of the mass matrix.
    # Unknowns of each node: 3 displacements, or 6, with rotations in rad behind them, as of shells and beams.
    unknowns: Literal[3, 6] = 3
    # Displacements with their stress, which ``fmd export --to load-cases`` asks for: CalculiX's ``.frd``, or ``.csv``.
    # In units of ``unit`` and ``stiffness_unit / unit``.
    stress: SourceFile | None = None
    # Geometric stiffness under the loads of that export, a file each: a name in which ``*`` stands for any text.
    geometric_stiffness: SourceFile | None = None
