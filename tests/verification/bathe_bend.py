"""Bathe's 45° bend as a solid: a mesh file of 20-node bricks along an arc, and its scene.

Bathe & Bolourchi, Int J Num Meth Eng 14 (1979) 961-986. Inches and pounds are read as metres and newtons: statics
take any consistent units.
"""

from pathlib import Path

import numpy as np

from fmd import Pipeline, load_scene
from fmd.verification.frequencies import write_abaqus_box

RADIUS, SIDE, ANGLE, MODULUS, LOAD = 100.0, 1.0, np.pi / 4, 1e7, 600.0
END = RADIUS * np.array([np.sin(ANGLE), 1 - np.cos(ANGLE), 0.0])
SONNEVILLE = np.array([-23.821, -13.732, 53.610])  # torsion of a square; Sonneville et al. 2021
OTHER_BEAMS = np.array([-23.6459716, -13.7208006, 53.5776451])  # other published beam elements

_SCENE = f"""
title = "Bathe's bend"
[body.strip]
shape = "mesh"
mesh = {{ file = "bend.inp", unit = "m" }}
E = "{MODULUS} Pa"
nu = 0
rho = "1 kg/m^3"
modes = {{ count = 1 }}
marker = {{ root = {{ face = "LEFT" }}, tip = {{ near = {[f"{x} m" for x in END]} }} }}
pieces = PIECES

[joint.clamp]
type = "fixed"
parent = "ground"
child = "strip.root"

[drive.load]
type = "point force"
marker = "strip.tip"
direction = [0, 0, 1]
force = "{LOAD} N"

[simulation]
duration = "1 ms"
output_step = "1 ms"
start = "equilibrium"
tip = "strip.tip"
run = [{{ integrator = "auto" }}]
"""


def bend(folder: Path, pieces: int, along: int, across: int = 2) -> Pipeline:
    """Return the bend under its load in pieces, with a mesh of so many bricks along and across it."""
    file = folder / "bend.inp"
    sizes = ((RADIUS * ANGLE, along), (SIDE, across), (SIDE, across))
    write_abaqus_box(file, [np.linspace(0.0, size, n + 1) for size, n in sizes])
    head, rest = file.read_text(encoding="utf-8").split("*ELEMENT")
    *words, nodes = head.partition("*NODE\n")
    number, s, y, z = np.array([line.split(",") for line in nodes.splitlines()], dtype=float).T
    r = RADIUS + SIDE / 2 - y
    x = np.stack([r * np.sin(s / RADIUS), RADIUS - r * np.cos(s / RADIUS), z - SIDE / 2], axis=1)
    lines = [f"{k:.0f}, " + ", ".join(f"{c:.15g}" for c in place) for k, place in zip(number, x, strict=True)]
    file.write_text("".join(words) + "\n".join(lines) + "\n*ELEMENT" + rest, encoding="utf-8")
    (folder / "bend.toml").write_text(_SCENE.replace("PIECES", str(pieces)), encoding="utf-8")
    return Pipeline(load_scene(folder / "bend.toml"))
