"""A scene as a function of some of its numbers: results of designs, in logarithms, and their derivatives."""

from collections.abc import Sequence
from dataclasses import field, replace
from functools import cached_property

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError, InputError
from fmd.core.limits.fitting import KEPT_DESIGNS
from fmd.fitting.frozen_run import FrozenRun, require_like_meshes
from fmd.fitting.parameters import Parameter, change_parameters
from fmd.fitting.sensitivities import change_of
from fmd.fitting.varied import VariedNumber
from fmd.output.channels import ResultChannel, find_channels, follow_mode
from fmd.scene.variants import with_first_run
from fmd.stages.pipeline import Pipeline


@dataclass(frozen=True)
class Design:
    """A scene at some values of its numbers, with the results that count."""

    run: Pipeline
    values: dict[Parameter, float]  # the numbers [SI], by those of the scene
    # Its results: largest values are those of this design, frequencies those of the modes most like the scene's.
    channels: tuple[ResultChannel, ...]

    @cached_property
    def results(self) -> Array:
        """The results in SI units, shape (n_results,)."""
        return np.array([float(channel.read(self.run)) for channel in self.channels])

    @cached_property
    def sensitivities(self) -> Array:
        """Derivatives of the results' logarithms by those of the numbers, (n_results, n_numbers).

        A result without end, such as a life without damage, has none.
        """
        moves = any(channel.moves for channel in self.channels)
        pairs = self.values.items()
        numbers = [each if each.is_factor else replace(each, value=value) for each, value in pairs]
        frozen, columns = FrozenRun(self.run), []
        with self.run.store.monitor("derivatives of a design") as advance:
            motion = frozen.at({}, moves, numbers)
            for own in numbers:
                both = frozen.beside(motion, own, moves=moves)
                pair = both.low, both.high
                changes = [np.atleast_1d(change_of(channel, self.run, *pair))[0] for channel in self.channels]
                with np.errstate(invalid="ignore"):
                    columns.append(own.value / (2.0 * both.step) * np.array(changes) / self.results)
                advance(len(columns) / len(numbers))
        return np.where(np.isfinite(self.results)[:, None], np.column_stack(columns), 0.0)


@dataclass
class DesignSpace:
    """Designs of a scene between bounds of its numbers.

    Raises
    ------
    InputError
        A name is no such result.
    """

    run: Pipeline  # stages of the scene as it is computed; each design is computed as this is, by its first run
    names: Sequence[str]  # results, as `find_channels` takes them, each a number above 0
    varied: tuple[VariedNumber, ...]
    solved: int = 0  # number of designs that have been computed
    _known: dict[bytes, Design] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in self.names:
            for channel in (start := find_channels(self.run, name, "--minimise, --subject")):
                if len(start) > 1 or np.ndim(channel.read(self.run)) or not channel.read(self.run) > 0.0:
                    mend = "is no result of one number above 0, such as mass, tip, stress, life or frequency.1"
                    raise InputError("--minimise, --subject", name, None, mend)

    def at(self, shares: Array) -> Design:
        """Return the design at some numbers, as an optimisation counts them; each is computed once.

        Raises
        ------
        AccuracyError
            It can't be computed, or a mode is lost; the message names the design.
        """
        key = np.asarray(shares, dtype=float).tobytes()
        if key not in self._known:
            pairs = zip(self.varied, shares, strict=True)
            values = {each.parameter: each.from_share(float(share)) for each, share in pairs}
            self.solved += 1
            for old in [*self._known][1:-KEPT_DESIGNS]:
                del self._known[old]
            try:
                self._known[key] = self._solve(values)
            except AccuracyError as error:
                place = ", ".join(f"{parameter.key} = {value:.6g}" for parameter, value in values.items())
                raise AccuracyError(f"the search came to {place}, where {error}") from error
        return self._known[key]

    def _solve(self, values: dict[Parameter, float]) -> Design:
        scene = change_parameters(with_first_run(self.run.scene), values)
        run = self.run.variant(scene, self.run.store.monitor)
        require_like_meshes(self.run, run, values)
        start = [channel for name in self.names for channel in find_channels(self.run, name)]
        channels = [
            follow_mode(own, self.run, run) if own.part else find_channels(run, name)[0]
            for name, own in zip(self.names, start, strict=True)
        ]
        return Design(run, values, tuple(channels))
