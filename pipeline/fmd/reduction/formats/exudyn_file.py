"""Bodies for Exudyn, the ``.npz`` that ``FEM.ObjectFFRFreducedOrderInterface`` loads, and bodies from such files.

The file holds what ``ObjectFFRFreducedOrder`` needs: integrals of a body in its floating frame, nodes and their shapes
(Zwölfer & Gerstmayr, The nodal-based floating frame of reference formulation with modal reduction, Acta Mechanica 232
(2021) 835–851). A marker is four nodes at the corners of a tetrahedron about it, that move with it as a rigid body, so
that Exudyn's mean of their motions is the marker's own motion.
"""

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmd.core.arrays import EPSILON, Array
from fmd.core.errors import InputError
from fmd.core.files import whole_file, write_text
from fmd.core.limits.files import MARKER_ARM
from fmd.fem.surface import SurfaceTopology
from fmd.reduction.body import MarkerShapes
from fmd.reduction.formats.body_format import BodyFormat, ExportedBody
from fmd.reduction.inertia import InertiaIntegrals
from fmd.reduction.modal_data import ModalData, without_stiffening

CORNERS: Array = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
"""Corners of a tetrahedron about the origin, all inertia axes of which are equal."""


def exudyn_arrays(
    data: ModalData, x: Array, shapes: Array, surface: SurfaceTopology | None = None, stress: Array | None = None
) -> dict[str, Any]:
    """Arrange a body's data as Exudyn's interface saves itself: arrays by their names in the file.

    Each of the body's nodes becomes four. Drawn nodes x (n_nodes, 3) are in the body's frame, with shapes (n_nodes, 3,
    n); ``surface`` is the one that they are, with the stress of each modal coordinate (n_nodes, 6, n): xx, yy, zz, yz,
    xz, xy [Pa per unit].
    """
    integrals, n = data.integrals, data.n
    G, S = integrals.G, integrals.S
    arm = MARKER_ARM * float(np.ptp(x, axis=0).max()) if len(x) else 1.0
    corners = [node.position + arm * corner for node in data.nodes.values() for corner in CORNERS]
    moves = [
        node.translation + np.cross(node.rotation, arm * corner, axis=0)
        for node in data.nodes.values()
        for corner in CORNERS[:, :, None]
    ]
    places = np.concatenate([x, np.reshape(corners, (-1, 3))])
    basis = np.concatenate([shapes, np.reshape(moves, (-1, 3, n))])
    P, mixed, modal = G[:, :, 0, 0], G[:, :, 0, 1:], G[:, :, 1:, 1:]
    one, E = np.eye(3), EPSILON
    arrays: dict[str, Any] = {
        "modeBasis": basis.reshape(-1, n),
        "massMatrixReduced": data.M,
        "stiffnessMatrixReduced": data.K,
        "infoList": np.array([n, len(places), 3, 4, 7, 7 + n]),
        "rigidBodyNodeType": "NodeType.RotationEulerParameters",
        "xRef": places.ravel(),
        "inertiaLocal": np.trace(P) * one - P,
        "Mtt": integrals.mass * one,
        "totalMass": integrals.mass,
        "chiU": S[:, 0] / integrals.mass,
        "chiUtilde": -E @ (S[:, 0] / integrals.mass),
        "mPsiTildePsi": -np.einsum("abc,bcji->jai", E, modal).reshape(3 * n, n),
        "mPsiTildePsiTilde": _transposed_products(modal).transpose(2, 0, 3, 1).reshape(3 * n, 3 * n),
        "mPhitTPsi": S[:, 1:],
        "mPhitTPsiTilde": np.einsum("acb,cj->ajb", E, S[:, 1:]).reshape(3, 3 * n),
        "mXRefTildePsi": -np.einsum("abc,bci->ai", E, mixed),
        "mXRefTildePsiTilde": _transposed_products(mixed[:, :, None])[:, :, 0].transpose(0, 2, 1).reshape(3, 3 * n),
        "trigList": np.zeros((0, 3), dtype=int) if surface is None else surface.triangles,
        "fileVersion": 1,
        "type": "ObjectFFRFreducedOrderInterface",
        "dampingMatrixReduced": data.D,
        "markerNames": np.array(list(data.nodes), dtype=str),
        "markerNodes": len(x) + np.arange(4 * len(data.nodes)).reshape(-1, 4),
    }
    results: dict[str, Any] = {}
    if stress is not None:
        none = np.zeros((len(corners), 6 * n))
        matrix = np.concatenate([stress.transpose(0, 2, 1).reshape(len(x), 6 * n), none])
        results = {"matrix": matrix, "outputVariableType": "OutputVariableType.StressLocal"}
    if surface is not None and stress is not None:  # for `read_exudyn`, which loads nothing pickled
        arrays |= {"surfaceEdges": surface.edges, "surfaceStress": stress}
    return arrays | {"postProcessingModes": results}


