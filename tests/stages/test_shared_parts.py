"""Bodies of one part share its mesh, its matrices and its modes: each is computed once."""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, Result, load_scene, solve
from fmd.core.cache import Cache
from fmd.fem.model import FEModel
from fmd.output.explain import forecast_run
from fmd.reduction import eigen
from fmd.reduction.eigen import FreeBodySolver
from fmd.scene.variants import change_modes
from fmd.stages.store import StageStore

BLADES = """
title = "Two blades and a third of another material, on a hub"

[body.hub]
shape = "rigid"
mass = "1 kg"
inertia = ["1e-3 kg m^2", "1e-3 kg m^2", "1e-3 kg m^2"]
marker = { centre = { at = ["0 m", "0 m", "0 m"] }, a = { at = ["5 cm", "0 m", "0 m"] } }

[body.one]
shape = "bar"
length = "200 mm"
depth = "10 mm"
width = "20 mm"
E = "70 GPa"
nu = 0.33
rho = "2700 kg/m^3"
mesh = { divisions = [6, 1, 1] }
modes = { count = 3, boundary = "joint" }
marker = { root = { face = "x-" }, tip = { face = "x+" } }

[body.two]
like = "one"

[body.steel]
like = "one"
E = "210 GPa"

[joint.shaft]
type = "revolute"
parent = "ground"
child = "hub.centre"
axis = [0, 0, 1]
rate = "10 rad/s"

[joint.one]
type = "revolute"
parent = "hub.a"
child = "one.root"
axis = [0, 0, 1]

[joint.two]
type = "revolute"
parent = "one.tip"
child = "two.root"
axis = [0, 0, 1]

[joint.steel]
type = "revolute"
parent = "hub.a"
child = "steel.root"
axis = [0, 0, 1]

[simulation]
duration = "10 ms"
output_step = "1 ms"
tip = "one.tip"
run = [{ integrator = "auto" }]
"""


@pytest.fixture
def computed(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Number of times that each stage is computed."""
    counts: Counter[str] = Counter()
    compute = StageStore.compute

    def count(self: StageStore, stage: str, work: Any) -> Any:
        counts[stage] += 1
        return compute(self, stage, work)

    monkeypatch.setattr(StageStore, "compute", count)
    return counts


def open_blades(folder: Path, cache: Cache) -> Pipeline:
    return solve_blades(folder, cache).run


def solve_blades(folder: Path, cache: Cache) -> Result:
    file = folder / "blades.toml"
    file.write_text(BLADES)
    return solve(load_scene(file), cache)


def test_two_bodies_of_a_part_share_what_they_have_in_common(tmp_path: Path, computed: Counter[str]):
    run = open_blades(tmp_path, Cache(None))
    one, two, steel = run.parts.values()
    for part in (one, two, steel):
        part.body  # noqa: B018 - computes it
    # steel has the same mesh, but other matrices and modes; the joints of one and two load other markers
    assert computed == {"mesh": 1, "assembly": 2, "modes": 2, "body": 3}
    assert two.mesh is one.mesh
    assert two.fe is one.fe
    assert two.modes is one.modes
    assert steel.modes is not one.modes
    # ω² is in proportion to Young's modulus.
    np.testing.assert_allclose(steel.modes.omega**2, 3 * one.modes.omega**2, rtol=1e-9)


def test_a_shared_part_has_the_modes_that_it_has_alone(tmp_path: Path):
    together, alone = (open_blades(tmp_path, Cache(None)) for _ in range(2))
    for part in together.parts.values():
        part.body  # noqa: B018 - computes it
    own = alone.parts["two"]
    np.testing.assert_allclose(together.parts["two"].modes.omega, own.modes.omega, rtol=1e-12)
    np.testing.assert_allclose(together.parts["two"].body.omega, own.body.omega, rtol=1e-12)


def test_a_shared_result_is_read_once_and_forecast_as_that_of_the_first_body(tmp_path: Path, computed: Counter[str]):
    result = solve_blades(tmp_path, Cache(tmp_path / "cache"))
    run = result.run
    forecast = {(step.stage, step.body): (step.fate, step.why) for step in forecast_run(result, False, False).steps}
    assert forecast["modes", "one"] == ("run", "not kept yet")
    assert forecast["modes", "two"] == ("cached", "that of one")
    assert forecast["modes", "steel"] == ("run", "not kept yet")
    for part in run.parts.values():
        part.body  # noqa: B018 - computes it
    assert computed["modes"] == 2
    again = open_blades(tmp_path, Cache(tmp_path / "cache"))
    assert again.parts["two"].modes is again.parts["one"].modes
    assert computed["modes"] == 2


def test_variants_with_more_modes_share_factor_and_static_responses(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the variant was made before its first one had any: the bodies are those that each has by itself."""
    made, solved = list[int](), list[int]()
    init, solve = FreeBodySolver.__init__, eigen.solve_balanced

    def count_solvers(self: FreeBodySolver, fe: FEModel, *rest: Any, **named: Any) -> None:
        made.append(fe.K.shape[0])
        init(self, fe, *rest, **named)

    def count_loads(K: Any, M: Any, R: Any, inverse: Any, f: Any, *more: Any) -> Any:
        solved.append(f.shape[1])
        return solve(K, M, R, inverse, f, *more)

    monkeypatch.setattr(FreeBodySolver, "__init__", count_solvers)
    monkeypatch.setattr(eigen, "solve_balanced", count_loads)
    scene = load_scene("beam", ["body.beam.mesh.divisions=[6, 1, 1]"])
    richer = change_modes(scene, lambda body: {"count": body.modes.count + 2})
    alone = Pipeline(richer, Cache(None)).part.stiffened
    first = Pipeline(scene, Cache(None))
    variant = first.variant(richer)
    made.clear(), solved.clear()
    own = variant.part.stiffened
    before = len(solved)
    assert first.part.stiffened.shapes.shape[2] == own.shapes.shape[2] - 2
    assert (len(made), len(solved)) == (1, before)
    for name in ("G", "stiffening", "displacement2", "rotation2"):
        one, other = getattr(own.integrals, name), getattr(alone.integrals, name)
        assert np.array_equal(one, other), name
    other = first.variant(
        scene.model_copy(update={"body": {"beam": scene.body["beam"].model_copy(update={"E": 2e11})}})
    )
    assert other.part.model is not first.part.model
