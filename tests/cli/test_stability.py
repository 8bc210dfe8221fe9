"""`fmd stability`: what it prints as JSON, and what it refuses."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fmd.cli.app import main

Answer = Callable[..., dict]


@pytest.fixture
def fmd(capsys: pytest.CaptureFixture[str]) -> Answer:
    def answer(*arguments: str) -> dict:
        with pytest.raises(SystemExit) as end:
            main(["stability", *arguments, "--json"])
        assert end.value.code in (0, None)
        return json.loads(capsys.readouterr().out)

    return answer


def test_the_papers_figures_are_drawn_and_printed(fmd: Answer, tmp_path: Path) -> None:
    answer = fmd("--two-dof", "--substeps", "2", "--resolution", "50", "--out", str(tmp_path))
    assert (answer["substeps"], answer["coupling"]) == (2, 0.0)
    assert np.shape(answer["map"]["rho"]) == (50, 50)
    assert answer["files"] == ["two-dof-2-substeps.png"]
    assert (tmp_path / answer["files"][0]).stat().st_size > 10_000
    # stable up to 2 of 2.5 in both directions, without what lies on the limit
    assert answer["stable_share"] == pytest.approx(0.8**2, abs=0.04)


def test_several_couplings_are_several_maps(fmd: Answer, tmp_path: Path) -> None:
    answer = fmd("--two-dof", "--coupling", "0", "--coupling", "0.3", "--resolution", "20", "--out", str(tmp_path))
    assert [row["coupling"] for row in answer["maps"]] == [0.0, 0.3]
    assert answer["maps"][1]["stable_share"] == 0.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "give a scene, e.g. beam, or --two-dof"),
        (["beam", "--two-dof"], "give a scene, e.g. beam, or --two-dof"),
        (["--two-dof", "--coupling", "1"], "must be 0 ≤ β < 1"),
        (["--two-dof", "--resolution", "1"], "--resolution 2 … 2000"),
        (["beam", "--substeps", "-1"], "must be 1 … 1000"),
    ],
)
def test_wrong_options_are_reported(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["stability", *arguments])
    assert message in capsys.readouterr().err


def test_a_scenes_limits_are_reported(fmd: Answer) -> None:
    answer = fmd("rod-slider", "--substeps", "5")
    # the slider of 2 kg on 400 N/m, 10 √2 rad/s; the rod turns freely
    assert answer["critical_step_s"] == pytest.approx(2 / np.sqrt(200), rel=1e-6)
    assert [row["substeps"] for row in answer["rows"]] == [1, 5]
    assert answer["rows"][1]["critical_step_s"] == pytest.approx(2 / np.sqrt(200), rel=1e-6)
    assert answer["coupling"] == 0.0
    assert answer["recommended"]["substeps"] > 1
