"""Markers: mean displacement and rotation of a face, and the tractions that they stand for."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import skfem

from fmd.core.arrays import Array
from fmd.fem.markers import Marker, face_marker, traction_marker
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.fem.space import Discretisation

FACES = ("x-", "x+", "y-", "z+")


@skfem.LinearForm
def unit_load(v: Any, _: Any) -> Any:
    return v


def marker_of(fe: FEModel, face: str) -> Marker:
    return face_marker(fe.discretisation, fe.discretisation.mesh.faces[face])


def face_loads(space: Discretisation, face: str) -> Array:
    """Nodal forces of a unit traction on a face, by scikit-fem's own linear form: ∫ N_i dA."""
    mesh = space.skfem_mesh
    axis, end = "xyz".index(face[0]), 0.0 if face[1] == "-" else mesh.p["xyz".index(face[0])].max()
    facets = mesh.facets_satisfying(lambda x: np.isclose(x[axis], end), boundaries_only=True)
    return unit_load.assemble(skfem.FacetBasis(mesh, space.kind.element, facets=facets))


def test_a_marker_sits_at_the_centroid_of_its_face(distorted: FEModel) -> None:
    # the box is 1.2 × 1 × 0.8 m with a corner at the origin
    assert marker_of(distorted, "x+").position == pytest.approx([1.2, 0.5, 0.4], abs=1e-14)
    assert marker_of(distorted, "z-").position == pytest.approx([0.6, 0.5, 0.0], abs=1e-14)


def test_the_centroid_is_that_of_the_area_not_of_the_nodes(element: Any, box_mesh: Callable[..., SolidMesh]) -> None:
    box = box_mesh(element.cell_type, (2, 4, 4))
    crowded = box.points.copy()
    crowded[:, 1:] **= 3  # nodes gather at one edge; the face is still the unit square
    mesh = SolidMesh(crowded, box.cells.copy(), box.cell_type, box.parts, box.faces)
    marker = face_marker(Discretisation(mesh, element.order), mesh.faces["x+"])
    assert marker.position == pytest.approx([1, 0.5, 0.5], abs=1e-14)
    assert np.abs(mesh.points[mesh.faces["x+"]].mean(axis=0) - [1, 0.5, 0.5]).max() > 0.1


@pytest.mark.parametrize("face", FACES)
def test_a_rigid_motion_is_followed_exactly(distorted: FEModel, face: str) -> None:
    marker = marker_of(distorted, face)
    rng = np.random.default_rng(0)
    shift, turn = rng.standard_normal((2, 3))
    u = shift + np.cross(turn, distorted.x)
    assert marker.translation(u) == pytest.approx(shift + np.cross(turn, marker.position), abs=1e-13)
    assert marker.rotation(u) == pytest.approx(turn, abs=1e-12)


def test_many_fields_are_followed_at_once(distorted: FEModel) -> None:
    marker = marker_of(distorted, "x+")
    fields = np.random.default_rng(1).standard_normal((len(distorted.x), 3, 4))
    for k in range(4):
        assert marker.translation(fields)[:, k] == pytest.approx(marker.translation(fields[..., k]), abs=1e-13)
        assert marker.rotation(fields)[:, k] == pytest.approx(marker.rotation(fields[..., k]), abs=1e-12)


@pytest.mark.parametrize("face", FACES)
def test_a_force_at_the_marker_is_a_uniform_traction(distorted: FEModel, face: str) -> None:
    marker = marker_of(distorted, face)
    assert marker.translation_weights.sum() == pytest.approx(1.0, abs=1e-14)
    loads = face_loads(distorted.discretisation, face)
    spread = np.zeros(len(distorted.x))
    spread[marker.nodes] = marker.translation_weights
    assert np.abs(spread - loads / loads.sum()).max() < 1e-14


