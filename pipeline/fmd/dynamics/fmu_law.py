"""An FMU for co-simulation as the law of a sampled controller."""

import os
import shutil
import tempfile
import weakref
from collections.abc import Callable, Sequence
from contextlib import chdir, suppress
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.errors import StabilityError, as_input_error

# Weights of an FMU's inputs at the end of its step and the two samples before it, and of its output at a sample and the
# one before it, by coupling and order: values that are held, and values at the middle of a step by straight lines.
COUPLINGS = {
    ("gauss-seidel", 1): ((1.0, 0.0, 0.0), (1.0, 0.0)),
    ("gauss-seidel", 2): ((0.5, 0.5, 0.0), (1.5, -0.5)),
    ("jacobi", 1): ((0.0, 1.0, 0.0), (1.0, 0.0)),
    ("jacobi", 2): ((0.0, 1.5, -0.5), (1.5, -0.5)),
}


@dataclass(frozen=True)
class FmuLaw:
    """Law of a controller that an FMU computes, from sample to sample (Busch, ZAMM 96, 2016)."""

    name: str
    path: str
    digest: str
    inputs: tuple[str, ...]  # its variables that take what is measured
    output: str  # its variable that is held
    parameters: tuple[tuple[str, float], ...]  # values that are set before it begins
    period: float  # sample time [s]
    coupling: str  # key of ``COUPLINGS`` with the order
    order: int  # 1 or 2

    def begin(self) -> Callable[[float, Array], float]:
        """Return a function that takes the time [s] and what is measured (m,), and advances an FMU of its own."""
        with as_input_error("controller", self.name, self.path, of=FmuError):
            fmu = FmuInstance(self.path)
        taken, kept = (np.array(weights) for weights in COUPLINGS[self.coupling, self.order])
        inputs: list[Array] = []  # of the last three samples, the latest first
        outputs: list[float] = []  # of the last two

        def act(time: float, measured: Array) -> float:
            try:
                if not inputs:
                    inputs.extend([measured.copy()] * len(taken))
                    fmu.start(self.parameters, zip(self.inputs, measured.tolist(), strict=True))
                    outputs.extend([fmu.read(self.output)] * len(kept))
                else:
                    inputs[:] = [measured.copy(), *inputs[:-1]]
                    fmu.advance(self.inputs, (taken @ np.stack(inputs)).tolist(), time - self.period, self.period)
                    outputs[:] = [fmu.read(self.output), outputs[0]]
            except FmuError as error:
                raise StabilityError(f"controller {self.name}: {error} at t = {time:.6g} s", time, measured) from error
            return float(kept @ outputs)

        return act


class FmuError(Exception):
    """An FMU refuses a call."""


class FmuInstance:
    """An instance of an FMU for co-simulation of FMI 2.0 or 3.0, unpacked into a folder that goes when it does."""

    def __init__(self, path: str) -> None:
        import fmpy
        from fmpy.simulation import instantiate_fmu

        self._description = fmpy.read_model_description(path, validate=False)
        self._references = {each.name: each.valueReference for each in self._description.modelVariables}
        folder = tempfile.mkdtemp(prefix="fmd-fmu-")
        try:
            fmpy.extract(path, unzipdir=folder)
            with chdir(os.curdir):  # FMPy stays in the FMU's folder where its library can't be loaded
                self._fmu = instantiate_fmu(folder, self._description, "CoSimulation")
        except Exception as error:  # of the archive, of the loader, of FMPy
            shutil.rmtree(folder, ignore_errors=True)
            raise FmuError(f"its FMU can't be started: {error}") from error
        self._is_third = self._description.fmiVersion.startswith("3")
        weakref.finalize(self, _close, self._fmu, folder)

    def start(self, *values: Any) -> None:
        """Begin at time 0 with some values, pairs of names and numbers."""
        pairs = [pair for some in values for pair in some]
        if self._is_third:
            self._call("enterInitializationMode", startTime=0.0)
        else:
            self._call("setupExperiment", startTime=0.0)
            self._call("enterInitializationMode")
        self._set([name for name, _ in pairs], [value for _, value in pairs])
        self._call("exitInitializationMode")

    def advance(self, names: Sequence[str], values: Sequence[float], time: float, step: float) -> None:
        """Set inputs and advance from a time by a step [s]."""
        self._set(names, values)
        found = self._call("doStep", currentCommunicationPoint=time, communicationStepSize=step)
        if self._is_third and (found[1] or found[2]):
            raise FmuError("its FMU ends the simulation" if found[1] else f"its FMU stops at {found[3]:.6g} s")

    def read(self, name: str) -> float:
        """Return the value of a variable."""
        (value,) = self._call("getFloat64" if self._is_third else "getReal", [self._references[name]])
        return float(value)

    def _set(self, names: Sequence[str], values: Sequence[float]) -> None:
        if names:
            self._call(
                "setFloat64" if self._is_third else "setReal", [self._references[name] for name in names], values
            )

    def _call(self, function: str, *arguments: Any, **named: Any) -> Any:
        from fmpy.fmi1 import FMICallException

        try:
            return getattr(self._fmu, function)(*arguments, **named)
        except FMICallException as error:
            raise FmuError(f"its FMU refuses {function}: {error}") from error


def _close(fmu: Any, folder: str) -> None:
    """End an instance and remove its folder."""
    with suppress(Exception):  # it has failed, or has not begun
        fmu.terminate()
    fmu.freeInstance()
    shutil.rmtree(folder, ignore_errors=True)
