"""Names of the functions that a system gives a meaning."""

from inspect import signature
from typing import Any

import pytest

from fmd.dynamics.system import accelerations, advance, fast_steps, find_responses, freeze_slow, velocities

NAMES = (accelerations, freeze_slow, find_responses, fast_steps, advance, velocities)


@pytest.mark.parametrize("name", NAMES, ids=lambda name: name.__name__)
def test_a_name_without_a_system_does_nothing(name: Any) -> None:
    with pytest.raises(NotImplementedError, match=r"^$"):
        name(*([None] * len(signature(name).parameters)))
