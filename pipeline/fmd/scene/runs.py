"""Runs in a scene file: the integrators that a simulation is run with, each with its settings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, get_args

from pydantic import Field, model_validator

from fmd.core.units import PositiveFrequency
from fmd.scene.kinds import KindBy
from fmd.scene.reading import FaultError
from fmd.scene.run_table import RunTable, SteeredRun, SteppedRun, SubCycledRun, Tolerance, TolerantRun
from fmd.scene.values import Count, Number

if TYPE_CHECKING:
    from fmd.integrators.protocol import Integrator


class CentralDifferenceRun(SteppedRun):
    """Central differences in leapfrog form: explicit, order 2, stable for steps below 2 / ω of the highest mode.

    Example:

        [[simulation.run]]
        integrator = "central-difference"
        step = "10 us"
    """

    title: ClassVar[str] = "Central differences"
    method: ClassVar[str] = "central_difference.CentralDifference"
    takes_contact: ClassVar[bool] = True

    integrator: Literal["central-difference"]


class SubCyclingRun(SubCycledRun):
    """Central differences with small steps for fast coordinates and large ones for slow coordinates.

    Miao, Zhu, Shi & Chen, Comput Mech 41 (2008) 269-277, eqs. (8)-(11). Where slow and fast coordinates couple through
    the mass matrix it is weakly unstable at any step; ``fmd stability`` computes what a scene stands. While surfaces of
    a contact touch, or may in the next cycle, all coordinates take the fast step.

    Example:

        [[simulation.run]]
        integrator = "sub-cycling"
        substeps = 10
        split = "1 kHz"
    """

    title: ClassVar[str] = "Sub-cycling"
    method: ClassVar[str] = "subcycling.Subcycling"
    takes_contact: ClassVar[bool] = True
    growth_remedy: ClassVar[str] = ", and reversible-sub-cycling takes longer ones"

    integrator: Literal["sub-cycling"]
    # Number of fast steps in a slow one; ``"auto"`` chooses it together with the split.
    substeps: Count | Literal["auto"]
    # Which coordinates are slow: all joints but those in ``simulation.fast`` (``"joints"``), every coordinate below a
    # frequency [Hz], or the choice with the least work for the wanted error (``"auto"``).
    split: Literal["joints", "auto"] | PositiveFrequency = "joints"
    # How the fast coordinates' forces go on over a cycle: by their tangents at its begin (``"tangents"``), by a
    # parabola through the last cycles (``"carried"``: one evaluation a cycle, whatever couples), or not at all as the
    # paper prints it (``"frozen"``). ``"auto"`` carries them where fast coordinates couple, vibrations grow by it no
    # more than by the wanted error or by tangents, and a part of the motion agrees with plain central differences to
    # the wanted error; else it takes tangents.
    forces: Literal["auto", "tangents", "carried", "frozen"] = "auto"

    def _check(self) -> None:
        if (self.substeps == "auto") != (self.split == "auto"):
            raise FaultError("is chosen together with the split: give both 'auto' or none", "substeps")

    def _settings(self, step: float, error: float, duration: float) -> tuple[Any, ...]:
        return step, self.substeps, "tangents" if self.forces == "auto" else self.forces


class ReversibleSubCyclingRun(SubCycledRun):
    """Sub-cycling for any inertial coupling: constant forces at each step, all else once in several; order 2.

    Forces of modes, springs and dampers act at each step; the mass matrix and all other forces are evaluated at the
    middle of each major cycle.

    Example:

        [[simulation.run]]
        integrator = "reversible-sub-cycling"
        substeps = 10
    """

    title: ClassVar[str] = "Reversible sub-cycling"
    method: ClassVar[str] = "reversible.ReversibleSubcycling"
    split: ClassVar[Literal["joints"]] = "joints"  # type: ignore[misc]

    integrator: Literal["reversible-sub-cycling"]
    substeps: Count  # Number of steps in a major cycle; with 1 it is central differences.

    def make(self, step: float, error: float, duration: float) -> Integrator:
        """Make the integrator; with a ratio of 1 it is central differences, whose limit is the same."""
        if self.substeps == 1:
            return CentralDifferenceRun(integrator="central-difference").make(step, error, duration)
        return super().make(step, error, duration)


class ExponentialRun(SteppedRun):
    """Exponential Runge-Kutta method of order 4 (ETDRK4) that solves the modal oscillators exactly.

    It takes no joint with rotations in space: no spherical and no free joint. In contacts without friction, of bodies
    that slide and don't turn, its steps keep the energy at any length.

    Example:

        [[simulation.run]]
        integrator = "exponential"
        step = "1 ms"
    """

    title: ClassVar[str] = "Exponential"
    method: ClassVar[str] = "exponential.Exponential"
    turns_in_space: ClassVar[bool] = False
    takes_contact: ClassVar[bool] = True
    takes_memory: ClassVar[bool] = False
    keeps_energy: ClassVar[bool] = True
    limit_remedy: ClassVar[str] = "; exponential-rosenbrock does"

    integrator: Literal["exponential"]


class RosenbrockRun(TolerantRun):
    """Exponential Rosenbrock method of order 4 that linearises anew in each step and chooses its steps.

    Example:

        [[simulation.run]]
        integrator = "exponential-rosenbrock"
        tolerance = 1e-8
    """

    title: ClassVar[str] = "Exponential Rosenbrock"
    method: ClassVar[str] = "rosenbrock.ExponentialRosenbrock"
    samples: ClassVar[bool] = True

    integrator: Literal["exponential-rosenbrock"]
    tolerance: Tolerance = 1e-6


class RungeKuttaRun(TolerantRun):
    """Runge-Kutta method of order 8 by Dormand and Prince, explicit, that chooses its steps.

    Its steps end where surfaces of contacts without friction come to touch, or leave.

    Example:

        [[simulation.run]]
        integrator = "runge-kutta"
        tolerance = 1e-8
    """

    title: ClassVar[str] = "Runge-Kutta"
    method: ClassVar[str] = "runge_kutta.RungeKutta"
    samples: ClassVar[bool] = True
    takes_contact: ClassVar[bool] = True
    takes_memory: ClassVar[bool] = False

    integrator: Literal["runge-kutta"]


class GeneralizedAlphaRun(SteppedRun):
    """Generalised-α method: implicit, order 2, with damping of the high frequencies that its step can't resolve.

    Example:

        [[simulation.run]]
        integrator = "generalized-alpha"
        rho = 0.8
        step = "50 us"
    """

    title: ClassVar[str] = "Generalised alpha"
    method: ClassVar[str] = "generalized_alpha.GeneralizedAlpha"
    takes_contact: ClassVar[bool] = True
    passes_over: ClassVar[bool] = True

    integrator: Literal["generalized-alpha"]
    # Spectral radius at infinite frequency: 1 damps nothing, 0 damps high frequencies at once.
    rho: Annotated[Number, Field(ge=0.0, le=1.0)] = 0.8

    @model_validator(mode="before")
    @classmethod
    def _take_no_tolerance(cls, table: Any) -> Any:
        if isinstance(table, dict) and "tolerance" in table:
            message = "generalized-alpha takes a step; exponential-rosenbrock and runge-kutta take a tolerance"
            raise FaultError(message, "tolerance")
        return table

    def _settings(self, step: float, error: float, duration: float) -> tuple[Any, ...]:
        return step, self.rho


class ScipyRun(TolerantRun):
    """Methods of SciPy that choose their steps, as references: Radau is implicit, LSODA switches by stiffness.

    Example:

        [[simulation.run]]
        integrator = "Radau"
        tolerance = 1e-8
    """

    title: ClassVar[str] = "Methods of SciPy"
    method: ClassVar[str] = "scipy_ivp.ScipyIvp"
    keeps_loops: ClassVar[bool] = False

    integrator: Literal["Radau", "LSODA"]

    def _settings(self, step: float, error: float, duration: float) -> tuple[Any, ...]:
        return self.integrator, self.tolerance


class AutoRun(SteeredRun):
    """The integrator that is cheapest for the mechanism, with a step for the wanted error.

    It marches with shorter and shorter steps until two integrations agree to ``simulation.error``: by ``exponential``
    where joints and modes don't couple through the mass matrix, by ``runge-kutta`` where few stable steps cover the
    duration, else by ``generalized-alpha``, ``central-difference``, ``exponential-rosenbrock`` or ``runge-kutta``, by
    what the steps that each of them needs would cost. The summary names the one that was taken.

    With contacts it stands for ``generalized-alpha`` where a face of elements touches, for ``central-difference`` where
    only rigid surfaces do, with steps halved until impulses, largest forces and heat agree to ``simulation.error``.

    Example:

        [[simulation.run]]
        integrator = "auto"
    """

    title: ClassVar[str] = "Automatic"
    method: ClassVar[str] = "automatic.Automatic"
    samples: ClassVar[bool] = True

    integrator: Literal["auto"]

    @staticmethod
    def in_contact(of_elements: bool) -> GeneralizedAlphaRun | CentralDifferenceRun:
        """Return the run that it stands for where faces of elements touch, or rigid surfaces alone."""
        if of_elements:
            return GeneralizedAlphaRun(integrator="generalized-alpha")
        return CentralDifferenceRun(integrator="central-difference")

    def _settings(self, step: float, error: float, duration: float) -> tuple[Any, ...]:
        return error, duration


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
    KindBy("integrator"),
]

RUNS: tuple[type[RunTable], ...] = get_args(get_args(Run)[0])


def name_methods(*traits: str) -> str:
    """Name the methods of all runs that have some traits, for a sentence: ``"a, b and c"``."""
    names = [name for run in RUNS if all(getattr(run, trait) for trait in traits) for name in run.names()]
    return " and ".join([*([", ".join(names[:-1])] if names[1:] else []), names[-1]])
