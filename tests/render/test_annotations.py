"""Annotations: free places for labels, rows of a legend, numbers on a colour bar."""

import numpy as np
import pytest

from fmd.render.annotations import arrange_legend, find_free_place, format_number, text_width

SIZE = (960, 540)


def test_a_label_stands_in_the_nearest_free_box() -> None:
    picture = np.full((300, 400, 3), 255, dtype=np.uint8)
    picture[100:200, 100:300] = 0
    half, place = np.array([40.0, 10.0]), (0.0, 1.0, 0.0, 1.0)
    column, row = find_free_place(picture, np.array([200.0, 120.0]), half, place)
    assert (column, row) == pytest.approx((200, 90), abs=4)
    picture[:] = 0
    column, row = find_free_place(picture, np.array([200.0, 20.0]), half, place)
    assert (column, row) == (200, 10)


def test_a_legend_takes_as_many_rows_as_it_needs() -> None:
    names = [f"part {k} (1,980 elements)" for k in range(7)]
    rows = arrange_legend(names, SIZE)
    assert [k for row in rows for k, _ in row] == list(range(7))
    assert len(rows) > 1
    for row in rows:
        k, left = row[-1]
        assert row[0][1] > 0
        assert left + text_width(names[k], 1 / 36, SIZE) < 1
    assert len(arrange_legend(names[:1], SIZE)) == 1


def test_numbers_beside_a_bar_are_short() -> None:
    assert [format_number(value, 300.0) for value in (-150.4, 1e-15, 20.0)] == ["−150", "0", "20"]
