"""Couplers of joints in a scene file: gears, slides that move together, and racks."""

from typing import Annotated, ClassVar, Literal

from fmd.core.units import Angle, Length
from fmd.scene.kinds import KindBy
from fmd.scene.reading import SceneTable
from fmd.scene.values import JointName, Number


class Gear(SceneTable):
    """A gear pair: one hinge's angle is a multiple of another's, ``angle = ratio · angle of driver + offset``.

    Example:

        [coupler.gears]
        type = "gear"
        joint = "wheel"
        driver = "pinion"
        ratio = -0.5
    """

    ends: ClassVar[tuple[tuple[str, str], ...]] = (("joint", "rad"), ("driver", "rad"))
    """Keys of the joint that follows and of the one that leads, with the units of their coordinates."""

    type: Literal["gear"]
    # Revolute joints that carry bodies.
    joint: JointName
    driver: JointName
    ratio: Number  # Angle of the first for an angle of 1 rad of the driver; below 0 for wheels that mesh outside.
    offset: Angle = 0.0  # Angle of the first where the driver's is 0 [rad].

    @property
    def multiple(self) -> float:
        """Angle of the joint that follows for an angle of 1 rad of the other."""
        return self.ratio


class Slides(SceneTable):
    """Slides that move together, as jaws of a gripper: ``position = ratio · position of driver + offset``.

    Example:

        [coupler.jaws]
        type = "slides"
        joint = "left"
        driver = "right"
        ratio = 1.0
    """

    ends: ClassVar[tuple[tuple[str, str], ...]] = (("joint", "m"), ("driver", "m"))
    """Keys of the joint that follows and of the one that leads, with the units of their coordinates."""

    type: Literal["slides"]
    # Prismatic joints that carry bodies.
    joint: JointName
    driver: JointName
    ratio: Number  # Displacement of the first for a displacement of 1 m of the driver; below 0 against its own axis.
    offset: Length = 0.0  # Displacement of the first where the driver's is 0 [m].

    @property
    def multiple(self) -> float:
        """Displacement of the joint that follows for a displacement of 1 m of the other."""
        return self.ratio


class Rack(SceneTable):
    """A rack and pinion: a slide's displacement follows a hinge's angle, ``position = radius · angle + offset``.

    Example:

        [coupler.steering]
        type = "rack"
        rack = "slide"
        pinion = "column"
        radius = "8 mm"
    """

    ends: ClassVar[tuple[tuple[str, str], ...]] = (("rack", "m"), ("pinion", "rad"))
    """Keys of the joint that follows and of the one that leads, with the units of their coordinates."""

    type: Literal["rack"]
    rack: JointName  # Prismatic joint that carries a body.
    pinion: JointName  # Revolute joint that carries a body.
    radius: Length  # Displacement for an angle of 1 rad; below 0 against the slide's axis [m].
    offset: Length = 0.0  # Displacement where the angle is 0 [m].

    @property
    def multiple(self) -> float:
        """Displacement of the joint that follows for an angle of 1 rad of the other [m/rad]."""
        return self.radius


AnyCoupler = Annotated[Gear | Slides | Rack, KindBy("type")]
