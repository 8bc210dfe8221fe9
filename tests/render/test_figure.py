"""Figures: saved whole or not at all."""

from pathlib import Path

import pytest

from fmd.render.charts import open_figure, style_axes


def test_a_figure_that_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "chart.png"
    path.write_text("old")
    with pytest.raises(RuntimeError, match="diverged"), open_figure(path, (2, 1), 50):
        raise RuntimeError("diverged")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(("suffix", "start"), [("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_the_suffix_chooses_the_format(tmp_path: Path, suffix: str, start: bytes) -> None:
    path = tmp_path / f"chart.{suffix}"
    with open_figure(path, (2, 1), 50) as figure:
        style_axes(figure.add_subplot(), "time [s]", "velocity [m/s]", "Title")
    assert path.read_bytes().startswith(start)
