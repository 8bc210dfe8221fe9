"""One package's assembly of stiffness and mass on a given mesh: ``python assembly_peers.py PACKAGE ELEMENT MESH.npz``.

Prints one JSON object. Each function below makes ready what isn't timed and returns two: what is timed, a space and its
K and M, and the energies uᵀKu, uᵀMu of a displacement. Nothing of the project is loaded for DOLFINx, NGSolve and SfePy,
so that they can run in an interpreter of their own. Linux only, for the sake of memory.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np

E, NU, RHO = 70e9, 0.3, 2780.0
LAM, MU = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
ELEMENTS = {"tet4": ("tetra", 1), "tet10": ("tetra", 2), "hex8": ("hexahedron", 1), "hex20": ("hexahedron", 2)}


def polynomials(order, count=4):
    """Displacements of the elements' order: coefficients (10, 3) of 1, x, y, z, x², y², z², xy, yz, zx."""
    return [np.random.default_rng(k).standard_normal((10, 3)) * ([[1]] * 4 + [[order - 1]] * 6) for k in range(count)]


def monomials(p):
    """At points (3, n): shape (10, n)."""
    x, y, z = p
    return np.array([x**0, x, y, z, x * x, y * y, z * z, x * y, y * z, z * x])


def nodal(found, factors):
    """Energies where the unknowns are the displacements of the nodes, axis by axis."""
    K, M, x = found
    u = (monomials(np.asarray(x).T).T @ factors).ravel()
    return u @ (K @ u), u @ (M @ u)


def space_of(points, cells, name):
    from fmd.fem.mesh import SolidMesh
    from fmd.fem.space import Discretisation

    return Discretisation(SolidMesh(points, cells, ELEMENTS[name][0], {}, {}), ELEMENTS[name][1])


def fmd(points, cells, name):
    """Ours, with M = m ⊗ 1₃ written out."""
    from fmd.fem.assembly import assemble
    from fmd.fem.material import Material

    mesh = space_of(points, cells, name).mesh

    def work():
        fe = assemble(mesh, ELEMENTS[name][1], Material(E, NU, RHO), "plain")  # as the others have it
        return fe.K, fe.M, fe.x

    return work, nodal


def scikit_fem(points, cells, name):
    """Its own form as in its examples, at its default quadrature."""
    return scikit_fem_form(space_of(points, cells, name), None, None)


def scikit_fem_lean(points, cells, name):
    """The same form, each matrix at the quadrature that it needs, which is ours."""
    space = space_of(points, cells, name)
    return scikit_fem_form(space, space.kind.stiffness_order, space.kind.mass_order)


def scikit_fem_form(space, stiffness_order, mass_order):
    import skfem
    from skfem.helpers import dot
    from skfem.models.elasticity import linear_elasticity

    mesh, inner = space.skfem_mesh, skfem.BilinearForm(lambda u, v, _: RHO * dot(u, v))

    def work():
        element = skfem.ElementVector(space.kind.element)
        basis = skfem.Basis(mesh, element, intorder=stiffness_order)
        K = linear_elasticity(LAM, MU).assemble(basis)
        if mass_order != stiffness_order:
            basis = skfem.Basis(mesh, element, intorder=mass_order)
        return K, inner.assemble(basis), space.x

    return work, nodal


