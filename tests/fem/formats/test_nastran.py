"""Nastran bulk data: fields of every form, and what is refused."""

from collections.abc import Callable

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.core.rotations import rotation_matrix
from fmd.fem.formats.import_mesh import solid_mesh
from fmd.fem.formats.nastran import read_nastran
from fmd.fem.formats.raw_mesh import MeshFileError

NASTRAN = """SOL 103
BEGIN BULK
$ small, large and free fields; exponents without an E
GRID           1       0     0.0      0.      0.
GRID,2,,1.0,0.,0.
GRID*                  3               0              1.              1.
*                     0.
GRID           4             0.0  10.0-1     0.0
GRID           5              0.      0.     1.0
GRID           6              1.      0.     1.0
GRID           7              1.      1.   .1+1
GRID           8              0.      1.     1.0
CHEXA          1       3       1       2       3       4       5       6+
+              7       8
ENDDATA
"""


def test_nastran_fields_of_every_kind_are_read() -> None:
    mesh = solid_mesh(read_nastran(NASTRAN), 1.0)
    assert mesh.volume == pytest.approx(1.0, rel=1e-14)
    assert {name: cells.tolist() for name, cells in mesh.parts.items()} == {"property-3": [0]}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("GRID,2,,1.0", "GRID,2,7,1.0"), "grid point 2: coordinate system 7 isn't there, or hangs on itself"),
        (("+              7       8", "+              7"), "line 13: CHEXA 1 lacks 1 of 8 nodes"),
        (("ENDDATA", "CHEXA,1,3,1,2,3,4,5,6\n+,7,8"), "element 1 is given twice"),
        (("       7       8\n", "       7      88\n"), "names grid point 88"),
        (("GRID,2,,1.0", "INCLUDE 'x.bdf'\nGRID,2,,1.0"), "INCLUDE isn't followed"),
    ],
)
def test_nastran_files_that_make_no_sense_are_refused_with_the_line(change: tuple[str, str], message: str) -> None:
    assert change[0] in NASTRAN
    with pytest.raises(MeshFileError, match=message):
        read_nastran(NASTRAN.replace(*change))


@pytest.mark.parametrize(
    ("kind", "point"),
    [
        ("CORD2C", lambda x: (np.hypot(x[0], x[1]), np.degrees(np.arctan2(x[1], x[0])), x[2])),
        (
            "CORD2S",
            lambda x: (
                np.linalg.norm(x),
                np.degrees(np.arctan2(np.hypot(x[0], x[1]), x[2])),
                np.degrees(np.arctan2(x[1], x[0])),
            ),
        ),
    ],
)
def test_points_of_round_systems_are_where_they_are_in_the_basic_one(
    kind: str, point: Callable[[Array], tuple[float, ...]]
) -> None:
    """Places in a turned system, found by its own formulas, with GRDSET for all but one."""
    x = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1.0)]) + 2.0
    origin, axes = np.array([0.5, -1.0, 0.25]), rotation_matrix(np.array([[0.4, -0.3, 0.7]]))[0]
    corners = np.concatenate([origin, origin + axes[:, 2], origin + axes @ [1.0, 0.0, 1.0]])
    places = [point((one - origin) @ axes) for one in x]
    deck = f"GRDSET,,7\nGRID,1,0,{x[0, 0]},{x[0, 1]},{x[0, 2]}\n"
    deck += "".join(f"GRID,{k},,{a:.12g},{b:.12g},{c:.12g}\n" for k, (a, b, c) in enumerate(places[1:], start=2))
    deck += "CHEXA,1,3,1,2,3,4,5,6\n+,7,8\n"
    first, second = (",".join(f"{value:.15g}" for value in part) for part in (corners[:6], corners[6:]))
    assert read_nastran(deck + f"{kind},7,,{first}\n,{second}\n").points == pytest.approx(x, abs=1e-10)


@pytest.mark.parametrize("name", ["CPYRAM", "CPYRA"])
def test_a_pyramid_has_its_mid_edge_nodes_around_the_base_and_then_upwards(name: str) -> None:
    # base of 1 × 1, height 3: volume 1
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 3), (0.5, 0, 0), (1, 0.5, 0), (0.5, 1, 0), (0, 0.5, 0)]
    points += [(0, 0, 1.5), (0.5, 0, 1.5), (0.5, 0.5, 1.5), (0, 0.5, 1.5)]
    lines = [f"GRID,{k},,{x!r},{y!r},{z!r}" for k, (x, y, z) in enumerate(((*map(float, p),) for p in points), start=1)]
    for count in (5, 13):
        nodes = [*map(str, range(1, count + 1))]
        card = f"{name},7,2,{','.join(nodes[:6])}" + (f"\n+,{','.join(nodes[6:])}" if count > 5 else "")
        mesh = solid_mesh(read_nastran("\n".join(["BEGIN BULK", *lines, card, "ENDDATA"])), 1.0)
        assert mesh.cell_type == {5: "pyramid", 13: "pyramid13"}[count]
        assert mesh.volume == pytest.approx(1.0, rel=1e-13)
        assert not any("order" in note for note in mesh.notes)


def test_a_star_of_large_fields_may_stand_apart_from_the_name() -> None:
    """As the punch files of MSC Nastran have it."""
    ends = ((1, 0, 0), (2, 1, 0), (3, 0, 1))
    cards = [f"GRID   *{k:16d}{'':16}{x:16.1f}{y:16.1f}\n*       {0.0:16.1f}" for k, x, y in ends]
    raw = read_nastran("\n".join(["BEGIN BULK", *cards, "CTRIA3,1,1,1,2,3", "ENDDATA"]))
    assert raw.points.tolist() == [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
