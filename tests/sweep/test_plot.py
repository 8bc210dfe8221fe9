"""The plot of a sweep: which figures, in which units, over which axes."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from fmd.render.sweep_chart import SweepAxis, SweepPanel, draw_sweep_lines, draw_sweep_maps
from fmd.sweep import plot
from fmd.sweep.points import Point, Variation
from fmd.sweep.record import Record
from fmd.sweep.study import Sweep
from fmd.sweep.table import SweepTable


def sweep(*variations: Variation) -> Sweep:
    """A sweep whose figures follow from the point's number; the last point is refused."""
    n_points = int(np.prod([len(variation.values) for variation in variations]))
    records = [
        Record("ok", summary={
            "frequencies_hz": [100.0 + k, 200.0 + k], "worst_stress": {"von_mises_pa": 1e6 * (k + 1)},
            "peak_tip_deflection_m": 1e-3 * k, "joint_units": {"hub": "rad"},
            "integrations": [{"seconds": 2e-3, "final": {"joint_positions": {"hub": 0.1 * k}}}],
        })
        for k in range(n_points - 1)
    ]  # fmt: skip
    records.append(Record("refused", "too long"))
    full = product(*(variation.values for variation in variations))
    points = tuple(Point(values, None, f"{k}") for k, values in enumerate(full))
    return Sweep(variations, points, tuple(records), n_points)


LENGTH = Variation("body.beam.length", ("100 mm", '"200mm"', "300mm"))
METHOD = Variation("simulation.run.0.integrator", ("auto", "runge-kutta"))


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> dict[str, tuple[object, ...]]:
    seen: dict[str, tuple[object, ...]] = {}
    for name in ("draw_sweep_lines", "draw_sweep_maps"):
        monkeypatch.setattr(f"fmd.render.sweep_chart.{name}", lambda *given, name=name, **_: seen.update({name: given}))
    return seen


def test_one_key_gives_lines_in_the_units_of_its_values(drawn, tmp_path):
    study = sweep(LENGTH)
    assert plot.draw_sweep(SweepTable(study), tmp_path, "Study") == ["sweep.png"]
    (axis,), panels, _ = drawn["draw_sweep_lines"]
    assert (axis.label, axis.numbers) == ("body.beam.length [mm]", (100.0, 200.0, 300.0))
    by_label = {panel.label: panel for panel in panels}
    frequency, stress = by_label["frequency [Hz]"], by_label["largest von Mises stress [MPa]"]
    assert frequency.names == ("mode 1", "mode 2")
    np.testing.assert_array_equal(frequency.values, [[100, 101, np.nan], [200, 201, np.nan]])
    np.testing.assert_allclose(stress.values, [[1.0, 2.0, np.nan]])
    np.testing.assert_allclose(by_label["largest deflection of the tip [mm]"].values, [[0.0, 1.0, np.nan]])
    assert {"hub at the end [rad]", "time of integration [ms]"} <= by_label.keys()


def test_two_keys_give_maps_and_three_give_points_over_each(drawn, tmp_path):
    study = sweep(LENGTH, METHOD)
    plot.draw_sweep(SweepTable(study), tmp_path, "Study")
    first, second, panels, _ = drawn["draw_sweep_maps"]
    assert (first.texts, second.texts, second.numbers) == (("100", "200", "300"), METHOD.values, None)
    (frequency,) = [panel for panel in panels if panel.label == "frequency of mode 1 [Hz]"]
    np.testing.assert_array_equal(frequency.values, [[100, 101], [102, 103], [104, np.nan]])
    three = sweep(LENGTH, METHOD, Variation("simulation.step", ("1us", "10us"), logarithmic=True))
    plot.draw_sweep(SweepTable(three), tmp_path, "Study")
    keys, panels, _ = drawn["draw_sweep_lines"]
    assert [key.label for key in keys] == ["body.beam.length [mm]", METHOD.key, "simulation.step [us]"]
    assert [key.logarithmic for key in keys] == [False, False, True]
    assert keys[2].numbers == (1.0, 10.0) * 6  # the last key varies fastest
    np.testing.assert_array_equal(panels[0].values[0], [*range(100, 111), np.nan])


def test_a_plot_says_what_it_leaves_out(monkeypatch, tmp_path):
    titles = []
    monkeypatch.setattr("fmd.render.sweep_chart.draw_sweep_lines", lambda *_, title: titles.append(title))
    for most, keys in ((24, 6), (2, 2)):
        monkeypatch.setattr(plot, "ASKED_PANELS", most)
        monkeypatch.setattr(plot, "SWEPT_KEYS", keys)
        plot.draw_sweep(SweepTable(sweep(LENGTH, METHOD, LENGTH)), tmp_path, "Study")
    assert titles == ["Study", "Study\n1 of 5 results, 2 of 3 keys; sweep.csv has all"]


def test_a_sweep_without_a_figure_has_no_plot(tmp_path):
    refused = Sweep((METHOD,), tuple(Point((v,), None) for v in METHOD.values), (Record("refused"),) * 2, 0)
    assert plot.draw_sweep(SweepTable(refused), tmp_path, "Study") == []


def test_lines_and_maps_are_drawn_with_their_labels_and_missing_points(tmp_path: Path) -> None:
    x, y = SweepAxis("length [mm]", ("1", "2", "100"), (1.0, 2.0, 100.0)), SweepAxis("method", ("auto", "plain"))
    line = SweepPanel("stress [MPa]", np.array([[1.0, np.nan, 3.0], [2.0, 2.5, 4.0]]), ("mode 1", "mode 2"))
    draw_sweep_lines([x], [line, line, line], tmp_path / "lines.svg", title="Study")
    text = (tmp_path / "lines.svg").read_text()
    assert all(f"<!-- {words} -->" in text for words in ("length [mm]", "stress [MPa]", "mode 2", "Study"))
    field = SweepPanel("stress [MPa]", np.array([[1.25, 2.0], [3.0, np.nan], [5.0, 6.0]]))
    draw_sweep_maps(x, y, [field], tmp_path / "map.svg", title="Study")
    text = (tmp_path / "map.svg").read_text()
    assert all(f"<!-- {words} -->" in text for words in ("1.25", "×", "auto", "method", "100"))
    same = SweepPanel("peak [um/N]", 132.74432860 + np.array([[1e-10, 0.0, 2e-10]]))
    draw_sweep_lines([x, y], [same], tmp_path / "same.svg", title="Study")
    assert "+1.327" not in (tmp_path / "same.svg").read_text()  # no axis counts round-off from an offset
    method = SweepAxis("method", ("auto", "plain", "auto"))
    zero = SweepAxis("spring", ("0", "1", "100"), (0.0, 1.0, 100.0), logarithmic=True)
    draw_sweep_lines([method, zero], [line], tmp_path / "words.svg", title="Study")
    text = (tmp_path / "words.svg").read_text()
    assert (text.count("<!-- auto -->"), text.count("<!-- 0 -->")) == (1, 1)  # a place a word; a point at 0 is drawn
    spring = SweepAxis("spring [N/m]", ("300", "600", "3000"), (300.0, 600.0, 3000.0), logarithmic=True)
    draw_sweep_lines([spring], [line], tmp_path / "log.svg", title="Study")
    text = (tmp_path / "log.svg").read_text()
    assert all(f"<!-- {words} -->" in text for words in ("300", "600", "1000", "3000"))  # numbers as on other axes
    assert "times" not in text
    draw_sweep_maps(x, y, [field, field], tmp_path / "map.png", title="Study")
    assert imread(tmp_path / "map.png")[..., :3].std() > 0.1
