"""Exudyn's files: integrals against sums over points and against Exudyn's own, files that come back, bad files."""

from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from fmd.core.errors import InputError
from fmd.reduction.formats.exudyn_file import exudyn_arrays, read_exudyn, write_exudyn
from tests.reduction.formats.bodies_of_points import N_MODES, point_body

BODY = point_body()
INTEGRALS = (
    "massMatrixReduced", "inertiaLocal", "Mtt", "chiU", "chiUtilde", "mPsiTildePsi", "mPsiTildePsiTilde", "mPhitTPsi",
    "mPhitTPsiTilde", "mXRefTildePsi", "mXRefTildePsiTilde",
)  # fmt: skip


def tilde(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


@pytest.fixture
def file(tmp_path: Path) -> Path:
    write_exudyn(tmp_path / "body.npz", exudyn_arrays(BODY.data, BODY.x, BODY.Phi))
    return tmp_path / "body.npz"


def test_integrals_are_sums_over_the_points():
    found = exudyn_arrays(BODY.data, BODY.x, BODY.Phi)
    points = list(zip(BODY.m, BODY.x, BODY.Phi, strict=True))

    def blocks(phi):
        return np.hstack([tilde(phi[:, j]) for j in range(N_MODES)])

    want = {
        "inertiaLocal": sum(m * tilde(x).T @ tilde(x) for m, x, _ in points),
        "mPsiTildePsi": sum(m * blocks(phi).T @ phi for m, _, phi in points),
        "mPsiTildePsiTilde": sum(m * blocks(phi).T @ blocks(phi) for m, _, phi in points),
        "mPhitTPsi": sum(m * phi for m, _, phi in points),
        "mPhitTPsiTilde": sum(m * blocks(phi) for m, _, phi in points),
        "mXRefTildePsi": sum(m * tilde(x).T @ phi for m, x, phi in points),
        "mXRefTildePsiTilde": sum(m * tilde(x).T @ blocks(phi) for m, x, phi in points),
        "massMatrixReduced": sum(m * phi.T @ phi for m, _, phi in points),
        "chiU": sum(m * x for m, x, _ in points) / BODY.m.sum(),
    }
    for name, value in want.items():
        assert np.abs(found[name] - value).max() < 1e-13 * np.abs(value).max(), name


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_exudyn_computes_the_same_integrals_and_loads_the_file(file: Path, capsys):
    FEM = pytest.importorskip("exudyn.FEM")
    fem = FEM.FEMinterface()
    fem.nodes = {"Position": BODY.x}
    fem.massMatrix = sp.csr_matrix(np.diag(np.repeat(BODY.m, 3)))
    fem.stiffnessMatrix = sp.csr_matrix((3 * len(BODY.x), 3 * len(BODY.x)))
    fem.modeBasis = {"matrix": BODY.Phi.reshape(-1, N_MODES), "type": "NormalModes"}
    theirs = FEM.ObjectFFRFreducedOrderInterface(fem, "NodeType.RotationEulerParameters", 0, 0)
    loaded = FEM.ObjectFFRFreducedOrderInterface(None)
    loaded.LoadFromFile(str(file))
    for name in INTEGRALS:
        want, found = getattr(theirs, name), getattr(loaded, name)
        want = want.toarray() if sp.issparse(want) else np.asarray(want)
        assert np.abs(found - want).max() < 1e-13 * np.abs(want).max(), name
    theirs.SaveToFile(str(file.with_name("theirs.npz")))
    back = read_exudyn(file.with_name("theirs.npz"))
    assert np.abs(back.integrals.G - BODY.integrals.G).max() < 1e-12 * np.abs(BODY.integrals.G).max()
    assert len(back.nodes) == len(BODY.x)
    assert loaded.nModes == N_MODES
    assert loaded.nNodes == len(BODY.x) + 8


def test_a_file_brings_the_body_back(file: Path):
    data, back = BODY.data, read_exudyn(file)
    assert np.abs(back.integrals.G - data.integrals.G).max() < 1e-12 * np.abs(data.integrals.G).max()
    assert np.abs(back.integrals.S - data.integrals.S).max() < 1e-12 * np.abs(data.integrals.S).max()
    assert np.array_equal(back.K, data.K)
    assert np.array_equal(back.D, data.D)
    for name, want in data.nodes.items():
        for key in ("position", "translation", "rotation"):
            assert np.abs(getattr(back.nodes[name], key) - getattr(want, key)).max() < 1e-12, key
    assert np.isnan(back.nodes["7"].rotation).all()
    assert back.notes == ()


def test_pickled_objects_in_a_file_are_not_loaded(file: Path):
    arrays = exudyn_arrays(BODY.data, BODY.x, BODY.Phi)
    np.savez(file, **{**arrays, "postProcessingModes": _Exploding()})
    assert read_exudyn(file).n == N_MODES
    np.savez(file, **{**arrays, "mPhitTPsi": _Exploding()})
    with pytest.raises(InputError, match="damaged: Object arrays cannot be loaded"):
        read_exudyn(file)


class _Exploding:
    def __reduce__(self):
        return _explode, ()


def _explode():
    raise AssertionError("a pickled object was loaded")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"totalMass": None}, "has no 'totalMass'"),
        ({"mPhitTPsi": np.zeros((2, 3))}, r"'mPhitTPsi' has shape \(2, 3\), expected \(3, 3\)"),
        ({"inertiaLocal": np.full((3, 3), np.nan)}, "'inertiaLocal' has shape .* all of it finite"),
        ({"xRef": np.zeros(7)}, "'modeBasis' has shape"),
    ],
)
def test_a_bad_file_is_refused(file: Path, change, message: str):
    arrays = exudyn_arrays(BODY.data, BODY.x, BODY.Phi) | change
    np.savez(file, **{name: value for name, value in arrays.items() if value is not None})
    with pytest.raises(InputError, match=message):
        read_exudyn(file)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 no archive", b"text"])
def test_what_is_no_archive_is_refused(tmp_path: Path, content: bytes):
    (tmp_path / "x.npz").write_bytes(content)
    with pytest.raises(InputError, match="or damaged"):
        read_exudyn(tmp_path / "x.npz")
