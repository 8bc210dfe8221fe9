"""Frequency responses in a scene file."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from fmd.core.units import Frequency, NonNegative, PositiveFrequency
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.values import FileCheck, Text, Words


def _write_number(value: Any) -> Any:
    """Return a number as text, which a formula may be, too."""
    return repr(value) if isinstance(value, int | float) and not isinstance(value, bool) else value


Density = Annotated[
    Text,
    BeforeValidator(_write_number),
    Words("number, or text: a formula of f or a ``.csv`` file"),
    WithJsonSchema({"type": ["number", "string"]}),
]
PortName = Annotated[Text, Words('text, e.g. ``"plate.tip.z"``')]


class FrequencyResponseChart(SceneTable):
    """Frequency response of the scene, linearised about a state: chart, table and NetCDF file.

    Parameters
    ----------
    file : str
        File of the chart; a table (``.csv``) and a NetCDF file (``.nc``) of the same name stand beside it.
    input : str
        What acts: ``"body.marker.z"`` (a force), ``".rz"`` (a moment), ``"drive.NAME"``, ``"JOINT.torque"``,
        ``"JOINT.force"`` or ``"ground.z"`` (an acceleration of the ground).
    output : str or tuple of str
        What answers: ``"body.marker.z"``, also ``".velocity"`` or ``".acceleration"`` of it, ``"JOINT.position"``,
        ``"body.element.xx"``.
    to : float
        Highest frequency [Hz].
    from_ : float, optional
        Lowest frequency [Hz]; a thousandth of the highest by default. In a scene its name is ``from``.
    points : int
        Number of evenly spaced frequencies; more are added about each resonance.
    about : str
        State of linearisation: the scene's ``"start"``, its ``"equilibrium"``, a ``"steady"`` motion, or a time of the
        first run in seconds.
    psd : float or str, optional
        One-sided power spectral density of a random input, in the input's SI unit squared per Hz: a number, a formula
        of the frequency f in Hz, or a ``.csv`` file of frequencies and densities. With it, root mean squares of the
        outputs are computed.
    title : str
        Text above the chart.

    Examples
    --------
    ::

        [[output]]
        type = "frf"
        file = "frf.png"
        input = "plate.side.z"
        output = ["plate.tip.z", "plate.root.xx"]
        to = "2 kHz"
        psd = 0.1
    """

    type: Literal["frf"]
    file: Annotated[str, FileCheck((".png", ".pdf", ".svg"))]
    input: PortName
    output: PortName | Annotated[tuple[PortName, ...], Field(min_length=1, max_length=20)]
    to: PositiveFrequency
    from_: Annotated[Frequency, NonNegative] | None = Field(default=None, alias="from")
    points: Annotated[int, Field(strict=True, ge=2, le=100_000)] = 1000
    about: Text = "start"
    psd: Density | None = None
    title: str = ""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return (self.output,) if isinstance(self.output, str) else self.output

    @model_validator(mode="after")
    def _range(self) -> FrequencyResponseChart:
        if self.from_ is not None and not self.from_ < self.to:
            raise FaultError(f"must be below the highest frequency, {self.to:g} Hz", "from")
        if self.file.startswith("motion."):
            raise FaultError("would write its table over the motion's file; 'frf.png' works", "file")
        return self
