"""Outputs in a scene file: charts, pictures and films, and files for other tools."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from pipeline.core.units import Stress
from pipeline.scene.pictures import Component, Film, MeshPicture, ModePictures, ModeSheet, StressPicture
from pipeline.scene.reading import FaultError, SceneTable
from pipeline.scene.values import BodyName, ElementName, FileCheck, JointName, Text

# Meanings of the quantities that a chart can draw.
CHART_QUANTITIES = {
    "joint_position": "angle of a revolute or displacement of a prismatic joint",
    "joint_rate": "angular rate of a revolute or speed of a prismatic joint",
    "tip_position": "position of the tip in space",
    "tip_deflection": "displacement of the tip by deformation, seen from the section at its body's joint",
    "tip_displacement": "displacement of the tip by deformation, in the axes of its body",
    "marker_position": "position of a marker in space",
    "modal_coordinates": "modal coordinates of a body, by default the one with the tip",
    "energy": "kinetic and potential energy",
    "centre_of_mass": "position of the centre of mass",
    "momentum": "momentum",
    "angular_momentum": "angular momentum about the ground's origin",
    "com_position": "position of the centre of mass",
    "com_velocity": "velocity of the centre of mass",
    "com_angular_velocity": "angular velocity of the centre of mass about the joint",
    "joint_angle": "angle of the one joint",
    "element_stress": "stress in a named element",
}


class Chart(SceneTable):
    """A chart of one quantity over time with the curves of all runs.

    Parameters
    ----------
    file : str
        File of the chart.
    quantity : str
        Quantity that is drawn; the table of quantities below explains each.
    joint : str, optional
        Revolute or prismatic joint whose position or rate is drawn.
    element : str, optional
        Named element whose stress is drawn.
    component : str
        Component of that stress; principal stresses are numbered from the largest.
    unit : str, optional
        Unit of the axis, e.g. ``"deg"`` or ``"mm/s"``; rad, m, s and MPa by default.
    title : str
        Text above the chart; the quantity's name by default.
    band : tuple of float, optional
        Range of stress that is marked [Pa].
    band_title : str
        Text for the band in the legend.

    Examples
    --------
    ::

        [[output]]
        type = "chart"
        file = "shoulder.png"
        quantity = "joint_position"
        joint = "shoulder"
        unit = "deg"
    """

    type: Literal["chart"]
    file: Annotated[str, AfterValidator(FileCheck((".png", ".pdf", ".svg")))]
    quantity: Literal[
        "com_position",
        "com_velocity",
        "com_angular_velocity",
        "tip_deflection",
        "tip_displacement",
        "tip_position",
        "joint_angle",
        "joint_rate",
        "joint_position",
        "modal_coordinates",
        "energy",
        "element_stress",
    ]
    joint: JointName | None = None
    element: ElementName | None = None
    component: Component = "von Mises"
    unit: Text | None = None
    title: str = ""
    band: tuple[Stress, Stress] | None = None
    band_title: str = ""

    @model_validator(mode="after")
    def _joint_where_needed(self) -> Chart:
        if self.quantity == "joint_position" and self.joint is None:
            raise FaultError("is missing: the name of the joint whose coordinate is drawn", "joint")
        if self.quantity not in ("joint_position", "joint_rate") and self.joint is not None:
            raise FaultError("belongs to the quantities 'joint_position' and 'joint_rate'", "joint")
        if self.unit is not None and self.joint is None and self.element is None:
            raise FaultError("belongs to a joint's position or rate, or to a stress", "unit")
        if (self.element is None) == (self.quantity == "element_stress"):
            wrong = "is missing: 'body.element', the element" if self.element is None else "belongs to 'element_stress'"
            raise FaultError(wrong, "element")
        if self.band is not None and (self.element is None or not self.band[0] < self.band[1]):
            raise FaultError("must be two stresses, the smaller first, on a chart of 'element_stress'", "band")
        return self


class Export(SceneTable):
    """A file for other tools; its suffix gives the format and what it holds.

    ``.msh`` and ``.vtu`` hold the mesh with its parts, ``.vtkhdf`` displacement and stress at several times for
    ParaView, ``.nc`` the reduced body: modes, mass, stiffness, inertia integrals and the stress of each mode.

    Parameters
    ----------
    file : str
        File that is written.
    body : str
        Flexible body that it holds.
    frames : int
        Number of output times in a ``.vtkhdf`` file, spread over the duration.

    Examples
    --------
    ::

        [[output]]
        type = "export"
        file = "motion.vtkhdf"
        body = "propeller"
        frames = 41
    """

    type: Literal["export"]
    file: Annotated[str, AfterValidator(FileCheck((".msh", ".vtu", ".vtkhdf", ".nc")))]
    body: BodyName
    frames: Annotated[int, Field(strict=True, ge=2, le=2000)] = 21


Output = Annotated[
    Chart | MeshPicture | ModePictures | ModeSheet | StressPicture | Film | Export, Field(discriminator="type")
]
