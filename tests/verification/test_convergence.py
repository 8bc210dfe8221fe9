"""Refining the mesh brings the first bending frequency nearer at the order that theory gives the element.

An eigenvalue, and with it the frequency, converges with the order 2p for displacements of order p (Strang & Fix, An
Analysis of the Finite Element Method, chapter 6): 2 and 4.

The bar is four times as long as deep, not 13.6 times as the paper's beam: the long sides then hold many elements of a
cube's shape with few in all, and elements of order 1 whose strain isn't enhanced, which lock in bending until they are
small against the depth, reach their asymptotic range within seconds.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.fem.assembly import assemble
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.meshes.bar import hexahedral_bar, tetrahedral_bar
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.mode_families import modes_of_family

pytestmark = pytest.mark.slow

STEEL = Material(E=210e9, nu=0.3, rho=7800.0)
LENGTH, DEPTH, WIDTH = SIZES = (0.4, 0.1, 0.05)


def frequency_hz(mesh: SolidMesh, order: int, formulation: str = "enhanced") -> float:
    fe = assemble(mesh, order, STEEL, formulation)
    modes = modes_of_family(FreeBodySolver(fe), fe, 1, "in-plane bending", np.array([0.0, 0.0, 1.0]))
    return float(modes.frequencies_hz[0])


@cache
def by_hexahedra(n: int, order: int, formulation: str = "enhanced") -> float:
    """Frequency on cubes, n over the depth."""
    return frequency_hz(SolidMesh(*hexahedral_bar(*SIZES, (4 * n, n, n // 2))), order, formulation)


def slope(sizes: Array, frequencies: Array, reference: float) -> float:
    errors = np.array(frequencies) / reference - 1
    assert (errors > 0).all()  # conforming elements are too stiff, always; enhanced ones here
    return float(np.polyfit(np.log(sizes), np.log(errors), 1)[0])


@pytest.fixture(scope="module")
def reference() -> float:
    """hex20 with six and eight elements over the depth, carried on to size zero at its order 4 (Richardson)."""
    coarse, fine = by_hexahedra(6, 2), by_hexahedra(8, 2)
    return fine - (coarse - fine) / ((8 / 6) ** 4 - 1)


@pytest.mark.long  # what converges to it below would not, else
def test_the_reference_is_converged(reference: float, timoshenko: Callable[..., Any]) -> None:
    # what Richardson's rule takes off is an estimate of the error that was left: far below the errors measured here
    assert by_hexahedra(8, 2) / reference - 1 < 1e-5
    # the same from the meshes of four and six, so the rule's order is the right one
    coarse, fine = by_hexahedra(4, 2), by_hexahedra(6, 2)
    assert fine - (coarse - fine) / ((6 / 4) ** 4 - 1) == pytest.approx(reference, rel=2e-6)
    assert reference == pytest.approx(timoshenko(*SIZES, STEEL).frequencies_hz(1)[0], rel=0.003)


@pytest.mark.parametrize(
    ("order", "formulation", "divisions"),
    [(1, "enhanced", (4, 6, 8)), (1, "plain", (6, 8, 12)), (2, "enhanced", (2, 4, 6))],
    ids=["hex8", "plain hex8", "hex20"],
)
def test_hexahedra_converge_with_twice_their_order(
    order: int, formulation: str, divisions: tuple[int, ...], reference: float
) -> None:
    found = [by_hexahedra(n, order, formulation) for n in divisions]
    assert slope(1 / np.array(divisions), found, reference) == pytest.approx(2 * order, abs=0.3)


def test_enhanced_strain_takes_two_thirds_of_the_error(reference: float) -> None:
    enhanced, plain = (by_hexahedra(4, 1, formulation) / reference - 1 for formulation in ("enhanced", "plain"))
    assert 0 < enhanced < 0.36 * plain


@pytest.mark.parametrize(
    ("order", "wanted"),
    [(1, (0.04, 0.03, 0.02, 0.0125)), (2, (0.06, 0.05, 0.04, 0.03, 0.025, 0.02))],
    ids=["tet4", "tet10"],
)
def test_gmshs_tetrahedra_converge_with_twice_their_order(
    order: int, wanted: tuple[float, ...], reference: float
) -> None:
    # Gmsh's cells are of about the size asked for, more or less so from mesh to mesh: what counts is their number
    meshes = [SolidMesh(*tetrahedral_bar(*SIZES, size)) for size in wanted]
    sizes = np.array([len(mesh.cells) for mesh in meshes]) ** (-1 / 3)
    found = [frequency_hz(mesh, order) for mesh in meshes]
    assert slope(sizes, found, reference) == pytest.approx(2 * order, abs=0.5)


def test_regular_tetrahedra_converge_with_order_two(reference: float, box_mesh: Callable[..., SolidMesh]) -> None:
    # cubes cut in six; tet4 only, tet10 would need too many of them
    divisions = (6, 8, 12)
    found = [frequency_hz(box_mesh("tetra", (4 * n, n, n // 2), SIZES), 1) for n in divisions]
    assert slope(1 / np.array(divisions), found, reference) == pytest.approx(2, abs=0.3)
