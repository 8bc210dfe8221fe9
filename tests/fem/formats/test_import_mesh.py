"""Meshes from files: every format with every element has the right order of nodes, by laws of elasticity."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.fem.assembly import assemble
from fmd.fem.elements import shape_functions
from fmd.fem.formats import import_mesh as mesh_file
from fmd.fem.formats.import_mesh import read_mesh
from fmd.fem.formats.meshio_reader import _read
from fmd.fem.formats.vtkhdf import vtk_cells
from fmd.fem.markers import face_marker
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.fem.selection import locate_points
from fmd.fem.space import Discretisation
from fmd.fem.surface import surface_topology
from fmd.meshes.gmsh_session import gmsh_model
from fmd.recovery.stress import element_stress, modal_stress, point_stress

FORMATS = ("inp", "bdf", "v2.msh", "v4.msh", "vtk", "med", "vtu")
KINDS = {  # cells and how Gmsh is asked for them: order, recombined, with inner nodes
    "tetra": (1, None, False),
    "tetra10": (2, None, False),
    "hexahedron": (1, True, False),
    "hexahedron20": (2, True, False),
    "hexahedron27": (2, True, True),
    "wedge": (1, False, False),
    "wedge15": (2, False, False),
    "pyramid": (1, True, False),
    "pyramid13": (2, True, False),
}
# Gmsh writes none, or as pyramids of 5 nodes; quadratic pyramids of Nastran have its own order in place of Nastran's.
UNWRITTEN = {(form, "hexahedron27") for form in ("bdf", "med")} | {
    (form, "pyramid13") for form in ("bdf", "vtk", "vtu")
}
WRITTEN = [(form, kind) for form in FORMATS for kind in KINDS if (form, kind) not in UNWRITTEN]
# Corners of a hexahedron's faces, counter-clockwise seen from inside.
INWARDS = ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))
VOLUME = 1.5 * 1.0 * 1.2  # a prism on a trapezoid: parallel sides of 2 and 1, 1 apart, 1.2 high
MATERIAL = Material(70e9, 0.33, 2700.0)


def make_prism(gmsh, order: int, recombined: bool | None, full: bool) -> None:
    """Mesh the prism on the trapezoid; its part is ``block``, the side at x = 0 ``left``."""
    gmsh.option.setNumber("Mesh.ElementOrder", order)
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", not full)
    occ = gmsh.model.occ
    corners = [occ.addPoint(*x, 0.0) for x in ((0, 0), (2, 0), (1, 1), (0, 1))]
    loop = occ.addCurveLoop([occ.addLine(corners[k], corners[(k + 1) % 4]) for k in range(4)])
    base = occ.addPlaneSurface([loop])
    occ.synchronize()
    if recombined is not None:
        for _, curve in gmsh.model.getEntities(1):
            gmsh.model.mesh.setTransfiniteCurve(curve, 3)
        gmsh.model.mesh.setTransfiniteSurface(base)
    if recombined:
        gmsh.model.mesh.setRecombine(2, base)
    layers = [] if recombined is None else [2]
    occ.extrude([(2, base)], 0, 0, 1.2, layers, recombine=recombined is not None)
    occ.synchronize()
    for end in ("Min", "Max"):
        gmsh.option.setNumber(f"Mesh.MeshSize{end}", 0.4 if order == 1 else 0.8)
    gmsh.model.addPhysicalGroup(3, [1], name="block")
    left = [tag for _, tag in gmsh.model.getEntities(2) if abs(occ.getCenterOfMass(2, tag)[0]) < 1e-9]
    gmsh.model.addPhysicalGroup(2, left, name="left")
    gmsh.model.mesh.generate(3)


def split_into_pyramids(gmsh, order: int) -> None:
    """Put six pyramids in place of each hexahedron, and let Gmsh add their mid-edge nodes."""
    _, hexahedra, nodes = (each[0] for each in gmsh.model.mesh.getElements(3, 1))
    corners = nodes.reshape(-1, 8).astype(int)
    x = np.array([[gmsh.model.mesh.getNode(node)[0] for node in cell] for cell in corners])
    centres = int(gmsh.model.mesh.getMaxNodeTag()) + 1 + np.arange(len(corners))
    gmsh.model.mesh.addNodes(3, 1, centres, x.mean(axis=1).ravel())
    gmsh.model.mesh.removeElements(3, 1, hexahedra)
    cells = [[*cell[list(face)], centre] for cell, centre in zip(corners, centres, strict=True) for face in INWARDS]
    gmsh.model.mesh.addElementsByType(1, 7, [], np.ravel(cells))
    gmsh.model.mesh.setOrder(order)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """The prism with every kind of cell in every format that Gmsh writes, and VTU written by VTK itself."""
    import pyvista

    folder = tmp_path_factory.mktemp("meshes")
    for kind, settings in KINDS.items():
        with gmsh_model("prism") as gmsh:
            make_prism(gmsh, *((1, True, False) if kind.startswith("pyramid") else settings))
            if kind.startswith("pyramid"):
                split_into_pyramids(gmsh, settings[0])
            for form in FORMATS[:-1]:
                gmsh.option.setNumber("Mesh.MshFileVersion", 2.2 if form == "v2.msh" else 4.1)
                gmsh.option.setNumber("Mesh.Binary", form == "v4.msh")
                gmsh.write(str(folder / f"{kind}.{form}"))
        pyvista.read(folder / f"{kind}.vtk").save(folder / f"{kind}.vtu")
    return folder


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch, folder: Path) -> Callable[..., FEModel]:
    """Read and assemble one of them; meshio without its own process, which has its tests elsewhere."""
    monkeypatch.setattr(mesh_file, "read_by_meshio", _read)

    def assembled(form: str, kind: str) -> FEModel:
        mesh = read_mesh(folder / f"{kind}.{form}", 1.0)
        assert mesh.cell_type == kind
        assert not any("order" in note for note in mesh.notes if form != "med")  # nothing had to be put right
        return assemble(mesh, mesh.order, MATERIAL)

    return assembled


@pytest.mark.parametrize(("form", "kind"), WRITTEN)
def test_every_format_and_element_has_volume_rigid_modes_and_patch_test(read, form: str, kind: str) -> None:
    fe = read(form, kind)
    assert fe.discretisation.mesh.volume == pytest.approx(VOLUME, rel=1e-6 if form in ("inp", "bdf") else 1e-12)
    assert fe.mass == pytest.approx(2700 * fe.discretisation.mesh.volume, rel=1e-12)
    stiffness = np.linalg.eigvalsh(fe.K.toarray()) / abs(fe.K).max()
    assert np.abs(stiffness[:6]).max() < 1e-12
    assert stiffness[6] > 1e-5
    assert patch_test_error(fe) < 1e-9 if form in ("inp", "bdf") else 1e-11


def patch_test_error(fe: FEModel) -> float:
    """Largest error inside of a linear displacement that is given on the surface, over its largest value."""
    exact = fe.x @ np.random.default_rng(1).standard_normal((3, 3))
    held = np.zeros(exact.shape, dtype=bool)
    held[surface_topology(fe.discretisation).nodes] = True
    if fe.discretisation.kind.name == "hex27":  # the surface's drawing leaves out the nodes inside its facets
        held[np.isin(np.arange(len(fe.x)), inner_facet_nodes(fe.discretisation))] = True
    held = held.ravel()
    assert not held.all()
    u = np.where(held, exact.ravel(), 0.0)
    K = sp.csc_array(fe.K)
    u[~held] = spsolve(K[~held][:, ~held], -K[~held][:, held] @ u[held])
    found = u.reshape(-1, 3, 1)
    stress = modal_stress(fe.discretisation, MATERIAL, found, np.arange(len(fe.x)))
    assert np.abs(stress - stress[0]).max() < 1e-6 * np.abs(stress).max()
    return float(np.abs(found[..., 0] - exact).max() / np.abs(exact).max())


def inner_facet_nodes(space: Discretisation) -> Array:
    elements, local = space.boundary_facets
    middle = np.array([[space.kind.element.doflocs[facet].mean(axis=0)] for facet in space.kind.facet_polygons])
    node = np.abs(space.kind.element.doflocs - middle).max(axis=2).argmin(axis=1)
    return space.element_nodes[elements, node[local]]


@pytest.mark.parametrize("kind", KINDS)
def test_surfaces_are_closed_and_exports_keep_the_order_of_nodes(read, kind: str) -> None:
    fe = read("v4.msh", kind)
    surface = surface_topology(fe.discretisation)
    a, b, c = np.moveaxis(fe.x[surface.nodes][surface.triangles] - [0.7, 0.5, 0.6], 1, 0)
    parts = np.einsum("ti,ti->t", a, np.cross(b, c)) / 6
    assert parts.min() > 0
    assert parts.sum() == pytest.approx(VOLUME, rel=1e-12)
    again = SolidMesh(fe.x.copy(), vtk_cells(fe.discretisation), kind, {}, {})
    assert again.volume == pytest.approx(VOLUME, rel=1e-12)


@pytest.mark.parametrize(("form", "kind"), [pair for pair in WRITTEN if pair[0] not in ("vtk", "vtu")])
def test_parts_and_faces_have_the_files_names(read, form: str, kind: str) -> None:
    space = read(form, kind).discretisation
    if form == "bdf":  # which has numbers of properties instead of names
        left = next(face for face in space.mesh.faces.values())
        assert len(space.mesh.parts["property-1"]) == len(space.mesh.cells)
    else:
        left = space.mesh.faces["left"]
        assert len(space.mesh.parts["block"]) == len(space.mesh.cells)
    # the side of 1 × 1.2 at x = 0
    assert face_marker(space, left).position == pytest.approx([0, 0.5, 0.6], abs=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_stress_in_an_element_and_at_a_point_is_that_of_a_linear_displacement(read, kind: str) -> None:
    space = read("v4.msh", kind).discretisation
    u = (space.x * [1e-3, 0, 0])[:, :, None]
    lam, mu = MATERIAL.lame
    wanted = 1e-3 * np.array([lam + 2 * mu, lam, lam, 0, 0, 0])
    inside = np.array([[0.3, 0.4, 0.5], [0.9, 0.2, 1.0]])
    for stress in (element_stress(space, MATERIAL, u, np.array([0, 3])), point_stress(space, MATERIAL, u, inside)):
        assert np.abs(stress[..., 0] - wanted).max() < 1e-9 * wanted[0]
    elements, X = locate_points(space, inside)
    N = [shape_functions(space.kind.geometry, x[:, None])[0][:, 0] for x in X]
    found = [n @ space.corner_coordinates[element] for n, element in zip(N, elements, strict=True)]
    assert np.abs(found - inside).max() < 1e-9


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_mesh(tmp_path / "no.inp", 1.0)
    with pytest.raises(InputError, match="is a folder"):
        read_mesh(tmp_path, 1.0)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a.stp", "is CAD, no mesh; give it as mesh = { cad = …, size = … }"),
        ("a.rst", r"is of results, no mesh; give the deck \(.inp, .bdf, .cdb\)"),
        ("a.full", r"is of matrices, no mesh; give the deck \(.inp, .bdf, .cdb\) or `matrices`"),
        ("a.SUB", "is a superelement of Ansys, which isn't read; give the deck"),
        ("a.mail", "is a mesh of Code_Aster as text; write it as .med"),
    ],
)
def test_files_that_hold_no_mesh_are_refused_with_what_to_give(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / name).write_text("x")
    with pytest.raises(InputError, match=message):
        read_mesh(tmp_path / name, 1.0)
