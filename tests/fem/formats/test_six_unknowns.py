"""Matrices with rotations: frames of beams by their textbook matrices, lumped masses, a disc on a spinning shaft."""

from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.linalg import eigh

import fmd
from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError, InputError
from fmd.core.rotations import rigid_motions
from fmd.fem.formats.matrices import node_marker, read_matrices
from fmd.fem.formats.six_unknowns import six_unknowns_model
from fmd.output.frequencies import mode_warnings
from fmd.reduction.eigen import FreeBodySolver

E, NU, RHO, SIDE = 70e9, 0.3, 2700.0, 0.02
SI = (1.0, 1.0, 1.0)


def beam(x: Array, ends: tuple[int, int], K: Array, M: Array) -> None:
    """Add an Euler–Bernoulli beam of a square section with consistent masses (Przemieniecki 1968)."""
    a, b = x[list(ends)]
    length = float(np.linalg.norm(b - a))
    e1 = (b - a) / length
    e2 = np.cross([0.3, 0.5, -0.9], e1)
    e2 /= np.linalg.norm(e2)
    Q = np.array([e1, e2, np.cross(e1, e2)])
    A, inertia = SIDE**2, SIDE**4 / 12
    torsion, polar = 0.1406 * SIDE**4, SIDE**4 / 6
    k, m = np.zeros((12, 12)), np.zeros((12, 12))
    for i, stiffness, mass in ((0, E * A, RHO * A), (3, E / 2 / (1 + NU) * torsion, RHO * polar)):
        k[np.ix_([i, i + 6], [i, i + 6])] = stiffness / length * np.array([[1, -1], [-1, 1]])
        m[np.ix_([i, i + 6], [i, i + 6])] = mass * length / 6 * np.array([[2, 1], [1, 2]])
    for across, turned, sign in ((1, 5, 1.0), (2, 4, -1.0)):
        own = np.ix_([across, turned, across + 6, turned + 6], [across, turned, across + 6, turned + 6])
        s = np.diag([1.0, sign * length, 1.0, sign * length])
        bending = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
        k[own] = E * inertia / length**3 * s @ bending @ s
        masses = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]])
        m[own] = RHO * A * length / 420 * s @ masses @ s
    turn = np.kron(np.eye(4), Q)
    dofs = (6 * np.array(ends)[:, None] + np.arange(6)).ravel()
    K[np.ix_(dofs, dofs)] += turn.T @ k @ turn
    M[np.ix_(dofs, dofs)] += turn.T @ m @ turn


