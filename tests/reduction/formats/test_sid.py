"""Standard input data: against sums over points and quadrature over elements, and files in both dialects."""

import re
from pathlib import Path

import numpy as np
import pytest
import skfem

from fmd.core.errors import InputError
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.links import Link
from fmd.dynamics.mechanism import Mechanism
from fmd.fem.assembly import assemble
from fmd.integrators.protocol import evaluate
from fmd.reduction.formats.sid_file import read_sid, write_sid
from fmd.reduction.formats.sid_terms import Taylor, modal_data_of, sid_terms
from fmd.reduction.inertia import inertia_integrals
from fmd.reduction.modal_data import ModalData
from fmd.scene.joints.free import FREE
from tests.reduction.formats.bodies_of_points import N_MODES, point_body, stiffened

BODY = point_body()


def tilde(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def equations_of_motion(mass, terms, q, rates, spin):
    """Mass matrix (6 + n, 6 + n), and what stands beside it on the left, (6 + n,), from SID's terms as published."""
    at = {name: term.at(q) for name, term in terms.items()}
    J = at["J"] if at["J"].shape == (3, 3) else at["J"][np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]]), 0]
    n, c, W = len(q), at["mdCM"][:, 0], tilde(spin)
    M = np.zeros((6 + n, 6 + n))
    M[:3, :3], M[3:6, 3:6], M[6:, 6:] = mass * np.eye(3), J, at["Me"]
    M[3:6, :3], M[:3, 3:6] = tilde(c), -tilde(c)
    M[6:, :3], M[6:, 3:6] = at["Ct"], at["Cr"]
    M[:3, 6:], M[3:6, 6:] = at["Ct"].T, at["Cr"].T
    rotation = np.einsum("ajb,j,b->a", at["Gr"].reshape(3, n, 3), rates, spin)
    modal = np.einsum("ijb,j,b->i", at["Ge"].reshape(n, n, 3), rates, spin)
    x, y, z = spin
    modal += at["Oe"] @ np.array([x * x, y * y, z * z, x * y, y * z, x * z])
    modal += at["Ke"] @ q + at["De"] @ rates
    translation = W @ W @ c + 2 * W @ at["Ct"].T @ rates
    return M, np.concatenate([translation, W @ J @ spin + rotation, modal])


def test_terms_are_the_integrals_over_a_part_of_tetrahedra(box_mesh, steel):
    """Each term from its definition, by scikit-fem's quadrature of order 8 over tet10."""
    fe = assemble(box_mesh("tetra", (2, 2, 2), (1.2, 1.0, 0.8), 0.2), 2, steel)
    Phi = np.random.default_rng(0).standard_normal((len(fe.x), 3, 2))
    n, space = 2, fe.discretisation
    basis = skfem.Basis(space.skfem_mesh, skfem.ElementVector(space.kind.element), intorder=8)
    phi = [np.asarray(basis.interpolate(Phi[..., k].ravel())).reshape(3, -1).T for k in range(n)]
    r = np.asarray(basis.global_coordinates()).reshape(3, -1).T
    dm = steel.rho * basis.dx.ravel()
    integrals = inertia_integrals(fe.x, fe.m, Phi)
    terms = sid_terms(ModalData(integrals, np.eye(n), np.zeros((n, n)), {}))

    def integral(values):
        return np.tensordot(dm, values, axes=1)

    def products(a, b):  # ã b̃ at the points
        return np.array([tilde(u) @ tilde(w) for u, w in zip(a, b, strict=True)])

    rates = [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)]

    def centrifugal(a, b):  # a · (ω̃ω̃ b) by products of rates
        return [(a[:, i] * b[:, j] + (i != j) * a[:, j] * b[:, i]) - (i == j) * (a * b).sum(axis=1) for i, j in rates]

    zero = np.zeros((n, n, 3))
    want0 = {
        "mdCM": integral(r)[:, None],
        "J": -integral(products(r, r)),
        "Ct": np.array([integral(f) for f in phi]),
        "Cr": np.array([integral(np.cross(r, f)) for f in phi]),
        "Me": np.array([[integral((f * g).sum(axis=1)) for g in phi] for f in phi]),
        "Gr": np.hstack([-2 * integral(products(r, f)) for f in phi]),
        "Ge": np.hstack([2 * np.array([integral(np.cross(g, f)) for f in phi]) for g in phi]),
        "Oe": np.array([[integral(c) for c in centrifugal(f, r)] for f in phi]),
    }
    want1 = {
        "mdCM": np.array([integral(f) for f in phi]).T[:, :, None],
        "J": np.stack([-integral(products(r, f) + products(f, r)) for f in phi], axis=1),
        "Ct": zero,
        "Cr": np.array([[integral(np.cross(g, f)) for g in phi] for f in phi]),
        "Gr": np.stack([np.hstack([-2 * integral(products(g, f)) for f in phi]) for g in phi], axis=1),
        "Oe": np.array([[[integral(c) for c in centrifugal(f, g)] for g in phi] for f in phi]),
    }
    for name, want in want0.items():
        assert np.abs(terms[name].M0 - want).max() < 1e-12 * np.abs(want).max(), name
    for name, want in want1.items():
        found = terms[name].M1
        assert np.abs(found - want).max() <= 1e-12 * max(np.abs(want).max(), 1e-300), name
    assert [name for name in want0 if name not in want1] == ["Me", "Ge"]
    assert not terms["Me"].order + terms["Ge"].order


