"""A tube in a hub whose nodes face one another: at the tube's edges the normal is one, and pressures are Lamé's."""

import importlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.integrators.protocol import evaluate

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Any, Any]:
    """An interference fit of 24 elements round each part, of which the hub has the points."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCHMARKS))
        module = importlib.import_module("contact_calculix")
    (case,) = (case for case in module.cases() if case.name == "interference fit")
    tube, hub = case.parts
    drawn = module.ring(19.98, 40.0, (0.0, 2 * np.pi), 8.0)
    case = replace(case, parts=(replace(tube, counts=(3, 24, 2)), replace(hub, counts=(5, 24, 2), shape=drawn)))
    return module, case, module.place_parts(case, tmp_path_factory.mktemp("fit"))


def test_pressures_of_a_fit_with_facing_nodes_are_lames(fit: tuple[Any, Any, Any]) -> None:
    """A thick tube in a thick hub; with one of two facets' normals they were 51 to 73 MPa, and 59.8 in the mean."""
    module, case, placed = fit
    _, _, pressures = module.find_rest(*placed)
    assert pressures.mean() == pytest.approx(case.exact, rel=0.01)
    assert pressures == pytest.approx(np.full(len(pressures), case.exact), rel=0.03)


def test_forces_change_with_a_move_as_little_as_it_is(fit: tuple[Any, Any, Any]) -> None:
    """Round-off chose between normals that are 15 degrees apart, at any move."""
    run, rng = fit[2][0], np.random.default_rng(34)
    p, n, M = run.system.parameters, run.mechanism.n, run.system.mass_matrix(run.start[0])
    modes = np.concatenate([run.mechanism.modes_of(link) for link in range(2)])
    shapes = max(np.abs(own.points.shapes).max() for own in run.mechanism.contacts)

    def forces(moved: Array) -> Array:
        q, a = run.start[0].copy(), np.zeros(n)
        q[run.mechanism.position_shift + modes] += moved
        evaluate(p, 0.0, q, np.zeros(n), a)
        return np.asarray((M @ a)[modes])

    first = forces(np.zeros(len(modes)))
    whole = np.abs(p.contact.force).sum() * shapes
    overlap = 2e-5
    for size in (1e-12, 1e-10, 1e-8):
        moves = size / shapes * rng.uniform(-1.0, 1.0, (5, len(modes)))
        change = max(np.abs(forces(moved) - first).max() for moved in moves)
        assert change < (1e-9 + 20.0 * size / overlap) * whole
