"""Run time against error of every integrator, ours and other programs', on the mechanisms of six scenes.

Run from the project's root: ``python benchmarks/work_precision.py``, with the extra ``bench``. Writes a CSV and a chart
of each. It is `fmd bench --peer`, also for a beam of more modes and for a spatial robot.
"""

import sys
from dataclasses import replace
from pathlib import Path

from few_modes import few_modes

HERE = Path(__file__).parent
sys.path.append(str(HERE.parent))
from fmd import Pipeline, load_scene  # noqa: E402
from fmd.output.work_precision import compare_on_scene, peer_rows, write_comparison  # noqa: E402

SCENES = {
    "rod-slider": ("rod-slider", ()),
    "beam": ("beam", ()),
    "beam-20-modes": ("beam", ("body.beam.modes.count=20",)),
    "beam-60-modes": ("beam", ("body.beam.modes.count=60",)),
    "arm": ("arm", few_modes("arm")),
    "robot": (str(HERE / "scenes" / "robot.toml"), ()),
}


def main() -> None:
    """Measure all scenes, or those that the command names."""
    for name in sys.argv[1:] or SCENES:
        scene, overrides = SCENES[name]
        run = Pipeline(load_scene(scene, overrides))
        result = compare_on_scene(run)
        write_comparison(run, replace(result, rows=(*result.rows, *peer_rows(name))), HERE, name)


if __name__ == "__main__":
    main()
