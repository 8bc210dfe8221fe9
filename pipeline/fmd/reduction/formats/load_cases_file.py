"""Decks for Abaqus and CalculiX that compute what a body of its matrices lacks: the stress of its shapes, and its K_G.

The first deck has a static step for each load. CalculiX's answers, ``.frd``, tell the stress. With its ``.dat`` beside
that deck one more is written for each load that stiffens solids. It has the stress at the points of integration as
initial stress of a body that is held at rest: to a deformed one CalculiX, as others, would add the stiffness by the
displacement to that by the stress. Then it writes the stiffness of the free body.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import qr

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import InputError
from fmd.core.files import read_text, whole_file
from fmd.core.limits.files import LARGEST_CASE
from fmd.core.limits.round_off import SOLVED, SUMMED
from fmd.fem.formats.abaqus import deck_sections
from fmd.fem.formats.program_fields import read_point_stress
from fmd.reduction.formats.body_format import BodyFormat, LoadCases
from fmd.reduction.loads import PRODUCTS, centrifugal_fields, inertia_of

if TYPE_CHECKING:
    from fmd.fem.markers import Marker
    from fmd.fem.model import FEModel
    from fmd.reduction.eigen import FreeBodySolver


_AXES = "xyz"


def stiffening_cases(fe: FEModel, solver: FreeBodySolver, markers: Mapping[str, Marker]) -> dict[str, Array]:
    """Return the loads whose combinations are all that stiffen a body, by name, each of shape (n_nodes, 3) [N].

    Products of angular rates and unit forces and torques at each marker, balanced by the body's own inertia. Reactions
    of joints and inertia of rigid motions are combinations of these, so no joint and no support counts. Loads without
    stress are left out, as that of a straight shaft's turning about itself.
    """
    names = [f"spin-{_AXES[a]}{_AXES[b]}" for a, b in PRODUCTS]
    names += [f"{name}-{what}{axis}" for name in markers for what in "fm" for axis in _AXES]
    columns = [marker.columns(len(fe.x), np.eye(3)) for marker in markers.values()]
    loads = np.concatenate([inertia_of(fe, centrifugal_fields(fe.x, None)), *columns], axis=2)
    u = solver.static_response(loads)
    strained = np.abs(fe.K @ u.reshape(-1, len(names))).max(axis=0) > SOLVED * np.abs(loads).max(axis=(0, 1))
    return dict(zip(np.array(names)[strained].tolist(), _loads_of(fe, u[:, :, strained]), strict=True))


def shape_cases(fe: FEModel, shapes: Array) -> dict[str, Array]:
    """Return the loads under which a body deforms as its shapes (n_nodes, 3, n), by name, shapes (n_nodes, 3) [N]."""
    return {f"mode-{number}": load for number, load in enumerate(_loads_of(fe, shapes), start=1)}


def _loads_of(fe: FEModel, u: Array) -> list[Array]:
    """Return loads ``K u`` by which the largest displacement is `LARGEST_CASE` of the body's size, rigid ones aside."""
    size = float(np.ptp(fe.x, axis=0).max())
    Q = np.linalg.qr(fe.rigid_modes)[0]
    flat = u.reshape(len(Q), -1)
    deformed = np.abs(flat - Q @ (Q.T @ flat)).max(axis=0)
    scale = LARGEST_CASE * size / np.where(deformed > 0.0, deformed, np.inf)
    return [load.reshape(-1, 3) for load in (fe.K @ (flat * scale)).T]


_SECTIONS = ("SOLID SECTION", "SHELL SECTION", "BEAM SECTION")


