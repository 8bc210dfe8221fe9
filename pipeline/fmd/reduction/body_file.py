"""Reduced bodies as NetCDF files: enough for motion and surface stress, without mesh or matrices."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fmd.core.arrays import Array, IntArray, read_only, require_shape
from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError
from fmd.core.files import whole_file
from fmd.fem.surface import SurfaceTopology
from fmd.reduction.body import FlexibleBody, MarkerShapes
from fmd.reduction.inertia import InertiaIntegrals

if TYPE_CHECKING:
    import xarray

FORMAT = "fmd reduced body"
VERSION = 2
_NO_ERROR = "not stated: shapes and matrices are input of other runs; an error budget of this body's scene tells"

# Dimensions, unit and meaning of each variable. "motions" are three translations and three rotations of the frame, then
# the modes; "state" is (1, q). A dimension may stand in a variable only once, hence the second of some.
_VARIABLES: dict[str, tuple[tuple[str, ...], str, str]] = {
    "marker": (("marker",), "", "names of the markers"),
    "x": (("node", "axis"), "m", "undeformed node positions relative to the joint"),
    "origin": (("axis",), "m", "position of the joint in the part's own coordinates, as in its mesh or CAD file"),
    "shapes": (("node", "axis", "mode"), "kg^-0.5", "basis: displacement for a unit of each modal coordinate"),
    "omega": (("mode",), "rad/s", "angular frequencies of the basis"),
    "joint_axis": (("axis",), "1", "unit vector of the joint's axis"),
    "coupling": ((), "1", "|M_theta_q| / sqrt(J) in the reference state"),
    "marker_position": (("marker", "axis"), "m", "undeformed position relative to the joint"),
    "marker_translation": (
        ("marker", "axis", "mode"), "kg^-0.5", "displacement for a unit of each modal coordinate",
    ),
    "marker_rotation": (
        ("marker", "axis", "mode"), "rad m^-1 kg^-0.5", "rotation for a unit of each modal coordinate",
    ),
    "marker_displacement2": (
        ("marker", "marker_motion", "mode", "mode_2"), "m^-1 kg^-1, rad m^-2 kg^-1",
        "second order of a marker's displacement and rotation: q^T displacement2 q / 2",
    ),
    "mass": ((), "kg", "mass"),
    "G": (
        ("axis", "axis_2", "state", "state_2"), "kg m^2, kg^0.5 m, 1",
        "Inertia shape integrals U_a^T m U_b: second moments, moment-mode and mode-mode integrals",
    ),
    "S": (("axis", "state"), "kg m, kg^0.5", "first moments 1^T m U_a"),
    "stiffening": (
        ("axis", "axis_2", "mode", "mode_2"), "1", "geometric stiffness that was taken off the modal blocks of G",
    ),
    "displacement2": (("axis", "mode", "mode_2"), "m^-1", "second-order first moments: c_a = S_a p + q^T B_a q / 2"),
    "rotation2": (("axis", "mode", "mode_2"), "1", "second-order angular momentum of the deforming: q^T C_a q'"),
    "M_hat": (
        ("motion", "motion_2"), "kg, kg m, kg m^2, kg^0.5, kg^0.5 m, 1",
        "mass matrix of translation, rotation and modes in the reference state",
    ),
    "K_hat": (("motion", "motion_2"), "s^-2", "stiffness matrix of translation, rotation and modes"),
    "elastic_frequencies": (("elastic_mode",), "Hz", "frequencies of the elastic modes that the basis is made of"),
    "surface_nodes": (("surface_node",), "1", "node numbers on the surface, ascending"),
    "triangles": (("triangle", "corner"), "1", "places in surface_nodes, counter-clockwise seen from outside"),
    "edges": (("edge", "end"), "1", "places in surface_nodes: outlines of the element faces"),
    "surface_stress": (
        ("surface_node", "component", "mode"), "Pa kg^-0.5 m^-1", "stress for a unit of each modal coordinate",
    ),
}  # fmt: skip
_SECOND_ORDER = ("stiffening", "displacement2", "rotation2")
# Errors of xarray and SciPy's reader on damaged files.
_UNREADABLE = (ValueError, TypeError, LookupError, AttributeError, OverflowError, MemoryError)


@dataclass(frozen=True)
class SavedBody:
    """Reduced body with its surface and stress, as a file holds them."""

    body: FlexibleBody
    surface: SurfaceTopology | None = None
    # (n_surface, 6, n): stress of each modal coordinate at the surface's nodes: xx, yy, zz, yz, xz, xy [Pa per unit]
    stress: Array | None = None
    elastic_hz: Array | None = None  # frequencies of the elastic modes that the basis is made of [Hz]


def save_body(
    path: str | Path,
    body: FlexibleBody,
    surface: SurfaceTopology | None = None,
    stress: Array | None = None,
    elastic_hz: Array | None = None,
) -> None:
    """Write a reduced body to a file, which appears whole or not at all.

    The arguments are those of `SavedBody`.

    Raises
    ------
    ValueError
        Stress without a surface, or of another shape.
    OSError
        The place can't be written.
    """
    dataset = body_dataset(SavedBody(body, surface, stress, elastic_hz))
    with whole_file(Path(path)) as part:
        dataset.to_netcdf(part, engine="scipy")


def load_body(path: str | Path) -> SavedBody:
    """Read a reduced body from a file, every number to the last bit as it was saved.

    Raises
    ------
    InputError
        The file can't be read, holds no reduced body, is of another version, cut off, or lacks a variable.
    """
    import xarray

    def refuse(mend: str) -> InputError:
        return InputError(str(path), "", None, mend)

    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise refuse(f"can't be read: {error.strerror or error}") from error
    if content[:4] != b"CDF\x02":
        raise refuse("no file of a reduced body: these are NetCDF 3 with 64-bit offsets")
    try:
        with xarray.open_dataset(io.BytesIO(content), engine="scipy", mask_and_scale=False, decode_times=False) as file:
            dataset = file.load()
    except _UNREADABLE as error:
        raise refuse(f"damaged or cut off: {error}") from error
    if dataset.attrs.get("format") != FORMAT:
        raise refuse("a NetCDF file, but not of a reduced body")
    if dataset.attrs.get("format_version") != VERSION:
        raise refuse(
            f"a reduced body of format version {dataset.attrs.get('format_version')}; this program reads {VERSION}"
        )
    try:
        return _saved(dataset)
    except LookupError as error:
        raise refuse(f"a reduced body that lacks {error}") from error
    except ValueError as error:
        raise refuse(f"a reduced body that contradicts itself: {error}") from error


def body_dataset(saved: SavedBody) -> xarray.Dataset:
    """Gather a reduced body in one labelled data set with units and descriptions as attributes."""
    import xarray

    arrays = _arrays(saved)
    data = {}
    for name, values in arrays.items():
        dims, unit, text = _VARIABLES[name]
        data[name] = (dims, values, {"units": unit, "long_name": text} | _layout(values))
    coordinates: dict[str, Any] = {
        "marker": ("marker", list(saved.body.markers), {"long_name": _VARIABLES["marker"][2]}),
        "axis": ["x", "y", "z"],
    }
    if saved.stress is not None:
        coordinates["component"] = ["xx", "yy", "zz", "yz", "xz", "xy"]
    attributes = {"format": FORMAT, "format_version": VERSION, "joint": saved.body.joint, "error": _NO_ERROR}
    return xarray.Dataset(data, coordinates, attributes)


def _arrays(saved: SavedBody) -> dict[str, NDArray[Any]]:
    """Arrays of a saved body by their names in the file; empty ones are left out."""
    body, surface = saved.body, saved.surface
    integrals, markers = body.integrals, list(body.markers.values())
    n = len(body.omega)
    arrays: dict[str, NDArray[Any]] = {
        "x": body.x,
        "origin": body.origin,
        "shapes": body.shapes,
        "omega": body.omega,
        "joint_axis": body.axis,
        "coupling": np.array(body.coupling),
        "marker_position": np.array([marker.position for marker in markers]),
        "marker_translation": np.array([marker.translation for marker in markers]),
        "marker_rotation": np.array([marker.rotation for marker in markers]),
        "mass": np.array(integrals.mass),
        "G": integrals.G,
        "S": integrals.S,
        "M_hat": integrals.mass_matrix(np.eye(1, 1 + n)[0]),
        "K_hat": np.diag(np.r_[np.zeros(6), body.omega**2]),
    }
    # NetCDF has no room for empty arrays.
    arrays |= {name: a for name in _SECOND_ORDER if (a := getattr(integrals, name)).size}
    if any(marker.displacement2.size for marker in markers):
        none = np.zeros((6, n, n))
        arrays["marker_displacement2"] = np.array(
            [marker.displacement2 if marker.displacement2.size else none for marker in markers]
        )
    if saved.elastic_hz is not None:
        arrays["elastic_frequencies"] = saved.elastic_hz
    if surface is not None:
        arrays |= {"surface_nodes": surface.nodes, "triangles": surface.triangles, "edges": surface.edges}
    if saved.stress is not None:
        if surface is None:
            raise ValueError("stress belongs to a surface, but there is none")
        require_shape("stress", saved.stress, (len(surface.nodes), 6, n))
        arrays["surface_stress"] = saved.stress
    return arrays


def _saved(dataset: xarray.Dataset) -> SavedBody:
    """Make the body of a data set; ``KeyError`` names a missing variable, ``ValueError`` a contradiction."""

    def variable(name: str) -> xarray.DataArray:
        if name not in dataset:
            raise KeyError(name)
        if (dims := dataset[name].dims) != (wanted := _VARIABLES[name][0]):
            raise ValueError(f"{name} has dimensions {dims}, expected {wanted}")
        return dataset[name]

    def real(name: str) -> Array:
        array = variable(name)
        return _restore_layout(array.to_numpy().astype(np.float64), array.attrs.get("layout"))

    def whole(name: str) -> IntArray:
        return variable(name).to_numpy().astype(np.int64)

    names = variable("marker").to_numpy().tolist()
    displacements2 = (
        [
            displacement2 if displacement2.any() else displacement2[:, :0, :0]
            for displacement2 in real("marker_displacement2")
        ]
        if "marker_displacement2" in dataset
        else []
    )
    shapes = (real(f"marker_{key}") for key in ("position", "translation", "rotation"))
    columns = zip(*shapes, *([displacements2] if displacements2 else []), strict=True)
    markers = {name: MarkerShapes(*values) for name, values in zip(names, columns, strict=True)}
    joint = str(dataset.attrs["joint"])
    if joint not in markers:
        raise ValueError(f"the joint's marker '{joint}' is none of {', '.join(markers)}")
    G, n = real("G"), dataset.sizes["mode"]
    require_shape("G", G, (3, 3, 1 + n, 1 + n))
    second_order: dict[str, Any] = {name: read_only(real(name)) for name in _SECOND_ORDER if name in dataset}
    body = FlexibleBody(
        x=real("x"),
        shapes=real("shapes"),
        omega=real("omega"),
        axis=real("joint_axis"),
        joint=joint,
        markers=markers,
        integrals=InertiaIntegrals(read_only(G), read_only(real("S")), float(real("mass")), **second_order),
        coupling=float(real("coupling")),
        origin=real("origin"),
    )
    surface = None
    if "surface_nodes" in dataset:
        surface = SurfaceTopology(whole("surface_nodes"), whole("triangles"), whole("edges"))
    return SavedBody(
        body,
        surface,
        real("surface_stress") if "surface_stress" in dataset else None,
        real("elastic_frequencies") if "elastic_frequencies" in dataset else None,
    )


def _layout(a: NDArray[Any]) -> dict[str, list[int]]:
    """Note an array's axes from the slowest in memory to the fastest, if that isn't their own order.

    Sums over an array run along its memory: laid out another way, G would give inertia tensors with other last bits.
    """
    order = np.argsort([-stride for stride in a.strides], kind="stable").tolist()
    return {} if order == sorted(order) else {"layout": order}


def _restore_layout(a: Array, order: Any) -> Array:
    """Lay an array out in memory as `_layout` has noted."""
    return a if order is None else np.ascontiguousarray(a.transpose(order)).transpose(np.argsort(order))
