"""What code depends on, and the constants that it reads, beside those of a program that is written as it is."""

import numpy as np
import pytest

from fmd.dynamics.compiler import llvm, parts
from fmd.dynamics.compiler.compiled import CompiledMechanism
from fmd.dynamics.compiler.structure import number_constants, place_constants, split_constants
from tests.dynamics.compiler.mechanisms import random_mechanism
from tests.dynamics.compiler.test_machine_code import with_other_numbers

NAMES = ("accelerations", "residual", "tangents", "energies")


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("is_long", [False, True])
def test_numbered_constants_leave_the_code_and_find_its_constants(
    seed: int, is_long: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if is_long:
        monkeypatch.setattr(parts, "LONG_PROGRAM", 0)
        monkeypatch.setattr(parts, "MOST_IN_PART", 150)
    compiled = CompiledMechanism(random_mechanism(seed).mechanism)
    for name in NAMES:
        program = compiled.program(name)
        source, constants = llvm.emit(program, 4)
        numbered, places = llvm.emit(number_constants(program), 4)
        assert numbered == source
        assert np.array_equal(place_constants(places, split_constants(program)[1]), constants)


def test_programs_have_one_structure_where_they_have_one_code() -> None:
    found: dict[bytes, set[str]] = {}
    for seed in range(12):
        mechanism = random_mechanism(seed).mechanism
        for own in (mechanism, with_other_numbers(mechanism, 1.3)):
            compiled = CompiledMechanism(own)
            compiled.program("energies" if own is mechanism else "momenta")  # numbers of nodes don't count
            for name in NAMES:
                program = compiled.program(name)
                found.setdefault(split_constants(program)[0], set()).add(llvm.emit(program, 4)[0].replace(name, ""))
    assert all(len(sources) == 1 for sources in found.values())
    assert len(found) < 2 * 12 * len(NAMES)
