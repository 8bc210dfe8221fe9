"""MBDyn's modal data: point masses that carry a body's inertia, the manual's example, bad files."""

from pathlib import Path

import numpy as np
import pytest

from fmd.core.errors import InputError
from fmd.reduction.formats.mbdyn_file import inertia_points, read_mbdyn, write_mbdyn
from fmd.reduction.inertia import inertia_integrals
from fmd.verification.bodies import MANUAL_EXAMPLE
from tests.reduction.formats.bodies_of_points import point_body

BODY = point_body()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "body.fem"
    write_mbdyn(path, BODY.data)
    return path


def test_the_points_have_the_bodys_integrals():
    """Thirty points of unequal masses, and about as many equal ones in other places."""
    mass, x, shapes = inertia_points(BODY.data)
    integrals = inertia_integrals(x, mass * np.eye(len(x)), shapes)
    assert len(x) == 2 * 12
    assert np.abs(integrals.G - BODY.integrals.G).max() < 1e-13 * np.abs(BODY.integrals.G).max()
    assert np.abs(integrals.S - BODY.integrals.S).max() < 1e-13 * np.abs(BODY.integrals.S).max()


def test_a_file_brings_the_body_back(file: Path):
    data, back = BODY.data, read_mbdyn(file)
    assert np.abs(back.integrals.G - data.integrals.G).max() < 1e-12 * np.abs(data.integrals.G).max()
    assert np.abs(back.integrals.S - data.integrals.S).max() < 1e-12 * np.abs(data.integrals.S).max()
    for name in ("K", "D", "M"):
        assert np.abs(getattr(back, name) - getattr(data, name)).max() < 1e-13
    for label, want in (("left-end", data.nodes["left end"]), ("right", data.nodes["right"])):
        for name in ("position", "translation", "rotation"):
            assert np.array_equal(getattr(back.nodes[label], name), getattr(want, name))
    assert back.notes == ()


def test_the_manuals_example_has_the_inertia_that_the_manual_says(tmp_path: Path):
    (tmp_path / "manual.fem").write_text(MANUAL_EXAMPLE)
    data = read_mbdyn(tmp_path / "manual.fem")
    assert data.integrals.mass == 3.0
    assert np.array_equal(data.integrals.inertia(np.array([1.0, 0.0, 0.0])), np.diag([11.0, 3.0, 11.0]))
    assert np.array_equal(data.M, np.diag([2.0, 2.0]))
    assert data.integrals.S[:, 1:].tolist() == [[0.0, 2.0], [0.0, 0.0], [2.0, 0.0]]


def test_global_inertia_replaces_that_of_the_nodes(tmp_path: Path):
    text = MANUAL_EXAMPLE + "** RECORD GROUP 12, GLOBAL INERTIA\n 4\n 0 1 0\n 12 0 0\n 0 4 0\n 0 0 12\n"
    (tmp_path / "x.fem").write_text(text)
    integrals = read_mbdyn(tmp_path / "x.fem").integrals
    assert integrals.mass == 4.0
    assert np.allclose(integrals.inertia(np.array([1.0, 0.0, 0.0])), np.diag([16.0, 4.0, 16.0]), rtol=1e-14)


def test_lacking_nodal_masses_are_noted(tmp_path: Path):
    text = MANUAL_EXAMPLE.partition("** RECORD GROUP 11")[0]
    (tmp_path / "x.fem").write_text(text + "** RECORD GROUP 12, INERTIA\n 3\n 0 0 0\n 11 0 0\n 0 3 0\n 0 0 11\n")
    data = read_mbdyn(tmp_path / "x.fem")
    assert "no record group 11" in data.notes[0]
    assert np.allclose(data.M, np.diag([2.0, 2.0]))
    (tmp_path / "x.fem").write_text(text)
    with pytest.raises(InputError, match="neither record group 11 nor 12"):
        read_mbdyn(tmp_path / "x.fem")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("** RECORD GROUP 1,", "** GROUP 1,", "it has no '** RECORD GROUP 1'"),
        (" 1001 1002 1003", " 1001 1002", "3 labels expected, not 2"),
        (" -2. 0 2.", " -2. 0", "record group 6 has 2 numbers, and 3 are expected"),
        (" 0 1e2", " 0 stiff", "'0 stiff' isn't a row of numbers"),
        (" 0 1e2", " 0 1e999", "record group 10 holds a number that isn't finite"),
        ("** RECORD GROUP 9", "** RECORD GROUP 10", "record group 10 stands twice"),
        ("REV0 3 2", "REV0 3 0", "has 3 nodes and 0 modes"),
        ("3 2 0 0 0", "3 2 0 0", "isn't a revision and five counts"),
    ],
)
def test_a_bad_file_is_refused_in_one_line(tmp_path: Path, old: str, new: str, message: str):
    path = tmp_path / "x.fem"
    assert old in MANUAL_EXAMPLE
    path.write_text(MANUAL_EXAMPLE.replace(old, new, 1))
    with pytest.raises(InputError) as error:
        read_mbdyn(path)
    assert message in str(error.value)
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)