def test_the_equations_are_those_of_the_points_to_first_order():
    terms, rng = sid_terms(BODY.data), np.random.default_rng(1)
    spin, q, v = rng.standard_normal(3), rng.standard_normal(N_MODES), rng.standard_normal(N_MODES)
    errors = []
    for size in (1e-3, 5e-4):
        M, forces = equations_of_motion(BODY.integrals.mass, terms, size * q, size * v, spin)
        forces[6:] -= BODY.data.K @ q * size + BODY.data.D @ v * size
        want = BODY.inertia_forces(size * q, size * v, spin)
        exact = BODY.integrals.mass_matrix(np.r_[1.0, size * q])
        errors.append([np.abs(forces - want).max(), np.abs(M - exact).max()])
    assert max(errors[0]) < 1e-3
    assert np.array(errors[0]) / errors[1] == pytest.approx(4.0, rel=1e-2)


def test_a_floating_body_accelerates_as_the_compiled_one_to_first_order():
    """With geometric stiffening, in mean axes, where the modal mass that SID leaves out is of second order."""
    turns = np.cross(np.eye(3), BODY.x[:, None]).swapaxes(1, 2)
    R = np.concatenate([np.tile(np.eye(3), (len(BODY.x), 1, 1)), turns], axis=2)
    rigid = R.reshape(-1, 6)
    weighted = np.repeat(BODY.m, 3)[:, None] * rigid
    elastic = BODY.Phi.reshape(-1, N_MODES)
    elastic = elastic - rigid @ np.linalg.solve(weighted.T @ rigid, weighted.T @ elastic)
    values, turn = np.linalg.eigh(elastic.T @ (np.repeat(BODY.m, 3)[:, None] * elastic))
    Phi = (elastic @ (turn / np.sqrt(values))).reshape(BODY.Phi.shape)
    omega = np.array([3.0, 5.0, 8.0])
    plain = ModalData(inertia_integrals(BODY.x, np.diag(BODY.m), Phi), np.diag(omega**2), np.zeros((3, 3)), {})
    data = stiffened(plain)
    link = Link("body", data.integrals, FREE, omega=omega, damping=np.zeros(3), markers={})
    system = CompiledSystem(Mechanism((link,)))
    rng = np.random.default_rng(2)
    spin, q, v = rng.standard_normal(3), rng.standard_normal(3), rng.standard_normal(3)
    terms, errors = sid_terms(data), []
    for size in (1e-3, 5e-4):
        state, rates, found = np.zeros(system.n_positions), np.zeros(system.n), np.zeros(system.n)
        state[6], state[7:] = 1.0, size * q  # a quaternion, scalar last, before the modes
        rates[3:6], rates[6:] = spin, size * v
        evaluate(system.parameters, 0.0, state, rates, found)
        M, forces = equations_of_motion(data.integrals.mass, terms, size * q, size * v, spin)
        errors.append(np.abs(found - np.linalg.solve(M, -forces)).max())
    assert errors[0] < 1e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)


