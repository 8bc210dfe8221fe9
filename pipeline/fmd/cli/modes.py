"""``fmd modes``: the natural frequencies of a part."""

from typing import Any

from fmd.cli.inputs import DEFAULTS, Options, read_quantity
from fmd.cli.options import Repair, SceneName, print_json
from fmd.cli.tables import open_console, print_frequencies, print_table, print_warnings
from fmd.output.frequencies import (
    frequencies_by_body,
    frequency_table,
    interface_warnings,
    mode_warnings,
    rotating_table,
)


def modes(
    scene: SceneName,
    *,
    speed: str | None = None,
    repair: Repair = False,
    options: Options = DEFAULTS,
) -> None:
    """Modes alone: frequencies beside the scene's reference.

    Parameters
    ----------
    speed
        Rate of rotation about the joint, e.g. "20 rad/s": the frequencies of the first flexible body alone on a hub
        that turns so, too; those of a whole rotor are `fmd campbell`'s.
    """
    pipeline = options.solve(scene, repair=repair, spare=[("output",)])
    result = frequency_table(pipeline)
    if speed is not None:
        result |= rotating_table(pipeline, read_quantity("--speed", speed, "angular rate"))
    result["bodies"] = frequencies_by_body(pipeline)
    result["warnings"] = mode_warnings(pipeline) + interface_warnings(pipeline)
    if result.get("rotating_growth_1_s"):
        text = f"at {speed} a motion of {pipeline.part.name} grows by {result['rotating_growth_1_s']:.3g} 1/s"
        result["warnings"].append({"code": "unstable-rotation", "body": pipeline.part.name, "text": text})
    result["seconds"] = dict(pipeline.log.seconds)
    if options.json:
        print_json(result)
    else:
        _print_frequencies(result)


def _print_frequencies(result: dict[str, Any]) -> None:
    first = next(iter(result["bodies"]))
    print_frequencies(result)
    if "speed_rad_s" in result:
        title = f"Frequencies of {first} alone on a hub that turns at {result['speed_rad_s']:.6g} rad/s"
        print_table(title, {"mode": "{}", "Hz": "{:.4f}"}, enumerate(result["rotating_frequencies_hz"], start=1))
    line = f"{first}: {result['rigid_modes']} rigid-body modes, {result['dofs']} unknowns"
    if (factor := result["factor"]) is not None:
        line += (
            f"; factor by {factor['solver']} in {factor['order']} order, {factor['nonzeros'] / 1e6:.3g} million "
            f"nonzeros of {factor['unknowns']} unknowns, {factor['memory'] / 1e6:.3g} MB"
        )
    console = open_console()
    console.print(line)
    warned = " ".join(warning["text"] for warning in result["warnings"])
    for name, body in result["bodies"].items():
        for note in body["mesh_notes"]:
            if note.removeprefix("mended: ") not in warned:
                console.print(f"mesh of {name}: {note}")
    print_warnings(result["warnings"])
