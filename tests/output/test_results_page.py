"""docs/results.md: its recipe gives the figures of the run, and it names every variable."""

import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

RESULTS = (Path(__file__).parents[2] / "docs" / "results.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def recipe(tmp_path_factory: pytest.TempPathFactory, fmd: Any) -> dict[str, Any]:
    """What is left after the command and the lines of docs/results.md, run as they stand there."""
    command, lines = re.search(r"```bash\n(.*?)```\s*```python\n(.*?)```", RESULTS, re.DOTALL).groups()
    names: dict[str, Any] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("recipe"))
        assert fmd(*shlex.split(command)[1:]) == 0
        exec(lines, names)
        names["all_runs"] = xarray.load_dataset("out/beam-paper/motion.nc")
    return names


def test_the_recipe_rebuilds_the_stress_that_the_summary_has(recipe: dict[str, Any]) -> None:
    worst = recipe["summary"]["worst_stress"]
    assert recipe["von_mises"].max() == pytest.approx(worst["von_mises_pa"], rel=1e-12)
    node = int(recipe["body"]["surface_nodes"][recipe["von_mises"].argmax()])
    place = (recipe["body"]["x"] + recipe["body"]["origin"])[node].to_numpy()
    assert place == pytest.approx(worst["position_m"], abs=1e-12)


def test_the_recipe_puts_the_tip_where_the_motion_has_it(recipe: dict[str, Any]) -> None:
    tip = recipe["body"].sel(marker="tip")
    place = (tip["marker_position"] + tip["marker_translation"] @ xarray.DataArray(recipe["q"], dims="mode")).to_numpy()
    in_space = recipe["now"]["beam.origin"].to_numpy() + recipe["R"] @ place
    assert in_space == pytest.approx(recipe["now"]["tip.position"].to_numpy(), abs=1e-12)
    # the face's nodes lie about their mean
    on_face = recipe["body"]["x"].to_numpy()[:, 0] > 0.34 - 1e-9
    assert recipe["position"][on_face].mean(axis=0) == pytest.approx(in_space, abs=1e-4)


def test_the_page_on_results_names_every_variable(recipe: dict[str, Any]) -> None:
    patterns = [
        re.sub(r"<\w+>", r"[\\w-]+", re.escape(name).replace(r"\<", "<").replace(r"\>", ">"))
        for row in re.findall(r"^\| (`.*?) \|", RESULTS, re.MULTILINE)
        for name in re.findall(r"`(.+?)`", row)
    ]
    named = re.compile("|".join(f"(?:{pattern})" for pattern in patterns))
    for name in (*recipe["all_runs"].data_vars, *recipe["body"].data_vars, *recipe["summary"]):
        assert named.fullmatch(name), f"docs/results.md lacks {name}"
    assert "hub.position" in recipe["all_runs"]


def test_every_variable_has_a_unit_and_a_name(recipe: dict[str, Any]) -> None:
    for name, variable in recipe["all_runs"].data_vars.items():
        assert {"units", "long_name"} <= set(variable.attrs), name
        some = variable.isel(axis=2) if name == "angular_momentum" else variable  # about the hinge alone
        assert np.isfinite(some).all(), name
