"""Superelements of other programs: one that is made here by dense matrices moves as the whole body does."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import scipy.linalg as la
from scipy.sparse import csr_array, save_npz
from scipy.spatial.transform import Rotation

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.core.cache import Cache
from fmd.core.errors import AccuracyError, InputError
from fmd.output.frequencies import mode_warnings
from tests.fem.formats.test_nastran_op2 import op2

BEAM = """title = "t"
[body.beam]
shape = "bar"
length = "340 mm"
depth = "25 mm"
width = "10 mm"
E = "722 MPa"
nu = 0.34
rho = "2000 kg/m^3"
mesh = { element = "hexahedron", order = 2, divisions = [8, 1, 1] }
modes = { count = 10, boundary = "interface", damping = 0.02 }
marker.root = { face = "x-", attachment = "rigid" }
marker.tip = { face = "x+", attachment = "rigid" }
"""
MOVES = """[joint.hub]
type = "spherical"
parent = "ground"
child = "beam.root"
spin = ["3 rad/s", "10 rad/s", "20 rad/s"]
[simulation]
duration = "60 ms"
output_step = "2 ms"
tip = "beam.tip"
gravity = ["0 m/s^2", "-9.81 m/s^2", "1 m/s^2"]
stiffening = "off"
[[simulation.run]]
integrator = "runge-kutta"
tolerance = 1e-8
"""
GIVEN = """title = "t"
[body.beam]
body = {{ file = "{}", unit = "mm", stiffness_unit = "N/mm", mass_unit = "t"{} }}
modes = {{ damping = 0.02 }}
marker = {{ root = {{ node = "7" }}, tip = {{ node = "3" }} }}
"""
RECOVERED = ', nodes = "nodes.csv", recovery = "otm.mtx", recovery_nodes = "nodes.csv"'
N_MODES = 10
UNKNOWNS = tuple([(n, c) for n in (7, 3) for c in range(1, 7)] + [(101 + k, 0) for k in range(N_MODES)])


class Made(NamedTuple):
    """A Craig–Bampton reduction in t, N and mm, of the nodes 7 and 3 and modal coordinates, and where it was made."""

    folder: Path
    K: Array
    M: Array
    places: dict[int, Array]
    all_of_it: Array  # displacements of all nodes by its unknowns
    x: Array
    free: Array  # angular frequencies of the whole body with rigid ends
    mass: float

    def with_places(self, name: str, **changed: Array) -> None:
        """Write nodes to a table."""
        rows = [f"{node}, {', '.join(map(repr, map(float, at)))}" for node, at in (self.places | changed).items()]
        (self.folder / name).write_text("node, x, y, z\n" + "\n".join(rows))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    folder = tmp_path_factory.mktemp("superelements")
    (folder / "beam.toml").write_text(BEAM)
    fe = scene(folder / "beam.toml").parts["beam"].fe
    x, K, M = 1e3 * fe.x, 1e-3 * fe.K.toarray(), 1e-3 * fe.M.toarray()
    places = {7: x[np.isclose(x[:, 0], 0.0)].mean(axis=0), 3: x[np.isclose(x[:, 0], 340.0)].mean(axis=0)}
    ends = np.isclose(x[:, 0], 0.0) | np.isclose(x[:, 0], 340.0)
    inner = np.flatnonzero(np.repeat(~ends, 3))
    T = np.zeros((3 * len(x), 12 + len(inner)))
    for k, at in enumerate(places.values()):
        for node in np.flatnonzero(np.isclose(x[:, 0], at[0])):
            T[3 * node : 3 * node + 3, 6 * k : 6 * k + 3] = np.eye(3)
            T[3 * node : 3 * node + 3, 6 * k + 3 : 6 * k + 6] = np.cross(np.eye(3), x[node] - at).T
    T[inner, 12 + np.arange(len(inner))] = 1.0
    K, M = T.T @ K @ T, T.T @ M @ T
    free = np.sqrt(la.eigh(K, M, eigvals_only=True, subset_by_index=[6, 13]))
    V = np.zeros((len(K), 12 + N_MODES))
    V[:12, :12], V[12:, :12] = np.eye(12), -la.solve(K[12:, 12:], K[12:, :12])
    V[12:, 12:] = la.eigh(K[12:, 12:], M[12:, 12:], subset_by_index=[0, N_MODES - 1])[1]
    K, M = V.T @ K @ V, V.T @ M @ V
    made = Made(folder, (K + K.T) / 2, (M + M.T) / 2, places, T @ V, x, free, fe.mass)
    made.with_places("nodes.csv")
    write_punch(made, "beam.pch", made.K, made.M)
    write_substructure(made, "beam.mtx", made.K, made.M)
    return made


def write_punch(made: Made, name: str, K: Array, M: Array, *cards: str) -> None:
    """Write as Nastran does: columns of a lower half in large fields, scalar points without a component."""
    unknowns = [(node, c) for node in (7, 3) for c in range(1, 7)] + [(101 + k, "") for k in range(N_MODES)]

    def lines() -> Iterator[str]:
        yield from ("$ KAAX, MAAX", "BEGIN BULK", *cards)
        for matrix, A in (("KAAX", K), ("MAAX", M), ("K4AAX", K)):
            yield f"{'DMIG':8}{matrix:8}{0:8}{6:8}{2:8}{0:8}"
            for j, (node, component) in enumerate(unknowns):
                yield f"{'DMIG*':8}{matrix:16}{node:16}{component:>16}"
                for i in range(j, len(A)):
                    yield f"{'*':8}{unknowns[i][0]:16}{unknowns[i][1]:>16}{A[i, j]:16.9E}"

    (made.folder / name).write_text("\n".join(lines()) + "\n")


def write_substructure(made: Made, name: str, K: Array, M: Array | None) -> None:
    """Write as Abaqus does: a user element, of which each modal coordinate is a node with one component."""
    nodes = [7, 3, *range(101, 101 + N_MODES)]
    lines = ["**", "*USER ELEMENT,NODES=         12,LINEAR", "** ELEMENT NODES"]
    lines += [f"**{','.join(map(str, part))}," for part in (nodes[:10], nodes[10:])] + ["1,2,3,4,5,6", "3,1"]
    for kind, A in (("STIFFNESS", K), ("MASS", M)):
        if A is not None:
            lines.append(f"*MATRIX,TYPE={kind}")
            values = [f"{value:.16E}" for value in A[np.tril_indices(len(A))]]
            lines += [", ".join(values[k : k + 4]) + "," for k in range(0, len(values), 4)]
    (made.folder / name).write_text("\n".join(lines) + "\n")


def scene(path: Path) -> Pipeline:
    return Pipeline(load_scene(path), Cache(None))


def given(made: Made, file: str, more: str = "", moves: str = "") -> Pipeline:
    path = made.folder / f"given-{abs(hash((file, more, moves)))}.toml"
    path.write_text(GIVEN.format(file, more) + moves)
    return scene(path)


@pytest.mark.parametrize("file", ["beam.pch", "beam.mtx"])
def test_its_frequencies_and_its_mass_are_those_of_the_whole_body(made: Made, file: str):
    """Craig and Bampton's are from above, and near for modes below the highest of the fixed interface."""
    part = given(made, file, f', nodes = "nodes.csv", mass = "{made.mass} kg"').parts["beam"]
    assert part.modes.omega[:8] == pytest.approx(made.free, rel=1e-2)
    assert (part.modes.omega[:8] > (1 - 1e-6) * made.free).all()
    assert part.modes.omega == pytest.approx(np.sqrt(la.eigh(made.K, made.M, eigvals_only=True)[6:]), rel=1e-6)
    assert part.given_model.mass == pytest.approx(made.mass, rel=1e-8)


