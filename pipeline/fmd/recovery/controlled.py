"""Motion of a mechanism with controllers as one of its bodies alone, which their outputs drive as functions of time."""

from dataclasses import replace

import numpy as np

from fmd.dynamics.signals.signal import constant, linear_table
from fmd.dynamics.state_functions import HeldValue, JointValue, Quantity, SignalValue
from fmd.recovery.motion import Motion


def leave_out_controllers(motion: Motion) -> Motion:
    """Return a motion without the controllers' states, whose outputs are known at the output times."""
    mechanism, trajectory = motion.mechanism, motion.trajectory
    times, held = trajectory.times, trajectory.held
    rates = {name: rate for name, rate, _ in mechanism.states}

    def known(quantity: Quantity) -> Quantity:
        if isinstance(quantity, HeldValue):
            return SignalValue(constant(quantity.initial)) if held is None else held.know(quantity)
        if not (isinstance(quantity, JointValue) and quantity.body in rates):
            return quantity
        values = trajectory.v[:, rates[quantity.body]]
        return SignalValue(linear_table(times, values) if len(times) > 1 else constant(float(values[0])))

    q = np.delete(trajectory.q, [position for _, _, position in mechanism.states], axis=1)
    v = np.delete(trajectory.v, list(rates.values()), axis=1)
    driven = mechanism.with_known(known)
    bodies = replace(driven, links=[link for link in driven.links if link.state is None])
    return replace(motion, mechanism=bodies, trajectory=replace(trajectory, q=q, v=v), known=known)
