"""Numbers and tables as HTML: prefixes that fit, and text that can't break out of its cell."""

import xml.etree.ElementTree as ET

import pytest

from fmd.core.html import facts, scaled, table


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (1.728e6, "Pa", "1.728 MPa"),
        (-2.5e-3, "m", "-2.5 mm"),
        (0.0, "m", "0 m"),
        (999.96, "m", "1 km"),  # rounded to four digits it is 1000 m
        (2e-12, "m", "2e-12 m"),  # below a nano, powers of ten are easier to read
        (3600.0, "s", "3600 s"),  # nobody says kiloseconds
        (2e-6, "s", "2 µs"),
        (1234.5, "rad/s", "1234 rad/s"),
        (1e-3, "kg", "0.001 kg"),
        (0.5, "", "0.5"),
        (None, "m", "–"),
    ],
)
def test_a_number_has_the_prefix_that_fits(value: float | None, unit: str, text: str) -> None:
    assert scaled(value, unit) == text


def test_digits_are_those_wanted() -> None:
    assert scaled(1.23456e-3, "s", 3) == "1.23 ms"


def test_a_table_has_its_words_on_the_left_and_its_numbers_on_the_right() -> None:
    root = ET.fromstring(table(("mode", "Hz"), [(1, "131.2"), (2, "349.3")], "modes"))
    assert root.findtext("caption") == "modes"
    assert [cell.text for cell in root.findall("thead/tr/th")] == ["mode", "Hz"]
    assert [[cell.text for cell in row] for row in root.findall("tbody/tr")] == [["1", "131.2"], ["2", "349.3"]]
    assert [[cell.tag for cell in row] for row in root.findall("tbody/tr")] == [["th", "td"]] * 2


def test_names_and_their_texts_stand_in_two_columns() -> None:
    root = ET.fromstring(facts([("machine", "a laptop"), ("numpy", "2.4")]))
    assert root.find("caption") is None
    assert [[cell.text for cell in row] for row in root.findall("tbody/tr")] == [
        ["machine", "a laptop"],
        ["numpy", "2.4"],
    ]


def test_text_is_escaped() -> None:
    evil = "<script>alert('a & b')</script>"
    for text in (table((evil,), [(evil, evil)], evil), facts([(evil, evil)], evil)):
        assert "<script" not in text
        assert evil in "".join(ET.fromstring(text).itertext())