def test_the_integrals_come_back_from_the_terms():
    data = stiffened(BODY.data)
    back = modal_data_of(data.integrals.mass, sid_terms(data), {})
    for name in ("G", "S", "stiffening", "displacement2", "rotation2"):
        want = getattr(data.integrals, name)
        assert np.abs(getattr(back.integrals, name) - want).max() < 1e-12 * np.abs(data.integrals.G).max(), name
    assert np.abs(back.M - data.M).max() < 1e-12
    assert back.notes == ()


def test_without_the_first_order_of_gr_only_the_sum_of_stiffening_is_known():
    data = stiffened(BODY.data)
    terms = sid_terms(data)
    terms["Gr"] = Taylor(terms["Gr"].M0)
    back = modal_data_of(data.integrals.mass, terms, {})
    trace, want = (np.einsum("aaij->ij", integrals.stiffening) for integrals in (back.integrals, data.integrals))
    assert np.abs(trace - want).max() < 1e-12 * np.abs(data.integrals.G).max()
    assert np.abs(back.integrals.G - data.integrals.G).max() < 1e-12 * np.abs(data.integrals.G).max()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "body.SID_FEM"
    write_sid(path, stiffened(BODY.data))
    return path


def in_the_other_dialect(text: str) -> str:
    """Nodes by ``new frame``, no line of counts, first orders as (row, column, mode), the inertia as a matrix."""
    head, rest = text.split("    J\n")
    inertia, rest = rest.split("    end J\n")
    places = {"1": "1,1", "2": "2,2", "3": "3,3", "4": "2,1", "5": "3,1", "6": "3,2"}
    for old, new in (("nrow = 6", "nrow = 3"), ("ncol = 1", "ncol = 3"), ("structure = 3", "structure = 2")):
        inertia = inertia.replace(old, new)
    inertia = re.sub(r"m0\( *(\d+), *\d+\)", lambda m: f"m0({places[m[1]]})", inertia)
    inertia = re.sub(r"m1\( *(\d+), *(\d+), *\d+\)", lambda m: f"m1({places[m[1]]},{m[2]})", inertia)
    others = [re.sub(r"m1\(( *\d+),( *\d+),( *\d+)\)", r"m1(\1,\3,\2)", one) for one in (head, rest)]
    whole = f"{others[0]}    J\n{inertia}    end J\n{others[1]}"
    return whole.partition("\n")[2].replace("    frame\n", "    new frame\n")


@pytest.mark.parametrize("dialect", ["frame", "new frame"])
def test_a_file_brings_the_body_back(file: Path, dialect: str):
    data = stiffened(BODY.data)
    if dialect == "new frame":
        file.write_text(in_the_other_dialect(file.read_text()))
    back = read_sid(file)
    assert np.abs(back.integrals.G - data.integrals.G).max() < 1e-12 * np.abs(data.integrals.G).max()
    assert np.array_equal(back.K, data.K)
    assert np.array_equal(back.D, data.D)
    assert np.array_equal(back.integrals.displacement2, data.integrals.displacement2)
    for node, want in zip(back.nodes.values(), data.nodes.values(), strict=True):
        for name in ("position", "translation", "rotation", "displacement2"):
            assert np.array_equal(getattr(node, name), getattr(want, name)), name
    assert list(back.nodes) == ["1", "2"]
    assert back.in_own_frame


def test_a_body_without_stiffening_fits_any_frame(tmp_path: Path):
    write_sid(tmp_path / "x.SID_FEM", BODY.data)
    assert not read_sid(tmp_path / "x.SID_FEM").in_own_frame


def test_columns_of_ge_may_go_by_axes(file: Path):
    """As they do in files of some writers of Modelica's library; Ge is antisymmetric in the modes, which tells."""
    terms = sid_terms(BODY.data)
    n = N_MODES
    text = file.read_text()
    start, end = text.index("    Ge\n"), text.index("    end Ge")
    by_axes = terms["Ge"].M0.reshape(n, n, 3).transpose(0, 2, 1).reshape(n, 3 * n)
    entries = "\n".join(f"m0({i + 1},{j + 1}) = {by_axes[i, j]:.17g}" for i, j in np.ndindex(n, 3 * n))
    head = text[start:end].partition("m0")[0]
    file.write_text(f"{text[:start]}{head}{entries}\n{text[end:]}")
    back = read_sid(file)
    want = stiffened(BODY.data).integrals.G
    assert np.abs(back.integrals.G - want).max() < 1e-12 * np.abs(want).max()


