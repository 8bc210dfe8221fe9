"""Elastic forces by strain: those of the stiffness matrix, without its round-off."""

from typing import Any

import numpy as np
import pytest

from fmd import load
from fmd.fem import model
from fmd.fem.strain import elastic_forces
from fmd.reduction.eigen import FreeBodySolver


def bar(element: str, order: int, nu: float = 0.3, **mesh: Any) -> dict[str, Any]:
    """Return a slender bar by its elements; of tetrahedra it is as wide as they are large."""
    size = {"divisions": [6, 1, 1]} if element == "hexahedron" else {"size": 0.02}
    table = {"shape": "bar", "length": 0.5, "depth": 0.005, "width": 0.006, "E": 70e9, "nu": nu, "rho": 2700.0}
    table |= {key: mesh.pop(key) for key in ("depth", "width") if key in mesh}
    table |= {"mesh": {"element": element, "order": order, **size, **mesh}, "modes": {"count": 4}}
    return {"title": "Bar", "body": {"bar": {**table, "marker": {"a": {"face": "x-"}}}}}


@pytest.mark.parametrize(
    "tables",
    [
        bar("hexahedron", 1),
        bar("hexahedron", 1, nu=0.499),
        bar("hexahedron", 1, formulation="plain"),
        bar("hexahedron", 2),
        bar("tetrahedron", 2),
    ],
    ids=["enhanced", "incompressible", "plain", "quadratic", "tetrahedra"],
)
def test_elastic_forces_are_those_of_the_stiffness_matrix(tables: dict[str, Any]) -> None:
    fe = load(tables).run.wholes["bar"].fe
    u = np.random.default_rng(0).standard_normal((fe.K.shape[0], 3))
    expected = fe.K @ u
    found = elastic_forces(fe.discretisation, fe.material, u.reshape(len(fe.x), 3, -1)).reshape(expected.shape)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    energies = u.T @ expected
    np.testing.assert_allclose(fe.stiffness_of(u), energies, rtol=0, atol=1e-12 * np.abs(energies).max())


def test_modes_of_a_slender_bar_are_as_exact_as_its_strain() -> None:
    """Its modulus changes no shape, and squared frequencies in proportion; the matrix has a round-off of 1e-8."""
    table = bar("hexahedron", 2)
    first, second = (load(table, f"body.bar.E={E} GPa").run.wholes["bar"].modes for E in (70.0, 70.14))
    np.testing.assert_allclose(second.omega**2 / first.omega**2, 70.14 / 70.0, rtol=1e-13)
    np.testing.assert_allclose(np.abs(second.shapes), np.abs(first.shapes), atol=1e-10 * np.abs(first.shapes).max())


def test_the_lowest_modes_of_many_are_those_of_few() -> None:
    """The highest has 8e6 times their squared frequency, by which its parts of lower motions must not grow."""
    table = bar("hexahedron", 1)
    table["body"]["bar"]["mesh"]["divisions"] = [40, 1, 1]
    fe = load(table).run.wholes["bar"].fe
    many, few = (FreeBodySolver(fe).modes(n) for n in (200, 4))
    np.testing.assert_allclose(many.omega[:4] ** 2, few.omega**2, rtol=1e-12)
    flat = many.shapes.reshape(len(fe.rigid_modes), -1)
    rigid = fe.rigid_modes / np.sqrt(np.einsum("ij,ij->j", fe.rigid_modes, fe.M @ fe.rigid_modes))
    np.testing.assert_allclose(rigid.T @ (fe.M @ flat), 0.0, atol=1e-12)


def test_modes_of_a_compact_body_take_no_strain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Round-off of its stiffness matrix, by an estimate, is 1e-13 of their energies; of the bar's it is 1e-9."""
    monkeypatch.setattr(model, "elastic_forces", lambda *_: pytest.fail("took strain"))
    table = bar("hexahedron", 1, depth=0.3, width=0.2, divisions=[6, 4, 3])
    assert load(table).run.wholes["bar"].modes.residual < 1e-8
    with pytest.raises(pytest.fail.Exception, match="took strain"):
        _ = load(bar("hexahedron", 1)).run.wholes["bar"].modes
