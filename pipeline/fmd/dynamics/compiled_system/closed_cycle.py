"""Sub-cycling of a compiled mechanism with loops: its fast equation, held from a major cycle's begin on.

Multipliers that are held over a cycle make the method one of first order that diverges with long cycles. So they answer
each fast step, and the slow coordinates, on which they act, with them: the equation is that of `middle`. What the slow
motion and the loads change in a cycle is taken in to first order in time, by the accelerations a little later.
"""

from __future__ import annotations

from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.held import step_all
from fmd.dynamics.compiled_system.kernels import set_inputs
from fmd.dynamics.compiled_system.middle import hold_reacting
from fmd.dynamics.compiled_system.parameters import ClosedCycle, ClosedParameters
from fmd.dynamics.jit.compiled import meaning
from fmd.dynamics.system import accelerations, advance, fast_steps, hold_slow


@meaning(hold_slow, ClosedParameters)
def _hold_slow(p: ClosedParameters, t: float, q: Array, v: Array, a: Array, frozen: ClosedCycle) -> None:
    middle, D, held = frozen.middle, frozen.D, frozen.middle.held
    n, n_slow, ahead = v.size, held.n_slow, frozen.ahead[0]
    set_inputs(p, float(t))
    held.time[0] = t
    for i in range(q.size):
        frozen.q[i] = q[i]
    hold_reacting(p, q, v, D, middle, a)
    for i in range(n_slow):  # the motion of q_L + D q_S, which leaves the fast coordinates where they are
        frozen.a[i] = v[i]
        frozen.v[i] = v[i] + ahead * middle.y[i]
        for j in range(n_slow, n):
            frozen.a[i] += D[j, i] * v[j]
    for j in range(n_slow, n):
        frozen.v[j] = v[j]
    advance(p, frozen.q, frozen.a, ahead, 0, n_slow)
    accelerations(p, t + ahead, frozen.q, frozen.v, frozen.a)
    p.whole.fresh[0] = 1.0  # for the next cycle
    for j in range(n_slow, n):
        held.slope[j] = (frozen.a[j] - a[j]) / ahead


@meaning(fast_steps, ClosedParameters)
def _fast_steps(
    p: ClosedParameters, frozen: ClosedCycle, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    step_all(p, frozen.middle.held, first, h, count, q, v, a)