def test_what_contradicts_is_noted_and_not_taken(file: Path):
    text = file.read_text()
    start = text.index("    Gr\n")
    file.write_text(text[:start] + re.sub(r"m0\( +1, +1\) = .*", "m0(1,1) = 1.0D+06", text[start:], count=1))
    (note,) = read_sid(file).notes
    assert note.startswith("Gr is not what Oe and Cr give, by 1.0e+00 of its largest entry")


def changed(old: str, new: str):
    return lambda text: text.replace(old, new, 1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: "\n".join(text.splitlines()[:200]), "the file ends here, before 'end part'; it is cut off"),
        (lambda text: "", "no standard input data"),
        (lambda text: "\x00\xff" * 50, "no standard input data"),
        (changed("mass = ", "mass = x"), "line 5: 'x"),
        (changed("mass = ", "mess = "), "the body has no mass"),
        (changed("end phi", "end fi"), "'m0(…) = …' or 'end phi' expected, not 'end fi'"),
        (changed("nrow = 3", "nrow = three"), "line 16: 'three' is no whole number"),
        (changed("nrow = 3", "nrow = 2"), "origin has 2 x 1 entries of order 0, none there"),
        (changed("order = 1", "order = 2"), "origin is of order 2; terms to first order are read"),
        (changed("    mdCM\n", "    mdcm\n"), "'mdcm' is no term of SID; these are mdCM, J"),
        (changed("rframe = body ref", "rframe = node 3"), "nodes are read relative to 'body ref', not to 'node 3'"),
        (changed("new node = 2", "new node = 1"), "there are two nodes 1"),
        (lambda t: t[: t.index("    Ke\n")] + t[t.index("    De\n") :], "the body has no Ke"),
        (changed("m0(   1,   1) = ", "m0(   1,   1) = 1e999 "), "is no finite number"),
    ],
)
def test_a_bad_file_is_refused_in_one_line(file: Path, change, message: str):
    file.write_text(change(file.read_text()))
    with pytest.raises(InputError) as error:
        read_sid(file)
    assert message in str(error.value)
    assert str(error.value).startswith(str(file))
    assert "\n" not in str(error.value)


def test_a_file_that_is_not_there_is_refused(tmp_path: Path):
    with pytest.raises(InputError, match="can't be read: No such file"):
        read_sid(tmp_path / "none.SID_FEM")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_what_the_wind_turbine_library_writes_is_read(tmp_path: Path):
    """A tapered beam on end with two bending shapes each way, by the other dialect's best known writer."""
    sid = pytest.importorskip("welib.yams.sid")
    z = np.r_[0.0, (np.arange(20) + 0.5) * 2.5, 50.0]  # middles of equal elements, and both ends
    s = z / z[-1]
    U, dU, ddU = (np.zeros((2, 3, len(z))) for _ in range(3))
    U[0, 0], dU[0, 0], ddU[0, 0] = s**2, 2 * s / 50, np.full_like(s, 2 / 50**2)
    U[1, 1], dU[1, 1], ddU[1, 1] = s**3, 3 * s**2 / 50, 6 * s / 50**2
    line = np.zeros((3, len(z)))
    line[2] = z
    theirs = sid.BeamShapes2SID(line, z, 4000 - 2000 * s, np.full((3, len(z)), 1e10), U, dU, ddU, "OpenFAST")
    path = tmp_path / "beam.SID_FEM"
    path.write_text(str(theirs).replace("-0.000000", " 0.000000"))
    back = read_sid(path)
    assert back.notes == ()
    assert len(back.nodes) == 20
    found = sid_terms(back)
    for name in ("mdCM", "J", "Ct", "Cr", "Me", "Gr", "Ge", "Oe", "Ke"):
        want = getattr(theirs, name)
        assert np.abs(found[name].M0 - want.M0).max() <= 1e-8 * np.abs(want.M0).max(), name
        if want.order:
            first = want.M1.transpose(0, 2, 1)
            assert np.abs(found[name].M1 - first).max() <= 1e-8 * np.abs(first).max(), name
