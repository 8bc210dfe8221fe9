"""The fit in a scene file: what was measured on it, and which numbers are to be found from that."""

from typing import Annotated

from pydantic import Field

from fmd.scene.reading import SceneTable
from fmd.scene.values import Count


class MeasuredFile(SceneTable):
    """A file of what was measured in one experiment, by which ``fmd fit`` finds numbers of the scene.

    Example:

        [[fit.experiment]]
        file = "heavy.uff"
        set = ["body.gripper.mass=0.8 kg"]
        places = { 1 = "forearm.wrist", 12 = "upper.elbow" }
    """

    file: str  # File of measurements (``.csv``, ``.mat``, ``.nc``, ``.uff``), relative to the scene.
    # Values of the scene that were others in this experiment, ``"body.gripper.mass=0.8 kg"``.
    set: tuple[str, ...] = ()
    # Markers by the numbers of a universal file's nodes, ``{ 1 = "plate.a" }``.
    places: dict[Annotated[str, Field(pattern=r"^\d+$")], str] = Field(default_factory=dict)

    def text(self, path: str) -> str:
        """Return the experiment as the option ``--to`` takes it, with the file's path."""
        return "; ".join([path, *self.set, *(f"{node}={marker}" for node, marker in self.places.items())])


class FitTable(SceneTable):
    """Numbers that ``fmd fit`` finds from measurements, as its options say it; options come before this table.

    Example:

        [fit]
        vary = ["joint.elbow.spring=10..200", "body.gripper.mass"]

        [[fit.experiment]]
        file = "measured.csv"
    """

    experiment: tuple[MeasuredFile, ...] = ()  # What was measured.
    vary: tuple[str, ...] = ()  # Numbers to find, with bounds or without, ``"joint.elbow.spring=10..200"``.
    sigma: tuple[str, ...] = ()  # Standard deviations of channels' noise, ``"elbow.position=0.1 deg"``.
    prior: tuple[str, ...] = ()  # What is known of numbers beforehand, ``"body.arm.E=5 %"``.
    # Bounds of how much later a channel's clock, or that of all channels, starts, ``"time=-5 ms..5 ms"``.
    shift: tuple[str, ...] = ()
    starts: Count = 1  # Number of searches.
