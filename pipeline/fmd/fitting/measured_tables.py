"""Tables of what was measured, from files of several formats, as columns with names and units."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.files import unreadable
from fmd.fitting.universal_files import read_universal
from fmd.scene.reading import FaultError
from fmd.scene.table_files import read_all_columns


class MeasuredTable(NamedTuple):
    """Columns of a file."""

    file: str
    header: list[str]  # names with units in brackets, ``"time [s]"``; that of times or frequencies is the first
    columns: list[Array]  # (n,): in these units; the first ascends


def read_table(text: str) -> MeasuredTable:
    """Read a file of measurements by its suffix, from ``FILE`` or ``FILE; NODE=MARKER``.

    Raises
    ------
    InputError
        The file can't be read, or isn't laid out as its format is read here.
    """
    file, *rest = (part.strip() for part in text.split(";"))
    places = {int(node): marker.strip() for node, _, marker in (part.partition("=") for part in rest)}
    suffix = Path(file).suffix.lower()
    universal = suffix in (".uff", ".unv", ".uf58", ".u58")
    if places and not universal:
        raise InputError(file, "", "; ".join(rest), "nodes are named for universal files alone")
    try:
        with Path(file).open("rb"):  # some readers don't say what the system says
            pass
        read = (lambda path: read_universal(path, places)) if universal else _READERS.get(suffix, _read_csv)
        header, columns = read(Path(file))
    except FaultError as fault:
        raise InputError(file, "", None, str(fault)) from None
    except OSError as error:
        raise InputError(file, "", None, unreadable(error, Path(file))) from None
    if not (np.diff(columns[0]) > 0.0).all():
        raise InputError(file, header[0], None, "must ascend from row to row")
    for name, values in zip(header, columns, strict=True):
        if not np.isfinite(values).all():
            raise InputError(file, name, None, "has values that aren't finite; leave such rows out")
    return MeasuredTable(file, header, columns)


def _read_csv(path: Path) -> tuple[list[str], list[Array]]:
    header, columns = read_all_columns(path, fewest=1)
    return header, [np.array(values) for values in columns]


def _read_mat(path: Path) -> tuple[list[str], list[Array]]:
    """Read ``names``, texts as in the first row of a CSV file, and ``data``, a column for each."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    mend = "must hold 'names', a cell array of the columns' names with units, and 'data', a column for each"
    try:
        found: dict[str, Any] = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        raise FaultError("is of version 7.3; save it with -v7") from None
    except (ValueError, MatReadError) as error:
        raise FaultError(f"is no MAT file: {error}") from None
    if not {"names", "data"} <= {*found}:
        raise FaultError(mend)
    header, data = [str(name).strip() for name in np.atleast_1d(found["names"])], np.asarray(found["data"])
    data = data[:, None] if data.ndim == 1 else data
    if data.ndim != 2 or data.shape[1] != len(header) or not np.isrealobj(data):
        raise FaultError(f"{mend}; it has {len(header)} names and data of shape {data.shape}")
    return header, [np.array(column, dtype=float) for column in data.T]


def _read_netcdf(path: Path) -> tuple[list[str], list[Array]]:
    """Read variables over one dimension, that of their coordinate, with their attributes ``units``."""
    import xarray

    try:
        with xarray.open_dataset(path, decode_times=False) as data:
            found = {
                str(name): (np.array(one.values, dtype=float), str(one.attrs.get("units", "")))
                for name, one in data.variables.items()
                if one.ndim == 1 and one.dtype.kind in "fiu" and (name in data.dims or "run" not in one.dims)
            }
            axes = [str(name) for name in data.dims if name in found]
    except ValueError as error:
        raise FaultError(f"is no NetCDF file: {error}") from None
    if len(axes) != 1:
        raise FaultError(f"must have one dimension with a coordinate, 'time' or 'frequency'; it has {axes or 'none'}")
    names = [axes[0], *(name for name in found if name != axes[0])]
    return [f"{name} [{found[name][1]}]".removesuffix(" []") for name in names], [found[name][0] for name in names]


_READERS: Mapping[str, Callable[[Path], tuple[list[str], list[Array]]]] = {".mat": _read_mat, ".nc": _read_netcdf}
