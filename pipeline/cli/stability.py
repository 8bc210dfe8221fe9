"""``fmd stability``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from pipeline.cli.options import Json, NoCache, SceneName, Set, open_pipeline, print_json


def stability(
    scene: SceneName = "",
    *,
    two_dof: Annotated[bool, Parameter(negative=())] = False,
    substeps: int = 0,
    coupling: Annotated[list[float] | None, Parameter(negative=())] = None,
    scheme: Annotated[str, Parameter(name="--scheme")] = "sub-cycling",
    law: Annotated[bool, Parameter(negative=())] = False,
    resolution: int = 400,
    along: Annotated[bool, Parameter(negative=())] = False,
    out: Path | None = None,
    set_: Set = None,
    no_cache: NoCache = False,
    json: Json = False,
) -> None:
    """Which step is safe: for a scene's mechanism, or as a map for the two-degree-of-freedom system.

    Parameters
    ----------
    two_dof
        Map the two-degree-of-freedom system of the paper's Figs. 2 and 3 instead.
    substeps
        Fast steps to a slow one; 2 for a map, 1 to 20 for a scene by default.
    coupling
        Inertial coupling of the map, 0 ≤ β < 1; give it several times for several maps.
    scheme
        What is mapped: "sub-cycling", the paper's, or "reversible".
    law
        With --two-dof: fit the law of the weak instability for each ratio from 2 to 20 instead of mapping one.
    resolution
        Points of a map each way.
    along
        Look for the worst state along the scene's first run, not only at its reference state.
    out
        Folder for the picture; out/stability by default.
    """
    from pipeline.core.errors import InputError

    if two_dof == bool(scene):
        raise InputError("stability", "", scene or None, "give a scene, e.g. beam, or --two-dof")
    if two_dof:
        substeps, couplings = substeps or 2, coupling or [0.0]
        _require_map(substeps, couplings, scheme, resolution)
        if law:
            _weak_growth(json)
        else:
            _two_dof_maps(substeps, couplings, scheme, resolution, out or Path("out") / "stability", json)
        return
    if not 0 <= substeps <= 1000:
        raise InputError("--substeps", "", substeps, "must be 1 … 1000")
    from pipeline.output.stability_results import summarise_limits
    from pipeline.stages.stability_limits import find_scene_limits

    run = open_pipeline(scene, set_, no_cache)
    result = find_scene_limits(run, [1, substeps] if substeps else list(range(1, 21)), along)
    if json:
        print_json(summarise_limits(result))
    else:
        from pipeline.cli.tables import print_stability

        print_stability(run.scene.title, result)


def _require_map(substeps: int, couplings: list[float], scheme: str, resolution: int) -> None:
    """Raise `InputError` unless maps can be made with these options."""
    from pipeline.core.errors import InputError
    from pipeline.stability.two_dof import SCHEMES

    if not all(0 <= beta < 1 for beta in couplings):
        raise InputError("--coupling", "", couplings, "must be 0 ≤ β < 1")
    if not 1 <= substeps <= 1000 or not 2 <= resolution <= 2000:
        raise InputError("--substeps", "", substeps, "must be 1 … 1000, and --resolution 2 … 2000")
    if scheme not in SCHEMES:
        raise InputError("--scheme", "", scheme, f"must be one of {', '.join(SCHEMES)}")


def _weak_growth(json: bool) -> None:
    from pipeline.stability.two_dof import fit_growth_law

    rows = [asdict(law) for law in map(fit_growth_law, range(2, 21))]
    if json:
        print_json({"rows": rows})
        return
    from pipeline.cli.tables import print_laws

    print_laws(rows)


def _two_dof_maps(
    substeps: int, couplings: list[float], scheme: str, resolution: int, folder: Path, json: bool
) -> None:
    from pipeline.output.stability_results import summarise_maps, write_maps

    found = summarise_maps(*write_maps(substeps, couplings, resolution, scheme, folder))
    if json:
        print_json(found if len(found["maps"]) > 1 else found | found["maps"][0])
        return
    from pipeline.cli.tables import print_maps

    print_maps(found, folder)
