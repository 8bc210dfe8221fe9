"""``fmd mesh``, ``fmd modes`` and ``fmd campbell``: a part alone."""

from __future__ import annotations

from pathlib import Path

from pipeline.cli.options import (
    Json,
    NoCache,
    Repair,
    SceneName,
    Set,
    open_pipeline,
    print_figures,
    print_json,
    rate_of,
)


def mesh(
    scene: SceneName,
    *,
    out: Path | None = None,
    set_: Set = None,
    repair: Repair = False,
    no_cache: NoCache = False,
    json: Json = False,
) -> None:
    """Mesh alone: counts, volume, mass and the smallest scaled Jacobian.

    Parameters
    ----------
    out
        File to write the mesh to, in the format of its suffix: .vtu, .msh, .inp ...
    """
    pipeline = open_pipeline(scene, set_, no_cache, repair)
    if out is not None:
        from pipeline.fem.formats.export import write_mesh

        write_mesh(pipeline.mesh, out)
    from pipeline.cli.tables import mesh_figures

    print_figures(mesh_figures(pipeline.part), json)


def modes(
    scene: SceneName,
    *,
    speed: str | None = None,
    set_: Set = None,
    repair: Repair = False,
    no_cache: NoCache = False,
    json: Json = False,
) -> None:
    """Modes alone: frequencies beside the scene's reference.

    Parameters
    ----------
    speed
        Rate of rotation about the joint, e.g. "20 rad/s": the frequencies on a hub that turns so, too.
    """
    from pipeline.output.frequencies import frequency_table, rotating_table

    pipeline = open_pipeline(scene, set_, no_cache, repair)
    result = frequency_table(pipeline)
    if speed is not None:
        result |= rotating_table(pipeline, rate_of("--speed", speed))
    result["seconds"] = dict(pipeline.log.seconds)
    if json:
        print_json(result)
    else:
        from pipeline.cli.tables import print_frequencies

        print_frequencies(result)


def campbell(
    scene: SceneName,
    *,
    to: str,
    points: int = 41,
    out: Path | None = None,
    set_: Set = None,
    no_cache: NoCache = False,
    json: Json = False,
) -> None:
    """Campbell diagram: frequencies on a turning hub over its rate of rotation, as a table and a chart.

    Parameters
    ----------
    to
        Highest rate of rotation, e.g. "8000 rpm".
    points
        How many rates, from 0 on.
    out
        Folder for the results; out/SCENE by default.
    """
    import numpy as np

    from pipeline.core.errors import InputError
    from pipeline.output.frequencies import campbell as compute

    pipeline = open_pipeline(scene, set_, no_cache)
    highest = rate_of("--to", to)
    if not highest > 0:
        raise InputError("--to", "", to, "must be above zero")
    if not 2 <= points <= 10_000:
        raise InputError("--points", "", points, "must be 2 … 10000")
    folder = out or Path("out") / pipeline.scene.name
    rates = np.linspace(0.0, highest, points)
    table, files = compute(pipeline, rates, folder)
    if json:
        rows = [
            {"rate_rad_s": rate, "frequencies_hz": row[np.isfinite(row)].tolist()}
            for rate, row in zip(rates.tolist(), table, strict=True)
        ]
        print_json({"rows": rows, "files": files})
    else:
        from pipeline.cli.tables import print_campbell

        print_campbell(pipeline.scene.title, rates, table, folder, files)
