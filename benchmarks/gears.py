"""Spur gears in mesh beside ISO 6336's formulas, written to gears.csv.

Run from the project's root: ``python benchmarks/gears.py``. Both pairs are of the ready scene ``gears``: its pinion and
its wheel, and two of its pinions. Stiffness is over the width; that of one pair is also less the twist of both gears'
discs between bore and root circle, which ISO's pair of teeth doesn't have.
"""

import sys
from collections.abc import Iterator
from math import acos, cos, degrees, pi, sin, sqrt, tan
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))
from benchmarks.table_format import write_rows
from fmd import Pipeline, load_scene
from fmd.contact.gear_pair import ToothFlexibility, mesh_gears
from fmd.core.cache import Cache
from fmd.core.involute import GearPair, Tooth, involute, tight_distance
from fmd.scene.gears import SpurGear

TABLE = Path(__file__).parent / "gears.csv"
FINER = {"fillet": 9, "flank": 8, "across": 8, "rim": 6}
PAIRS = (("pinion", "wheel"), ("pinion", "pinion"))
Gears = dict[str, tuple[SpurGear, ToothFlexibility]]


def iso_stiffness(pair: GearPair) -> tuple[float, float, float]:
    """Return c'_th C_B, c' and c_γα of solid discs of steel [N/m for each m of width], by ISO 6336-1:2006, method B."""
    (z1, x1), (z2, x2) = ((gear.teeth, gear.shift) for gear in (pair.pinion, pair.wheel))
    q = 0.04723 + 0.15551 / z1 + 0.25791 / z2 + 0.00529 * x1**2 + 0.00182 * x2**2
    q -= 0.00635 * x1 + 0.11654 * x1 / z1 + 0.00193 * x2 + 0.24188 * x2 / z2  # mm µm/N
    rack = pair.pinion
    theory = 1e9 / q * (1.0 + 0.5 * (1.2 - rack.dedendum)) * (1.0 - 0.02 * (20.0 - degrees(rack.alpha)))
    return theory, 0.8 * theory, 0.8 * theory * (0.75 * pair.contact_ratio + 0.25)


def iso_root(tooth: Tooth, contact_ratio: float) -> float:
    """Return Y_F Y_S of ISO 6336-3:2006, clauses 6 and 7, for a load at the outer point of single contact."""
    h, rho, x, z, alpha = tooth.dedendum, tooth.rounding, tooth.shift, tooth.teeth, tooth.alpha
    E = pi / 4 - h * tan(alpha) - (1 - sin(alpha)) * rho / cos(alpha)
    G, theta = rho - h + x, pi / 6
    for _ in range(50):
        theta = 2 * G / z * tan(theta) - 2 / z * (pi / 2 - E) + pi / 3
    s = z * sin(pi / 3 - theta) + sqrt(3) * (G / cos(theta) - rho)
    radius = rho + 2 * G**2 / (cos(theta) * (z * cos(theta) ** 2 - 2 * G))
    base, tip = 2 * tooth.base_radius, 2 * tooth.tip_radius
    outer = 2 * sqrt((sqrt(tip**2 - base**2) / 2 - tooth.base_pitch * (contact_ratio - 1)) ** 2 + base**2 / 4)
    angle = acos(base / outer)
    gamma = (pi / 2 + 2 * x * tan(alpha)) / z + involute(tan(alpha)) - involute(tan(angle))
    lean = angle - gamma
    arm = (cos(gamma) - sin(gamma) * tan(lean)) * outer / tooth.module - z * cos(pi / 3 - theta) - G / cos(theta) + rho
    arm /= 2
    form = 6 * arm * cos(lean) / (s**2 * cos(alpha))
    return form * (1.2 + 0.13 * s / arm) * (s / (2 * radius)) ** (1 / (1.21 + 2.3 * arm / s))


def iso_root_stress(tooth: Tooth, contact_ratio: float, load: float, width: float) -> float:
    """Return the nominal stress at the root [Pa] for a force along the line of action [N]."""
    return load * cos(tooth.alpha) / (width * tooth.module) * iso_root(tooth, contact_ratio)


def disc_twist(gear: SpurGear, own: ToothFlexibility) -> float:
    """Return what a disc from bore to root circle yields on the line of action [m for 1 N for each m of width]."""
    shear, tooth = own.E / (2 * (1 + own.nu)), own.tooth
    return tooth.base_radius**2 / (4 * pi * shear) * (4 / gear.bore**2 - 1 / tooth.root_radius**2)


def load_gears(changes: dict[str, int]) -> tuple[Gears, float]:
    """Return the scene's gears with what loads on their teeth move, and the pinion's torque [N m]."""
    table = ",".join(f"{key}={x}" for key, x in changes.items())
    scene = load_scene("gears", [f"body.{name}.mesh={{{table}}}" for name in PAIRS[0]])
    run = Pipeline(scene, Cache(None))
    (torque,) = (output.torque for output in scene.output if output.type == "gear-mesh")
    return {name: (scene.body[name], run.wholes[name].tooth_flexibility) for name in PAIRS[0]}, torque


def figures(gears: Gears, names: tuple[str, str], torque: float) -> Iterator[tuple[str, str, float, float]]:
    """Yield name, what it stands beside, ISO's value and ours, in N/(mm µm) and MPa."""
    (pinion, wheel), both = (gears[name][0] for name in names), [gears[name][1] for name in names]
    distance = tight_distance(pinion.tooth, wheel.tooth)
    assert distance is not None
    pair, width, load = GearPair(pinion.tooth, wheel.tooth, distance), pinion.width, torque / pinion.tooth.base_radius
    found, ratio = mesh_gears(pair, both, width, load, 64), pair.contact_ratio
    theory, single, mesh = (1e-9 * x for x in iso_stiffness(pair))
    stiffest = found.single.max()
    teeth = 1e-9 / (width / stiffest - sum(disc_twist(*gears[name]) for name in names))
    yield "one pair, largest, less the discs' twist [N/(mm µm)]", "theoretical, c'/0.8", theory, teeth
    yield "one pair, largest [N/(mm µm)]", "c'", single, 1e-9 * stiffest / width
    yield "mesh, mean [N/(mm µm)]", "c_γα", mesh, 1e-9 * found.stiffness.mean() / width
    for k, (name, gear) in enumerate(zip(("pinion", "wheel"), (pinion, wheel), strict=True)):
        nominal = 1e-6 * iso_root_stress(gear.tooth, ratio, load, width)
        yield f"stress at the {name}'s root [MPa]", "Y_F Y_S", nominal, 1e-6 * found.root_stress[k].max()


def main() -> None:
    """Compare both pairs on default and on finer elements, and write their table."""
    rows = []
    meshes = [load_gears(changes) for changes in ({}, FINER)]
    for names in PAIRS:
        teeth = "/".join(str(meshes[0][0][name][0].teeth) for name in names)
        by_mesh = [figures(gears, names, torque) for gears, torque in meshes]
        for (figure, beside, iso, ours), (*_, finer) in zip(*by_mesh, strict=True):
            rows.append({"teeth": teeth, "figure": figure, "beside": beside, "iso": iso, "fmd": ours, "finer": finer})
            print(*rows[-1].values(), sep=", ", flush=True)
    write_rows(TABLE, rows, digits=4)


if __name__ == "__main__":
    main()
