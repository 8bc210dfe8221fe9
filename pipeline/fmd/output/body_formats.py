"""A flexible body in the formats of other multibody programs: one function each, for the registry of formats."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from fmd.core.errors import InputError
from fmd.core.files import whole_file
from fmd.reduction.formats import exudyn_file, mbdyn_file, sid_file
from fmd.reduction.modal_data import ModalData, modal_data, without_stiffening
from fmd.scene.damping import damping_ratios
from fmd.stages.part import FlexiblePart
from fmd.stages.pipeline import Pipeline
from fmd.stages.spatial_body import spatial_body, superelement, surface_stress


def write_sid(run: Pipeline, body: str | None, path: Path) -> list[Path]:
    """Write a body's standard input data, with geometric stiffening unless the scene turns it off."""
    sid_file.write_sid(path, _data(_part(run, body), not run.scene.moves or run.scene.simulation.stiffening != "off"))
    return [path]


def write_mbdyn(run: Pipeline, body: str | None, path: Path) -> list[Path]:
    """Write a body for MBDyn's modal joint."""
    mbdyn_file.write_mbdyn(path, _data(_part(run, body), stiffened=False))
    return [path]


def write_exudyn(run: Pipeline, body: str | None, path: Path) -> list[Path]:
    """Write a body for Exudyn, and a script beside it that loads it."""
    part = _part(run, body)
    reduced, data = spatial_body(part, stiffened=False), _data(part, stiffened=False)
    drawn: dict[str, Any] = {"x": reduced.x, "shapes": reduced.shapes}
    if part.has_stress:
        nodes = part.surface.nodes
        drawn = {"x": reduced.x[nodes], "shapes": reduced.shapes[nodes], "surface": part.surface}
        drawn["stress"] = surface_stress(part, reduced)
    exudyn_file.write_exudyn(path, exudyn_file.exudyn_arrays(data, **drawn))
    script = path.with_suffix(".py")
    template = files("fmd.output").joinpath("exudyn_body.py.txt").read_text(encoding="utf-8")
    with whole_file(script) as half:
        half.write_text(template.replace("@FILE@", path.name).replace("@BODY@", part.name), encoding="utf-8")
    return [path, script]


def write_simscape(run: Pipeline, body: str | None, path: Path) -> list[Path]:
    """Write a body as a superelement for Simscape Multibody."""
    from fmd.reduction.formats.superelement_files import write_simscape as write

    write(path, superelement(_part(run, body)))
    return [path]


def write_openfast(run: Pipeline, body: str | None, path: Path) -> list[Path]:
    """Write a body as a superelement for OpenFAST's module ExtPtfm, and the module's input file."""
    from fmd.reduction.formats.superelement_files import write_extptfm

    part = _part(run, body)
    gravity = np.array(run.scene.simulation.gravity if run.scene.moves else (0.0, 0.0, 0.0))
    try:
        return write_extptfm(path, superelement(part), gravity)
    except ValueError as error:
        mend = f"{error}; name one by modes.boundary = 'interface' and modes.interface = ['…']"
        raise InputError(part.file, f"body.{part.name}.modes.interface", None, mend) from error


def write_full(run: Pipeline, body: str | None, path: Path) -> list[Path]:
    """Write a body's full matrices, nodes and modes."""
    from fmd.fem.formats.matrices import MatrixModel
    from fmd.fem.formats.matrix_files import write_matrices, write_modes

    part = _part(run, body)
    if part.is_reduced:
        mend = "is a reduced body, and has no full matrices"
        raise InputError(part.file, f"body.{part.name}.body", None, mend)
    labels = part.fe.labels if isinstance(part.fe, MatrixModel) else np.arange(1, len(part.fe.x) + 1)
    modes = path.with_name(f"{path.stem}-modes.npz")
    written = write_matrices(path, part.fe, labels)
    write_modes(modes, labels, part.modes.frequencies_hz, part.modes.shapes)
    return [*written, modes]


def _part(run: Pipeline, body: str | None) -> FlexiblePart:
    assert body is not None  # the formats here hold one body
    return run.parts[body]


def _data(part: FlexiblePart, stiffened: bool) -> ModalData:
    body = spatial_body(part, stiffened)
    data = modal_data(body, np.array(damping_ratios(part.shape.modes.damping, body.omega.tolist())))
    return data if stiffened else without_stiffening(data)  # a body from a file may bring its own
