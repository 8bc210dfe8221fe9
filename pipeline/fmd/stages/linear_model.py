"""From a scene to its linear model: names of inputs and outputs, static correction, and the operating point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError
from fmd.core.limits.responses import RELIABLE_SHARE, SETTLED_STATE, STILL
from fmd.core.units import to_si
from fmd.responses.linearisation import Linearisation
from fmd.responses.ports import MotionPort
from fmd.responses.state_space import StateSpace
from fmd.scene.variants import change_simulation, correct_statically, open_to_space
from fmd.stability.tangent import OperatingPoint
from fmd.stages.linear_ports import find_input, find_output
from fmd.stages.run_checks import require_no_contact

if TYPE_CHECKING:
    from fmd.dynamics.mechanism import Mechanism
    from fmd.scene.scene import Scene
    from fmd.stages.pipeline import Pipeline


import re
from collections.abc import Callable
from pathlib import Path

from fmd.core.formula import parse_formula
from fmd.dynamics.signals.signal import formula

Density = Callable[[Array], Array]


def read_density(text: str, folder: Path, at: tuple[str, str]) -> Density:
    """Read a one-sided power spectral density over the frequency f [Hz], in the input's SI unit squared per Hz.

    The text is a number, a formula of f, or the name of a ``.csv`` file, in a folder, of two columns, frequency [Hz]
    and density, which is straight lines in double logarithmic scale between its rows and zero outside. Messages name
    the file and key at fault.

    Raises
    ------
    InputError
        It is none of these, or negative.
    """
    if text.endswith(".csv"):
        return _read_table(folder / text, text, at)
    try:
        if re.search(r"\bt\b", text):
            raise InputError(*at, text, "is a formula of the frequency f in Hz, not of t")
        signal = formula(parse_formula(re.sub(r"\bf\b", "t", text)), 1.0)
    except ValueError as error:
        fault = re.sub(r"\bt\b", "f", str(error))
        mend = f"{fault}; a number, a formula such as '1e-3 if f < 500 else 0', or a .csv file works"
        raise InputError(*at, text, mend) from None

    def density(frequencies_hz: Array) -> Array:
        values = np.asarray(signal.values(np.asarray(frequencies_hz, dtype=float))[:, 0])
        bad = ~(values >= 0.0) | ~np.isfinite(values)
        if bad.any():
            where = float(frequencies_hz[np.argmax(bad)])
            raise InputError(*at, text, f"is {values[np.argmax(bad)]:.3g} at {where:.5g} Hz; a density is 0 or above")
        return values

    return density


def _read_table(path: Path, text: str, at: tuple[str, str]) -> Density:
    try:
        rows = [line.split("#")[0] for line in path.read_text(encoding="utf-8").splitlines()]
    except OSError as error:
        raise InputError(*at, text, f"can't be read: {error.strerror or error}") from None
    numbers: list[list[float]] = []
    for k, row in enumerate(rows, start=1):
        cells = [cell for cell in re.split(r"[,;\s]+", row.strip()) if cell]
        try:
            values = [float(cell) for cell in cells]
        except ValueError:
            if numbers:
                raise InputError(*at, text, f"line {k} isn't two numbers: {row!r}") from None
            continue  # a header
        if values and len(values) != 2:
            raise InputError(*at, text, f"line {k} has {len(values)} numbers; frequency in Hz and density are needed")
        numbers += [values] if values else []
    table = np.array(numbers).reshape(-1, 2)
    if len(table) < 2 or not (np.diff(table[:, 0]) > 0).all() or not (table > 0).all():
        raise InputError(*at, text, "must hold two rows at least, of ascending frequencies and densities above 0")
    x, y = np.log(table).T

    def density(frequencies_hz: Array) -> Array:
        f = np.asarray(frequencies_hz, dtype=float)
        inside = (f >= table[0, 0]) & (f <= table[-1, 0])
        return np.where(inside, np.exp(np.interp(np.log(np.maximum(f, 1e-300)), x, y)), 0.0)

    return density


STARTS = ("start", "equilibrium", "steady")


@dataclass(frozen=True)
class LinearModel:
    """A scene's linear model, with what belongs to its inputs."""

    model: StateSpace
    about: str  # operating point about which the scene is linearised
    motions: Array  # (n_inputs,): inputs that are the acceleration of a prescribed motion
    warnings: list[dict[str, str]]  # ``code`` and ``text`` of what the answers suffer from
    # Half of the highest frequency that the modes of every body reach, up to which the model is close to that of the
    # whole meshes [Hz]; ``None`` without modes, which leave nothing out.
    holds_to_hz: float | None = None

    def input_names(self, as_positions: bool) -> list[tuple[str, str]]:
        """Return names and units of the inputs; prescribed motions by position, or by acceleration as in the model."""
        return [
            (name.removesuffix(".acceleration"), unit.removesuffix("/s^2")) if moves and as_positions else (name, unit)
            for (name, unit), moves in zip(self.model.inputs, self.motions, strict=True)
        ]

    def frequency_response(self, frequencies_hz: Array) -> Array:
        """Return the response of outputs to inputs, (n_frequencies, n_outputs, n_inputs); to positions of motions."""
        found = self.model.frequency_response(frequencies_hz)
        square = -((2 * np.pi * np.asarray(frequencies_hz)) ** 2)
        found[:, :, self.motions] *= square[:, None, None]
        return found


