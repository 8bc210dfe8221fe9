"""Spectral density of a random input as a user gives it: a number, a formula of the frequency, or a table in a file."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.formula import parse_formula
from fmd.dynamics.signals.signal import formula

Density = Callable[[Array], Array]


def read_density(text: str, folder: Path, at: tuple[str, str]) -> Density:
    """Read a one-sided power spectral density over the frequency f [Hz], in the input's SI unit squared per Hz.

    The text is a number, a formula of f, or the name of a ``.csv`` file, in a folder, of two columns, frequency [Hz]
    and density, which is straight lines in double logarithmic scale between its rows and zero outside. Messages name
    the file and key at fault.

    Raises
    ------
    InputError
        It is none of these, or negative.
    """
    if text.endswith(".csv"):
        return _read_table(folder / text, text, at)
    try:
        if re.search(r"\bt\b", text):
            raise InputError(*at, text, "is a formula of the frequency f in Hz, not of t")
        signal = formula(parse_formula(re.sub(r"\bf\b", "t", text)), 1.0)
    except ValueError as error:
        fault = re.sub(r"\bt\b", "f", str(error))
        mend = f"{fault}; a number, a formula such as '1e-3 if f < 500 else 0', or a .csv file works"
        raise InputError(*at, text, mend) from None

    def density(frequencies_hz: Array) -> Array:
        values = np.asarray(signal.values(np.asarray(frequencies_hz, dtype=float))[:, 0])
        bad = ~(values >= 0.0) | ~np.isfinite(values)
        if bad.any():
            where = float(frequencies_hz[np.argmax(bad)])
            raise InputError(*at, text, f"is {values[np.argmax(bad)]:.3g} at {where:.5g} Hz; a density is 0 or above")
        return values

    return density


def _read_table(path: Path, text: str, at: tuple[str, str]) -> Density:
    try:
        rows = [line.split("#")[0] for line in path.read_text(encoding="utf-8").splitlines()]
    except OSError as error:
        raise InputError(*at, text, f"can't be read: {error.strerror or error}") from None
    numbers: list[list[float]] = []
    for k, row in enumerate(rows, start=1):
        cells = [cell for cell in re.split(r"[,;\s]+", row.strip()) if cell]
        try:
            values = [float(cell) for cell in cells]
        except ValueError:
            if numbers:
                raise InputError(*at, text, f"line {k} isn't two numbers: {row!r}") from None
            continue  # a header
        if values and len(values) != 2:
            raise InputError(*at, text, f"line {k} has {len(values)} numbers; frequency in Hz and density are needed")
        numbers += [values] if values else []
    table = np.array(numbers).reshape(-1, 2)
    if len(table) < 2 or not (np.diff(table[:, 0]) > 0).all() or not (table > 0).all():
        raise InputError(*at, text, "must hold two rows at least, of ascending frequencies and densities above 0")
    x, y = np.log(table).T

    def density(frequencies_hz: Array) -> Array:
        f = np.asarray(frequencies_hz, dtype=float)
        inside = (f >= table[0, 0]) & (f <= table[-1, 0])
        return np.where(inside, np.exp(np.interp(np.log(np.maximum(f, 1e-300)), x, y)), 0.0)

    return density
