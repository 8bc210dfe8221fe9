"""Reduced bodies in our own NetCDF files: modes, mass, stiffness, inertia integrals and the stress of each mode."""

from pathlib import Path

import numpy as np

from fmd.core.errors import InputError
from fmd.reduction.body import MarkerShapes
from fmd.reduction.body_file import load_body, save_body
from fmd.reduction.formats.body_format import BodyFormat
from fmd.reduction.modal_data import ModalData


def read_netcdf(path: Path) -> ModalData:
    """Read a body from the NetCDF file of ``fmd export --to python``: nodes numbered from 0, and its markers by name.

    Raises
    ------
    InputError
        The file can't be read, holds no reduced body, or one for motion about an axis alone.
    """
    saved = load_body(path)
    body, n = saved.body, len(saved.body.omega)
    if body.integrals.normal >= 0:
        raise InputError(str(path), "", None, "has the inertia of motion about one axis alone; write it anew")
    unknown = np.full((3, n), np.nan)
    places = enumerate(zip(body.x, body.shapes, strict=True))
    nodes = {str(k): MarkerShapes(x, shapes, unknown) for k, (x, shapes) in places}
    second = body.integrals.stiffening, body.integrals.displacement2, body.integrals.rotation2
    return ModalData(
        body.integrals,
        np.diag(body.omega**2),
        np.zeros((n, n)),
        nodes | dict(body.markers),
        in_own_frame=any(term.any() for term in second),
        surface=saved.surface,
        stress=saved.stress,
    )


FORMAT = BodyFormat(lambda body, path: save_body(path, *body.in_scene(), body.frequencies_hz()), read_netcdf)