def felupe(points, cells, name):
    """Its solid body, each matrix at the quadrature it needs."""
    import felupe as fem

    from fmd.fem.formats.vtkhdf import vtk_cells

    space = space_of(points, cells, name)
    region, finer = {
        "tet4": (fem.RegionTetra, fem.TetrahedronQuadrature(order=2)),
        "tet10": (fem.RegionQuadraticTetra, None),
        "hex8": (fem.RegionHexahedron, None),
        "hex20": (fem.RegionQuadraticHexahedron, None),
    }[name]
    kind = {"tet4": "tetra", "tet10": "tetra10", "hex8": "hexahedron", "hex20": "hexahedron20"}[name]
    mesh = fem.Mesh(np.array(space.x), vtk_cells(space), kind)
    if name == "tet10":
        from felupe.quadrature import Scheme
        from skfem.quadrature import get_quadrature_tet

        x, w = get_quadrature_tet(4)
        finer = Scheme(x.T, w)

    def body(**more):
        return fem.SolidBody(
            fem.LinearElastic(E=E, nu=NU), fem.FieldContainer([fem.Field(region(mesh, **more), dim=3)]), density=RHO
        )

    def work():
        body_of_K = body()
        body_of_M = body(quadrature=finer) if finer is not None else body_of_K
        return body_of_K.assemble.matrix().tocsr(), body_of_M.assemble.mass().tocsr(), space.x

    return work, nodal


def sfepy(points, cells, name):
    """Its terms for elasticity and mass."""
    from sfepy.base.base import output
    from sfepy.discrete import Equation, Equations, FieldVariable, Integral, Material
    from sfepy.discrete.fem import FEDomain, Field, Mesh
    from sfepy.mechanics.matcoefs import stiffness_from_lame
    from sfepy.terms import Term

    output.set_output(quiet=True)
    cell, order = ELEMENTS[name]
    if name == "hex20":
        raise ModuleNotFoundError("no serendipity element of order 2 by this interface")
    label = "3_4" if cell == "tetra" else "3_8"
    mesh = Mesh.from_data("block", points, None, [cells.astype(np.int32)], [np.zeros(len(cells), np.int32)], [label])
    domain = FEDomain("block", mesh)
    omega = domain.create_region("Omega", "all")

    def matrix(field, term, degree):
        u = FieldVariable("u", "unknown", field)
        v = FieldVariable("v", "test", field, primary_var_name="u")
        solid = Material("m", D=stiffness_from_lame(3, LAM, MU), rho=RHO)
        term = Term.new(term, Integral("i", order=degree), omega, m=solid, v=v, u=u)
        equations = Equations([Equation("balance", term)])
        equations.time_update(None)
        equations.init_state()
        equations.time_update_materials(None, mode="normal")
        graph = equations.create_matrix_graph()
        return equations.evaluate(mode="weak", dw_mode="matrix", asm_obj=graph)

    def work():
        field = Field.from_args("u", np.float64, "vector", omega, approx_order=order)
        less = 2 if cell == "tetra" else 0
        K = matrix(field, "dw_lin_elastic(m.D, v, u)", max(2 * order - less, 1) if less else 3)
        return K, matrix(field, "dw_dot(m.rho, v, u)", 2 * order if less else 3), field.get_coor()

    return work, nodal


def ngsolve_mesh(points, cells):
    """Its mesh of a block."""
    import netgen.meshing as ng
    from ngsolve import Mesh

    net = ng.Mesh(dim=3)
    net.Add(ng.FaceDescriptor(surfnr=1, domin=1, bc=1))
    number = [net.Add(ng.MeshPoint(ng.Pnt(*p))) for p in points.tolist()]
    for cell in cells.tolist():
        net.Add(ng.Element3D(1, [number[k] for k in cell]))
    return Mesh(net)


def ngsolve(points, cells, name):
    """Its symbolic forms."""
    from ngsolve import CF, BilinearForm, Grad, GridFunction, InnerProduct, Sym, Trace, VectorH1, dx, x, y, z

    if name == "hex20":
        raise ModuleNotFoundError("no serendipity element")
    mesh = ngsolve_mesh(points, cells)

    def work():
        V = VectorH1(mesh, order=ELEMENTS[name][1])
        u, v = V.TnT()
        strain, virtual = Sym(Grad(u)), Sym(Grad(v))
        K, M = BilinearForm(V), BilinearForm(V)
        K += (LAM * Trace(strain) * Trace(virtual) + 2 * MU * InnerProduct(strain, virtual)) * dx
        M += RHO * InnerProduct(u, v) * dx
        K.Assemble()
        M.Assemble()
        return V, K, M

    def energies(found, factors):
        V, K, M = found
        terms = [1 + 0 * x, x, y, z, x * x, y * y, z * z, x * y, y * z, z * x]
        u = GridFunction(V)
        u.Set(CF(tuple(sum(float(c) * t for c, t in zip(axis, terms, strict=True)) for axis in factors.T)))
        return tuple(InnerProduct(u.vec, (A.mat * u.vec).Evaluate()) for A in (K, M))

    return work, energies


