"""``fmd compile``: the equations of a scene's mechanism as machine code."""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from fmd.cli.inputs import DEFAULTS, Options
from fmd.cli.options import Flag, SceneName, print_json
from fmd.cli.tables import open_console, print_table
from fmd.core.errors import InputError
from fmd.core.files import refusing, write_text

if TYPE_CHECKING:
    from fmd.dynamics.compiler.compiled import CompiledMechanism

_FUNCTIONS = ("accelerations", "residual", "frames", "energies", "momenta")
_C = Annotated[Path | None, Parameter(name="--c", help="Write the functions to this file, as C without globals.")]


def _write_c(compiled: CompiledMechanism, scene: str, path: Path) -> None:
    """Write a mechanism's functions as C, each under the scene's name and its own.

    Raises
    ------
    InputError
        The file can't be written, or the mechanism has loops.
    """
    from fmd.dynamics.compiler.c_source import write_c

    if compiled.mechanism.closures:
        raise InputError("--c", "", str(path), "the mechanism has loops, whose forces no single function computes")
    first = re.sub(r"\W", "_", scene, flags=re.ASCII)
    names = {name: f"{first}_{name}" if first.isidentifier() else f"scene_{first}_{name}" for name in _FUNCTIONS}
    with refusing("--c", path):
        write_text(path, write_c({own: compiled.program(name) for name, own in names.items()}))


def compile(
    scene: SceneName,
    *,
    show: Flag = False,
    c: _C = None,
    options: Options = DEFAULTS,
) -> None:
    """Equations of motion as machine code: operations, size, and the structure that saves arithmetic.

    Parameters
    ----------
    show
        List every function, not the accelerations alone.
    """
    from fmd.dynamics.compiler.compiled import compile_mechanism

    run = options.solve(scene)
    mechanism = run.mechanism
    rows: list[dict[str, Any]] = []
    tick = time.perf_counter()
    compiled = compile_mechanism(mechanism)
    if c is not None:
        _write_c(compiled, run.scene.name, c)
    for name in _FUNCTIONS if show or options.json else _FUNCTIONS[:1]:
        size = compiled.n_bytes(name)
        seconds, tick = time.perf_counter() - tick, time.perf_counter()
        rows.append({"function": name, "flops": compiled.flops(name), "bytes": size, "seconds": seconds})
    if options.json:
        first = {key: rows[0][key] for key in ("flops", "bytes", "seconds")}
        structure = compiled.structure
        print_json({"scene": run.scene.name, **first, "structure": structure, "functions": rows})
        return
    title = f"{run.scene.title}: {mechanism.n} coordinates"
    columns = {"function": "{}", "operations": "{}", "bytes": "{}", "ready after": "{:.0f} ms"}
    print_table(title, columns, ((r["function"], r["flops"], r["bytes"], 1e3 * r["seconds"]) for r in rows))
    for line in compiled.structure or ["no structure that saves arithmetic"]:
        open_console().print(line)
