"""Controllers in a scene file: their outputs are names in the formulas of drives, and of controllers after them."""

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from fmd.core.units import PositiveTime
from fmd.scene.kinds import KindBy
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.state_loads import FormulaVariables
from fmd.scene.values import Number, SourceFile, Text


class Controller(FormulaVariables):
    """Something whose output formulas may name."""

    inputs: ClassVar[tuple[str, ...]] = ()  # keys that hold formulas of what it takes
    has_states: ClassVar[bool] = True  # true if its output isn't known from the state of the mechanism alone

    @property
    def formulas(self) -> Mapping[str, str]:
        """Formulas of the controller, by their keys."""
        given = ((key, getattr(self, key)) for key in self.inputs)
        return {key: text for key, text in given if text is not None}

    def _check(self) -> None:
        parsed = []
        for key, text in self.formulas.items():
            try:
                parsed.append(self.parse(text))
            except ValueError as error:
                raise FaultError(str(error), key) from None
        for name in self.find_unused(parsed):
            raise FaultError("isn't in a formula of this controller", "variables", name)


class PidController(Controller):
    """A controller by an error, its integral and its rate (PID), with limits, continuous or sampled.

    Its output is ``proportional e + integral ∫e dt + derivative de/dt`` within the limits. What they cut off winds the
    integral back, in the time ``tracking_time`` (Åström & Hägglund, Advanced PID Control, 2006, section 3.5). With a
    sample time it measures at times 0, T, 2 T … and holds its output in between.

    Example:

        [controller.servo]
        type = "pid"
        error = "0.5 - hinge.angle"
        error_rate = "-hinge.rate"
        proportional = 40.0
        integral = 60.0
        derivative = 4.0
        lowest = -15.0
        highest = 15.0
        sample_time = "5 ms"

        [drive.motor]
        type = "torque"
        joint = "hinge"
        torque = { formula = "servo", unit = "N m" }
    """

    inputs: ClassVar[tuple[str, ...]] = ("error", "error_rate")

    type: Literal["pid"]
    error: str  # Formula of the error, in SI units: ``"ref(t) - hinge.angle"``.
    error_rate: str | None = None  # Formula of its rate, where that is measured: ``"ref.rate - hinge.rate"``.
    # Gains in SI units of the output for those of the error, of its integral and of its rate.
    proportional: Number = 0.0
    integral: Number = 0.0
    derivative: Number = 0.0
    # Time constant of the filter behind the derivative where the error's rate isn't given [s]. A sampled controller
    # takes the difference over a sample time without it.
    filter: PositiveTime | None = None
    # Limits of the output [SI units].
    lowest: Number | None = None
    highest: Number | None = None
    # Time in which limits wind the integral back [s]; by default ``proportional / integral``, or with a derivative
    # ``sqrt(derivative / integral)``.
    tracking_time: PositiveTime | None = None
    sample_time: PositiveTime | None = None  # Time from sample to sample [s]; without it the controller is continuous.

    def _check(self) -> None:
        if not (self.proportional or self.integral or self.derivative):
            raise FaultError("is missing: a controller without any gain does nothing", "proportional")
        if not self.derivative:
            for key in ("error_rate", "filter"):
                if getattr(self, key) is not None:
                    raise FaultError("has no effect without a derivative", key)
        if self.error_rate is not None and self.filter is not None:
            raise FaultError("has no effect: the error's rate is given", "filter")
        if self.derivative and self.error_rate is None and self.filter is None and self.sample_time is None:
            raise FaultError("is missing: a derivative needs it, or error_rate, e.g. '1 ms'", "filter")
        if self.lowest is not None and self.highest is not None and not self.lowest < self.highest:
            raise FaultError(f"must be above lowest, {self.lowest:g}", "highest")
        if self.tracking_time is not None and not (self.integral and self.has_limits):
            raise FaultError("has no effect without limits and an integral", "tracking_time")
        if self.has_limits and self.integral and self.tracking is None:
            raise FaultError("is missing: limits need it where gains have other signs, e.g. '0.1 s'", "tracking_time")

    @property
    def has_states(self) -> bool:  # type: ignore[override]
        """True if it remembers, or holds a value that only sampling gives."""
        return self.sample_time is not None or bool(self.integral or self.filters)

    @property
    def has_limits(self) -> bool:
        """True if its output is bounded."""
        return self.lowest is not None or self.highest is not None

    @property
    def filters(self) -> bool:
        """True if it makes the derivative itself."""
        return bool(self.derivative) and self.error_rate is None

    @property
    def tracking(self) -> float | None:
        """Time in which limits wind the integral back [s]; none if no gains tell it."""
        if self.tracking_time is not None or not self.integral:
            return self.tracking_time
        square = self.derivative / self.integral
        found = square**0.5 if square > 0.0 else self.proportional / self.integral
        return found if found > 0.0 else None