def _transposed_products(G: Array) -> Array:
    """``∫ ãᵀ b̃ dm = 1 ∫ a·b dm − ∫ b aᵀ dm`` from ``G[c, d] = ∫ a_c b_d dm``; shape (3, 3, …)."""
    return np.asarray(np.multiply.outer(np.eye(3), np.einsum("cc...->...", G)) - G.swapaxes(0, 1))


def write_exudyn(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write arrays as Exudyn's file, which appears whole or not at all."""
    with whole_file(path) as part, part.open("wb") as stream:
        np.savez(stream, **arrays)


def read_exudyn(path: Path) -> ModalData:
    """Read a body from the file of Exudyn's ``ObjectFFRFreducedOrderInterface``; its nodes are numbered from 0.

    Markers that `exudyn_arrays` has written are nodes, too, under their names. Nothing pickled is loaded.

    Raises
    ------
    InputError
        The file can't be read, or is none of these.
    """

    def refuse(mend: str) -> InputError:
        return InputError(str(path), "", None, mend)

    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            found = {name: file[name] for name in file.files if name != "postProcessingModes" and "List" not in name}
            if "surfaceStress" in found:  # written by `exudyn_arrays`, with triangles that are no pickled list
                found["trigList"] = file["trigList"]
    except OSError as error:
        raise refuse(f"can't be read: {error.strerror or error}") from error
    except Exception as error:  # what NumPy and zipfile raise on damaged bytes is of many kinds
        raise refuse(f"no body of Exudyn's ObjectFFRFreducedOrderInterface, or damaged: {error}") from error
    n = len(found["stiffnessMatrixReduced"]) if "stiffnessMatrixReduced" in found else 0
    shapes = {
        "massMatrixReduced": (n, n), "stiffnessMatrixReduced": (n, n), "inertiaLocal": (3, 3), "chiU": (3,),
        "mPsiTildePsiTilde": (3 * n, 3 * n), "mPhitTPsi": (3, n), "mXRefTildePsiTilde": (3, 3 * n), "totalMass": (),
    }  # fmt: skip
    shapes["modeBasis"] = (3 * (found["xRef"].size // 3), n) if "xRef" in found else (0, n)
    shapes["xRef"] = (shapes["modeBasis"][0],)
    for name, shape in shapes.items():
        if name not in found:
            raise refuse(f"has no '{name}'; save the body by ObjectFFRFreducedOrderInterface.SaveToFile(….npz)")
        if found[name].shape != shape or not np.isfinite(found[name]).all():
            raise refuse(f"'{name}' has shape {found[name].shape}, expected {shape}, all of it finite")
    try:
        return _data(found, n)
    except (ValueError, IndexError, KeyError) as error:
        raise refuse(f"a body that contradicts itself: {error}") from error


def _data(found: Mapping[str, NDArray[Any]], n: int) -> ModalData:
    mass, J = float(found["totalMass"]), found["inertiaLocal"]
    G = np.zeros((3, 3, 1 + n, 1 + n))
    G[:, :, 0, 0] = 0.5 * np.trace(J) * np.eye(3) - J
    mixed = _products(found["mXRefTildePsiTilde"].reshape(3, n, 3).transpose(0, 2, 1))
    G[:, :, 0, 1:], G[:, :, 1:, 0] = mixed, mixed.transpose(1, 0, 2)
    modal = _products(found["mPsiTildePsiTilde"].reshape(n, 3, n, 3).transpose(1, 3, 0, 2))
    G[:, :, 1:, 1:] = 0.5 * (modal + modal.transpose(1, 0, 3, 2))
    S = np.column_stack([mass * found["chiU"], found["mPhitTPsi"]])
    places, basis = found["xRef"].reshape(-1, 3), found["modeBasis"].reshape(-1, 3, n)
    unknown = np.full((3, n), np.nan)
    nodes = {str(k): MarkerShapes(at, moves, unknown) for k, (at, moves) in enumerate(zip(places, basis, strict=True))}
    for name, own in zip(found.get("markerNames", ()), found.get("markerNodes", ()), strict=True):
        arms = places[own] - places[own].mean(axis=0)
        turned = np.cross(arms[:, None], basis[own].transpose(0, 2, 1)).sum(axis=0).T
        rotation = turned / ((arms**2).sum() * 2 / 3)
        nodes[str(name)] = MarkerShapes(places[own].mean(axis=0), basis[own].mean(axis=0), rotation)
    D = found.get("dampingMatrixReduced", np.zeros((n, n)))
    integrals = InertiaIntegrals(G, S, mass)
    loss = found["massMatrixReduced"] - np.einsum("aaij->ij", G)[1:, 1:]
    notes: tuple[str, ...] = ()
    if np.abs(loss).max() > 1e-6 * np.abs(found["massMatrixReduced"]).max():
        notes = ("massMatrixReduced isn't what mPsiTildePsiTilde gives; the latter is taken",)
    return ModalData(integrals, found["stiffnessMatrixReduced"], D, nodes, notes, **_surface(found, n))


def _surface(found: Mapping[str, NDArray[Any]], n: int) -> dict[str, Any]:
    """Surface and stress, where `exudyn_arrays` has written them; nothing else in the file tells stress unpickled."""
    if "surfaceStress" not in found:
        return {}
    stress, triangles, edges = (found[name] for name in ("surfaceStress", "trigList", "surfaceEdges"))
    if stress.shape[1:] != (6, n) or triangles.shape[1:] != (3,) or max(triangles.max(), edges.max()) >= len(stress):
        raise ValueError(f"surfaceStress has shape {stress.shape}, which its triangles don't fit")
    return {"surface": SurfaceTopology(np.arange(len(stress)), triangles, edges), "stress": stress}


def _products(T: Array) -> Array:
    """Return ``∫ a_c b_d dm`` of ``∫ ãᵀ b̃ dm`` (3, 3, …)."""
    trace = 0.5 * np.einsum("aa...->...", T)
    return np.asarray(np.multiply.outer(np.eye(3), trace) - T).swapaxes(0, 1)


def _write(body: ExportedBody, path: Path) -> list[Path]:
    """Write a body, and a script beside it that loads it."""
    reduced, surface, stress = body.in_space()
    nodes = slice(None) if surface is None else surface.nodes
    x, shapes = reduced.x[nodes], reduced.shapes[nodes]
    data = without_stiffening(body.modal_data(stiffened=False))
    write_exudyn(path, exudyn_arrays(data, x, shapes, surface, stress))
    script = path.with_suffix(".py")
    template = files("fmd.reduction.formats").joinpath("exudyn_body.py.txt").read_text(encoding="utf-8")
    write_text(script, template.replace("@FILE@", path.name).replace("@BODY@", body.name))
    return [path, script]


FORMAT = BodyFormat(_write, read_exudyn, second_order=False)