def test_grid_points_may_stand_in_the_file_of_the_matrices(made: Made):
    cards = [f"GRID,{node},,{','.join(map(repr, map(float, at)))}" for node, at in made.places.items()]
    write_punch(made, "whole.pch", made.K, made.M, *cards)
    assert given(made, "whole.pch").parts["beam"].modes.omega[:8] == pytest.approx(made.free, rel=1e-2)


def test_nastrans_unknowns_may_have_axes_of_their_own(made: Made):
    """Matrices of OUTPUT2 in the order of EXTRN; a node lies and moves in a system that hangs on another one."""
    Q = Rotation.from_rotvec([0.3, -0.8, 0.5])
    origin, place = np.array([10.0, 20.0, -5.0]), made.places[3]
    first, second = np.eye(3), Q.as_matrix()  # a shifted system, and in it a turned one
    corners = [origin, origin + first[:, 2], origin + first[:, 0]]
    cards = [f"CORD2R,4,0,{','.join(f'{x:.17g}' for x in np.ravel(corners)[:6])}"]
    cards += [",".join(["", *(f"{x:.17g}" for x in corners[2])])]
    corners = [np.zeros(3), second[:, 2], second[:, 0]]
    cards += [f"CORD2R,5,4,{','.join(f'{x:.17g}' for x in np.ravel(corners)[:6])}"]
    cards += [",".join(["", *(f"{x:.17g}" for x in corners[2])])]
    at = second.T @ (place - origin)
    cards += [
        f"GRID,3,5,{','.join(f'{x:.17g}' for x in at)},5",
        "GRID,7,," + ",".join(map(repr, made.places[7].tolist())),
    ]
    cards += ["EXTRN,3,123456,7,123456", *(f"EXTRN,{101 + k},0" for k in range(N_MODES))]
    (made.folder / "turned.pch").write_text("BEGIN SUPER 5\n" + "\n".join(cards) + "\n")
    order = np.r_[6:12, 0:6, 12 : 12 + N_MODES]
    turn = la.block_diag(second, second, np.eye(6 + N_MODES))
    K, M = (turn.T @ A[np.ix_(order, order)] @ turn for A in (made.K, made.M))
    (made.folder / "beam.op2").write_bytes(op2({"KAA": K, "MAA": M, "BXX": np.ones((1, 1)), "K4XX": np.ones((1, 1))}))
    part = given(made, "beam.op2", ', nodes = "turned.pch"').parts["beam"]
    assert part.modes.omega[:8] == pytest.approx(made.free, rel=1e-2)
    for node in "37":
        assert part.given_model.data.nodes[node].position == pytest.approx(1e-3 * made.places[int(node)], abs=1e-12)
    plain = given(made, "beam.mtx", ', nodes = "nodes.csv"').parts["beam"]
    tips, roots = ([own.given_model.data.nodes[node].rotation for own in (part, plain)] for node in "37")
    signs = np.sign(np.sum(roots[0] * roots[1], axis=0))  # of whole modes, by the other node
    assert np.abs(tips[0] * signs - tips[1]).max() < 1e-6 * np.abs(tips[1]).max()
    (made.folder / "round.pch").write_text("\n".join(cards).replace("CORD2R,5", "CORD2C,5"))
    with pytest.raises(InputError, match="moves in coordinate system 5, which is no CORD2R"):
        given(made, "beam.op2", ', nodes = "round.pch"').parts["beam"].fe  # noqa: B018
    listed = r"body\.beam\.body\.nodes = 'nodes\.csv': lists 0 unknowns by EXTRN, and \S+ has 22 rows; name the \.pch"
    with pytest.raises(InputError, match=listed):
        given(made, "beam.op2", ', nodes = "nodes.csv"').parts["beam"].fe  # noqa: B018