def write_load_cases(path: Path, cases: LoadCases) -> list[Path]:
    """Write the deck of all loads and, if CalculiX's ``.dat`` lies beside it, those of the geometric stiffness.

    Raises
    ------
    InputError
        The ``.dat`` has another number of steps, or the deck has no sections.
    """
    model = re.split(r"(?im)^\s*\*\s*STEP\b", cases.deck)[0].rstrip() + "\n"
    named = [card.get("ELSET") for _, keyword, card, _ in deck_sections(model) if keyword in _SECTIONS]
    sections = [f'"{name}"' if f'"{name}"' in model else name for name in dict.fromkeys(named) if name]
    if not sections:  # CalculiX tells a name in quotes from one without
        raise InputError(
            str(path),
            "",
            None,
            f"the deck of nodes has no *{' and no *'.join(_SECTIONS)}, whose stress is wanted",
        )
    support = _support(cases)
    prints = [f"*EL PRINT, ELSET={name}\nS" for name in sections]
    every = cases.stiffening | cases.shapes
    steps = [_step(name, cases.labels, load, prints) for name, load in every.items()]
    written = [_write(path, [model, support, *steps])]
    answers = path.with_suffix(".dat")
    if not answers.is_file() or len(cases.rigid) > 3 * len(cases.labels):  # of nodes that turn CalculiX has no K_G
        return written
    stress = read_point_stress(read_text(answers))
    if len(stress) != len(every):
        fault = f"has the stress of {len(stress)} steps, and {path.name} has {len(every)}; run it anew"
        raise InputError(str(answers), "", None, fault)
    for (name, load), own in zip(cases.stiffening.items(), stress, strict=False):
        initial = "\n".join(["*INITIAL CONDITIONS, TYPE=STRESS", *own, ""])
        deck = [model, initial, *_stored(name, cases.labels, load)]
        written.append(_write(path.with_name(f"{path.stem}-kg-{name}.inp"), deck))
    return written


def _support(cases: LoadCases) -> str:
    """Return six single unknowns that hold the body without strain, displacements as far as they can."""
    n_each = len(cases.rigid) // len(cases.labels)
    rigid = (cases.rigid / np.abs(cases.rigid).max(axis=0)).reshape(-1, n_each, 6)
    rigid[:, 3:] *= SOLVED
    fixed = qr(rigid.reshape(-1, 6).T, mode="r", pivoting=True)[1][:6]
    each = (divmod(k, n_each) for k in sorted(fixed.tolist()))
    lines = [f"{cases.labels[node]}, {axis + 1}, {axis + 1}" for node, axis in each]
    return "\n".join(["*BOUNDARY", *lines, ""])


def _stored(name: str, labels: IntArray, load: Array) -> list[str]:
    """Return a step in which all but one displacement are held, and one that writes the free body's matrices.

    A body that is held more softly would answer to the digits that the stress has too few.
    """
    held = "\n".join(["*BOUNDARY", f"{labels[0]}, 1, 2", *(f"{label}, 1, 3" for label in labels[1:]), ""])
    end = ["*STEP, PERTURBATION", "*BOUNDARY, OP=NEW", "*FREQUENCY, SOLVER=MATRIXSTORAGE", "1", "*END STEP", ""]
    return [held, _step(name, labels, load, []), "\n".join(end)]


def _step(name: str, labels: IntArray, load: Array, prints: Sequence[str]) -> str:
    """Return a static step under a load."""
    lines = ["*STEP", f"** {name}", "*STATIC", "*CLOAD, OP=NEW"]
    least = SUMMED * np.abs(load).max()
    for label, forces in zip(labels, load.tolist(), strict=True):
        lines += [f"{label}, {axis}, {force:.12e}" for axis, force in enumerate(forces, start=1) if abs(force) > least]
    lines += ["*NODE FILE", "U", "*EL FILE", "S", *prints, "*END STEP", ""]
    return "\n".join(lines)


def _write(path: Path, parts: Sequence[str]) -> Path:
    with whole_file(path) as part, part.open("w", encoding="utf-8") as stream:
        stream.writelines(parts)
    return path


FORMAT = BodyFormat(lambda body, path: write_load_cases(path, body.load_cases()))
