"""``fmd optimise``: the best design of a scene under limits."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from fmd.cli.inputs import DEFAULTS, Options, settle
from fmd.cli.options import Folder, Names, SceneName, Several, print_json
from fmd.cli.tables import open_console, print_files, print_records, print_table, print_warnings
from fmd.core.errors import InputError
from fmd.core.files import refusing
from fmd.core.limits.fitting import FRONT
from fmd.sweep.points import split_names

if TYPE_CHECKING:
    from fmd.fitting.optimise import Optimum


def optimise(
    scene: SceneName,
    *,
    vary: Names,
    minimise: Several = None,
    maximise: Several = None,
    subject: Several = None,
    points: int | None = None,
    starts: int = 1,
    out: Folder = None,
    options: Options = DEFAULTS,
) -> None:
    """Best design of a scene between bounds, under limits on its results; of two aims the designs that none beats.

    Parameters
    ----------
    vary
        Keys of numbers with bounds: body.arm.width=20..60mm.
    minimise
        A result: mass, BODY.mass, tip, BODY.stress, BODY.life or BODY.frequency.N; two of them for their Pareto front.
    maximise
        A result that is to be large; with one of --minimise, or two, a front.
    subject
        A limit, "life >= 1e7", "frequency.1 >= 40 Hz" or "frequency.1 outside 40..60 Hz".
    points
        Number of designs of a front; 7 by default.
    starts
        Number of searches, one from the scene's values and others from between the bounds; the best design is taken.
    """
    from fmd.fitting.fit_files import write_design, write_front
    from fmd.fitting.optimise import optimise_scene, read_limits
    from fmd.fitting.pareto import find_front
    from fmd.fitting.varied import read_varied
    from fmd.scene.result_names import require_results

    aims = [(name, sign) for given, sign in ((minimise, 1), (maximise, -1)) for name in given or []]
    _check(aims, points, starts)
    run = settle(options.open(scene))
    require_results(run.scene, [name for name, _ in aims], "--minimise, --maximise")
    limits = read_limits(run, split_names("--subject", subject or []))
    varied = read_varied(run, split_names("--vary", vary))
    if len(aims) == 2:
        found = find_front(run, (aims[0], aims[1]), limits, varied, points or FRONT, starts)
        write = partial(write_front, found, title=f"{run.scene.title}: front")
    else:
        found = [optimise_scene(run, aims[0][0], limits, varied, aims[0][1], starts)]
        write = partial(write_design, found[0])
    folder = out or Path("out") / f"{run.scene.name}-design"
    with refusing("--out", folder):
        files = write(folder, scene, options.set_ or ())
    if options.json:
        print_json({"scene": run.scene.name, "designs": [each.summary() for each in found], "files": files})
    else:
        _print_front(found) if len(found) > 1 else _print(found[0])
        print_files(folder, files)


def _check(aims: list[tuple[str, int]], points: int | None, starts: int) -> None:
    if len(aims) not in (1, 2):
        raise InputError("--minimise", "", None, "one result, or two for their front, e.g. --minimise mass")
    if points is not None and (len(aims) != 2 or points < 3):
        raise InputError("--points", "", points, "must be 3 or more, and belongs to two aims")
    if starts < 1:
        raise InputError("--starts", "", starts, "must be 1 or more")


def _print(found: Optimum) -> None:
    summary = found.summary()
    columns = {"number": "key", "first": "start:.5g", "best": "value:.6g", "unit": "unit", "": "at"}
    designs = [row | {"at": row["at_bound"] and f"at its {row['at_bound']} bound"} for row in summary["parameters"]]
    print_records("Design", columns, designs)
    columns = {"result": "name", "first": "start:.5g", "best": "value:.6g", "unit": "unit", "limit": "must"}
    columns["% per % of it"] = "per_cent:+.3g"
    results = [
        row
        | {"must": None if row["limit"] is None else f"{row['must']} {row['limit']:.6g}"}
        | {"per_cent": row["per_cent_of_aim"] if row["active"] else None}
        for row in summary["results"]
    ]
    print_records(f"Results: {summary['aim']} {summary['results'][0]['name']}", columns, results)
    number = f"{summary['designs']} {'design' if summary['designs'] == 1 else 'designs'}"
    open_console().print(f"{number}; {100 * summary['gradient_left']:.2g} % of the gradient is left")
    print_warnings(summary["warnings"], "design.json")


def _print_front(found: list[Optimum]) -> None:
    first = found[0].design
    names = [parameter.key for parameter in first.values] + [channel.name for channel in first.channels]
    columns = {"design": "{}", **dict.fromkeys(names, "{:.5g}")}
    rows = [(k, *each.design.values.values(), *each.design.results) for k, each in enumerate(found, start=1)]
    print_table("Front", columns, rows)
    print_warnings([warning for each in found for warning in each.warnings()], "design-N.json")
