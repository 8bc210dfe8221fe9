"""A wrong unit of a mesh or of matrices is warned of where the body is unusual, and refused where none can be so."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import fmd
from fmd.core.errors import InputError
from fmd.fem.model import FEModel
from fmd.output.frequencies import mode_warnings
from tests.stages.test_left_out import CUBE


def warned(body: dict[str, Any]) -> list[str]:
    run = fmd.load({"title": "Body", "body": {"b": body | {"modes": {"count": 1}}}}).run
    return [each["text"] for each in mode_warnings(run) if each["code"] == "unusual-size"]


def cube(folder: Path, unit: str) -> dict[str, Any]:
    (folder / "cube.inp").write_text(CUBE.partition("*NSET")[0].replace("9, 0.5, 0.5, 2\n", ""))
    return {"mesh": {"file": str(folder / "cube.inp"), "unit": unit}, "E": 70e9, "nu": 0.33, "rho": 2700.0}


@pytest.mark.parametrize(
    ("unit", "said"),
    [("m", []), ("mm", []), ("km", ["the diagonal of its box"]), ("nm", ["the diagonal of its box", "its lowest fre"])],
)
def test_a_cube_in_an_unusual_unit_is_warned_of(tmp_path: Path, unit: str, said: list[str]) -> None:
    found = warned(cube(tmp_path, unit))
    assert len(found) == len(said)
    assert all(text.startswith(f"b: {what}") and "unusual" in text for text, what in zip(found, said, strict=True))


def test_a_cube_as_large_as_no_body_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"body.b.mesh: can't be: the body would have 5.34e\+16 m across"):
        warned(cube(tmp_path, "parsec"))


def test_matrices_in_an_unusual_unit_are_warned_of(tmp_path: Path, small_bar: FEModel) -> None:
    sp.save_npz(tmp_path / "K.npz", sp.csr_array(small_bar.K))
    sp.save_npz(tmp_path / "M.npz", sp.csr_array(small_bar.M))
    np.savetxt(
        tmp_path / "x.csv", np.c_[np.arange(len(small_bar.x)), 1e4 * small_bar.x], delimiter=",", header="n,x,y,z"
    )
    files = {key: str(tmp_path / name) for key, name in (("stiffness", "K.npz"), ("mass", "M.npz"), ("nodes", "x.csv"))}
    end = np.flatnonzero(small_bar.x[:, 0] == 0).tolist()
    (text,) = warned({"matrices": files | {"unit": "m", "stiffness_unit": "nN/m"}, "marker": {"end": {"nodes": end}}})
    assert text.startswith("b: the diagonal of its box is 3033 m, which is unusual")