def linearise_scene(run: Pipeline, inputs: Sequence[str], outputs: Sequence[str], about: str = "start") -> LinearModel:
    """Linearise a scene between channels that are named as in docs/responses.md.

    It is about its ``start``, an ``equilibrium``, a ``steady`` state, or a time [s] of its first run.

    Raises
    ------
    InputError
        A name is unknown, doesn't fit its use, or isn't linear; or there is no such time.
    AccuracyError
        There is no equilibrium or steady state, or the march to the time diverged.
    """
    require_no_contact(run.scene, "a linear model")
    time = read_about(run, about)
    simulation = run.scene.simulation
    requested = [find_input(run.scene, name) for name in inputs]
    scene = correct_statically(open_to_space(run.scene), [at.drive for at in requested if at.drive is not None])
    if about in ("equilibrium", "steady"):
        scene = change_simulation(scene, start=about)
    corrected = run.variant(scene, run.store.monitor)
    mechanism, state = _operating_state(corrected, time)
    name = about if time is None else f"t = {time:g} s"
    if about == "start" and simulation.start != "undeformed":
        name = simulation.start
    if scene.gear_mesh:
        import_module("fmd.stages.gear_teeth").require_pressed_teeth(corrected, mechanism, state, name)
    ports_in = [at.port(mechanism) for at in requested]
    ports_out = [find_output(corrected, mechanism, name) for name in outputs]
    linearisation = Linearisation(mechanism, ports_in, ports_out)
    model = linearisation.at(state)
    accelerations = linearisation.accelerations(state)
    motions = np.array([isinstance(port, MotionPort) for port in ports_in], dtype=bool)
    warnings = _find_warnings(model, mechanism, state, accelerations, name)
    highest = [float(part.modes.frequencies_hz.max()) for part in run.parts.values() if len(part.modes.frequencies_hz)]
    holds = RELIABLE_SHARE * min(highest) if highest else None
    return LinearModel(model, name, motions, [*warnings, *_reduced_bodies(corrected), *_sampled(mechanism)], holds)


def _sampled(mechanism: Mechanism) -> list[dict[str, str]]:
    """Warn of sampled controllers, whose outputs count as constant."""
    names = [controller.name for controller in mechanism.controllers]
    text = f"sampled controllers count as open, with the value that they hold: {', '.join(names)}"
    return [{"code": "sampled", "text": text}] if names else []


def _reduced_bodies(run: Pipeline) -> list[dict[str, str]]:
    """Warn of bodies whose shapes are those of a file: nothing is known of what these leave out."""
    return [
        {
            "code": "not-corrected",
            "text": f"{name} has the shapes of its file alone: without static correction, zeros can be off",
        }
        for name, part in run.parts.items()
        if part.is_reduced
    ]


def default_inputs(scene: Scene) -> list[str]:
    """Return the names of a scene's drives as inputs; without any, the forces on its tip."""
    return [f"drive.{name}" for name in scene.drive] or [f"{scene.simulation.tip}.{way}" for way in "xyz"]


def default_outputs(scene: Scene) -> list[str]:
    """Return the names of a scene's tip and of its joints with one position as outputs."""
    joints = [name for name, joint in scene.joint.items() if joint.kind.unit and name not in scene.closing]
    return [*(f"{scene.simulation.tip}.{way}" for way in "xyz"), *(f"{name}.position" for name in joints)]


def read_about(run: Pipeline, about: str) -> float | None:
    """Return the time [s] of a operating point, ``None`` for the start.

    Raises
    ------
    InputError
        It is neither a state's name nor a time of the scene.
    """
    duration = run.scene.simulation.duration
    if about in STARTS:
        return None
    try:
        time = float(about)
    except ValueError:
        try:
            time = to_si(about, "time")
        except ValueError:
            time = np.nan
    if not 0.0 <= time <= duration:
        mend = f"must be one of {', '.join(STARTS)}, or a time of the scene, 0 … {duration:g} s"
        raise InputError("--about", "", about, mend)
    return time


def _operating_state(run: Pipeline, time: float | None) -> tuple[Mechanism, OperatingPoint]:
    """Return a scene's mechanism with the state at its start, or at a time of its first run."""
    if not time:
        q, v = run.start
        return run.mechanism, OperatingPoint(0.0, q, v)
    plan = replace(next(iter(run.plans.values())), excited=None, excited_system=None)
    trajectory = plan.march(np.array([0.0, time]))
    return plan.mechanism, OperatingPoint(time, trajectory.q[-1], trajectory.v[-1])


def _find_warnings(
    model: StateSpace, mechanism: Mechanism, state: OperatingPoint, a: Array, about: str
) -> list[dict[str, str]]:
    """Warn of a state that doesn't last, and of one from which a motion grows by itself."""
    found = []
    modes = np.concatenate([mechanism.modes_of(k) for k in range(len(mechanism.links))])
    omega = np.concatenate([link.omega for link in mechanism.links])
    joints = np.setdiff1d(np.arange(mechanism.n), modes)
    allowed = STILL * (1.0 + float((state.v**2).max(initial=0.0)))
    deflections = state.q[modes + mechanism.position_shift]
    shift = np.abs(a[modes]) / omega**2
    moves = np.abs(a[joints]).max(initial=0.0) > allowed
    if moves or shift.max(initial=0.0) > SETTLED_STATE * max(np.abs(deflections).max(initial=0.0), 1e-8):
        text = f"the mechanism accelerates at the operating point ({about}): the answers are of one instant"
        text += "; --about equilibrium or --about steady take a state that lasts" if about == "start" else ""
        found.append({"code": "not-steady", "text": text})
    if model.growth:
        text = f"from the operating point ({about}) a small motion grows by {model.growth:.3g} 1/s"
        found.append({"code": "unstable", "text": text})
    elif (undamped := model.poles_hz[model.damping < 1e-9]).size:
        text = f"no damping at {undamped[0]:.5g} Hz{' and others' if undamped.size > 1 else ''}: the response is "
        text += "unbounded there; modes.damping, or dampers, bound it"
        found.append({"code": "undamped", "text": text})
    return found
