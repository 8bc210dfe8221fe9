"""``fmd linearise``: a scene as a linear state-space model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from fmd.cli.inputs import DEFAULTS, Options, settle
from fmd.cli.options import Folder, Names, SceneName, print_json
from fmd.cli.tables import print_files, print_table, print_warnings

_FORMATS = (".npz", ".mat")


def linearise(
    scene: SceneName,
    *,
    in_: Annotated[Names | None, Parameter(name="--in")] = None,
    out: Annotated[Names | None, Parameter(name="--out")] = None,
    about: str = "start",
    format_: Annotated[Literal["npz", "mat"] | None, Parameter(name="--format")] = None,
    folder: Folder = None,
    options: Options = DEFAULTS,
) -> None:
    """State-space model A, B, C, D of a scene, with names and units, as .npz and .mat.

    Parameters
    ----------
    in_
        Inputs, as for fmd frf; all drives of the scene by default.
    out
        Outputs, as for fmd frf; the tip's displacement and all joints' positions by default.
    about
        State of linearisation: start, equilibrium, steady, or a time of the first run in seconds.
    format_
        Write this format alone.
    """
    from fmd.output.responses import write_model
    from fmd.stages.linear_model import default_inputs, default_outputs, linearise_scene

    run = settle(options.open(scene, linear=True))
    inputs, outputs = in_ or default_inputs(run.scene), out or default_outputs(run.scene)
    linear = linearise_scene(run, inputs, outputs, about)
    where = folder or Path("out") / run.scene.name
    files = write_model(linear, where, _FORMATS if format_ is None else (f".{format_}",))
    model = linear.model
    if options.json:
        channels = {
            kind: [{"name": channel.name, "unit": channel.unit} for channel in getattr(model, kind)]
            for kind in ("states", "inputs", "outputs")
        }
        poles = {"poles_hz": model.poles_hz.tolist(), "damping": model.damping.tolist()}
        print_json({**channels, "about": linear.about, **poles, "warnings": linear.warnings, "files": files})
        return
    for kind in ("inputs", "outputs", "states"):
        rows = [(k, channel.name, channel.unit) for k, channel in enumerate(getattr(model, kind), start=1)]
        print_table(f"{kind.capitalize()} about {linear.about}", {"number": "{}", "name": "{}", "unit": "{}"}, rows)
    print_warnings(linear.warnings)
    print_files(where, files)
