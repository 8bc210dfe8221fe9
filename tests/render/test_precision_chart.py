"""Work–precision charts: every method has its curve and its name."""

from pathlib import Path

import numpy as np

from fmd.render.plane_charts import draw_work_precision


def test_every_method_is_named_and_drawn(tmp_path: Path) -> None:
    curves = {f"method {k}": np.array([[1.0, 1e-2], [2.0, 1e-4 * (k + 1)]]) for k in range(12)}
    draw_work_precision(curves, tmp_path / "chart.svg", title="Beam", error_label="error of the tip [1]")
    text = (tmp_path / "chart.svg").read_text()  # Matplotlib writes each text as a comment beside its outlines
    for words in (*curves, "Beam", "run time of integration alone [s]", "error of the tip [1]"):
        assert f"<!-- {words} -->" in text
    assert text.count("stroke-dasharray") >= 2  # the methods of other programs, after the tenth
