"""``fmd view``: a mechanism in the browser before and after it runs."""

import webbrowser
from pathlib import Path

from fmd.cli.inputs import DEFAULTS, Options
from fmd.cli.options import Flag, SceneName, print_json
from fmd.cli.tables import open_console
from fmd.output.report.page import write_page
from fmd.output.report.view_page import make_view_page


def view(
    scene: SceneName,
    *,
    run: Flag = False,
    out: Path | None = None,
    no_browser: Flag = False,
    options: Options = DEFAULTS,
) -> None:
    """A mechanism in the browser before it runs: bodies, joints, loads and faces by name, joints moved by sliders.

    Parameters
    ----------
    run
        Run it first, and play its motion, too.
    out
        The page; out/SCENE/view.html by default.
    no_browser
        Write the page only.
    """
    solved = options.solve(scene, spare=(("output",), ("output", "reference", "accuracy")))
    path = out or Path("out") / solved.scene.name / "view.html"
    motion = solved.motion if run and solved.scene.moves else None
    write_page(path, lambda: make_view_page(solved, options.set_ or (), motion))
    size = path.stat().st_size
    if options.json:
        print_json({"scene": solved.scene.name, "file": str(path), "bytes": size})
        return
    open_console().print(f"{path}: {size / 1e6:.2f} MB; open it in a browser", soft_wrap=True)
    if not no_browser:
        webbrowser.open(path.resolve().as_uri())
