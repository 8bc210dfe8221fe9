"""Linear state-space models ``ẋ = A x + B u``, ``y = C x + D u`` with names and units, and their frequency response."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.files import whole_file
from fmd.core.limits import responses as limits
from fmd.core.limits.round_off import SUMMED


class Channel(NamedTuple):
    """A state, an input or an output."""

    name: str  # e.g. ``plate.tip.z``
    unit: str  # SI, e.g. ``m``


@dataclass(frozen=True)
class StateSpace:
    """A linear time-invariant model of a mechanism's small motions.

    Raises
    ------
    ValueError
        Shapes disagree with the names.
    """

    A: Array  # (n, n), in SI units
    B: Array  # (n, n_inputs), in SI units
    C: Array  # (n_outputs, n), in SI units
    D: Array  # (n_outputs, n_inputs), in SI units
    states: tuple[Channel, ...]  # names and units of the states
    inputs: tuple[Channel, ...]  # names and units of the inputs
    outputs: tuple[Channel, ...]  # names and units of the outputs

    def __post_init__(self) -> None:
        n, n_in, n_out = len(self.states), len(self.inputs), len(self.outputs)
        shapes = (self.A.shape, self.B.shape, self.C.shape, self.D.shape)
        if shapes != ((n, n), (n, n_in), (n_out, n), (n_out, n_in)):
            raise ValueError(f"matrices of shapes {shapes} don't have {n} states, {n_in} inputs and {n_out} outputs")

    @cached_property
    def poles(self) -> Array:
        """Eigenvalues of A [1/s], complex, by their size."""
        found = np.linalg.eigvals(self.A) if len(self.A) else np.zeros(0)
        return np.asarray(found[np.lexsort((found.imag, np.abs(found)))])

    @cached_property
    def _fastest(self) -> float:
        return float(np.abs(self.poles).max(initial=0.0))

    @cached_property
    def slowest_pole(self) -> float:
        """Size of a pole that is a rigid motion's, of 0 but for round-off [1/s].

        It is measured by the fastest oscillation: what strong dampers hold decays faster by many orders.
        """
        oscillation = float(self.poles.imag.max(initial=0.0))
        return max(
            limits.SLOW_POLE * (oscillation or self._fastest),
            limits.ROUNDED_POLES * np.finfo(float).eps * self._fastest,
        )

    @property
    def oscillating_poles(self) -> Array:
        """Poles with a positive imaginary part [1/s], by their size."""
        return self.poles[self.poles.imag > self.slowest_pole]

    @property
    def poles_hz(self) -> Array:
        """Natural frequencies of the oscillating poles ``|λ|/2π`` [Hz], ascending."""
        return np.abs(self.oscillating_poles) / (2 * np.pi)

    @property
    def damping(self) -> Array:
        """Damping ratios of the oscillating poles, ``−Re λ/|λ|``; negative for a motion that grows."""
        ratios = -self.oscillating_poles.real / np.abs(self.oscillating_poles)
        return np.where(np.abs(ratios) < SUMMED, 0.0, ratios)

    @property
    def growth(self) -> float:
        """Largest rate at which a small motion grows [1/s]; 0 if none does."""
        fastest = float(self.poles.real.max(initial=0.0))
        return fastest if fastest > self.slowest_pole else 0.0

    def zeros_hz(self, number_in: int = 0, number_out: int = 0) -> Array:
        """Frequencies of the oscillating zeros of one output by one input ``|z|/2π`` [Hz], ascending.

        Those are finite eigenvalues of the pencil ``[A − z 1, B; C, D]`` (Rosenbrock 1970). Zeros that cancel a pole,
        of a mode that the input doesn't move or the output doesn't see, are left out, and so are those far from the
        imaginary axis, at which no response is small.
        """
        from scipy.linalg import eigvals

        n = len(self.A)
        if not n:
            return np.zeros(0)
        # Time is scaled by the fastest oscillation, the row and column by their sizes, so that infinity is told apart.
        speed = float(self.poles.imag.max(initial=0.0)) or self._fastest or 1.0
        b, c, d = self.B[:, number_in], self.C[number_out], self.D[number_out, number_in]
        size_b, size_c = np.linalg.norm(b) or 1.0, np.linalg.norm(c) or 1.0
        pencil = np.block([[self.A / speed, b[:, None] / size_b], [c[None] / size_c, np.array([[d * speed]])]])
        pencil[n, n] /= size_b * size_c
        pair = eigvals(pencil, np.diag(np.r_[np.ones(n), 0.0]), homogeneous_eigvals=True)
        finite = np.abs(pair[0]) < limits.INFINITE_ZERO * np.abs(pair[1])
        zeros = pair[0][finite] / pair[1][finite]
        zeros = zeros[(zeros.imag > self.slowest_pole / speed) & (np.abs(zeros.real) < limits.FAR_ZERO * zeros.imag)]
        apart = np.abs(zeros[:, None] * speed - self.oscillating_poles).min(axis=1, initial=np.inf)
        zeros = zeros[apart > limits.CANCELS * np.abs(zeros) * speed]
        return np.sort(np.abs(zeros)) * speed / (2 * np.pi)

    def frequency_response(self, frequencies_hz: Array) -> Array:
        """Return ``C (iω − A)⁻¹ B + D`` at frequencies, complex, shape (n_frequencies, n_outputs, n_inputs).

        A is brought to triangular form once (Laub, IEEE Trans Automatic Control 26, 1981).
        """
        from scipy.linalg import matrix_balance, schur

        omega = 2j * np.pi * np.asarray(frequencies_hz, dtype=float)
        n = len(self.A)
        direct = np.broadcast_to(self.D.astype(complex), (len(omega), *self.D.shape))
        if not n:
            return direct.copy()
        balanced, (scale, _) = matrix_balance(self.A, permute=False, separate=True)  # positions and rates alike
        T, Q = schur(balanced.astype(complex), output="complex")
        right, left = Q.conj().T @ (self.B / scale[:, None]), (self.C * scale) @ Q
        x = np.zeros((n, len(omega), self.B.shape[1]), dtype=complex)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # at an undamped pole itself
            for k in range(n - 1, -1, -1):
                known = right[k] + np.tensordot(T[k, k + 1 :], x[k + 1 :], 1)
                x[k] = known / (omega - T[k, k])[:, None]
            return np.asarray(np.einsum("ok,kfi->foi", left, x) + direct)

    def save(self, path: Path, more: Mapping[str, Any] | None = None) -> None:
        """Write matrices, names and units as ``.npz`` (NumPy) or ``.mat`` (MATLAB, Octave), and ``more`` values.

        Raises
        ------
        ValueError
            The suffix is neither.
        """
        if path.suffix not in (".npz", ".mat"):
            raise ValueError(f"{path.suffix!r} isn't a format of state-space models; .npz and .mat are")
        contents: dict[str, Any] = {"A": self.A, "B": self.B, "C": self.C, "D": self.D, **(more or {})}
        for kind in ("states", "inputs", "outputs"):
            channels: tuple[Channel, ...] = getattr(self, kind)
            contents[kind] = [channel.name for channel in channels]
            contents[f"{kind[:-1]}_units"] = [channel.unit for channel in channels]
        with whole_file(path) as part:
            if path.suffix == ".npz":
                arrays: dict[str, Any] = {name: np.array(values) for name, values in contents.items()}
                with part.open("wb") as file:
                    np.savez(file, **arrays)
                return
            from scipy.io import savemat

            cells = {name: _as_cells(values) for name, values in contents.items()}
            with part.open("wb") as file:
                savemat(file, cells)

    def to_control(self) -> Any:
        """Return the model as ``control.ss`` of the package python-control, with all names.

        Raises
        ------
        ModuleNotFoundError
            The package isn't installed; the message says how it is.
        """
        try:
            import control
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError("to_control needs python-control: pip install control") from error
        names = {kind: _plain(getattr(self, kind)) for kind in ("states", "inputs", "outputs")}
        return control.ss(self.A, self.B, self.C, self.D, **names)


def _plain(channels: Sequence[Channel]) -> list[str]:
    """Return names that python-control takes: it reads a dot as that of a subsystem."""
    return [channel.name.replace(".", "_").replace(" ", "_") for channel in channels]


def _as_cells(values: Any) -> Any:
    """Return texts as MATLAB's cell array, and arrays as they are."""
    if not isinstance(values, list):
        return values
    cells = np.empty((len(values), 1), dtype=object)
    cells[:, 0] = values
    return cells


def choose_frequencies(model: StateSpace, lowest: float, highest: float, points: int, ratio: float = 1.3) -> Array:
    """Return frequencies from the lowest to the highest [Hz], ascending, with no resonance between two of them.

    ``points`` of them are evenly spaced; about a pole each is farther from it than the one before by the ratio.
    """
    even = np.linspace(lowest, highest, points)
    spacing = (highest - lowest) / max(points - 1, 1)
    found: list[Array] = [even]
    for frequency, damping in zip(model.poles_hz, model.damping, strict=True):
        half = frequency * max(abs(damping), limits.LEAST_DAMPING)
        count = int(
            np.ceil(
                np.log(max(spacing / (ratio - 1.0) / (limits.NEAREST_TO_POLE * half), 20.0 * ratio)) / np.log(ratio)
            )
        )
        away = limits.NEAREST_TO_POLE * half * ratio ** np.arange(count)
        peak = frequency * np.sqrt(max(1.0 - 2.0 * damping**2, 0.0))
        found += [peak - away, peak + away, np.full(int(abs(damping) >= limits.LEAST_DAMPING), peak)]
    every = np.unique(np.concatenate(found))
    return np.asarray(every[(every >= lowest) & (every <= highest)])
