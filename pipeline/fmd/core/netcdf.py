"""NetCDF files written as such, without a library: loading one takes longer than a short run.

The layout is the classic format with 64-bit offsets (NetCDF Classic Format Specification, Unidata), which every reader
of NetCDF knows, in the conventions of xarray: text as characters in UTF-8, NaN for a missing value.
"""

import math
import struct
from collections.abc import Iterable, Sequence
from dataclasses import field
from os import SEEK_CUR
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmd.core.data_classes import dataclass

_CHAR, _DOUBLE = 2, 6  # types of the format
_DIMENSION, _VARIABLE, _ATTRIBUTE = 10, 11, 12  # its tags
_LARGEST = 2**32 - 1  # entry for the size of a variable that is larger


@dataclass(frozen=True, slots=True)
class NetcdfVariable:
    """An array of numbers or of text with named dimensions."""

    name: str
    dims: tuple[str, ...]
    values: NDArray[Any]  # floats or text
    attributes: dict[str, str | float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.dims) != self.values.ndim:
            raise ValueError(f"{self.name} has {len(self.dims)} named dimensions and {self.values.ndim} axes")


@dataclass(frozen=True, slots=True)
class NetcdfBlock:
    """Numbers of a variable that is written piece by piece, as rows along its second dimension."""

    name: str
    first: int  # place of the first number along the first dimension
    row: int  # place of the first number along the second dimension
    values: NDArray[Any]  # (n_rows, …): as the variable's further dimensions have them


def empty_variable(
    name: str, dims: tuple[str, ...], shape: tuple[int, ...], attributes: dict[str, str | float]
) -> NetcdfVariable:
    """Return a variable without values, which take no memory: blocks bring them when it is written."""
    return NetcdfVariable(name, dims, np.broadcast_to(np.zeros((), dtype=">f8"), shape), attributes)


def write_netcdf(path: Path, variables: Sequence[NetcdfVariable], blocks: Iterable[NetcdfBlock] = ()) -> None:
    """Write variables to a NetCDF file; dimensions of the same name are shared; blocks fill variables that are empty.

    Raises
    ------
    ValueError
        Two lengths of one dimension differ.
    """
    encoded = [_encode(variable) for variable in variables]
    sizes: dict[str, int] = {}
    for dims, values, _ in encoded:
        for dim, size in zip(dims, values.shape, strict=True):
            if sizes.setdefault(dim, size) != size:
                raise ValueError(f"dimension {dim} has lengths {sizes[dim]} and {size}")
    numbers = {dim: number for number, dim in enumerate(sizes)}
    start = b"CDF\x02" + _integers(0) + _integers(_DIMENSION, len(sizes))
    start += b"".join(_text(dim) + _integers(size) for dim, size in sizes.items())
    start += _integers(0, 0, _VARIABLE, len(encoded))
    heads, lengths = [], []
    for variable, (dims, values, attributes) in zip(variables, encoded, strict=True):
        head = _text(variable.name) + _integers(len(dims), *(numbers[dim] for dim in dims))
        head += _integers(_ATTRIBUTE, len(attributes)) + b"".join(attributes)
        length = -(-values.nbytes // 4) * 4
        kind = _CHAR if values.dtype.kind == "S" else _DOUBLE
        heads.append(head + _integers(kind) + struct.pack(">I", min(length, _LARGEST)))
        lengths.append(length)
    begin = len(start) + sum(len(head) + 8 for head in heads)
    places = {}
    with path.open("wb") as file:
        file.write(start)
        for variable, head, length in zip(variables, heads, lengths, strict=True):
            file.write(head + struct.pack(">q", begin))
            places[variable.name] = begin
            begin += length
        for (_, values, _), length in zip(encoded, lengths, strict=True):
            if values.size > 1 and not any(values.strides):  # of an `empty_variable`: one number in memory
                file.truncate(file.tell() + length)
                file.seek(length, SEEK_CUR)
            else:
                file.write(values.tobytes())
                file.write(bytes(length - values.nbytes))
        shapes = {variable.name: variable.values.shape for variable in variables}
        for block in blocks:
            _, n_rows, *rest = shapes[block.name]
            file.seek(places[block.name] + 8 * (block.first * n_rows + block.row) * math.prod(rest))
            file.write(np.asarray(block.values, dtype=">f8").tobytes())


def _encode(variable: NetcdfVariable) -> tuple[tuple[str, ...], NDArray[Any], list[bytes]]:
    """Return the dimensions, the values as they are stored, and the attributes of a variable."""
    attributes = [
        _text(name) + (_text(value, _CHAR) if isinstance(value, str) else _number(value))
        for name, value in variable.attributes.items()
    ]
    if variable.values.dtype.kind == "U":
        texts = np.char.encode(variable.values, "utf-8")
        longest = max(1, texts.dtype.itemsize)
        letters = np.ascontiguousarray(texts.astype(f"S{longest}")).view("S1").reshape(*texts.shape, longest)
        return (*variable.dims, f"string{longest}"), letters, [*attributes, _text("_Encoding") + _text("utf-8", _CHAR)]
    missing = _text("_FillValue") + _number(np.nan)
    return variable.dims, np.asarray(variable.values, dtype=">f8"), [*attributes, missing]


def _number(value: float) -> bytes:
    return _integers(_DOUBLE, 1) + struct.pack(">d", value)


def _integers(*values: int) -> bytes:
    return struct.pack(f">{len(values)}i", *values)


def _text(text: str, *before: int) -> bytes:
    """Encode a text after its length, filled up to whole words of four bytes."""
    content = text.encode("utf-8")
    return _integers(*before, len(content)) + content.ljust(-(-len(content) // 4) * 4, b"\0")
