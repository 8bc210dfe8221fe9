"""Base of all runs' tables: the integrator that a run makes, its label, and what its method needs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, get_args

from pydantic import Field, field_validator

from fmd.core.units import PositiveTime
from fmd.scene.reading import SceneTable
from fmd.scene.values import Number

if TYPE_CHECKING:
    from fmd.integrators.protocol import Integrator

Tolerance = Annotated[Number, Field(ge=3e-14, lt=1.0)]


class RunTable(SceneTable):
    """A run by one method of integration: the base of all methods' tables."""

    title: ClassVar[str]  # the method's name in the reference of scene files
    method: ClassVar[str]  # module in `fmd.integrators` and class of the integrator
    # Its error sets the steps; any other method is given one, in the run or in the simulation.
    chooses_steps: ClassVar[bool] = False
    keeps_loops: ClassVar[bool] = True  # it brings each step back onto the constraints of loops
    turns_in_space: ClassVar[bool] = True  # it takes joints with rotations in space, whose positions are quaternions
    samples: ClassVar[bool] = False  # its steps end where sampled controllers measure
    takes_contact: ClassVar[bool] = False  # it tells contacts when a step ends
    keeps_energy: ClassVar[bool] = False  # it does in contacts without memory, at any step, of bodies that don't turn
    takes_memory: ClassVar[bool] = True  # it takes contacts with friction, damping or restitution, if any
    passes_over: ClassVar[bool] = False  # it stays stable where its steps don't resolve fast vibrations
    limit_remedy: ClassVar[str] = ""  # how the message that refuses a step for its limit names another method
    growth_remedy: ClassVar[str] = ""  # how the one that refuses it for vibrations that it makes grow names another

    if TYPE_CHECKING:  # a field of each method, which describes it
        integrator: str

    @property
    def is_limited(self) -> bool:
        """True if it takes given steps that have to resolve fast vibrations."""
        return not (self.chooses_steps or self.passes_over or self.keeps_energy)

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Return the names that a scene may give the method by."""
        return get_args(cls.model_fields["integrator"].annotation)

    def make(self, step: float, error: float, duration: float) -> Integrator:
        """Make the integrator, whose module is loaded here: each brings kernels of its own.

        The step [s] is for methods that are given one; error and duration [s] are those of the simulation.
        """
        integrator: Integrator = self._method()(*self._settings(step, error, duration))
        return integrator

    @classmethod
    def ladders(cls, explicit: Sequence[float], coarse: Sequence[float]) -> Iterator[Sequence[Integrator]]:
        """Yield families of the method for a comparison, as its integrator has them."""
        yield from cls._method().ladders(explicit, coarse)

    @classmethod
    def _method(cls) -> Any:
        """Return the integrator's class."""
        module, _, name = cls.method.partition(".")
        return getattr(import_module(f"fmd.integrators.{module}"), name)

    def _settings(self, step: float, error: float, duration: float) -> tuple[Any, ...]:
        """Return the integrator's arguments."""
        return (getattr(self, "tolerance", step),)

    def label(self, substeps: int = 1) -> str:
        """Return the name of the motion by this run; ``substeps`` are those of the integrator."""
        return self.integrator


class SteppedRun(RunTable):
    """A run whose step is given."""

    # Time step [s]; by default that of the simulation. In sub-cycling it is the fast one.
    step: PositiveTime | None = None

    @field_validator("step", mode="before")
    @classmethod
    def _given(cls, step: Any) -> Any:
        if step == "auto":
            raise ValueError("is chosen for all runs: set simulation.step = 'auto', and leave the run's own out")
        return step


class SteeredRun(RunTable):
    """A run whose error sets the steps."""

    chooses_steps: ClassVar[bool] = True
    step: ClassVar[None] = None


class TolerantRun(SteeredRun):
    """A run whose steps keep a tolerance."""

    tolerance: Tolerance = 1e-9  # Relative tolerance of the error in a step.


class SubCycledRun(SteppedRun):
    """A run with small steps for fast coordinates and large ones for slow coordinates."""

    if TYPE_CHECKING:
        substeps: int | Literal["auto"]
        split: Literal["joints", "auto"] | float

    def _settings(self, step: float, error: float, duration: float) -> tuple[Any, ...]:
        return step, self.substeps

    def label(self, substeps: int = 0) -> str:
        """Return the name of the motion by this run: with its ratio, or that of the integrator."""
        return f"{self.integrator} {substeps or self.substeps}:1"