class LagController(Controller):
    """A first-order lag: its output y follows its input u by ``time_constant dy/dt = u − y``.

    Example:

        [controller.valve]
        type = "lag"
        input = "200*(0.1 - slide.position)"
        time_constant = "20 ms"

        [drive.ram]
        type = "force"
        joint = "slide"
        force = { formula = "valve", unit = "N" }
    """

    inputs: ClassVar[tuple[str, ...]] = ("input",)

    type: Literal["lag"]
    input: str  # Formula of the input, in SI units.
    time_constant: PositiveTime  # Time in which the output comes to 63 % of a step of the input [s].
    start: Number = 0.0  # Output at time 0 [SI units].


class ExternalValue(SceneTable):
    """A value that a program in Python sets between steps, see docs/control.md; ``fmd run`` keeps the one given here.

    Example:

        [controller.command]
        type = "external"

        [drive.motor]
        type = "torque"
        joint = "hinge"
        torque = { formula = "command", unit = "N m" }
    """

    has_states: ClassVar[bool] = False

    type: Literal["external"]
    value: Number = 0.0  # Value at the start [SI units].


class FmuController(Controller):
    """An FMU for co-simulation (FMI 2.0 or 3.0) that takes formulas of the motion and gives one output.

    From sample to sample it advances by itself, and the mechanism with what it has given. How both exchange values sets
    the order in which the error falls with the sample time, see docs/control.md. It takes the extra ``fmu``.

    Example:

        [controller.valve]
        type = "fmu"
        file = "valve.fmu"
        input = { "spool.x" = "0.1 - slide.position" }
        output = "ram.force"
        sample_time = "1 ms"
        order = 2

        [drive.ram]
        type = "force"
        joint = "slide"
        force = { formula = "valve", unit = "N" }
    """

    type: Literal["fmu"]
    file: SourceFile  # The FMU, relative to the scene's file.
    # Formulas of its inputs by their names in the FMU, in its units.
    input: dict[Text, str] = Field(default_factory=dict)
    output: Text  # Name of the variable in the FMU that formulas of drives take under the controller's name.
    # Values of its parameters by their names in the FMU, in its units.
    parameters: dict[Text, Number] = Field(default_factory=dict)
    sample_time: PositiveTime  # Time from one exchange to the next [s].
    # ``"gauss-seidel"``: the mechanism goes first and the FMU takes what it has come to; ``"jacobi"``: both go from
    # what they know at the last exchange.
    coupling: Literal["gauss-seidel", "jacobi"] = "gauss-seidel"
    # 1: values are held over a sample time; 2: both are extrapolated, or interpolated, to its middle.
    order: Annotated[int, Field(strict=True, ge=1, le=2)] = 1

    @property
    def formulas(self) -> Mapping[str, str]:
        """Formulas of its inputs, by their keys."""
        return {f"input.{name}": text for name, text in self.input.items()}


AnyController = Annotated[PidController | LagController | ExternalValue | FmuController, KindBy("type")]
