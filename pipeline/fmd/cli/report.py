"""``fmd report``: one web page of all results."""

from pathlib import Path

from fmd.cli.inputs import DEFAULTS, Options, settle
from fmd.cli.options import Flag, SceneName, print_json
from fmd.cli.tables import open_console
from fmd.output.report.page import write_report


def report(
    scene: SceneName,
    *,
    out: Path | None = None,
    no_budget: Flag = False,
    brief: Flag = False,
    options: Options = DEFAULTS,
) -> None:
    """One web page of all results: frequencies, modes, a part that turns, charts, run times and errors, versions.

    Parameters
    ----------
    out
        The page; out/SCENE/report.html, or brief.html, by default.
    no_budget
        Don't estimate the errors of the results.
    brief
        One sheet for those who decide: the answer with its interval, three pictures, what is uncertain.
    """
    solved = options.open(scene)
    path = out or Path("out") / solved.scene.name / ("brief.html" if brief else "report.html")
    write_report(solved, path, options.set_ or (), budget=not no_budget, brief=brief)
    settle(solved)  # computed by now
    size = path.stat().st_size
    if options.json:
        print_json({"scene": solved.scene.name, "file": str(path), "bytes": size})
    else:
        open_console().print(f"{path}: {size / 1e6:.2f} MB; open it in a browser", soft_wrap=True)
