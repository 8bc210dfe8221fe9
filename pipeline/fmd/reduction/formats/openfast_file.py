"""Superelements for OpenFAST's module ExtPtfm, in its text format of FLEX."""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.files import read_text, whole_file
from fmd.core.fortran import read_real
from fmd.core.limits.files import LONGEST_LINE, MOST_COORDINATES
from fmd.reduction.craig_bampton import Superelement
from fmd.reduction.formats.body_format import BodyFormat, ExportedBody

_KEYS = {"!mass matrix": "M", "!stiffness matrix": "K", "!damping matrix": "D"}
_INTERFACE = 6


def write_extptfm(path: Path, element: Superelement, gravity: Array) -> list[Path]:
    """Write a superelement of one interface, and the input file of OpenFAST's module ExtPtfm that names it.

    The input file, beside that of the superelement, has ``_ExtPtfm`` in its name. OpenFAST takes gravity from the
    file's loads [m/s²].

    Raises
    ------
    ValueError
        Another number of interfaces than one, or more modes than OpenFAST's lines hold.
    """
    if len(element.origins) != 1:
        raise ValueError(f"OpenFAST's platform has one interface, and the body {len(element.origins)} markers")
    loads = element.weight @ gravity
    lines = [*_extptfm_lines(element, loads)]
    if max(map(len, lines[-2:])) >= LONGEST_LINE:
        raise ValueError(f"{len(loads)} coordinates don't fit into OpenFAST's lines of {LONGEST_LINE} characters")
    main = path.with_name(f"{path.stem}_ExtPtfm.dat")
    for place, text in ((path, "\n".join(lines)), (main, _input_file(path.name, len(loads) - _INTERFACE))):
        with whole_file(place) as part:
            part.write_text(text + "\n", encoding="ascii", errors="replace")
    return [path, main]


def _extptfm_lines(element: Superelement, loads: Array) -> Iterator[str]:
    n = len(loads)
    (name, place), *_ = element.origins.items()
    yield f"!Superelement of 6 motions of '{name}' at ({', '.join(f'{a:.9g}' for a in place)}) m and {n - 6} modes"
    yield "!Flex 5 Format; kg, N, m"
    yield f"!Dimension: {n}"
    yield "!Time increment in simulation: 1.0E+06"
    yield "!Total simulation time in file: 1.0E+06"
    for title, matrix in (("Mass", element.M), ("Stiffness", element.K), ("Damping", element.D)):
        yield ""
        yield f"!{title} Matrix"
        yield f"!Dimension: {n}"
        yield from map(_row, matrix)
    yield ""
    yield "!Loading and Wave Elevation"
    yield f"!Dimension: 1 time column - {n} force columns"
    yield from (_row(np.r_[time, loads]) for time in (0.0, 1e6))


def _input_file(name: str, n_modes: int) -> str:
    return f"""---------------------- EXTPTFM INPUT FILE --------------------------------------
Superelement of {n_modes} modes
---------------------- SIMULATION CONTROL --------------------------------------
False          Echo            - Echo input data to <RootName>.ech (flag)
"default"      DT              - Communication interval for controllers (s) (or "default")
   3           IntMethod       - Integration Method {{1:RK4; 2:AB4, 3:ABM4}} (switch)
---------------------- REDUCTION INPUTS ----------------------------------------
   1           FileFormat      - File Format {{0:Guyan; 1:FlexASCII}} (switch)
"{name}"   Red_FileName    - Path of the file containing Guyan/Craig-Bampton inputs (-)
"NA"           RedCst_FileName - Path of the file containing constant inputs (-) (currently unused)
-1             NActiveDOFList  - Number of active CB modes, -1 for all modes (integer)
0,             ActiveDOFList   - List of active CB modes [unused if NActiveDOFList<=0]
0              NInitPosList    - Number of initial positions, 0 for all at rest (integer)
0,             InitPosList     - List of initial positions [unused if NInitPosList<=0]
0              NInitVelList    - Number of initial velocities, 0 for all at rest (integer)
0,             InitVelList     - List of initial velocities [unused if NInitVelList<=0]
---------------------- OUTPUT --------------------------------------------------
True           SumPrint        - Print summary data to <RootName>.sum (flag)
   1           OutFile         - Output file {{1: module's; 2: glue code's; 3: both}} (currently unused)
True           TabDelim        - Use tab delimiters in tabular output? (flag) (currently unused)
"ES10.3E2"     OutFmt          - Format of tabular output (quoted string) (currently unused)
   0           TStart          - Time to begin tabular output (s) (currently unused)
               OutList         - The next lines list output parameters (-)
"IntrfFx"
"IntrfFy"
"IntrfFz"
"IntrfMx"
"IntrfMy"
"IntrfMz"
END of input file (the word "END" must appear in the first 3 columns of this last OutList line)
--------------------------------------------------------------------------------"""


def _row(values: Array) -> str:
    return " ".join(f"{value: .16E}" for value in values)


def read_extptfm(path: Path) -> dict[str, Array]:
    """Read a superelement's matrices K, M and D, (6 + n, 6 + n) each, and its loads (n_times, 7 + n), time first.

    Raises
    ------
    InputError
        The file can't be read, is cut off or damaged; the message names the line.
    """
    lines = read_text(path).splitlines()
    low = [" ".join(line.lower().split()) for line in lines]
    heads = [line for line in low if line.startswith("!dimension:")]
    found = re.match(r"!dimension: *(\d+)$", heads[0]) if heads else None
    if found is None or not _INTERFACE <= int(found[1]) <= MOST_COORDINATES:
        mend = "no superelement in FLEX's format: '!Dimension: …', six or more, should stand in its first lines"
        raise InputError(str(path), "", None, mend)
    n, arrays = int(found[1]), {}
    for number, line in enumerate(low):
        if line in _KEYS:
            arrays[_KEYS[line]] = _rows(path, lines, number + 2, n, n)
        elif line.startswith("!loading"):
            rest = sum(1 for other in lines[number + 2 :] if other.strip())
            arrays["loads"] = _rows(path, lines, number + 2, rest, n + 1)
    for key in ("M", "K", "D"):
        if key not in arrays:
            title = next(title for title, own in _KEYS.items() if own == key)
            raise InputError(str(path), "", None, f"has no '{title}'; it is cut off, or none of ExtPtfm's")
    return arrays


def _rows(path: Path, lines: list[str], first: int, count: int, length: int) -> Array:
    rows = []
    for number in range(first, first + count):
        items = lines[number].split() if number < len(lines) else []
        try:
            row = [read_real(item) for item in items]
        except ValueError:
            row = []
        if len(row) != length or not np.isfinite(row).all():
            mend = f"{length} finite numbers expected, not '{' '.join(items)[:40]}'"
            raise InputError(str(path), f"line {number + 1}", None, mend)
        rows.append(row)
    return np.array(rows).reshape(count, length)


def _write(body: ExportedBody, path: Path) -> list[Path]:
    try:
        return write_extptfm(path, body.superelement(), body.gravity)
    except ValueError as error:
        mend = f"{error}; name one by modes.boundary = 'interface' and modes.interface = ['…']"
        raise body.fault("modes.interface", mend) from error


FORMAT = BodyFormat(_write)
