"""A rigid block of 2 kg that slides along x, 1 m off a wall, for tests of what pulls and stops it."""

MASS = 2.0


def sliding_block(run: str, slide: str = "", more: str = "") -> str:
    """Return the scene's text with its run, more keys of the joint ``slide``, and more tables."""
    return f"""
title = "Block"

[body.block]
shape = "rigid"
mass = "{MASS} kg"
inertia = ["0.02 kg m^2", "0.03 kg m^2", "0.04 kg m^2"]
marker = {{ centre = {{ at = ["0 m", "0 m", "0 m"] }}, side = {{ at = ["0.1 m", "0 m", "0 m"] }} }}

[ground.wall]
at = ["-1 m", "0 m", "0 m"]

[joint.slide]
type = "prismatic"
parent = "ground"
child = "block.centre"
axis = [1, 0, 0]
{slide}

[simulation]
duration = "1 s"
output_step = "10 ms"
tip = "block.side"
run = [{run}]

{more}
"""
