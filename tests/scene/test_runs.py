"""Runs make the integrators that they are named by, and answer for them."""

import pytest

from fmd.core.errors import InputError
from fmd.scene.runs import RUNS, CentralDifferenceRun, ReversibleSubCyclingRun, name_methods

KINDS = [(run, name) for run in RUNS for name in run.names()]


@pytest.mark.parametrize(("run", "name"), KINDS, ids=[name for _, name in KINDS])
def test_a_run_makes_the_integrator_of_its_name_with_what_it_needs(run, name):
    ratio = {"substeps": 5} if "substeps" in run.model_fields else {}
    table = run.model_validate({"integrator": name, **ratio})
    method = table.make(1e-3, 1e-4, 2.0)
    assert method.name == name
    assert method.step == (0.0 if run.chooses_steps else 1e-3)
    assert method.substeps == ratio.get("substeps", 1)
    assert table.label(method.substeps) == table.label() == (f"{name} 5:1" if ratio else name)
    assert getattr(method, "tolerance", None) == getattr(table, "tolerance", None)


def test_reversible_sub_cycling_without_a_ratio_is_central_difference_under_its_own_label():
    run = ReversibleSubCyclingRun(integrator="reversible-sub-cycling", substeps=1)
    method = run.make(1e-3, 1e-4, 2.0)
    assert method.name == "central-difference"
    assert run.label(method.substeps) == "reversible-sub-cycling 1:1"


def test_methods_are_named_by_what_they_do():
    assert name_methods("chooses_steps", "keeps_loops") == "exponential-rosenbrock, runge-kutta and auto"
    assert name_methods("passes_over") == "generalized-alpha"


def test_a_step_that_is_chosen_is_the_simulation_s():
    with pytest.raises(InputError, match=r"set simulation.step = 'auto', and leave the run's own out"):
        CentralDifferenceRun(integrator="central-difference", step="auto")
