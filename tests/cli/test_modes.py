"""`fmd modes`: frequencies as JSON and as a table."""

import json
from importlib.resources import files

import numpy as np
import pytest


def test_modes_prints_one_json_object_with_frequencies_beside_table_1(fmd, capsys):
    assert fmd("modes", "beam", "--json") == 0
    result = json.loads(capsys.readouterr().out)
    # Table 1 of Miao et al. 2008; the tolerance is the half per cent.
    assert result["reference_hz"] == [131.2, 349.3, 653.9, 1025.3, 1444.5]
    np.testing.assert_allclose(result["frequencies_hz"], result["reference_hz"], rtol=5e-3)
    assert result["rigid_modes"] == 6
    assert {"relative_error", "dofs", "seconds"} <= result.keys()


def test_modes_of_the_printed_length_agree_with_timoshenko_theory(fmd, capsys):
    assert fmd("modes", "beam", "--set", "body.beam.length=300mm", "--json") == 0
    result = json.loads(capsys.readouterr().out)
    # Free-free Timoshenko beam of 300 mm.
    np.testing.assert_allclose(result["frequencies_hz"], [167.4, 442.6, 822.0, 1276.5, 1784.1], rtol=5e-3)


def test_rigid_scenes_have_nothing_to_mesh(fmd, capsys):
    assert fmd("modes", "rod-slider") == 2
    assert "no flexible body" in capsys.readouterr().err


def test_each_flexible_body_has_a_table_of_its_frequencies(fmd, tmp_path, capsys):
    scene = (files("fmd.models") / "beam.toml").read_text()
    second = scene[scene.index("[body.beam]") : scene.index("[joint.hub]")].replace("body.beam", "body.other")
    joint = scene[scene.index("[joint.hub]") : scene.index("[drive")].replace("hub", "other").replace("beam.", "other.")
    path = tmp_path / "two.toml"
    path.write_text(scene + second + joint.partition("\n#")[0])
    command = ["modes", str(path), "--set", "body.other.E=2888 MPa"]  # four times the beam's: twice its frequencies
    assert fmd(*command, "--json") == 0
    result = json.loads(capsys.readouterr().out)
    assert result["frequencies_hz"] == result["bodies"]["beam"]["frequencies_hz"]
    assert result["frequencies_hz"][0] == pytest.approx(131.04, abs=0.01)
    twice = result["bodies"]["other"]["frequencies_hz"]
    assert twice == pytest.approx(2 * np.array(result["frequencies_hz"]), rel=1e-9)
    assert fmd(*command) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert (
        printed.index("Frequencies of beam, free of its joint")
        < printed.index("131.04")
        < printed.index("Frequencies of other")
    )
    assert f"{twice[0]:.2f}" in printed[printed.index("Frequencies of other") :]


def test_damaged_cache_entries_are_rebuilt(fmd, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("FMD_CACHE", str(tmp_path / "cache"))
    arguments = ["modes", "beam", "--set", "body.beam.mesh.divisions=[24, 2, 1]", "--json"]
    assert fmd(*arguments) == 0
    first = json.loads(capsys.readouterr().out)
    for entry in (tmp_path / "cache" / "stages").iterdir():
        content = bytearray(entry.read_bytes())
        content[len(content) // 2] ^= 1
        entry.write_bytes(content)
    assert fmd(*arguments) == 0
    second = json.loads(capsys.readouterr().out)
    assert second["frequencies_hz"] == first["frequencies_hz"]
    assert second["seconds"].keys() == first["seconds"].keys() == {"mesh", "assembly", "modes"}


def test_frequencies_on_a_turning_hub_are_printed_as_a_second_table(fmd, capsys):
    assert fmd("modes", "beam", "--set", "body.beam.mesh.divisions=[24, 2, 1]", "--speed", "20 rad/s") == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "Frequencies of beam alone on a hub that turns at 20 rad/s" in printed
    assert "131.2" in printed  # Table 1's first
    assert "6 rigid-body modes, 1407 unknowns" in printed
