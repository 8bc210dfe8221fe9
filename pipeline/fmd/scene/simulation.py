"""The simulation in a scene file: its duration, its settings and its runs."""

from typing import Annotated, Literal

from pydantic import Field

from fmd.core.units import Acceleration, PositiveTime
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.runs import Run
from fmd.scene.toml_lines import KeyPath
from fmd.scene.values import JointName, MarkerName, Number, three_along


class Simulation(SceneTable):
    """The integration over time: its duration, its settings, and the runs by one or several integrators.

    Example:

        [simulation]
        duration = "0.5 s"
        output_step = "0.5 ms"
        step = "10 us"
        tip = "beam.tip"
        gravity = ["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]

        [[simulation.run]]
        integrator = "central-difference"
    """

    duration: PositiveTime  # Time that is integrated [s].
    output_step: PositiveTime  # Time between two results [s]; it doesn't change the integrators' steps.
    # Time step of the integrators that don't choose it [s]; ``"auto"`` takes the longest with the wanted error.
    step: PositiveTime | Literal["auto"] | None = None
    # Wanted error of what is chosen automatically, relative to the largest value of each kind of coordinate.
    error: Annotated[Number, Field(ge=1e-10, le=0.1)] = 1e-3
    tip: MarkerName  # Marker whose motion is recorded and compared between runs.
    # Acceleration of free fall [m/s²].
    gravity: Annotated[
        tuple[Acceleration, Acceleration, Acceleration], three_along('["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]')
    ] = (0.0, 0.0, 0.0)
    # Frame of a body with free modes on a torque-driven hinge: modes without inertial coupling to the hinge
    # (``"joint-conforming"``) or the free modes themselves (``"free"``), for comparison.
    frame: Literal["joint-conforming", "free"] = "joint-conforming"
    # Geometric stiffening by all loads that pass through a body: where they count beside the wanted error (``"auto"``),
    # always or never.
    stiffening: Literal["auto", "on", "off"] = "auto"
    # State at the start: bodies undeformed (``"undeformed"``), deformed as in a steady motion at the rates of the start
    # (``"steady"``), everything at rest where the loads of time 0 hold it (``"equilibrium"``), or on the motion that
    # repeats after each ``period`` (``"periodic"``), which a march would only settle at.
    start: Literal["undeformed", "steady", "equilibrium", "periodic"] = "undeformed"
    # Period of the loads and motions [s], of two turns of the crank in a four-stroke engine; for a periodic start.
    period: PositiveTime | None = None
    # Revolute and prismatic joints whose coordinates take the fast steps in sub-cycling.
    fast: tuple[JointName, ...] = ()
    # Runs by one or several integrators; the others are compared with the first.
    run: Annotated[tuple[Run, ...], Field(min_length=1, examples=[[{"integrator": "auto"}]])]

    def _check(self) -> None:
        steps: dict[KeyPath, float | str | None] = {("step",): self.step, ("output_step",): self.output_step}
        steps |= {("run", number, "step"): run.step for number, run in enumerate(self.run)}
        for path, step in steps.items():
            if isinstance(step, float) and step > self.duration:
                raise FaultError(f"must not be longer than the duration, {self.duration:g} s", *path)
        if (self.period is not None) != (self.start == "periodic"):
            message = (
                "is missing: a periodic start needs it" if self.period is None else "is for start = 'periodic' alone"
            )
            raise FaultError(message, "period")
        if self.period is not None and self.period > self.duration:
            raise FaultError(f"must not be longer than the duration, {self.duration:g} s", "period")
        if self.step is None:
            for run in self.run:
                if not run.chooses_steps and run.step is None:
                    message = f"is missing: {run.integrator} needs a step: 'auto' here, or '10 us' here or in the run"
                    raise FaultError(message, "step")
