"""Sub-cycling of a compiled mechanism with loops: its fast equation, frozen from a major cycle's begin on.

Multipliers that are frozen over a cycle make the method one of first order that diverges with long cycles. So they
answer each fast step, and the slow coordinates, on which they act, with them: the equation is that of `middle`. What
the slow motion and the loads change in a cycle is taken in to first order in time, by the accelerations a little later.
"""

from __future__ import annotations

from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.frozen import step_all
from fmd.dynamics.compiled_system.kernels import set_inputs
from fmd.dynamics.compiled_system.middle import freeze_reacting
from fmd.dynamics.compiled_system.parameters import ClosedCycle, ClosedParameters
from fmd.dynamics.system import accelerations, advance, fast_steps, freeze_slow


@freeze_slow.register(ClosedParameters)
def _freeze_slow(p: ClosedParameters, t: float, q: Array, v: Array, a: Array, closed: ClosedCycle) -> None:
    middle, D, frozen = closed.middle, closed.D, closed.middle.frozen
    n, n_slow, ahead = v.size, frozen.n_slow, closed.ahead[0]
    set_inputs(p, float(t))
    frozen.time[0] = t
    for i in range(q.size):
        closed.q[i] = q[i]
    freeze_reacting(p, q, v, D, middle, a)
    for i in range(n_slow):  # the motion of q_L + D q_S, which leaves the fast coordinates where they are
        closed.a[i] = v[i]
        closed.v[i] = v[i] + ahead * middle.y[i]
        for j in range(n_slow, n):
            closed.a[i] += D[j, i] * v[j]
    for j in range(n_slow, n):
        closed.v[j] = v[j]
    advance(p, closed.q, closed.a, ahead, 0, n_slow)
    accelerations(p, t + ahead, closed.q, closed.v, closed.a)
    p.whole.fresh[0] = 1.0  # for the next cycle
    for j in range(n_slow, n):
        frozen.slope[j] = (closed.a[j] - a[j]) / ahead


@fast_steps.register(ClosedParameters)
def _fast_steps(
    p: ClosedParameters, frozen: ClosedCycle, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    step_all(p, frozen.middle.frozen, first, h, count, q, v, a)