@pytest.mark.parametrize(("recovered", "within"), [(False, 0.015), (True, 1e-3)])
def test_it_moves_as_the_whole_body(made: Made, recovered: bool, within: float):
    """A ball joint's motion beside that of the mesh: 0.8 % of the deflection, and 3e-4 with points within."""
    more = ', nodes = "nodes.csv"'
    if recovered:
        nodes = dict(enumerate(made.x, start=1001))
        np.savetxt(made.folder / "skin.csv", [[k, *at] for k, at in nodes.items()], "%d %.17g %.17g %.17g")
        save_npz(made.folder / "otm.npz", csr_array(made.all_of_it))
        more += ', recovery = "otm.npz", recovery_nodes = "skin.csv"'
    run = given(made, "beam.mtx", more, MOVES)
    (made.folder / "whole.toml").write_text(BEAM + MOVES)
    whole = scene(made.folder / "whole.toml")
    deflection = np.abs(whole.motion.tip_deflection).max()
    assert deflection > 1e-4
    assert np.abs(run.motion.tip_position - whole.motion.tip_position).max() < within * deflection
    (note,) = run.parts["beam"].mesh_notes
    assert ("of 16 of 16 shapes from 106 points" if recovered else "shapes from 2 points") in note


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda K, M: (K + np.diag([1.0] + 21 * [0.0]), M), "isn't free: .*reduce it without supports"),
        (lambda K, M: (np.triu(K), M), "the stiffness isn't symmetric"),
        (lambda K, M: (K, M - 0.2 * np.diag([M[0, 0]] + 21 * [0.0])), "and its moments are none of a body's"),
        (lambda K, M: (K, 0 * M), "all entries of the mass matrix are zero"),
        (lambda K, M: (K, -M), "no mass matrix: moved as a whole the body has -0.17 kg"),
        (lambda K, M: (K, 1e6 * M), "are of no matter"),
    ],
)
def test_a_fault_of_the_matrices_is_named(made: Made, change, message: str):
    from fmd.reduction.given_superelement import GivenSuperelement
    from fmd.reduction.superelement_data import superelement_data

    K, M = change(made.K, made.M)
    element = GivenSuperelement(UNKNOWNS, K, M, 0 * K, made.places).in_si(1e-3, 1e3, 1e3)
    with pytest.raises(AccuracyError, match=message):
        superelement_data(Path("x"), element)


