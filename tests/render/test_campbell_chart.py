"""Campbell diagrams: modes and multiples of the rate."""

from pathlib import Path

import numpy as np

from fmd.render.campbell_chart import draw_campbell


def test_modes_and_multiples_of_the_rate_are_named(tmp_path: Path) -> None:
    rates = np.linspace(0.0, 800.0, 9)
    frequencies = np.stack([100 + 0.1 * rates, np.where(rates < 500, 300.0, np.nan)], axis=1)
    draw_campbell(rates, frequencies, tmp_path / "campbell.svg", title="Hub")
    text = (tmp_path / "campbell.svg").read_text()
    for words in ("mode 1", "mode 2", "1 ×", "4 ×", "Hub", "rate of rotation [rad/s]", "frequency [Hz]"):
        assert f"<!-- {words} -->" in text
    assert "<!-- mode 3 -->" not in text


def test_labels_of_multiples_that_lie_together_do_not_overlap(tmp_path: Path) -> None:
    draw_campbell(np.linspace(0.0, 30.0, 5), np.full((5, 1), 1400.0), tmp_path / "low.svg", title="Slow")
    text = (tmp_path / "low.svg").read_text()
    assert [f"<!-- {k} × -->" in text for k in range(1, 5)] == [True, False, False, False]


def test_ranges_in_which_a_vibration_grows_are_shaded_and_wanted_orders_drawn(tmp_path: Path) -> None:
    rates = np.linspace(0.0, 300.0, 5)
    chart = tmp_path / "unstable.svg"
    draw_campbell(
        rates, np.full((5, 1), 30.0), chart, title="Shaft", orders=(1.0, 3.0), unstable=[(155.0, 207.0), (250.0, 260.0)]
    )
    text = chart.read_text()
    assert text.count("<!-- grows -->") == 1
    assert "<!-- 1 × -->" in text
    assert "<!-- 3 × -->" in text
    assert "<!-- 2 × -->" not in text
