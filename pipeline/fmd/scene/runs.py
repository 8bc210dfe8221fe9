"""Runs in a scene file: the integrators that a simulation is run with, each with its settings."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, model_validator

from fmd.core.units import PositiveFrequency, PositiveTime
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.values import Count, Number

Tolerance = Annotated[Number, Field(ge=3e-14, lt=1.0)]


class CentralDifferenceRun(SceneTable):
    """Central differences in leapfrog form: explicit, order 2, stable for steps below 2 / ω of the highest mode.

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
    """Generalised-α method: implicit, order 2, with damping of the high frequencies that its step can't resolve.

    Parameters
    ----------
    rho : float
        Spectral radius at infinite frequency: 1 damps nothing, 0 damps high frequencies at once.
    step : float, optional
        Time step [s]; by default that of the simulation.

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

    @model_validator(mode="before")
    @classmethod
    def _take_no_tolerance(cls, table: Any) -> Any:
        if isinstance(table, dict) and "tolerance" in table:
            message = "generalized-alpha takes a step; exponential-rosenbrock and runge-kutta take a tolerance"
            raise FaultError(message, "tolerance")
        return table


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

    integrator: Literal["Radau", "LSODA"]
    tolerance: Tolerance = 1e-9

    step: ClassVar[None] = None


class AutoRun(SceneTable):
    """The integrator that is cheapest for the mechanism, with a step for the wanted error.

    It marches with shorter and shorter steps until two integrations agree to ``simulation.error``: by ``exponential``
    where joints and modes don't couple through the mass matrix, by ``runge-kutta`` where few stable steps cover the
    duration, else by ``generalized-alpha``, ``central-difference``, ``exponential-rosenbrock`` or ``runge-kutta``, by
    what the steps that each of them needs would cost. The summary names the one that was taken.

    Examples
    --------
    ::

        [[simulation.run]]
        integrator = "auto"
    """

    integrator: Literal["auto"]

    step: ClassVar[None] = None


def _refuse_dop853(table: Any) -> Any:
    if isinstance(table, dict) and table.get("integrator") == "DOP853":
        raise FaultError("is no integrator of its own; take runge-kutta, the same method compiled", "integrator")
    return table


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
    BeforeValidator(_refuse_dop853),
]
