"""``fmd compile``: the equations of a scene's mechanism as machine code."""

from __future__ import annotations

import time
from typing import Any

from rich.console import Console

from pipeline.cli.inputs import open_pipeline
from pipeline.cli.options import Flag, Json, NoCache, SceneName, Set, print_json
from pipeline.cli.tables import new_table

_FUNCTIONS = ("accelerations", "residual", "frames", "energies", "momenta")


def compile(
    scene: SceneName,
    *,
    show: Flag = False,
    set_: Set = None,
    no_cache: NoCache = False,
    json: Json = False,
) -> None:
    """Equations of motion as machine code: operations, size, and the structure that saves arithmetic.

    Parameters
    ----------
    show
        List every function, not the accelerations alone.
    """
    from pipeline.dynamics.compiler.compiled import compile_mechanism

    run = open_pipeline(scene, set_, no_cache)
    mechanism = run.mechanism
    rows: list[dict[str, Any]] = []
    tick = time.perf_counter()
    compiled = compile_mechanism(mechanism)
    for name in _FUNCTIONS if show or json else _FUNCTIONS[:1]:
        size = compiled.n_bytes(name)
        seconds, tick = time.perf_counter() - tick, time.perf_counter()
        rows.append({"function": name, "flops": compiled.flops(name), "bytes": size, "seconds": seconds})
    if json:
        first = {key: rows[0][key] for key in ("flops", "bytes", "seconds")}
        structure = compiled.structure
        print_json({"scene": run.scene.name, **first, "structure": structure, "functions": rows})
        return
    table = new_table(f"{run.scene.title}: {mechanism.n} coordinates", "function", "operations", "bytes", "ready after")
    for row in rows:
        table.add_row(row["function"], str(row["flops"]), str(row["bytes"]), f"{1e3 * row['seconds']:.0f} ms")
    console = Console()
    console.print(table)
    for line in compiled.structure or ["no structure that saves arithmetic"]:
        console.print(line, markup=False)
