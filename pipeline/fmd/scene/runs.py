"""Runs in a scene file: the integrators that a simulation is run with, each with its settings."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, get_args

from pydantic import BeforeValidator, Field, model_validator

from fmd.core.units import PositiveTime
from fmd.scene.reading import FaultError
from fmd.scene.run_table import RunTable, SteeredRun
from fmd.scene.sub_cycled_runs import ReversibleSubCyclingRun, SubCyclingRun
from fmd.scene.values import Number

Tolerance = Annotated[Number, Field(ge=3e-14, lt=1.0)]


class CentralDifferenceRun(RunTable):
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

    title: ClassVar[str] = "Central differences"

    integrator: Literal["central-difference"]
    step: PositiveTime | None = None

    @staticmethod
    def _method() -> type[Any]:
        from fmd.integrators.central_difference import CentralDifference

        return CentralDifference


class ExponentialRun(RunTable):
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

    title: ClassVar[str] = "Exponential"
    limit_remedy: ClassVar[str] = "; exponential-rosenbrock does"

    integrator: Literal["exponential"]
    step: PositiveTime | None = None

    @staticmethod
    def _method() -> type[Any]:
        from fmd.integrators.exponential import Exponential

        return Exponential


class RosenbrockRun(SteeredRun):
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

    title: ClassVar[str] = "Exponential Rosenbrock"

    integrator: Literal["exponential-rosenbrock"]
    tolerance: Tolerance = 1e-6

    @staticmethod
    def _method() -> type[Any]:
        from fmd.integrators.rosenbrock import ExponentialRosenbrock

        return ExponentialRosenbrock


class RungeKuttaRun(SteeredRun):
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

    title: ClassVar[str] = "Runge-Kutta"

    integrator: Literal["runge-kutta"]
    tolerance: Tolerance = 1e-9

    @staticmethod
    def _method() -> type[Any]:
        from fmd.integrators.runge_kutta import RungeKutta

        return RungeKutta


class GeneralizedAlphaRun(RunTable):
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

    title: ClassVar[str] = "Generalised alpha"
    passes_over: ClassVar[bool] = True

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

    @staticmethod
    def _method() -> type[Any]:
        from fmd.integrators.generalized_alpha import GeneralizedAlpha

        return GeneralizedAlpha

    def _settings(self, step: float, error: float, duration: float) -> tuple[Any, ...]:
        return step, self.rho


class ScipyRun(SteeredRun):
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

    title: ClassVar[str] = "Methods of SciPy"
    keeps_loops: ClassVar[bool] = False

    integrator: Literal["Radau", "LSODA"]
    tolerance: Tolerance = 1e-9

    @staticmethod
    def _method() -> type[Any]:
        from fmd.integrators.scipy_ivp import ScipyIvp

        return ScipyIvp

    def _settings(self, step: float, error: float, duration: float) -> tuple[Any, ...]:
        return self.integrator, self.tolerance


class AutoRun(SteeredRun):
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

    title: ClassVar[str] = "Automatic"

    integrator: Literal["auto"]

    @staticmethod
    def _method() -> type[Any]:
        from fmd.integrators.automatic import Automatic

        return Automatic

    def _settings(self, step: float, error: float, duration: float) -> tuple[Any, ...]:
        return error, duration


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

RUNS: tuple[type[RunTable], ...] = get_args(get_args(Run)[0])


def name_methods(*traits: str) -> str:
    """Name the methods of all runs that have some traits, for a sentence: ``"a, b and c"``."""
    names = [name for run in RUNS if all(getattr(run, trait) for trait in traits) for name in run.names()]
    return " and ".join([*([", ".join(names[:-1])] if names[1:] else []), names[-1]])
