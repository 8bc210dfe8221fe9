"""Errors of frequency responses and root mean squares, by more modes and other meshes.

The response of a model with twice as many modes tells what the modes leave out. Recovered stress, a coarser mesh and
one of more elements from side to side tell by how much the mesh shifts the frequencies of all these modes, by which the
response is moved, and what it takes of the flexibility. As in an error budget the stated error is `SAFETY` times the
root of the sum of their squares.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from fmd.accuracy.coarse_mesh import Pair, make_coarse_pair, make_pair_across
from fmd.accuracy.mesh_excess import add_across, combine_modes, energy_excess
from fmd.accuracy.time_limit import FAULTS
from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.errors import SAFETY
from fmd.core.limits.patience import OF_MORE_MODES, OF_TWO_MESHES
from fmd.core.limits.responses import ERROR_BANDS, ERROR_DECADES, FINE_RATIO, POINTS_OF_BAND
from fmd.core.progress import Advance
from fmd.responses.random_vibration import random_response
from fmd.responses.state_space import choose_frequencies
from fmd.scene.variants import change_modes
from fmd.stages.linear_model import LinearModel, linearise_scene
from fmd.stages.pipeline import Pipeline

SHIFTS = (0.5, 1.0, 1.5)  # multiples: beside a resonance a larger shift may change less
NO_ERRORS = "no errors were estimated"

Request = tuple[Sequence[str], Sequence[str], str]
"""Names of inputs and outputs, and the state of linearisation."""


@dataclass(frozen=True)
class ResponseErrors:
    """Stated errors of a frequency response."""

    # (n_frequencies, n_outputs, n_inputs): size of the complex response's error; empty where none is stated
    values: Array
    rms: Array  # (n_outputs,): errors of the root mean squares; empty without a random input
    why: str = ""  # why none is stated; empty if they are


@dataclass(frozen=True)
class BandErrors:
    """Stated errors of a linear model's responses by ranges of frequency."""

    edges_hz: Array  # (n_bands + 1,): ends of the ranges [Hz]
    # (n_bands, n_outputs, n_inputs): largest size of a response's error in each range; empty where none is stated
    values: Array
    shares: Array  # (n_bands,): largest of these over the largest response of its pair in the range
    why: str = ""  # why none is stated; empty if they are


@dataclass(frozen=True)
class _Variants:
    """A model with more modes, and what the mesh does to the given one."""

    given: LinearModel
    rich: LinearModel
    shift: Callable[[Array], Array]  # share by which the mesh raises frequencies, at frequencies [Hz]
    share: Array
    """Share of the response that the mesh takes away, or adds, whatever the frequency, shape (n_outputs, n_inputs)."""


def estimate_response_errors(
    run: Pipeline,
    linear: LinearModel,
    request: Request,
    frequencies_hz: Array,
    density: Callable[[Array], Array] | None = None,
) -> ResponseErrors:
    """Estimate the errors of a scene's frequency response, and of root mean squares in its range.

    The model was made of ``request``; frequencies [Hz] ascend; ``density`` is the spectral density of the only input.
    """
    try:
        lowest = float(frequencies_hz[0])
        found = run.store.compute("errors of responses", lambda: _find_variants(run, linear, request, lowest))
    except FAULTS as fault:  # of a variant: the response itself is there
        found = f"{fault}"
    if isinstance(found, str):
        return ResponseErrors(np.zeros(0), np.zeros(0), found)
    own = linear.frequency_response(frequencies_hz)
    more = found.rich.frequency_response(frequencies_hz)
    moved = np.max([_change_by_shift(found, frequencies_hz, more, times) for times in SHIFTS], axis=0)
    values = total_error(np.abs(more - own), moved, found.share * np.abs(more))
    if density is None:
        return ResponseErrors(values, np.zeros(0))
    return ResponseErrors(values, _errors_of_rms(found, frequencies_hz, density))


def estimate_band_errors(
    run: Pipeline, linear: LinearModel, request: Request, reduced: LinearModel | None = None
) -> BandErrors:
    """Estimate the errors of a linear model by ranges of frequency, up to that which its modes hold to.

    The distance of ``reduced``, the model with fewer states, from the whole one comes on top.
    """
    highest = float(linear.model.poles_hz.max(initial=1.0)) if linear.holds_to_hz is None else linear.holds_to_hz
    edges = np.geomspace(highest / 10.0**ERROR_DECADES, highest, ERROR_BANDS + 1)
    even = np.unique(np.concatenate([np.geomspace(*ends, POINTS_OF_BAND) for ends in pairwise(edges)]))
    near = choose_frequencies(linear.model, float(edges[0]), highest, 2)
    frequencies = np.union1d(even, near)
    own = linear.frequency_response(frequencies)
    kept = np.isfinite(own).all(axis=(1, 2))
    frequencies, own = frequencies[kept], own[kept]
    found = estimate_response_errors(run, linear, request, frequencies)
    if found.why:
        return BandErrors(np.zeros(0), np.zeros(0), np.zeros(0), found.why)
    errors = found.values
    if reduced is not None:
        errors = errors + np.abs(reduced.frequency_response(frequencies) - own)
    starts = np.searchsorted(frequencies, edges[:-1])
    values, largest = (np.maximum.reduceat(each, starts, axis=0) for each in (errors, np.abs(own)))
    shares = np.divide(values, largest, out=np.zeros_like(values), where=largest > 0.0).max(axis=(1, 2), initial=0.0)
    return BandErrors(edges, values, shares)


