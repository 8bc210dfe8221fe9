"""Flexible bodies that are read as reduced bodies from files, of other programs and of this one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.errors import InputError, as_input_error
from fmd.core.units import unit_ratio
from fmd.fem.formats.node_places import read_places
from fmd.reduction.formats.body_format import BodyFormat, body_format
from fmd.reduction.given_superelement import GivenSuperelement, Recovery
from fmd.reduction.modal_data import ModalData, without_stiffening
from fmd.scene.outputs import READ_FORMATS
from fmd.scene.reading import suggest_name

if TYPE_CHECKING:
    from fmd.core.arrays import Array
    from fmd.fem.markers import Marker
    from fmd.fem.model import FEModel
    from fmd.reduction.body import FlexibleBody
    from fmd.reduction.equivalent_model import EquivalentModel
    from fmd.reduction.modes import Modes
    from fmd.scene.any_body import Flexible
    from fmd.scene.reduced_bodies import BodyFile
    from fmd.scene.source_files import SourceFiles
    from fmd.stages.basis import ConstrainedModel


def read_reduced_body(shape: Flexible, source: SourceFiles | None, file: str, body: str) -> EquivalentModel:
    """Read a reduced body from the file that a scene names.

    Raises
    ------
    InputError
        No format of bodies that are read has the file's suffix, it can't be read, or the scene says of it what it tells
        itself.
    """
    from fmd.reduction.equivalent_model import equivalent_model

    assert shape.shape == "reduced"
    assert source is not None
    path = Path(source.paths["file"])
    for own in _formats_of(path.suffix.lower()):
        if own.read_superelement is not None:
            return equivalent_model(
                _read_superelement(own.read_superelement(path), shape.body, source, (file, f"body.{body}.body"))
            )
        if own.read is not None:
            if said := [key for key in shape.body.model_fields_set if key != "file"]:
                mend = "belongs to superelements (.pch, .op4, .op2, .mtx); this file is in SI units and has all of that"
                raise InputError(file, f"body.{body}.body.{said[0]}", getattr(shape.body, said[0]), mend)
            return equivalent_model(own.read(path))
    formats = {suffixes[0].lower(): body_format(name) for name, suffixes in READ_FORMATS.items()}
    read = [suffix for suffix, own in formats.items() if own.read or own.read_superelement]
    raise InputError(str(path), "", None, f"is no file of a reduced body that is read; these are: {' '.join(read)}")


def _read_superelement(
    given: GivenSuperelement, table: BodyFile, source: SourceFiles, where: tuple[str, str]
) -> ModalData:
    """Complete a superelement by its nodes, its units and its points within, as a scene's table has them."""
    from fmd.reduction.superelement_data import superelement_data

    length, path = unit_ratio(table.unit, "m"), source.paths["file"]
    if table.nodes is not None:
        found = read_places(source.paths["nodes"])
        given = replace(
            given,
            unknowns=given.unknowns or found.unknowns,
            nodes={**given.nodes, **found.places},
            axes={**given.axes, **found.axes},
        )
    if len(given.unknowns) != len(given.K):
        listed = f"lists {len(given.unknowns)} unknowns by EXTRN, and {path} has {len(given.K)} rows"
        mend = f"{listed}; name the .pch of that run, which has EXTRN"
        raise InputError(where[0], f"{where[1]}.nodes", table.nodes, mend)
    with as_input_error(str(path)):
        to_file = given.to_file(length)
    given = given.in_si(length, unit_ratio(table.stiffness_unit, "N/m"), unit_ratio(table.mass_unit, "kg"))
    recovery = None if table.recovery is None else _read_recovery(source, length, to_file)
    return superelement_data(path, given, table.mass, recovery)


def _read_recovery(source: SourceFiles, length: float, to_file: Array) -> Recovery:
    """Read motion of points within by the unknowns in the part's axes, of which ``to_file`` makes those of the file."""
    from fmd.fem.formats.matrix_readers import read_rows

    rows, found = read_rows(source.paths["recovery"]), read_places(source.paths["recovery_nodes"])
    n, each = len(found.places), rows.shape[0] // max(len(found.places), 1)
    if each not in (3, 6) or rows.shape != (each * n, len(to_file)):
        raise InputError(
            str(source.paths["recovery"]), "", None,
            f"has {rows.shape[0]} rows and {rows.shape[1]} columns; {n} points have three rows each, or six, and the "
            f"superelement has {len(to_file)} unknowns",
        )  # fmt: skip
    axes = np.array([found.axes.get(label, np.eye(3)) for label in found.places])  # in which the rows are
    matrix = axes @ rows.toarray().reshape(n, each, -1)[:, :3] @ to_file
    return Recovery(tuple(found.places), length * np.array([*found.places.values()]), matrix)


def _formats_of(suffix: str) -> Iterator[BodyFormat]:
    """Yield the formats of bodies whose files have a suffix, given in lower case."""
    for name, suffixes in READ_FORMATS.items():
        if suffix in map(str.lower, suffixes):
            yield body_format(name)


def modes_of_file(fe: FEModel) -> Modes:
    """Return the modes of the free body in the space of its file's shapes."""
    from fmd.reduction.equivalent_model import modes_of

    return modes_of(_equivalent(fe))


def file_notes(fe: FEModel) -> tuple[str, ...]:
    """Return what a body's file says that can't be right, and what was taken instead."""
    return _equivalent(fe).data.notes


def place_file_markers(fe: FEModel, shape: Flexible, file: str, body: str) -> dict[str, Marker]:
    """Place a body's markers on the nodes of its file.

    Raises
    ------
    InputError
        There is no such node, or it doesn't turn.
    """
    from fmd.reduction.equivalent_model import equivalent_marker

    assert shape.shape == "reduced"
    model, markers = _equivalent(fe), {}
    for name, marker in shape.marker.items():
        key = f"body.{body}.marker.{name}.node"
        for label in marker.labels:
            if label not in model.data.nodes:
                mend = f"no such node; {suggest_name(label, model.data.nodes, 'the nodes of the file')}"
                raise InputError(file, key, label, mend)
        with as_input_error(file, key, marker.node):
            markers[name] = equivalent_marker(model, [model.data.nodes[label] for label in marker.labels])
    return markers


def reduce_file_body(
    model: ConstrainedModel, modes: Modes, shape: Flexible, frame: str, stiffening: str
) -> FlexibleBody:
    """Refer a file's body to the joint that carries it, without its geometric stiffening if that is ``"off"``.

    Raises
    ------
    InputError
        Its geometric stiffening belongs to a frame that the joint doesn't keep, or can't be taken out.
    """
    from fmd.reduction.equivalent_model import finish_body
    from fmd.stages.basis import reduce_body

    assert shape.shape == "reduced"
    in_space = replace(model, joint=replace(model.joint, normal=-1))
    body = reduce_body(in_space, modes, shape.modes, frame)
    labels = {name: marker.labels for name, marker in shape.marker.items()}
    fe = _equivalent(model.fe)
    if stiffening == "off" and fe.data.in_own_frame:
        if not fe.data.is_separable:
            mend = f"can't be told apart from inertia in {shape.body.file}, whose Gr has no first order; take 'auto'"
            raise InputError(model.file, "simulation.stiffening", stiffening, mend)
        fe = replace(fe, data=without_stiffening(fe.data))
    with as_input_error(model.file, f"body.{model.name}.body.file", shape.body.file):
        return finish_body(fe, body, labels)


def _equivalent(fe: FEModel) -> EquivalentModel:
    from fmd.reduction.equivalent_model import EquivalentModel

    assert isinstance(fe, EquivalentModel)
    return fe
