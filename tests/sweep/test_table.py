"""Tables of a sweep: values of an axis, rows and dimensions of lists."""

import numpy as np
import pytest
import xarray

from fmd.cli.swept_points import print_messages
from fmd.sweep.points import Point, Variation
from fmd.sweep.record import Record
from fmd.sweep.study import Sweep
from fmd.sweep.table import SweepTable, axis_values


@pytest.mark.parametrize(
    ("texts", "values", "unit"),
    [
        (("[1, 2]", "[3,4]"), ("[1, 2]", "[3,4]"), ""),
        (('"1 us"', '"2 us"'), (1e-6, 2e-6), "s"),
        (("1", "2.5"), (1, 2.5), ""),
        (("1 us", "fast"), ("1 us", "fast"), ""),
        (("1 us", "1 mm"), ("1 us", "1 mm"), ""),
    ],
)
def test_values_are_si_numbers_if_all_are_quantities_of_a_kind(texts, values, unit):
    assert axis_values(Variation("key", texts)) == (values, unit)


def test_a_list_becomes_a_dimension_and_what_a_point_lacks_is_nan(tmp_path):
    """A point that was refused has no figures; one that is done has two runs, each with its seconds."""
    summary = {"integrations": [{"seconds": 1.0, "integrator": "a"}, {"seconds": 2.0, "integrator": "b"}]}
    points = (Point(("1 ms",), None, "key"), Point(("2 ms",), None, refusal="too long"))
    records = (Record("ok", summary=summary), Record("refused", "too long"))
    table = SweepTable(Sweep((Variation("step", ("1 ms", "2 ms")),), points, records, 1))
    assert [row["step [s]"] for row in table.rows] == [1e-3, 2e-3]
    assert [row["run.1.seconds"] for row in table.rows] == [2.0, None]
    assert [row["message"] for row in table.rows] == ["", "too long"]
    table.write_netcdf(tmp_path / "sweep.nc")
    data = xarray.load_dataset(tmp_path / "sweep.nc", engine="scipy")
    assert data["run.seconds"].dims == ("step", "run")
    np.testing.assert_array_equal(data["run.seconds"], [[1.0, 2.0], [np.nan, np.nan]])
    assert data["run.integrator"].values.tolist() == [["a", "b"], ["", ""]]
    assert data["run.seconds"].units == data["step"].units == "s"


def test_messages_and_warnings_are_printed_once_with_the_numbers_of_their_points(capsys):
    records = (
        Record("ok", summary={"warnings": [{"code": "large-deflection", "text": "arm turns far"}]}),
        Record("refused", "no such key"),
        Record("ok", summary={"warnings": [{"code": "large-deflection", "text": "arm turns far"}]}),
        Record("ok", summary={"warnings": []}),
    )
    print_messages(Sweep((), (), records, 4))
    assert capsys.readouterr().out.splitlines() == ["1, 3: warning: arm turns far", "2: no such key"]


def test_a_designs_keys_are_coordinates_along_its_points(tmp_path):
    values = (("1 mm", "3 mm", "2 mm"), ("7 N", "5 N", "6 N"))
    points = tuple(Point(pair, None, "key") for pair in zip(*values, strict=True))
    records = tuple(Record("ok", summary={"tip_m": float(k)}) for k in range(3))
    variations = (Variation("length", values[0]), Variation("load", values[1]))
    SweepTable(Sweep(variations, points, records, 3)).write_netcdf(tmp_path / "sweep.nc")
    data = xarray.load_dataset(tmp_path / "sweep.nc", engine="scipy")
    assert data["tip_m"].dims == ("point",)
    assert {*data["tip_m"].coords} == {"length", "load"}
    np.testing.assert_allclose(data["length"], [1e-3, 3e-3, 2e-3])
    np.testing.assert_allclose(data["load"], [7.0, 5.0, 6.0])


def test_a_design_of_many_points_and_keys_is_no_grid_and_needs_not_all_combinations():
    values = tuple(str(k) for k in range(1000))  # of six keys: 1e18 combinations
    variations = tuple(Variation(f"key{k}", values) for k in range(6))
    points = tuple(Point((value,) * 6, None, "key") for value in values)
    assert not Sweep(variations, points, (), 0).is_grid
    assert Sweep(variations[:1], tuple(Point((value,), None, "key") for value in values), (), 0).is_grid