def dolfinx(points, cells, name):
    """Its compiled forms; the compilation is done before."""
    import dolfinx.fem.petsc
    import dolfinx.mesh
    import ufl
    from mpi4py import MPI

    kind, order = ELEMENTS[name]
    if kind == "tetra":
        kind = "tetrahedron"
    else:
        cells = cells[:, [0, 1, 3, 2, 4, 5, 7, 6]]
    geometry = ufl.Mesh(ufl.VectorElement("Lagrange", kind, 1))
    domain = dolfinx.mesh.create_mesh(MPI.COMM_SELF, cells.astype(np.int64), points, geometry)
    element = ufl.VectorElement("S" if name == "hex20" else "Lagrange", kind, order)

    def work():
        V = dolfinx.fem.FunctionSpace(domain, element)
        u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
        strain, virtual = ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(v))
        stress = LAM * ufl.tr(strain) * ufl.Identity(3) + 2 * MU * strain
        matrices = []
        for form in (ufl.inner(stress, virtual) * ufl.dx, RHO * ufl.inner(u, v) * ufl.dx):
            matrix = dolfinx.fem.petsc.assemble_matrix(dolfinx.fem.form(form))
            matrix.assemble()
            matrices.append(matrix)
        return V, *matrices

    def energies(found, factors):
        V, K, M = found
        u = dolfinx.fem.Function(V)
        u.interpolate(lambda p: (monomials(p).T @ factors).T)
        return tuple(u.vector.dot(A * u.vector) for A in (K, M))

    return work, energies


PACKAGES = {
    "fmd": (fmd, "numpy"),
    "scikit-fem": (scikit_fem, "skfem"),
    "scikit-fem, our quadrature": (scikit_fem_lean, "skfem"),
    "DOLFINx": (dolfinx, "dolfinx"),
    "FElupe": (felupe, "felupe"),
    "NGSolve": (ngsolve, "ngsolve"),
    "SfePy": (sfepy, "sfepy"),
}


def status(key):
    """Memory of this process [MB], by its name in Linux."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(f"{key}:"))


def main():
    """Assemble two to five times, once if that takes twenty seconds; print what was found."""
    package, name, path = sys.argv[1:]
    make, module = PACKAGES[package]
    with np.load(path) as mesh:
        work, energies = make(mesh["points"], mesh["cells"], name)
        points, cells = mesh["points"], mesh["cells"]
    Path("/proc/self/clear_refs").write_text("5")  # the peak starts anew here
    before, seconds, found = status("VmRSS"), [], None
    while len(seconds) < 5 and (sum(seconds) < 10 or len(seconds) < 2) and sum(seconds) < 20:
        del found
        tick = time.process_time()
        found = work()
        seconds.append(time.process_time() - tick)
    result = {
        "version": sys.modules[module].__version__,
        "seconds": float(np.median(seconds[1:] or seconds)),  # the first compiles, loads and warms up
        "megabytes": status("VmHWM") - before,
        "energies": [energies(found, factors) for factors in polynomials(ELEMENTS[name][1])],
    }
    if package.startswith("scikit-fem"):  # numbered as ours: entry by entry
        own = fmd(points, cells, name)[0]()
        result["entries"] = max(float(abs(A - B).max() / abs(B).max()) for A, B in zip(own[:2], found[:2], strict=True))
    print(json.dumps(result))


if __name__ == "__main__":
    main()
