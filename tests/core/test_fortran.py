"""Numbers of Fortran's programs: those that Python writes, with the exponents that its own float doesn't read."""

import numpy as np
import pytest

from fmd.core.fortran import read_field, read_real


def test_exponents_of_d_and_of_three_digits_without_a_letter_are_read_to_the_bit() -> None:
    random = np.random.default_rng(3)
    for value in random.choice([-1, 1], 200) * 10 ** random.uniform(-300, 300, 200):
        text = f"{value:.16e}"
        assert read_real(text) == read_real(text.replace("e", "D")) == read_real(text.replace("e", "d")) == float(text)
        if abs(np.log10(abs(value))) > 101:
            assert read_real(text.replace("e", "")) == float(text)


@pytest.mark.parametrize(("field", "value"), [("", 0.0), ("7.0-1", 0.7), ("-2.5+3", -2500.0), (".5d0", 0.5), ("3", 3)])
def test_fields_of_cards_may_be_blank_and_their_exponents_lack_a_letter(field: str, value: float) -> None:
    assert read_field(field) == value


@pytest.mark.parametrize("text", ["", "7.0-1", "1-3", "1.0-2.0", "D5", "1.0D", "blade"])
def test_what_is_no_number_is_an_error(text: str) -> None:
    with pytest.raises(ValueError, match="float"):
        read_real(text)
