"""Accelerations of a compiled mechanism with those of unit forces, its inverse mass matrix where no loops close."""

from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.closed import close_response
from fmd.dynamics.compiled_system.kernels import set_inputs
from fmd.dynamics.compiled_system.parameters import CompiledParameters, Responses
from fmd.dynamics.system import accelerations, find_responses
from fmd.kernels.vectors import call_native


@find_responses.register(CompiledParameters)
def _find_responses(p: CompiledParameters, of: Responses, t: float, q: Array, v: Array, a: Array, X: Array) -> None:
    first = 0
    if of.together:  # the articulated inertias are those of both
        set_inputs(p, float(t))
        call_native(of.together, (p.inputs, q, v, of.units[0], a, X[0]))
        first = 1
    else:
        accelerations(p, t, q, v, a)
    for block in range(first, of.units.shape[0]):
        call_native(of.solve, (p.inputs, q, of.units[block], X[block]))
        close_response(p, of.units[block], X[block])
