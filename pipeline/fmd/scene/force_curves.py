"""Forces of nonlinear springs in a scene file: formulas and tables by elongation."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, ValidationInfo, model_validator

from fmd.core.limits.scene import MOST_ELONGATIONS
from fmd.core.units import Length, unit_ratio
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.table_files import Column, check_curve, read_table, scene_folder
from fmd.scene.values import LengthUnit, Number, SourceFile


class ForceByElongation(SceneTable):
    """Force of a nonlinear spring by its elongation: a formula, or a table in the scene or in a CSV file.

    Parameters
    ----------
    formula : str, optional
        Formula of the elongation x in metres, e.g. ``"2000*x + 5e5*x**3"``; a formula or a table.
    elongations : tuple of float, optional
        Elongations of a table, ascending [m]. Beyond its ends the force goes on straight.
    values : tuple of float, optional
        Forces of the table in ``unit``, one for each elongation.
    file : str, optional
        CSV file that holds the table, relative to the scene's file; with ``elongation`` and ``column``.
    elongation : str or int, optional
        Column of the file with the elongations.
    column : str or int, optional
        Column of the file with the forces.
    elongation_unit : str
        Unit of the file's elongations.
    between : str
        Course of a table between its elongations: ``"straight"`` lines or a ``"smooth"`` curve.
    unit : str
        Unit of the formula's or the table's forces.

    Examples
    --------
    ::

        [spring.bump.force]
        elongations = ["-30 mm", "-10 mm", "0 mm", "40 mm"]
        values = [-9, -1.2, 0, 4.1]
        between = "smooth"
        unit = "kN"
    """

    formula: str | None = None
    elongations: Annotated[tuple[Length, ...], Field(min_length=2, max_length=MOST_ELONGATIONS)] | None = None
    values: tuple[Number, ...] | None = None
    file: SourceFile | None = None
    elongation: Column | None = None
    column: Column | None = None
    elongation_unit: LengthUnit = "m"
    between: Literal["straight", "smooth"] = "straight"
    unit: str

    @model_validator(mode="after")
    def _read_a_file(self, info: ValidationInfo) -> Self:
        table = read_table(self, "elongation", ("formula", "elongations", "values"), scene_folder(info))
        if table is None:
            return self
        if len(table.values) > MOST_ELONGATIONS:
            raise FaultError(f"has {len(table.values)} rows; {MOST_ELONGATIONS} are the most", "file")
        elongations = tuple(unit_ratio(self.elongation_unit, "m") * x for x in table.arguments)
        return self.model_copy(update={"elongations": elongations, "values": table.values})

    @model_validator(mode="after")
    def _given_one_way(self) -> ForceByElongation:
        check_curve(self, "x", "elongations", "force")
        return self

    @property
    def factor(self) -> float:
        """Factor from the unit of the forces to newtons."""
        return unit_ratio(self.unit, "N")
