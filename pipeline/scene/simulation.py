"""The simulation in a scene file: its duration and settings, and the integrators that it is run with."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from pipeline.core.units import Acceleration, PositiveFrequency, PositiveTime
from pipeline.scene.reading import FaultError, KeyPath, SceneTable
from pipeline.scene.values import Count, Number, Place

Tolerance = Annotated[Number, Field(ge=3e-14, lt=1.0)]


class CentralDifferenceRun(SceneTable):
    """Central differences in leapfrog form, order 2: explicit, stable for steps below 2 over the highest frequency.

    Parameters
    ----------
    step : float, optional
        Time step [s]; by default that of the simulation.

    Examples
    --------
    ::

        [[simulation.run]]
        integrator = "central-difference"
        step = "10 us"
    """

    integrator: Literal["central-difference"]
    step: PositiveTime | None = None


class SubCyclingRun(SceneTable):
    """Central differences with small steps for fast coordinates and large ones for slow coordinates.

    Miao, Zhu, Shi & Chen, Comput Mech 41 (2008) 269-277, eqs. (8)-(11). Where slow and fast coordinates couple through
    the mass matrix it is weakly unstable at any step; ``fmd stability`` computes what a scene stands.

    Parameters
    ----------
    substeps : int or str
        Number of fast steps in a slow one; ``"auto"`` chooses it together with the split.
    split : float or str
        Which coordinates are slow: all joints but those in ``simulation.fast`` (``"joints"``), every coordinate below
        a frequency [Hz], or the choice with the least work for the wanted error (``"auto"``).
    step : float, optional
        Fast step [s]; by default the simulation's step.

    Examples
    --------
    ::

        [[simulation.run]]
        integrator = "sub-cycling"
        substeps = 10
        split = "1 kHz"
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
    """Sub-cycling that stays stable with inertial coupling: slow coordinates react in every fast step; order 2.

    Parameters
    ----------
    substeps : int
        Number of fast steps in a slow one; with 1 it is central differences.
    split : float or str
        Which coordinates are slow: all joints but those in ``simulation.fast`` (``"joints"``), or every coordinate
        below a frequency [Hz].
    step : float, optional
        Fast step [s]; by default the simulation's step.

    Examples
    --------
    ::

        [[simulation.run]]
        integrator = "reversible-sub-cycling"
        substeps = 10
    """

    integrator: Literal["reversible-sub-cycling"]
    substeps: Count
    split: Literal["joints"] | PositiveFrequency = "joints"
    step: PositiveTime | None = None


class ExponentialRun(SceneTable):
    """Exponential Runge-Kutta method of order 4 (ETDRK4) that solves the modal oscillators exactly.

    It takes no joint with rotations in space: no spherical and no free joint.

    Parameters
    ----------
    step : float, optional
        Time step [s]; by default that of the simulation.

    Examples
    --------
    ::

        [[simulation.run]]
        integrator = "exponential"
        step = "1 ms"
    """

    integrator: Literal["exponential"]
    step: PositiveTime | None = None


class RosenbrockRun(SceneTable):
    """Exponential Rosenbrock method of order 4 that linearises anew in each step and chooses its steps.

    Parameters
    ----------
    tolerance : float
        Relative tolerance of the error in a step.

    Examples
    --------
    ::

        [[simulation.run]]
        integrator = "exponential-rosenbrock"
        tolerance = 1e-8
    """

    integrator: Literal["exponential-rosenbrock"]
    tolerance: Tolerance = 1e-6

    step: ClassVar[None] = None


class RungeKuttaRun(SceneTable):
    """Runge-Kutta method of order 8 by Dormand and Prince, explicit, that chooses its steps.

    Parameters
    ----------
    tolerance : float
        Relative tolerance of the error in a step.

    Examples
    --------
    ::

        [[simulation.run]]
        integrator = "runge-kutta"
        tolerance = 1e-8
    """

    integrator: Literal["runge-kutta"]
    tolerance: Tolerance = 1e-9

    step: ClassVar[None] = None


class GeneralizedAlphaRun(SceneTable):
    """Generalised-α method: implicit, order 2, with damping of high frequencies; it takes a step or a tolerance.

    Parameters
    ----------
    rho : float
        Spectral radius at infinite frequency: 1 damps nothing, 0 damps high frequencies at once.
    step : float, optional
        Time step [s]; by default that of the simulation.
    tolerance : float, optional
        Relative tolerance of the error in a step; with it the method chooses its steps.

    Examples
    --------
    ::

        [[simulation.run]]
        integrator = "generalized-alpha"
        rho = 0.8
        step = "50 us"
    """

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
    """Methods of SciPy that choose their steps, as references: Radau is implicit, LSODA switches by stiffness.

    Parameters
    ----------
    tolerance : float
        Relative tolerance of the error in a step.

    Examples
    --------
    ::

        [[simulation.run]]
        integrator = "Radau"
        tolerance = 1e-8
    """

    integrator: Literal["DOP853", "Radau", "LSODA"]
    tolerance: Tolerance = 1e-9

    step: ClassVar[None] = None


class AutoRun(SceneTable):
    """The integrator that measurements show to be fastest for the mechanism, with a step for the wanted error.

    It takes ``exponential`` where joints and modes don't couple through the mass matrix, else
    ``exponential-rosenbrock`` if the mechanism is stiff over the duration and ``runge-kutta`` if it isn't, and refines
    the step until two integrations agree to ``simulation.error``.

    Examples
    --------
    ::

        [[simulation.run]]
        integrator = "auto"
    """

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
    """The integration over time: its duration, its settings, and the runs by one or several integrators.

    Parameters
    ----------
    duration : float
        Time that is integrated [s].
    output_step : float
        Time between two results [s]; it doesn't change the integrators' steps.
    step : float or str, optional
        Time step of the integrators that don't choose it [s]; ``"auto"`` takes the longest with the wanted error.
    error : float
        Wanted error of what is chosen automatically, relative to the largest value of each kind of coordinate.
    tip : str
        ``"body.marker"`` whose motion is recorded.
    gravity : tuple of float
        Acceleration of free fall [m/s²].
    frame : str
        Frame of a body with free modes on a torque-driven hinge: modes without inertial coupling to the hinge
        (``"joint-conforming"``) or the free modes themselves (``"free"``), for comparison.
    stiffening : str
        Geometric stiffening by inertia loads: when the speed makes it matter (``"auto"``), always or never.
    start : str
        Deformation at the start: none (``"undeformed"``) or that of a steady motion at the rates of the start
        (``"steady"``).
    fast : tuple of str
        Revolute and prismatic joints whose coordinates take the fast steps in sub-cycling.
    run : tuple of Run
        Runs by one or several integrators; the others are compared with the first.

    Examples
    --------
    ::

        [simulation]
        duration = "0.5 s"
        output_step = "0.5 ms"
        step = "10 us"
        tip = "beam.tip"
        gravity = ["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]

        [[simulation.run]]
        integrator = "central-difference"
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
