"""Scenes of beams for linear answers."""

from pathlib import Path

from fmd.scene.scene import load_scene
from fmd.stages.pipeline import Pipeline

LENGTH, DEPTH, WIDTH = 0.5, 0.01, 0.02
SIMULATION = """
[simulation]
duration = "1 s"
output_step = "0.1 s"
tip = "{tip}"

[[simulation.run]]
integrator = "auto"
"""


def beam(name: str, length: float, divisions: str, modes: str = "", more: str = "") -> str:
    """Write a body's tables: a bar of steel without lateral contraction, with markers at its ends."""
    return f"""
[body.{name}]
shape = "bar"
length = "{1e3 * length} mm"
depth = "{1e3 * DEPTH} mm"
width = "{1e3 * WIDTH} mm"
E = "210 GPa"
nu = 0.0
rho = "7800 kg/m^3"
mesh = {{ element = "hexahedron", order = 2, divisions = {divisions} }}
modes = {{ count = 6, family = "in-plane bending"{modes} }}
marker = {{ root = {{ face = "x-" }}, tip = {{ face = "x+" }} }}
{more}
"""


def fixed(name: str, parent: str, child: str) -> str:
    """Write the table of a fixed joint."""
    return f'[joint.{name}]\ntype = "fixed"\nparent = "{parent}"\nchild = "{child}"\n'


def pipeline_of(folder: Path, *tables: str, tip: str = "beam.tip", overrides: tuple[str, ...] = ()) -> Pipeline:
    """Make the pipeline of a scene of some tables."""
    file = folder / "scene.toml"
    file.write_text("\n".join(['title = "A scene"', *tables, SIMULATION.format(tip=tip)]), encoding="utf-8")
    return Pipeline(load_scene(file, overrides))


def supported(name: str) -> str:
    """Write the table of a support that holds a body's root."""
    return f'[[body.{name}.support]]\nface = "x-"\n'
