"""NetCDF files of our own writing, read back by others."""

from pathlib import Path

import numpy as np
import pytest
import xarray
from scipy.io import netcdf_file

from fmd.core.netcdf import NetcdfVariable, write_netcdf


@pytest.fixture
def variables() -> list[NetcdfVariable]:
    """Numbers of no, one and two dimensions in both memory layouts, text of odd lengths, values at the limits."""
    rng = np.random.default_rng(1)
    return [
        NetcdfVariable("name", ("name",), np.array(["a", "Welle Ø 5", "日本"])),
        NetcdfVariable(
            "x", ("x",), np.array([0.0, -0.0, 1e-308, np.inf, np.nan]), {"units": "m", "long_name": "µm × 10⁶"}
        ),
        NetcdfVariable("table", ("name", "x"), rng.normal(size=(5, 3)).T, {"units": "kg m^2/s"}),
        NetcdfVariable("one", (), np.array(3.5)),
        NetcdfVariable("none", ("empty",), np.zeros(0)),
    ]


def test_xarray_reads_what_was_written(variables: list[NetcdfVariable], tmp_path: Path) -> None:
    write_netcdf(tmp_path / "file.nc", variables)
    with xarray.open_dataset(tmp_path / "file.nc", engine="scipy") as file:
        assert set(file.variables) == {variable.name for variable in variables}
        for variable in variables:
            assert file[variable.name].dims == variable.dims
            assert np.array_equal(file[variable.name], variable.values, equal_nan=variable.values.dtype.kind == "f")
            assert file[variable.name].attrs == variable.attributes


def test_the_numbers_are_the_same_bits(variables: list[NetcdfVariable], tmp_path: Path) -> None:
    write_netcdf(tmp_path / "file.nc", variables)
    with netcdf_file(tmp_path / "file.nc", mmap=False) as file:
        for variable in variables[1:]:
            stored = np.asarray(file.variables[variable.name].data, dtype="<f8")
            assert stored.tobytes() == np.asarray(variable.values).tobytes()


def test_a_dimension_has_one_length(tmp_path: Path) -> None:
    two = [NetcdfVariable("a", ("x",), np.zeros(2)), NetcdfVariable("b", ("x",), np.zeros(3))]
    with pytest.raises(ValueError, match="dimension x has lengths 2 and 3"):
        write_netcdf(tmp_path / "file.nc", two)
    with pytest.raises(ValueError, match="a has 1 named dimensions and 2 axes"):
        NetcdfVariable("a", ("x",), np.zeros((2, 2)))