@pytest.mark.parametrize("held", ["one node", "two near nodes"])
def test_few_nodes_tell_a_body_that_their_unknowns_move_as_a_whole(made: Made, held: str):
    """The same matrices by other coordinates: tip less what the root carries along, and a node near the root."""
    from fmd.core.rotations import rigid_motions
    from fmd.reduction.given_superelement import GivenSuperelement
    from fmd.reduction.superelement_data import superelement_data

    T = np.eye(len(UNKNOWNS))  # new coordinates by the given ones
    T[6:9, :6] = -rigid_motions((made.places[3] - made.places[7])[None])[0]
    T[9:12, 3:6] = -np.eye(3)
    unknowns, places = [(7, c) for c in range(1, 7)] + [(100 + k, 0) for k in range(16)], {7: made.places[7]}
    if held == "two near nodes":
        node = int(np.argmin(np.linalg.norm(made.x - made.places[7] - [42.5, 12.5, 5.0], axis=1)))
        T[6:9], places[8] = made.all_of_it[3 * node : 3 * node + 3], made.x[node]
        unknowns[6:9] = [(8, c) for c in (1, 2, 3)]
    heavy = 100.0  # as dense as nothing is if the body were no larger than its nodes are apart
    back = np.linalg.inv(T)
    K, M = (heavy * back.T @ A @ back for A in (made.K, made.M))
    data = superelement_data(Path("x"), GivenSuperelement(tuple(unknowns), K, M, 0 * K, places).in_si(1e-3, 1e3, 1e3))
    omega = np.sqrt(la.eigh(made.K, made.M, eigvals_only=True)[6:])
    assert np.sqrt(data.K.diagonal()) == pytest.approx(omega, rel=1e-6)
    assert data.integrals.mass == pytest.approx(heavy * made.mass, rel=1e-8)


@pytest.mark.parametrize(
    ("places", "message"),
    [
        (
            np.outer(range(4), [1.0, 2.0, 2.0]),
            r"no body has moments of inertia of \S+, 45, 45 kg m² .*on one line perhaps",
        ),
        (np.zeros((4, 3)), "4 nodes at one place tell no rotation of the body"),
    ],
)
def test_nodes_that_tell_no_rotation_are_refused(places: Array, message: str):
    """Masses of 1 kg, three units of length apart: 9 · (2 · 1.5² + 2 · 0.5²) kg m² across their line."""
    from fmd.reduction.given_superelement import GivenSuperelement
    from fmd.reduction.superelement_data import superelement_data

    unknowns = tuple((node, c) for node in range(4) for c in (1, 2, 3))
    K = np.kron(4 * np.eye(4) - 1, np.eye(3))
    with pytest.raises(AccuracyError, match=message):
        superelement_data(Path("x"), GivenSuperelement(unknowns, K, np.eye(12), 0 * K, dict(enumerate(places))))


@pytest.mark.parametrize("component", [0, 8, 11])
def test_components_of_placed_nodes_that_are_no_motion_are_refused(made: Made, component: int):
    lines = (made.folder / "beam.mtx").read_text().replace("\n1,2,3,4,5,6\n", f"\n1,2,3,4,5,{component}\n")
    (made.folder / "odd.mtx").write_text(lines)
    with pytest.raises(InputError, match=f"node 7 has component {component}; 1 to 3 are displacements, 4 to 6 rot"):
        given(made, "odd.mtx", ', nodes = "nodes.csv"').parts["beam"].fe  # noqa: B018


