"""Integrations in a scene file: what is integrated over time, and by which methods."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from pipeline.core.units import Acceleration, PositiveFrequency, PositiveTime
from pipeline.scene.reading import FaultError, KeyPath, SceneTable
from pipeline.scene.values import Count, Number, Place

Tolerance = Annotated[Number, Field(ge=3e-14, lt=1.0)]


class CentralDifferenceRun(SceneTable):
    """Central differences; ``step`` [s] overrides that of the simulation."""

    integrator: Literal["central-difference"]
    step: PositiveTime | None = None


class SubCyclingRun(SceneTable):
    """Sub-cycling.

    Parameters
    ----------
    substeps : int or str
        Fast steps in a slow one; ``"auto"`` chooses with the split.
    split : float or str
        What is slow: all joints but those listed as fast (``"joints"``), every coordinate below a frequency [Hz], or
        what makes the least work for the wanted error (``"auto"``).
    step : float, optional
        Fast step [s]; overrides that of the simulation.
    """

    integrator: Literal["sub-cycling"]
    substeps: Count | Literal["auto"]
    split: Literal["joints", "auto"] | PositiveFrequency = "joints"
    step: PositiveTime | None = None

    @model_validator(mode="after")
    def _both_or_none(self) -> SubCyclingRun:
        if (self.substeps == "auto") != (self.split == "auto"):
            raise FaultError("is chosen together with the split: give both 'auto' or none", "substeps")
        return self


class ReversibleSubCyclingRun(SceneTable):
    """Sub-cycling that inertial coupling leaves stable.

    Parameters
    ----------
    substeps : int
        Fast steps in a slow one; with 1 it is central differences.
    split : float or str
        What is slow: all joints but those listed as fast (``"joints"``), or every coordinate below a frequency [Hz].
    step : float, optional
        Fast step [s]; overrides that of the simulation.
    """

    integrator: Literal["reversible-sub-cycling"]
    substeps: Count
    split: Literal["joints"] | PositiveFrequency = "joints"
    step: PositiveTime | None = None


class ExponentialRun(SceneTable):
    """Exponential time differencing of order 4; ``step`` [s] overrides that of the simulation."""

    integrator: Literal["exponential"]
    step: PositiveTime | None = None


class RosenbrockRun(SceneTable):
    """Exponential Rosenbrock method of order 4: chooses its steps by a relative ``tolerance``."""

    integrator: Literal["exponential-rosenbrock"]
    tolerance: Tolerance = 1e-6

    step: ClassVar[None] = None


class RungeKuttaRun(SceneTable):
    """Dormand and Prince's Runge–Kutta method of order 8: chooses its steps by a relative ``tolerance``."""

    integrator: Literal["runge-kutta"]
    tolerance: Tolerance = 1e-9

    step: ClassVar[None] = None


class GeneralizedAlphaRun(SceneTable):
    """Generalised-α with spectral radius ``rho`` at infinite frequency; with a ``tolerance`` it chooses its steps."""

    integrator: Literal["generalized-alpha"]
    rho: Annotated[Number, Field(ge=0.0, le=1.0)] = 0.8
    step: PositiveTime | None = None
    tolerance: Tolerance | None = None

    @model_validator(mode="after")
    def _one_of_two(self) -> GeneralizedAlphaRun:
        if self.step is not None and self.tolerance is not None:
            raise FaultError("can't stand beside a step: with a tolerance the method chooses its steps", "tolerance")
        return self


class ScipyRun(SceneTable):
    """One of SciPy's adaptive methods, with its relative ``tolerance``."""

    integrator: Literal["DOP853", "Radau", "LSODA"]
    tolerance: Tolerance = 1e-9

    step: ClassVar[None] = None


class AutoRun(SceneTable):
    """The method that measurements say is fastest, with a step that meets the simulation's wanted error."""

    integrator: Literal["auto"]

    step: ClassVar[None] = None


Run = Annotated[
    CentralDifferenceRun
    | SubCyclingRun
    | ReversibleSubCyclingRun
    | ExponentialRun
    | RosenbrockRun
    | RungeKuttaRun
    | GeneralizedAlphaRun
    | ScipyRun
    | AutoRun,
    Field(discriminator="integrator"),
]


class Simulation(SceneTable):
    """What is integrated over time, and how.

    Parameters
    ----------
    duration, output_step : float
        How long it lasts, and the time between two results [s].
    step : float or str, optional
        Time step of the methods that don't choose it [s]; ``"auto"`` for the longest with the wanted error.
    error : float
        Wanted error, relative to the largest value of each kind of coordinate; for what is chosen automatically.
    tip : str
        ``"body.marker"`` whose motion is recorded.
    gravity : tuple of float
        Acceleration of free fall [m/s²].
    frame : str
        How free modes are re-expressed for a torque-driven hinge.
    stiffening : str
        Geometric stiffening by the inertia loads: when the speed matters, always or never.
    start : str
        Whether the bodies start undeformed, or as the rates at the start bend them when they are steady.
    fast : tuple of str
        The revolute and prismatic joints whose coordinates take the fast steps in sub-cycling.
    run : tuple of Run
        The integrations; the others are compared with the first.
    """

    duration: PositiveTime
    output_step: PositiveTime
    step: PositiveTime | Literal["auto"] | None = None
    error: Annotated[Number, Field(ge=1e-10, le=0.1)] = 1e-3
    tip: Place
    gravity: tuple[Acceleration, Acceleration, Acceleration] = (0.0, 0.0, 0.0)
    frame: Literal["joint-conforming", "free"] = "joint-conforming"
    stiffening: Literal["auto", "on", "off"] = "auto"
    start: Literal["undeformed", "steady"] = "undeformed"
    fast: tuple[Place, ...] = ()
    run: Annotated[tuple[Run, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _steps_fit(self) -> Simulation:
        steps: dict[KeyPath, float | str | None] = {("step",): self.step, ("output_step",): self.output_step}
        steps |= {("run", number, "step"): run.step for number, run in enumerate(self.run)}
        for path, step in steps.items():
            if isinstance(step, float) and step > self.duration:
                raise FaultError(f"must not be longer than the duration, {self.duration:g} s", *path)
        if self.step is None:
            for run in self.run:
                chooses = isinstance(run, RosenbrockRun | RungeKuttaRun | ScipyRun | AutoRun) or getattr(
                    run, "tolerance", None
                )
                if not chooses and run.step is None:
                    message = f"is missing: {run.integrator} needs a step, here or in the run, e.g. '10 us'"
                    raise FaultError(message, "step")
        return self
