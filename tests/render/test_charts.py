import re
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from fmd.core.arrays import Array
from fmd.render.chart_data import Curve
from fmd.render.charts import COLOURS, PALENESS, draw_chart, fit_length

TIME = np.linspace(0.0, 0.5, 201)
WAVE = np.sin(20 * TIME)
RGB = np.array([to_rgb(colour) for colour in COLOURS])


def draw(path: Path, *curves: Curve, labels: tuple[str, ...] = ()) -> Path:
    draw_chart(TIME, curves, path, title="Velocity", ylabel="velocity [m/s]", component_labels=labels)
    return path


def count(picture: Array, colour: Array) -> int:
    """How many pixels have a colour, nearly."""
    return int(np.count_nonzero(np.all(np.abs(picture[..., :3] - 255 * colour) < 12, axis=-1)))


def test_a_chart_has_the_size_of_ten_by_six_inches(tmp_path: Path) -> None:
    picture = iio.imread(draw(tmp_path / "chart.png", Curve("one run", WAVE)))
    assert picture.shape[:2] == (960, 1600)
    assert picture.std() > 0


def test_curves_that_coincide_are_all_seen(tmp_path: Path) -> None:
    curves = [Curve(f"run {number}", WAVE.copy()) for number in range(3)]
    upper = iio.imread(draw(tmp_path / "chart.png", *curves))[:600]
    pale = PALENESS + (1 - PALENESS) * RGB[0]
    assert min(count(upper, colour) for colour in (pale, RGB[1], RGB[2])) > 300


def test_a_stated_error_is_a_band_about_the_first_curve_where_it_is_broader_than_a_line(tmp_path: Path) -> None:
    """The band is 0.2 of the curve's colour over white; its area is twice the error times the duration."""
    plain = iio.imread(draw(tmp_path / "plain.png", Curve("run", WAVE)))
    narrow = iio.imread(draw(tmp_path / "narrow.png", Curve("run", WAVE, (1e-3,))))
    assert np.array_equal(plain, narrow)
    colour = 0.2 * RGB[0] + 0.8
    areas = [
        count(iio.imread(draw(tmp_path / f"{error}.png", Curve("run", WAVE, (error,)))), colour) for error in (0.2, 0.4)
    ]
    assert count(plain, colour) < 0.01 * areas[0]
    scale = [1.0 / (2.0 + 2.0 * error) for error in (0.2, 0.4)]  # of the axis, which spans the band, too
    assert areas[1] / areas[0] == pytest.approx(2 * scale[1] / scale[0], rel=0.15)


def test_components_differ_in_colour(tmp_path: Path) -> None:
    curves = [Curve(name, np.stack([WAVE, WAVE - 1], axis=1)) for name in ("first", "second")]
    picture = iio.imread(draw(tmp_path / "chart.png", *curves, labels=("x", "y")))
    assert min(count(picture, RGB[0]), count(picture, RGB[1])) > 300
    assert count(picture, RGB[2]) == 0


@pytest.mark.parametrize(("size", "factor"), [(4e-5, "$10^{-6}$ m/s"), (2e3, "$10^{3}$ m/s"), (0.3, "$10^{-3}$ m/s")])
def test_differences_are_in_the_same_unit_with_a_power_of_a_thousand(tmp_path: Path, size: float, factor: str) -> None:
    text = draw(tmp_path / "chart.svg", Curve("first", WAVE), Curve("second", WAVE + size)).read_text()
    assert factor in text  # Matplotlib writes each text as a comment beside its outlines


def test_runs_that_agree_have_no_empty_strip_of_differences(tmp_path: Path) -> None:
    text = draw(tmp_path / "chart.svg", Curve("first", WAVE), Curve("second", WAVE)).read_text()
    assert "difference" not in text
    assert "second" in text  # in the legend


def test_one_run_has_full_colour_and_no_legend(tmp_path: Path) -> None:
    curve = Curve("central-difference", WAVE)
    assert "central-difference" not in draw(tmp_path / "chart.svg", curve).read_text()
    assert count(iio.imread(draw(tmp_path / "chart.png", curve)), RGB[0]) > 1000


@pytest.mark.parametrize(
    ("largest", "unit", "difference"), [(2.0, "m", "µm"), (0.31, "mm", "nm"), (3e-4, "µm", "nm"), (2e-7, "nm", "nm")]
)
def test_lengths_are_in_a_unit_that_fits_them(tmp_path: Path, largest: float, unit: str, difference: str) -> None:
    given = [Curve(name, largest * (1 + more) * WAVE) for name, more in (("one", 0.0), ("two", 1e-6))]
    path = tmp_path / "chart.svg"
    draw_chart(TIME, given, path, title="", ylabel="deflection [m]")
    text = path.read_text()
    assert f"deflection [{unit}]" in text
    assert re.search(rf"\[\S*\s?{difference}\]", text)


def test_a_length_keeps_its_value_in_another_unit() -> None:
    for largest in (0.0, 3e-10, 2e-8, 5e-5, 0.02, 7.0):
        factor, label = fit_length("position [m]", largest)
        unit = label.partition("[")[2].rstrip("]")
        assert factor * {"m": 1.0, "mm": 1e-3, "µm": 1e-6, "nm": 1e-9}[unit] == pytest.approx(1.0)
    assert fit_length("speed [m/s]", 1e-3) == (1.0, "speed [m/s]")


def test_short_times_are_in_milliseconds(tmp_path: Path) -> None:
    path = tmp_path / "chart.svg"
    draw_chart(TIME / 10, [Curve("one", WAVE)], path, title="", ylabel="force [N]")
    assert "time [ms]" in path.read_text()


def test_shapes_that_disagree_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "chart.png"
    with pytest.raises(ValueError, match=r"curve 'short' has shape \(5,\), expected 201 times and 1 components"):
        draw(path, Curve("first", WAVE), Curve("short", WAVE[:5]))
    with pytest.raises(ValueError, match="1 component labels for 2 components"):
        draw(path, Curve("first", np.stack([WAVE, WAVE], axis=1)), labels=("x",))
    with pytest.raises(ValueError, match="at least one curve"):
        draw(path)
    with pytest.raises(ValueError, match=r"curve 'none' has shape \(0,\)"):
        Curve("none", np.empty(0))
    assert not list(tmp_path.iterdir())