def test_rows_of_points_within_may_be_in_axes_of_their_own(made: Made):
    """Nastran's OTM is in each point's CD, which GRDSET may set for all."""
    Q = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()
    at = ",".join(f"{x:.17g}" for x in [0, 0, 0, *Q[:, 2]])
    points, cards = dict(enumerate(made.x[::9], start=1001)), [f"CORD2R,5,,{at}"]
    cards += ["," + ",".join(f"{x:.17g}" for x in Q[:, 0]), "GRDSET,,,,,,5"]
    own = made.all_of_it.reshape(len(made.x), 3, -1)[::9].copy()
    for k, (label, x) in enumerate(points.items()):
        cards.append(f"GRID,{label},," + ",".join(map(repr, x.tolist())) + (",0" if k % 2 else ""))
        own[k] = own[k] if k % 2 else Q.T @ own[k]
    (made.folder / "within.bdf").write_text("\n".join(cards))
    save_npz(made.folder / "turned.npz", csr_array(own.reshape(-1, own.shape[2])))
    save_npz(
        made.folder / "plain.npz", csr_array(made.all_of_it.reshape(len(made.x), -1)[::9].reshape(-1, own.shape[2]))
    )
    np.savetxt(made.folder / "within.csv", [[k, *x] for k, x in points.items()], "%d %.17g %.17g %.17g")
    files = (("turned.npz", "within.bdf"), ("plain.npz", "within.csv"))
    turned, plain = (
        given(made, "beam.mtx", f', nodes = "nodes.csv", recovery = "{rows}", recovery_nodes = "{nodes}"').parts["beam"]
        for rows, nodes in files
    )
    for label in map(str, points):
        shapes = [part.given_model.data.nodes[label].translation for part in (turned, plain)]
        assert shapes[0] == pytest.approx(shapes[1], abs=1e-12 * np.abs(shapes[1]).max())


@pytest.mark.parametrize(
    ("file", "more", "message"),
    [
        ("beam.mtx", "", "no unknown is of a node with a place; name a file of nodes by body.nodes"),
        ("beam.mtx", ', nodes = "nodes.csv", mass = "1 kg"', r"has 0\.17 kg, and body\.mass is 1 kg"),
        ("light.mtx", "", r"has no \*MATRIX,TYPE=MASS; .*CalculiX writes the stiffness alone"),
        ("short.mtx", "", "TYPE=STIFFNESS has 252 numbers; one half of 22 rows has 253"),
        ("whole.op4", "", r"matrix KGG has 300000 rows, and a superelement has at most 10000; .*`matrices =`"),
        ("beam.mtx", RECOVERED.replace("otm.mtx", "empty.op4"), "can't be read as a matrix: it holds no real matrix"),
        ("empty.pch", "", "one matrix K… and one M… are wanted among its real ones, which are none"),
        ("beam.pch", ', nodes = "turned.bdf"', "coordinate system 4 isn't there"),
        ("beam.mtx", RECOVERED, "2 points have three rows each"),
        ("beam.mtx", ', recovery = "otm.mtx"', "recovery_nodes: is missing: recovery and recovery_nodes belong"),
        ("beam.SID_FEM", "", "belongs to superelements"),
    ],
)
def test_what_a_file_lacks_is_said(made: Made, file: str, more: str, message: str):
    write_substructure(made, "light.mtx", made.K, None)
    lines = (made.folder / "beam.mtx").read_text().splitlines()
    first = lines.index("*MATRIX,TYPE=STIFFNESS") + 1
    lines[first] = lines[first].split(",", 1)[1]
    (made.folder / "short.mtx").write_text("\n".join(lines))
    (made.folder / "empty.pch").write_text("BEGIN BULK\n")
    (made.folder / "empty.op4").write_text("")
    huge = (
        f"{300_000:8d}{300_000:8d}{6:8d}{2:8d}{name:8s}1P,3E23.16\n{300_001:8d}{1:8d}{1:8d}\n 1.0\n"
        for name in ("KGG", "MGG")
    )
    (made.folder / "whole.op4").write_text("".join(huge))
    (made.folder / "turned.bdf").write_text("GRID,7,,0.,0.,0.,4\n")
    (made.folder / "otm.mtx").write_text("%%MatrixMarket matrix coordinate real general\n3 22 1\n1 1 1.0\n")
    (made.folder / "beam.SID_FEM").write_text("part\n")
    with pytest.raises((InputError, AccuracyError), match=message):
        given(made, file, more).parts["beam"].fe  # noqa: B018


def test_what_it_cannot_give_is_refused_by_name(made: Made):
    part = given(made, "beam.mtx", ', nodes = "nodes.csv"').parts["beam"]
    assert not part.has_stress
    with pytest.raises(InputError, match="without elements it has no mesh, no stress and no picture"):
        part.mesh  # noqa: B018


def test_a_superelement_in_an_unusual_unit_is_warned_of(made: Made):
    run = given(made, "beam.pch", ', nodes = "nodes.csv"')
    (made.folder / "slow.toml").write_text(
        (made.folder / Path(run.scene.file).name).read_text().replace("N/mm", "nN/mm")
    )
    texts = [[each["text"] for each in mode_warnings(own)] for own in (run, scene(made.folder / "slow.toml"))]
    assert not texts[0]
    assert [text[:34] for text in texts[1]] == ["beam: its lowest frequency is 0.00"]
