"""The least that a body from a file may have: one marker or two, on every kind of joint, in every format."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from fmd.output.formats import write_format
from tests.stages.test_reduced_files import BEAM, JOINTS, NODES, SIMULATION, SUFFIXES, scene_of

SCENE = """
title = "minimal"
[body.beam]
body = {{ file = "{file}" }}
marker = {{ {markers} }}
[joint.hub]
parent = "ground"
child = "beam.root"
{joint}
"""


@pytest.mark.parametrize(("joint", "n_markers"), [(joint, 1 + k % 2) for k, joint in enumerate(JOINTS)])
@pytest.mark.parametrize("to", SUFFIXES)
def test_a_minimal_body_runs(
    to: str, joint: str, n_markers: int, fmd: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It ends well, with a motion."""
    write_format(scene_of(BEAM, "", "", tmp_path), to, "beam", tmp_path / f"beam{SUFFIXES[to]}")
    named = dict(zip(("root", "tip")[:n_markers], NODES[to], strict=False))
    markers = ", ".join(f'{name} = {{ node = "{node}" }}' for name, node in named.items())
    motion = (
        SIMULATION.replace("STIFFENING", "off").replace("50 ms", "6 ms").replace("beam.tip", f"beam.{[*named][-1]}")
    )
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE.format(file=f"beam{SUFFIXES[to]}", markers=markers, joint=JOINTS[joint]) + motion)
    assert fmd("run", scene, "--no-pictures", "--no-budget", "--json", "--out", tmp_path / "out") == 0
    said = capsys.readouterr()
    assert "Traceback" not in said.err
    final = json.loads(said.out)["integrations"][0]["final"]
    assert final["kinetic_energy_j"] > 0.0 or joint == "clamp"