def frame(seed: int = 3, n: int = 16, chord: bool = True) -> tuple[Array, Array, Array]:
    """Return positions and matrices of a frame of beams whose nodes lie on a helix with noise."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0, 2 * np.pi, n)
    x = np.stack([0.3 * np.cos(s), 0.3 * np.sin(s), 0.1 * s], axis=1) + 0.01 * rng.standard_normal((n, 3))
    K, M = np.zeros((6 * n, 6 * n)), np.zeros((6 * n, 6 * n))
    for k in range(n - 1):
        beam(x, (k, k + 1), K, M)
    if chord:
        beam(x, (0, n // 2), K, M)
    return x, K, M


def lumped(x: Array, seed: int = 5) -> Array:
    """Return masses of rigid bodies on nodes, each with its own centre and inertia."""
    rng = np.random.default_rng(seed)
    M = np.zeros((6 * len(x), 6 * len(x)))
    for k in range(len(x)):
        m, c, W = rng.uniform(0.1, 0.3), 0.02 * rng.standard_normal(3), 0.01 * rng.standard_normal((3, 3))
        G = rigid_motions(c[None])[0]
        J = np.zeros((6, 6))
        J[3:, 3:] = np.trace(W @ W.T) * np.eye(3) - W @ W.T
        M[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] = m * G.T @ G + m * J
    return M


def write(path: Path, x: Array, K: Array, M: Array, length: float = 1.0) -> tuple[Path, Path, Path]:
    arm = np.tile(np.repeat([1.0, 1.0 / length], 3), len(x))
    files = path / "K.npz", path / "M.npz", path / "nodes.csv"
    for file, A in zip(files, (K, M), strict=False):
        sp.save_npz(file, sp.csr_array(arm[:, None] * A * arm))
    np.savetxt(files[2], np.c_[100 + np.arange(len(x)), x / length], delimiter=",")
    return files


def exact(K: Array, M: Array, count: int = 10) -> Array:
    return np.sqrt(np.maximum(eigh(K, M, eigvals_only=True)[: count + 6], 0.0))[6:]


def test_lumped_masses_of_every_kind_give_the_matrices_own_frequencies(tmp_path: Path) -> None:
    x, K, _ = frame()
    M = lumped(x)
    model = read_matrices(*write(tmp_path, x, K, M, 1e-3), (1e-3, 1.0, 1.0), 6)
    pairs = FreeBodySolver(model).modes(10)
    assert pairs.n_rigid == 6
    assert pairs.omega == pytest.approx(exact(K, M), rel=1e-7)
    assert np.abs(model.frequency_changes(pairs.shapes)).max() < 1e-9


def test_inertia_is_that_of_the_matrix_and_what_lumping_costs_is_said_to_first_order(tmp_path: Path) -> None:
    x, K, M = frame(n=32, chord=False)
    model = read_matrices(*write(tmp_path, x, K, M), SI, 6)
    R6 = np.zeros((6 * len(x), 6))
    R6.reshape(-1, 6, 6)[:, :3] = rigid_motions(x)
    R6.reshape(-1, 6, 6)[:, 3:, 3:] = np.eye(3)
    given, found = (
        R6.T @ M @ R6,
        rigid_motions(model.x).reshape(-1, 6).T @ model.M @ rigid_motions(model.x).reshape(-1, 6),
    )
    assert np.abs(found - given).max() < 1e-9 * np.abs(given).max()
    pairs = FreeBodySolver(model).modes(6)
    off = pairs.omega / exact(K, M, 6) - 1
    said = model.frequency_changes(pairs.shapes)
    assert 1e-4 < np.abs(off).max() < 0.05
    assert said == pytest.approx(off, rel=0.15, abs=2e-5)


def test_a_node_with_rotations_is_a_whole_marker_by_itself(tmp_path: Path) -> None:
    x, K, M = frame()
    model = read_matrices(*write(tmp_path, x, K, M), SI, 6)
    pairs = FreeBodySolver(model).modes(6)
    marker = node_marker(model, np.array([105]))
    y = model.shown @ pairs.shapes.reshape(-1, 6)  # type: ignore[attr-defined]
    assert marker.position == pytest.approx(x[5])
    assert marker.translation(pairs.shapes) == pytest.approx(y[15:18], abs=1e-12)
    assert marker.rotation(pairs.shapes) == pytest.approx(y[3 * (len(x) + 5) : 3 * (len(x) + 6)], abs=1e-12)


def test_a_node_that_turns_without_stiffness_is_named(tmp_path: Path) -> None:
    """Two nodes in frictionless bearings, about one axis and about all."""
    x, K, _ = frame()
    for unknown in (6 * 5 + 3, 6 * 9 + 3, 6 * 9 + 4, 6 * 9 + 5):
        K = K - np.outer(K[:, unknown], K[unknown]) / K[unknown, unknown]
        K[unknown], K[:, unknown] = 0.0, 0.0
    model = read_matrices(*write(tmp_path, x, K, lumped(x)), SI, 6)
    with pytest.raises(AccuracyError, match=r"turns freely beside the rest: node 10[59], node 10[59]$"):
        FreeBodySolver(model).modes(10)


def test_solids_among_them_keep_their_masses_as_they_are(small_bar: object) -> None:
    """Nodes without rotations: the model has the points and the masses of the solid alone."""
    bar = small_bar
    n = len(bar.x)  # type: ignore[attr-defined]
    six = (6 * np.arange(n)[:, None] + np.arange(3)).ravel()
    big = sp.csr_array((np.ones(3 * n), (six, np.arange(3 * n))), shape=(6 * n, 3 * n))
    K, M = (sp.csr_array(big @ A @ big.T) for A in (bar.K, bar.M))  # type: ignore[attr-defined]
    model = six_unknowns_model(Path("M"), K, M, bar.x, np.arange(n))  # type: ignore[attr-defined]
    assert len(model.x) == n
    assert abs(model.m - bar.m).max() < 1e-14 * bar.m.max()  # type: ignore[attr-defined]
    assert model.arms is None


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ("grounded", AccuracyError, "the body isn't free"),
        ("degrees", AccuracyError, "isn't free|differ by"),
        ("one way", AccuracyError, r"mass and inertia of the whole differ by \S+ from those of rigid bodies"),
        ("half the rows", InputError, "has 93 rows and 93 columns; 16 nodes have 96 displacements and rotations"),
    ],
)
def test_faults_are_named(tmp_path: Path, change: str, error: type[Exception], message: str) -> None:
    x, K, M = frame()
    match change:
        case "grounded":
            K[27, 27] += 1e5
        case "degrees":
            d = np.tile(np.repeat([1.0, np.pi / 180], 3), len(x))
            K, M = d[:, None] * K * d, d[:, None] * M * d
        case "one way":
            M[12, 12] += 0.5
        case _:
            K = K[:93, :93]
    files = write(tmp_path, x, K if len(K) == 96 else np.eye(96), M)
    if len(K) < 96:
        sp.save_npz(files[0], sp.csr_array(K))
    with pytest.raises(error, match=message):
        read_matrices(*files, SI, 6)


def test_three_unknowns_of_a_file_with_six_tell_what_to_say(tmp_path: Path) -> None:
    files = write(tmp_path, *frame())
    with pytest.raises(InputError, match=r"twice as many: with rotations say matrices\.unknowns = 6"):
        read_matrices(*files, SI)


def test_rows_of_abaqus_with_directions_to_six_are_read(tmp_path: Path) -> None:
    x, K, M = frame()
    files = write(tmp_path, x, K, M)
    for name, A in (("K.mtx", K), ("M.mtx", M)):
        rows = sp.coo_array(sp.tril(sp.csr_array(A)))
        lines = [
            f"{100 + i // 6},{i % 6 + 1},{100 + j // 6},{j % 6 + 1},{value!r}"
            for i, j, value in zip(*rows.coords, rows.data.tolist(), strict=True)
        ]
        (tmp_path / name).write_text("\n".join(lines))
    found = read_matrices(tmp_path / "K.mtx", tmp_path / "M.mtx", files[2], SI, 6)
    wanted = read_matrices(*files, SI, 6)
    assert found.T is not None
    assert wanted.T is not None
    for A in ("K", "M"):  # of arms only what they show is the same
        one, other = (each.T.T @ getattr(each, A) @ each.T for each in (found, wanted))
        assert abs(one - other).max() < 1e-9 * abs(other).max()
    assert abs(wanted.T.T @ wanted.K @ wanted.T).max() == pytest.approx(np.abs(K).max(), rel=1e-9)


def test_a_scene_has_the_body_with_its_inertia_and_warns_of_lumped_masses(tmp_path: Path) -> None:
    x, K, M = frame(n=32, chord=False)
    stiffness, mass, nodes = map(str, write(tmp_path, x, K, M))
    files = {"stiffness": stiffness, "mass": mass, "nodes": nodes, "unit": "m", "unknowns": 6}
    markers = {"root": {"nodes": [100]}, "tip": {"nodes": [131]}}
    table = {
        "title": "Frame on a hinge",
        "body": {"frame": {"matrices": files, "modes": {"count": 6}, "marker": markers}},
        "joint": {"hinge": {"type": "revolute", "parent": "ground", "child": "frame.root", "axis": [0, 1, 0]}},
        "simulation": {
            "duration": "10 ms",
            "output_step": "1 ms",
            "gravity": ["0 m/s^2", "0 m/s^2", "-9.81 m/s^2"],
            "tip": "frame.tip",
            "stiffening": "off",
            "run": [{"integrator": "runge-kutta"}],
        },
    }
    result = fmd.load(table)
    turn = np.zeros(6 * len(x))
    turn.reshape(-1, 6)[:, :3], turn.reshape(-1, 6)[:, 4] = np.cross([0.0, 1.0, 0.0], x - x[0]), 1.0
    assert result.body.inertia_about_joint == pytest.approx(turn @ M @ turn, rel=1e-9)
    (text,) = (each["text"] for each in mode_warnings(result.run) if each["code"] == "masses-lumped")
    assert "changes a frequency of its modes by about" in text
    path = np.asarray(result.motion.tip_position)
    assert 1e-5 < np.linalg.norm(path[-1] - path[0]) < 1e-2  # it falls freely by 0.5 mm in 10 ms


def test_a_fixed_joint_on_several_nodes_holds_their_rotations_if_it_is_rigid(tmp_path: Path) -> None:
    x, K, _ = frame(n=8)
    stiffness, mass, nodes = map(str, write(tmp_path, x, K, lumped(x)))
    files = {"stiffness": stiffness, "mass": mass, "nodes": nodes, "unit": "m", "unknowns": 6}
    feet = [100, 104, 107]
    table = {
        "title": "Frame on three feet",
        "body": {
            "frame": {
                "matrices": files,
                "modes": {"count": 4, "boundary": "joint"},
                "marker": {"feet": {"nodes": feet, "attachment": "rigid"}, "tip": {"nodes": [102]}},
            }
        },
        "joint": {"hub": {"type": "fixed", "parent": "ground", "child": "frame.feet"}},
        "simulation": {
            "duration": "1 ms",
            "output_step": "1 ms",
            "tip": "frame.tip",
            "run": [{"integrator": "runge-kutta"}],
        },
    }
    free = np.setdiff1d(np.arange(48), np.concatenate([6 * (k - 100) + np.arange(6) for k in feet]))
    omega2 = eigh(K[np.ix_(free, free)], lumped(x)[np.ix_(free, free)], eigvals_only=True, subset_by_index=[0, 3])
    assert fmd.load(table).modes.frequencies_hz == pytest.approx(np.sqrt(omega2) / (2 * np.pi), rel=1e-7)
    del table["body"]["frame"]["marker"]["feet"]["attachment"]  # type: ignore[index]
    assert fmd.load(table).modes.frequencies_hz[0] < 0.9 * np.sqrt(omega2[0]) / (2 * np.pi)
