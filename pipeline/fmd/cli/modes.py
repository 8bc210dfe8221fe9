"""``fmd modes``: the natural frequencies of a part."""

from __future__ import annotations

from typing import Any

from fmd.cli.inputs import read_rate, solve_as_far_as_sound
from fmd.cli.options import Json, NoCache, Repair, SceneName, Set, print_json
from fmd.cli.tables import frequency_tables, new_table, open_console
from fmd.output.frequencies import frequencies_by_body, frequency_table, mode_warnings, rotating_table


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
        Rate of rotation about the joint, e.g. "20 rad/s": the frequencies of the first flexible body alone on a hub
        that turns so, too; those of a whole rotor are `fmd campbell`'s.
    """
    pipeline = solve_as_far_as_sound(scene, set_, no_cache, repair, [("output",)])
    result = frequency_table(pipeline)
    if speed is not None:
        result |= rotating_table(pipeline, read_rate("--speed", speed))
    result["bodies"] = frequencies_by_body(pipeline)
    result["warnings"] = mode_warnings(pipeline)
    if result.get("rotating_growth_1_s"):
        text = f"at {speed} a motion of {pipeline.part.name} grows by {result['rotating_growth_1_s']:.3g} 1/s"
        result["warnings"].append({"code": "unstable-rotation", "body": pipeline.part.name, "text": text})
    result["seconds"] = dict(pipeline.log.seconds)
    if json:
        print_json(result)
    else:
        _print_frequencies(result)


def _print_frequencies(result: dict[str, Any]) -> None:
    console, first = open_console(), next(iter(result["bodies"]))
    for body_table in frequency_tables(result):
        console.print(body_table)
    if "speed_rad_s" in result:
        title = f"Frequencies of {first} alone on a hub that turns at {result['speed_rad_s']:.6g} rad/s"
        table = new_table(title, "mode", "Hz")
        for k, frequency in enumerate(result["rotating_frequencies_hz"]):
            table.add_row(str(k + 1), f"{frequency:.4f}")
        console.print(table)
    line = f"{first}: {result['rigid_modes']} rigid-body modes, {result['dofs']} unknowns"
    if (factor := result["factor"]) is not None:
        line += (
            f"; factor by {factor['solver']} in {factor['order']} order, {factor['nonzeros'] / 1e6:.3g} million "
            f"nonzeros of {factor['unknowns']} unknowns, {factor['memory'] / 1e6:.3g} MB"
        )
    console.print(line)
    for warning in result["warnings"]:
        console.print(f"warning: {warning['text']}")
