"""Lifted mechanisms, whose rigid bodies' inertia, modal damping and gravity are inputs, against the others."""

from dataclasses import replace

import numpy as np
import pytest

from fmd.dynamics.compiler.compiled import compile_mechanism
from fmd.dynamics.links import rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from tests.dynamics.compiler.comparison import TIME, difference, interpreted
from tests.dynamics.compiler.mechanisms import random_mechanism


@pytest.mark.parametrize("seed", [2, 5, 8])
def test_a_lifted_mechanism_accelerates_as_the_other_one(seed: int) -> None:
    made = random_mechanism(seed, second_order=False)
    q, v = made.state(seed)
    expected = interpreted(made.compiled, "accelerations", v.shape, q=q, v=v)
    found = interpreted(compile_mechanism(replace(made.mechanism, lifted=True)), "accelerations", v.shape, q=q, v=v)
    assert difference(found, expected) < 1e-10


def test_lifted_mechanisms_have_one_code_for_all_masses_and_others_for_those_that_are_none() -> None:
    made = random_mechanism(2, second_order=False).mechanism
    rigid = [k for k, link in enumerate(made.links) if not len(link.omega)]

    def with_bodies(mass: float, centre: float) -> Mechanism:
        own = rigid_integrals(mass, np.array([centre, 0.1, -0.2]), np.diag([0.3, 0.4, 0.5]) * mass)
        links = [replace(link, integrals=own) if k in rigid else link for k, link in enumerate(made.links)]
        return replace(made, links=links, gravity=np.array([0.0, -9.8 * mass, 0.0]), lifted=True)

    assert rigid
    light, heavy, central = (compile_mechanism(with_bodies(*own)) for own in ((1.0, 0.1), (2.5, 0.2), (1.0, 0.0)))
    assert light.digest == heavy.digest
    assert not np.array_equal(light.numbers, heavy.numbers)
    assert light.signal_values(TIME).size == heavy.signal_values(TIME).size
    assert central.digest != light.digest
    assert compile_mechanism(replace(with_bodies(1.0, 0.1), lifted=False)).digest != light.digest
