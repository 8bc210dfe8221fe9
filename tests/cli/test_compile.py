"""``fmd compile``: figures of a mechanism's compiled equations."""

import json

import pytest


def test_the_rod_sliders_structure_and_size_are_told(fmd, capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("FMD_CACHE", str(tmp_path))
    assert fmd("compile", "rod-slider", "--json") == 0
    figures = json.loads(capsys.readouterr().out)
    assert {"scene", "flops", "bytes", "seconds", "structure", "functions"} == set(figures)
    assert 0 < figures["flops"] < 40  # two coordinates in a plane: M̂ is diagonal
    assert figures["structure"][0].startswith("plane motion")
    assert {row["function"] for row in figures["functions"]} >= {"accelerations", "residual"}


def test_the_table_lists_accelerations_alone_unless_all_are_wanted(fmd, capsys):
    assert fmd("compile", "rod-slider") == 0
    short = capsys.readouterr().out
    assert fmd("compile", "rod-slider", "--show") == 0
    assert "residual" in capsys.readouterr().out
    assert "accelerations" in short
    assert "residual" not in short


@pytest.mark.parametrize("scene", ["verification/none", "rod-slidr"])
def test_an_unknown_scene_is_refused(fmd, scene, capsys):
    assert fmd("compile", scene) == 2
    assert "no such" in capsys.readouterr().err


def test_the_functions_are_written_as_c(fmd, capsys, tmp_path):
    path = tmp_path / "equations.c"
    assert fmd("compile", "rod-slider", "--c", path) == 0
    text = path.read_text()
    assert text.startswith("#include <math.h>\n")
    assert "void rod_slider_accelerations(const double *const *in, double *const *out)" in text
    assert "/* in: inputs, q, v; out: energies */" in text


def test_a_file_of_c_that_cannot_be_written_is_told(fmd, capsys, tmp_path):
    (tmp_path / "file").touch()
    assert fmd("compile", "rod-slider", "--c", tmp_path / "file" / "equations.c") == 2
    assert "can't be written" in capsys.readouterr().err
