"""Steps of scenes with contacts: refused before contacts are found, and chosen by the modes for an implicit method."""

from __future__ import annotations

import re
from typing import Any

import pytest

from fmd import Pipeline, load_scene
from fmd.core.errors import ConvergenceError, InputError
from fmd.integrators.generalized_alpha import GeneralizedAlpha
from tests.contact.test_contact_points import BLOCK

IMPLICIT = "simulation.run.0.integrator=generalized-alpha"


def block(*overrides: str, **tables: Any) -> Pipeline:
    return Pipeline(load_scene(BLOCK | tables, overrides))


def test_a_step_beyond_the_modes_own_limit_is_refused_before_contacts_are_found() -> None:
    run, free = block("simulation.step=1 ms"), block(contact={})
    with pytest.raises(InputError, match=r"simulation\.step = '0\.001 s': is too long for contact") as refused:
        _ = run.mechanism
    assert "contact" not in run.parts["block"].results
    stable = float(re.search(r"stable up to ([\d.e-]+) s", str(refused.value)).group(1))  # type: ignore[union-attr]
    assert stable == pytest.approx(2.0 / free.parts["block"].body.omega[-1], rel=1e-3)
    assert "simulation.run.0.integrator = 'generalized-alpha'" in str(refused.value)
    assert "body.block.modes.enrich" not in str(refused.value)  # there are none to leave out
    with pytest.raises(InputError, match=r"body\.block\.modes\.enrich = 'none' leaves out the fastest modes"):
        _ = block("simulation.step=1 ms", "body.block.modes.enrich=inertia").mechanism


def test_auto_is_refused_with_the_methods_and_the_step_they_need() -> None:
    simulation = {key: value for key, value in BLOCK["simulation"].items() if key != "step"}
    simulation["run"] = [{"integrator": "auto"}]
    told = (
        r"simulation\.run\.0\.integrator = 'auto': takes no contact; central-difference, sub-cycling and "
        r"generalized-alpha do, with simulation\.step = 'auto' or yours"
    )
    with pytest.raises(InputError, match=told):
        block(simulation=simulation)


def test_an_implicit_method_takes_a_step_by_its_modes_and_the_impulse_of_short_explicit_ones() -> None:
    implicit, explicit = (block(*own, "body.block.modes.enrich=inertia") for own in ([IMPLICIT], []))
    (first,) = implicit.growths
    assert first.step == pytest.approx(0.25 * 2.0 / implicit.parts["block"].body.omega[3])  # of four modes that count
    assert first.step > implicit.system.largest_step  # which an explicit method would diverge at
    found = [run.motion.contacts["floor"] for run in (implicit, explicit)]
    assert found[0].impulse[-1, 1] == pytest.approx(found[1].impulse[-1, 1], rel=0.02)
    assert found[0].lost_part(implicit.motion.energies[0]) <= 0.01  # by halvings


def test_a_step_that_does_not_converge_is_halved_where_it_is_left_open_and_named_where_it_is_given(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    march, steps = GeneralizedAlpha.march, []

    def fail_at_first(method: GeneralizedAlpha, *arguments: Any) -> Any:
        steps.append(method.step)
        if method.step == steps[0]:
            raise ConvergenceError("Newton's iteration did not converge")
        return march(method, *arguments)

    monkeypatch.setattr(GeneralizedAlpha, "march", fail_at_first)
    assert block(IMPLICIT).motion.contacts["floor"].impulse[-1, 1] > 0.0
    assert steps[-1] <= 0.5 * steps[0]
    steps.clear()
    with pytest.raises(ConvergenceError, match=r"simulation\.step: Newton's iteration did not converge"):
        _ = block(IMPLICIT, "simulation.step=1 us").motion
