"""Loads that prescribed joints need: what free joints in their place lack for the prescribed motion."""

from dataclasses import replace

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.compiler.compiled import CompiledMechanism
from fmd.dynamics.mechanism import Mechanism


class Drives:
    """Prescribed joints of a mechanism, and the mechanism with free joints in their place."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.frozen = CompiledMechanism(mechanism)
        free = replace(mechanism, links=[replace(link, motion=None) for link in mechanism.links])
        self.free = CompiledMechanism(free)

    def loads(self, t: float, q: Array, v: Array) -> dict[str, float]:
        """Torque [N m] or force [N] along each prescribed joint at a state, by the name of the body it carries."""
        frozen, free = self.frozen.mechanism, self.free.mechanism
        a = self.frozen.accelerations(t, q, v)
        positions, rates, accelerations = np.zeros(free.n_positions), np.zeros(free.n), np.zeros(free.n)
        pairs = ((v, rates), (a, accelerations))
        for k, (link, other) in enumerate(zip(frozen.links, free.links, strict=True)):
            at, to, i, j = (
                frozen.layout.position[k],
                free.layout.position[k],
                frozen.layout.rate[k],
                free.layout.rate[k],
            )
            if link.motion is not None:
                positions[to], rates[j], accelerations[j] = link.motion.value(t)
            else:
                positions[to : to + other.n_positions] = q[at : at + link.n_positions]
                for given, out in pairs:
                    out[j : j + other.n_rates] = given[i : i + link.n_rates]
            modes, new = frozen.modes_of(k), free.modes_of(k)
            positions[new + free.n_positions - free.n] = q[modes + frozen.n_positions - frozen.n]
            for given, out in pairs:
                out[new] = given[modes]
        r = self.free.residual(t, positions, rates, accelerations)
        return {
            link.name: float(r[free.layout.rate[k]]) for k, link in enumerate(frozen.links) if link.motion is not None
        }
