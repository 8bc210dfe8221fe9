"""Runs with two step lengths in a scene file: small steps for fast coordinates, large ones for slow coordinates."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Literal

from pydantic import model_validator

from fmd.core.units import PositiveFrequency, PositiveTime
from fmd.scene.reading import FaultError
from fmd.scene.run_table import RunTable
from fmd.scene.values import Count

if TYPE_CHECKING:
    from fmd.integrators.protocol import Integrator


class SubCycledRun(RunTable):
    """A run with small steps for fast coordinates and large ones for slow coordinates."""

    if TYPE_CHECKING:
        substeps: int | Literal["auto"]
        split: Literal["joints", "auto"] | float
        step: float | None

    def _settings(self, step: float, error: float, duration: float) -> tuple[Any, ...]:
        return step, self.substeps

    def label(self, substeps: int = 0) -> str:
        """Return the name of the motion by this run: with its ratio, or that of the integrator."""
        return f"{self.integrator} {substeps or self.substeps}:1"


class SubCyclingRun(SubCycledRun):
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

    title: ClassVar[str] = "Sub-cycling"
    growth_remedy: ClassVar[str] = ", and reversible-sub-cycling takes longer ones"

    integrator: Literal["sub-cycling"]
    substeps: Count | Literal["auto"]
    split: Literal["joints", "auto"] | PositiveFrequency = "joints"
    step: PositiveTime | None = None

    @model_validator(mode="after")
    def _both_or_none(self) -> SubCyclingRun:
        if (self.substeps == "auto") != (self.split == "auto"):
            raise FaultError("is chosen together with the split: give both 'auto' or none", "substeps")
        return self

    @staticmethod
    def _method() -> type[Any]:
        from fmd.integrators.subcycling import Subcycling

        return Subcycling


class ReversibleSubCyclingRun(SubCycledRun):
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

    title: ClassVar[str] = "Reversible sub-cycling"

    integrator: Literal["reversible-sub-cycling"]
    substeps: Count
    split: Literal["joints"] | PositiveFrequency = "joints"
    step: PositiveTime | None = None

    @staticmethod
    def _method() -> type[Any]:
        from fmd.integrators.reversible import ReversibleSubcycling

        return ReversibleSubcycling

    def make(self, step: float, error: float, duration: float) -> Integrator:
        """Make the integrator; with a ratio of 1 it is central differences, whose limit is the same."""
        if self.substeps == 1:
            from fmd.integrators.central_difference import CentralDifference

            return CentralDifference(step)
        return super().make(step, error, duration)
