"""Numbers as Fortran's programs write them, and as Nastran's cards have them."""

import re

_LETTERLESS = re.compile(r"(?<=[\d.])([+-]\d+)$")
_THREE_DIGITS = re.compile(r"(?<=[\d.])([+-]\d{3})$")


def read_real(text: str) -> float:
    """Return a number whose exponent may have a D, or three digits and no letter: 1.0D+05, 1.25-101.

    Raises
    ------
    ValueError
        It is no number.
    """
    try:
        return float(text)
    except ValueError:
        return float(_THREE_DIGITS.sub(r"E\1", text.strip()).upper().replace("D", "E"))


def read_field(field: str) -> float:
    """Return the number of a field of a Nastran card: 0 if it is blank; any exponent may lack its letter, as 7.0-1.

    Raises
    ------
    ValueError
        It is no number.
    """
    return read_real(_LETTERLESS.sub(r"E\1", field)) if field else 0.0