def _change_by_shift(found: _Variants, frequencies_hz: Array, response: Array, times: float) -> Array:
    """Return what a multiple of the shift of frequencies changes in a response."""
    shifted = frequencies_hz * (1.0 + times * found.shift(frequencies_hz))
    return np.abs(found.rich.frequency_response(shifted) - response)


def _find_variants(run: Pipeline, linear: LinearModel, request: Request, lowest: float) -> _Variants | str:
    if not run.parts:
        return _Variants(linear, linear, np.zeros_like, np.zeros(linear.model.D.shape))
    shifted = shift_frequencies(run, lambda done: run.store.advance(OF_TWO_MESHES * done))
    if isinstance(shifted, str):
        return shifted
    pair, rich = shifted.pair, linearise_scene(shifted.richer, *request)
    of_stress = np.array([channel.unit == "Pa" for channel in linear.model.outputs])[:, None]
    lowest_excess = 2.0 * float(shifted.share(np.zeros(1))[0])
    if isinstance(pair, str):
        return (
            pair
            if of_stress.any()
            else _Variants(linear, rich, shifted.share, np.full(rich.model.D.shape, lowest_excess))
        )
    coarse = linearise_scene(pair.coarse.variant(pair.coarse.scene), *request)
    at = np.array([lowest])
    own, other = (np.abs(each.frequency_response(at)[0]) for each in (rich, coarse))
    gains = np.abs(np.where(of_stress, pair.gains["spot stress"], pair.gains["displacement"]))
    share = np.divide(np.abs(other - own), own * gains, out=np.zeros_like(own), where=own > 0)
    share = np.where(of_stress, share, np.maximum(share, lowest_excess))  # what is too stiff yields too little
    return _Variants(linear, rich, shifted.share, share)


@dataclass(frozen=True)
class FrequencyShift:
    """By how much a mesh raises the frequencies of a scene with about twice as many modes."""

    richer: Pipeline
    pair: Pair | str  # the richer run and the same on a coarser mesh, or why there is none, as of a mesh from a file
    hertz: Array  # (n,): frequencies of all parts' modes, ascending [Hz]
    excess: Array  # (n,): relative excess of the squares of the frequencies up to each

    def share(self, frequencies_hz: Array) -> Array:
        """Return the share by which frequencies are raised, at frequencies [Hz]."""
        return np.asarray(np.interp(frequencies_hz, self.hertz, 0.5 * self.excess))


def shift_frequencies(run: Pipeline, advance: Advance = lambda done: None) -> FrequencyShift | str:
    """Return what the mesh does to the frequencies of a run's flexible bodies, or why that isn't known."""
    lacking = [name for name, part in run.parts.items() if part.is_reduced or not part.has_mesh]
    if lacking:
        return f"{lacking[0]} has no mesh, and tells nothing of its own error"
    richer = run.variant(change_modes(run.scene, lambda body: {"count": 2 * body.modes.count + 2}))
    for k, part in enumerate(richer.parts.values(), start=1):
        assert part.modes is not None  # which makes them
        advance(OF_MORE_MODES * k / len(richer.parts))
    pair = make_coarse_pair(richer)
    pair = pair.removeprefix("not estimated: ") if isinstance(pair, str) else pair
    advance(1.0)
    return FrequencyShift(richer, pair, *_excess_of_modes(richer, pair))


def _excess_of_modes(run: Pipeline, pair: Pair | str) -> tuple[Array, Array]:
    """Return the frequencies of all parts' modes, ascending, and the excess of their squares by the mesh up to each.

    As in the error budget: by recovered stress, by a coarser mesh if there is one, and by more elements across.
    """
    across = make_pair_across(run)
    hertz, excess = [], []
    for name, part in run.parts.items():
        own = energy_excess(part, part.body)[0]
        own = own if isinstance(pair, str) else combine_modes(part, own, pair)
        if across is not None and across.divides(name):
            own = add_across(own, across, name)
        hertz.append(part.modes.frequencies_hz)
        excess.append(np.abs(own))
    every = np.concatenate(hertz)
    order = np.argsort(every)
    return every[order], np.asarray(np.maximum.accumulate(np.concatenate(excess)[order]))


def _errors_of_rms(found: _Variants, frequencies_hz: Array, density: Callable[[Array], Array]) -> Array:
    """Return the errors of root mean squares in a range of frequencies, each integrated about its own resonances."""
    ends = float(frequencies_hz[0]), float(frequencies_hz[-1])

    def rms(linear: LinearModel, shift: Callable[[Array], Array] = np.zeros_like) -> Array:
        at = choose_frequencies(linear.model, *ends, len(frequencies_hz), FINE_RATIO)
        return random_response(at / (1.0 + shift(at)), linear.frequency_response(at)[:, :, 0], density).rms

    own, more = rms(found.given), rms(found.rich)
    return total_error(np.abs(more - own), np.abs(rms(found.rich, found.shift) - more), found.share[:, 0] * own)


def total_error(*estimates: Array | float) -> Array:
    """Return the stated error by independent estimates: `SAFETY` times the root of the sum of their squares."""
    return np.asarray(SAFETY * np.sqrt(sum(estimate**2 for estimate in estimates)))
