"""`fmd mesh`: its figures, and the files that it writes."""

from __future__ import annotations

import json

import pytest


def test_mesh_reports_counts_volume_and_mass(fmd, capsys):
    assert fmd("mesh", "beam", "--set", "body.beam.mesh.divisions=[10, 3, 2]", "--json") == 0
    result = json.loads(capsys.readouterr().out)
    assert result["elements"] == 10 * 3 * 2
    assert result["nodes"] == 11 * 4 * 3
    assert result["parts"] == {"bar": 60}
    assert (result["element_type"], result["order"], result["min_quality"]) == ("hexahedron", 2, pytest.approx(1.0))
    assert result["volume_m3"] == pytest.approx(0.34 * 0.025 * 0.01, rel=1e-12)
    assert result["mass_kg"] == pytest.approx(0.34 * 0.025 * 0.01 * 2000, rel=1e-12)


def test_mesh_can_be_written_and_read_again(fmd, tmp_path, capsys):
    import meshio

    path = tmp_path / "beam.vtu"
    assert fmd("mesh", "beam", "--out", str(path)) == 0
    assert "elements" in capsys.readouterr().out
    assert sum(len(block.data) for block in meshio.read(path).cells) == 30 * 3


def test_mesh_refuses_an_unknown_format(fmd, tmp_path, capsys):
    assert fmd("mesh", "beam", "--out", str(tmp_path / "beam.docx")) == 2
    assert "no known mesh format" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
