"""Growth of small vibrations of a mechanism with sampled controllers, whose outputs are held between samples.

Linearised at a state, the mechanism moves by ``x' = A x + B u`` with held values u, exactly ``x⁺ = Φ x + Γ u`` over a
time h, with ``Φ, Γ`` the blocks of ``exp([[A, B], [0, 0]] h)`` (Åström & Wittenmark, Computer-Controlled Systems, 1997,
section 2.3). Controllers are linear without their limits. The eigenvalues μ of the map of x, of the controllers'
memories and of u over a common multiple of all sample times say how vibrations grow.
"""

from collections.abc import Sequence
from math import lcm

import numpy as np
from scipy.linalg import expm

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.newton import NUDGE
from fmd.core.limits.stability import LONGEST_CYCLE, RATE_NUDGE, SAME_SAMPLES
from fmd.dynamics.compiled_system.sampling import Measurement
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.controllers import LinearLaw
from fmd.integrators.protocol import evaluate, evaluate_velocities
from fmd.stability.tangent import OperatingPoint, differentiate


@dataclass(frozen=True)
class SampledLoops:
    """Linear model of a mechanism between samples, and of what its controllers measure."""

    A: Array  # (n, n): rates of positions and rates by these
    B: Array  # (n, n_held): rates of positions and rates by held values
    C: Sequence[Array]  # (n_measured, n): what each controller measures by positions and rates
    D: Sequence[Array]  # (n_measured, n_held): what each controller measures by held values
    outputs: tuple[int, ...]  # number of the value that each controller holds

    def growth_rate(self, periods: Sequence[float], laws: Sequence[LinearLaw]) -> float | None:
        """Return the largest growth rate of small vibrations [1/s]; none if sample times have no common multiple.

        Each controller has a period [s] and a law.
        """
        every = _count_steps(periods)
        if every is None:
            return None
        base, cycle = min(periods), lcm(*every)
        n, held = self.B.shape
        memories = np.cumsum([n, *(len(law.C) for law in laws), held])
        size = int(memories[-1])
        flow = np.eye(size)
        block = expm(np.block([[self.A, self.B], [np.zeros((held, n + held))]]) * base)
        flow[:n, :n], flow[:n, size - held :] = block[:n, :n], block[:n, n:]
        total = np.eye(size)
        for step in range(cycle):
            for k, law in enumerate(laws):
                if step % every[k] == 0:
                    total = self._sample(k, law, int(memories[k]), size) @ total
            total = flow @ total
        return float(np.log(max(np.abs(np.linalg.eigvals(total)).max(), 1e-300)) / (cycle * base))

    def _sample(self, k: int, law: LinearLaw, first: int, size: int) -> Array:
        """Return the map of a controller's sample, whose memory begins at a place."""
        A, B, C, D, _ = law.matrices
        n, held = self.B.shape
        own, output = slice(first, first + len(C)), size - held + self.outputs[k]
        measured = np.zeros((len(D), size))
        measured[:, :n], measured[:, size - held :] = self.C[k], self.D[k]
        sample = np.eye(size)
        sample[own], sample[output] = B @ measured, D @ measured
        sample[own, own] += A
        sample[output, own] += C
        return sample


def _count_steps(periods: Sequence[float]) -> list[int] | None:
    """Return the sample times in the shortest of them; none if they aren't whole, or their cycle is too long."""
    ratios = np.array(periods) / min(periods)
    whole = np.rint(ratios)
    if np.abs(ratios - whole).max() > SAME_SAMPLES or lcm(*whole.astype(int).tolist()) > LONGEST_CYCLE:
        return None
    return [int(count) for count in whole]


def linearise_loops(system: CompiledSystem, at: OperatingPoint, held: Array) -> SampledLoops:
    """Linearise a mechanism, and what its controllers measure, at a state with values that are held there (n_held,)."""
    p, n, n_positions = system.parameters, system.n, system.n_positions
    measurement = Measurement(system.compiled, held.size)
    controllers = system.mechanism.controllers

    def set_state(x: Array) -> tuple[Array, Array]:
        q, v, u = np.split(x, [n_positions, n_positions + n])
        p.inputs[p.inputs.size - held.size :] = u
        measurement.held[:] = u
        return q.copy(), v.copy()

    def slope(x: Array) -> Array:
        (q, v), dq, a = set_state(x), np.zeros(n_positions), np.zeros(n)
        evaluate_velocities(p, q, v, dq)
        evaluate(p, at.time, q, v, a)
        return np.concatenate([dq, a])

    def measured(x: Array) -> Array:
        measurement.set_state(at.time, *set_state(x))
        return np.concatenate([measurement.of(k).copy() for k in range(len(controllers))])

    centre = np.concatenate([at.q, at.v, held])
    nudges = np.concatenate([np.repeat([NUDGE, RATE_NUDGE], [n_positions, n]), RATE_NUDGE * (1.0 + np.abs(held))])
    both, seen = differentiate(slope, centre, nudges), differentiate(measured, centre, nudges)
    rows = np.cumsum([len(controller.measured) for controller in controllers])[:-1]
    size = n_positions + n
    C, D = (np.split(part, rows) for part in (seen[:, :size], seen[:, size:]))
    outputs = tuple(controller.output.number for controller in controllers)
    return SampledLoops(both[:, :size], both[:, size:], C, D, outputs)