@pytest.mark.parametrize("face", FACES)
def test_a_torque_at_the_marker_has_that_torque_and_no_force(distorted: FEModel, face: str) -> None:
    # The forces dual to the mean rotation: Σ f = 0 and Σ r × f = e_a about any point
    marker = marker_of(distorted, face)
    x = distorted.x[marker.nodes]
    for a in range(3):
        forces = marker.rotation_weights[a]
        assert np.abs(forces.sum(axis=0)).max() < 1e-12
        assert np.cross(x, forces).sum(axis=0) == pytest.approx(np.eye(3)[a], abs=1e-12)


def test_the_columns_are_loads_and_measure_the_motion(distorted: FEModel) -> None:
    marker = marker_of(distorted, "x+")
    directions = np.linalg.qr(np.random.default_rng(2).standard_normal((3, 3)))[0][:2]
    B = marker.columns(len(distorted.x), directions)
    assert B.shape == (len(distorted.x), 3, 5)
    # as loads: unit forces along x, y, z through the marker, and unit torques without force
    r = distorted.x - marker.position
    forces, torques = B.sum(axis=0), np.cross(r[:, :, None], B, axis=1).sum(axis=0)
    assert np.abs(forces - np.eye(3, 5)).max() < 1e-12
    assert np.abs(torques - np.concatenate([np.zeros((3, 3)), directions.T], axis=1)).max() < 1e-12
    # as measures: mean displacement, and mean rotation about the directions
    u = np.random.default_rng(3).standard_normal(distorted.x.shape)
    measured = np.tensordot(B, u, ((0, 1), (0, 1)))
    assert measured == pytest.approx(np.concatenate([marker.translation(u), directions @ marker.rotation(u)]), rel=1e-9)
    assert np.array_equal(marker.columns(len(distorted.x), np.zeros((0, 3))), B[..., :3])


def test_a_marker_is_rigid_only_by_its_flag(distorted: FEModel) -> None:
    space = distorted.discretisation
    assert not marker_of(distorted, "x+").rigid
    assert face_marker(space, space.mesh.faces["x+"], rigid=True).rigid


def test_warping_and_stretching_of_the_face_are_not_taken_for_motion(distorted: FEModel) -> None:
    # About the centre of a rectangle y·z and y, z along themselves have neither mean nor moment.
    marker = marker_of(distorted, "x+")
    r = distorted.x - marker.position
    warped = np.outer(r[:, 1] * r[:, 2], [1, 0, 0])
    fields = [r * [0, 1, 0], r * [0, 0, 1]]
    if distorted.discretisation.kind.name != "tet4":  # its space lacks y·z
        fields.append(warped)
    for u in fields:
        assert np.abs(marker.translation(u)).max() < 1e-14
        assert np.abs(marker.rotation(u)).max() < 1e-13


def test_points_that_span_no_boundary_facet_are_refused(distorted: FEModel) -> None:
    faces = distorted.discretisation.mesh.faces
    edge = np.intersect1d(faces["x-"], faces["y-"])
    with pytest.raises(ValueError, match="no boundary facet of the mesh lies on the face"):
        face_marker(distorted.discretisation, edge)


def test_a_section_weighted_by_forces_moves_and_turns_with_a_rigid_motion() -> None:
    rng = np.random.default_rng(5)
    x, forces, centre = rng.normal(size=(9, 3)), rng.normal(size=(6, 9, 3)), rng.normal(size=3)
    marker = traction_marker(centre, np.arange(9), x, forces)
    moved, turned = rng.normal(size=(2, 3))
    u = (moved + np.cross(turned, x - centre))[..., None]
    assert marker.translation(u)[:, 0] == pytest.approx(moved, abs=1e-12)
    assert marker.rotation(u)[:, 0] == pytest.approx(turned, abs=1e-12)
    loads = marker.columns(9, np.eye(3))
    assert np.linalg.matrix_rank(np.concatenate([loads.reshape(27, 6), forces.reshape(6, 27).T], axis=1)) == 6
    with pytest.raises(ValueError, match="resultants of the section's forces depend on one another"):
        traction_marker(centre, np.arange(9), x, np.concatenate([forces[:5], forces[:1]]))
