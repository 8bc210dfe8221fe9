"""A scene that a program of Python takes on step by step, by the conventions of gymnasium's environments."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fmd.accuracy.solved_scene import SolvedScene
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.limits.stepping import FIRST_TOLERANCE
from fmd.dynamics.compiled_system.sampling import Measurement
from fmd.dynamics.compiler.compiled import compile_mechanism
from fmd.integrators.adaptive import AdaptiveIntegrator
from fmd.integrators.open_march import OpenMarch
from fmd.integrators.runge_kutta import RungeKutta
from fmd.scene.controllers import ExternalValue
from fmd.scene.scene import Scene, load_scene
from fmd.stages.mechanism import add_observer


class SteppedScene:
    """A scene in the hands of a program: it sets values, takes a step, and sees what it asked for.

    The values are the scene's controllers of type ``external``, in their order; formulas of drives name them. Each step
    is marched by the scene's first run if its steps follow the error, else by ``runge-kutta``.

    Parameters
    ----------
    scene : Scene, str or Path
        A scene, or what `fmd.load_scene` takes.
    observe : sequence of str
        Formulas of the motion, as in the formulas of controllers: ``"hinge.angle"``, ``"arm.tip.x - 0.3"``.
    sample_time : float
        Duration of a step [s].

    Raises
    ------
    InputError
        A formula names what the scene doesn't have, or the sample time isn't above 0.

    Example:

        env = fmd.SteppedScene("arm.toml", observe=["hinge.angle", "hinge.rate"], sample_time=1e-3)
        observation, info = env.reset()
        truncated = False
        while not truncated:
            action = [-40.0 * observation[0] - 4.0 * observation[1]]
            observation, reward, terminated, truncated, info = env.step(action)
    """

    def __init__(self, scene: Scene | str | Path, observe: Sequence[str] = (), sample_time: float = 1e-3) -> None:
        run = SolvedScene(scene if isinstance(scene, Scene) else load_scene(scene)).run
        if not sample_time > 0.0:
            raise InputError(run.scene.file, "sample_time", sample_time, "must be a time above 0, in seconds")
        self.scene, self.sample_time, self.observe = run.scene, sample_time, tuple(observe)
        self.system, self._start = run.system, run.start
        method = next(iter(run.drafts)).integrator
        error = run.scene.simulation.error
        self._method = method if isinstance(method, AdaptiveIntegrator) else RungeKutta(FIRST_TOLERANCE * error)
        external = (isinstance(run.scene.controller[name], ExternalValue) for name in self._held)
        self._numbers = [number for number, own in enumerate(external) if own]
        observing = add_observer(run.divided_scene, run.bodies, run.mechanism, observe)
        self._measurement = Measurement(compile_mechanism(observing), len(observing.held)) if observe else None
        self._duration = run.scene.simulation.duration
        self._march = self._begin()

    @property
    def _held(self) -> list[str]:
        """Names of the controllers whose outputs are held, in the order of their numbers."""
        return [
            name
            for name, one in self.scene.controller.items()
            if isinstance(one, ExternalValue) or getattr(one, "sample_time", None)
        ]

    @property
    def actions(self) -> tuple[str, ...]:
        """Names of the values that a step sets."""
        names = self._held
        return tuple(names[k] for k in self._numbers)

    @property
    def time(self) -> float:
        """Present time [s]."""
        return self._march.time

    @property
    def state(self) -> tuple[Array, Array]:
        """Present positions (n_positions,) and rates (n,), in the order of `system`."""
        return self._march.q.copy(), self._march.v.copy()

    def _begin(self) -> OpenMarch:
        self._since, self._count = 0.0, 0  # samples are counted, so that no round-off adds up
        return OpenMarch(self._method, self.system, *self._start, self._duration)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Go back to time 0, and return what is observed and ``{"time": 0.0}``; nothing is random in it.

        Seed and options aren't used: gymnasium hands them over.
        """
        self._march = self._begin()
        return self._look(), {"time": 0.0}

    def step(
        self, action: Sequence[float] | Array = (), dt: float | None = None
    ) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Set the values, and march on by one sample time, or by another time dt [s].

        Parameters
        ----------
        action : sequence of float
            Values of `actions` [SI units]; without any they stay as they are.

        Returns
        -------
        tuple
            What is observed (n_observed,); 0.0, as there is no reward; False, as no state ends it; True once the
            scene's duration is over; and ``{"time": t}``.

        Raises
        ------
        ValueError
            There are other numbers of values, or one isn't finite.
        StabilityError
            The march can't go on.
        """
        march = self._march
        if len(action):
            if len(action) != len(self._numbers) or not all(map(math.isfinite, action)):
                names = ", ".join(self.actions) or "none: the scene has no controller of type external"
                raise ValueError(f"an action holds one finite number for each of {names}, not {action!r}")
            for number, value in zip(self._numbers, action, strict=True):
                march.hold(number, float(value))
        if dt is None:
            self._count += 1
        else:
            self._since, self._count = march.time + dt, 0
        march.advance(self._since + self._count * self.sample_time)
        time = march.time
        return self._look(), 0.0, False, time >= self._duration, {"time": time}

    def run(self, callback: Callable[[float, Array], Sequence[float]]) -> tuple[Array, Array]:
        """Go through the scene from time 0; before each step a function returns the action.

        Parameters
        ----------
        callback : callable
            Takes the time [s] and what is observed, and returns the values that are held over the next sample time.

        Returns
        -------
        tuple of ndarray, shapes (n_times,) and (n_times, n_observed)
            Times of the samples [s], and what is observed then.
        """
        observed, _ = self.reset()
        times, found, over = [0.0], [observed], False
        while not over:
            observed, _, _, over, info = self.step(callback(times[-1], observed))
            times.append(info["time"])
            found.append(observed)
        return np.array(times), np.array(found)

    def _look(self) -> Array:
        if self._measurement is None:
            return np.zeros(0)
        march, measurement = self._march, self._measurement
        measurement.held[: march.held.size] = march.held
        measurement.set_state(march.time, march.q, march.v)
        return measurement.of(len(self.system.mechanism.controllers)).copy()
