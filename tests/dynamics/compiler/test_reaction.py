"""What reversible sub-cycling holds at a cycle's middle is what the functions of its parts say, one after the other."""

from __future__ import annotations

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.dynamics.compiler.compiled import CompiledMechanism, compile_mechanism
from fmd.dynamics.compiler.program import LANES
from tests.dynamics.compiler.comparison import TIME, difference


def by_parts(compiled: CompiledMechanism, q: Array, v: Array, units: Array) -> dict[str, Array]:
    """Return the arrays that ``react`` fills, from residual tangents and solutions of their own."""
    n, n_slow, inputs = len(v), compiled.mechanism.n_slow, compiled.signal_values(TIME)
    by_q, by_v, M = compiled.tangents(inputs, q, v, np.zeros(n))
    D = np.zeros((n, LANES))
    D[:n_slow] = np.linalg.solve(M[:n_slow, :n_slow], (M @ units)[:n_slow])
    found = {"a": compiled.accelerations(TIME, q, v), "D": D}
    for name, tangent in (("K", by_q), ("C", by_v)):
        change = tangent @ (units - D)
        found[name] = np.linalg.solve(M, change)
        found[f"{name}y"] = np.zeros((n, LANES))
        found[f"{name}y"][:n_slow] = np.linalg.solve(M[:n_slow, :n_slow], change[:n_slow])
    return found


@pytest.mark.parametrize("name", ["react", "undamped_react"])
def test_one_function_holds_what_its_parts_say(name: str) -> None:
    mechanism = Pipeline(load_scene("arm", ["body.forearm.modes.enrich=none"])).mechanism
    compiled, random, n = compile_mechanism(mechanism), np.random.default_rng(3), mechanism.n
    q, v, units = 0.1 * random.normal(size=n), random.normal(size=n), np.zeros((n, LANES))
    for lane in range(n - mechanism.n_slow):
        units[mechanism.n_slow + lane, lane] = 1.0
    arguments = compiled.program(name).arguments
    filled = {k: np.zeros(n if k == "a" else (n, LANES)) for k in arguments[4:]}
    compiled.call(name, compiled.signal_values(TIME), q, v, units, *filled.values())
    expected = by_parts(compiled, q, v, units)
    assert set(filled) == {"a", "D", "K", "Ky", *(("C", "Cy") if name == "react" else ())}
    for k, values in filled.items():
        assert difference(values, expected[k]) < 1e-10, k
