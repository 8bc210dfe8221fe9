"""A scene's frequencies: at rest beside its reference, and on a hub that turns."""

from dataclasses import asdict
from typing import Any

import numpy as np

from fmd.core.limits.scene import LUMPING_COUNTS, POOR_QUALITY, THICK_LAYERS
from fmd.recovery.half_waves import half_waves
from fmd.recovery.plies import shells_of
from fmd.reduction.rotating import rotating_modes
from fmd.scene.imported_bodies import MatrixPart
from fmd.scene.magnitudes import UNUSUAL, find_unusual
from fmd.scene.outputs import Export
from fmd.stages.file_sizes import unusual_sizes
from fmd.stages.part import FlexiblePart
from fmd.stages.pipeline import Pipeline


def frequency_table(run: Pipeline) -> dict[str, Any]:
    """Gather what the modes stage found and how far it is from the scene's reference.

    Of a part in pieces the frequencies are those of the pieces put together.
    """
    divided = run.division.divided.get(run.part.name)
    found = run.modes.frequencies_hz if divided is None else divided.frequencies_hz
    wanted = np.array(run.scene.reference.frequencies if run.scene.reference else ())[: len(found)]
    known = {
        "frequencies_hz": found.tolist(),
        "reference_hz": wanted.tolist(),
        "relative_error": (found[: len(wanted)] / wanted - 1).tolist(),
    }
    if divided is not None:
        return known | {
            "rigid_modes": 0 if divided.whole.shape.support else 6,
            "mode_numbers": list(range(1, len(found) + 1)),
            "dofs": 3 * len(divided.whole.space.x),
            "residual": max(part.modes.residual for part in divided.pieces),
            "factor": None,
        }
    return known | {
        "rigid_modes": run.modes.n_rigid,
        "mode_numbers": list(run.modes.numbers),
        "dofs": run.modes.dofs,
        "residual": run.modes.residual,
        "factor": None if run.modes.factor is None else asdict(run.modes.factor),
    }


def frequencies_by_body(run: Pipeline) -> dict[str, dict[str, Any]]:
    """Gather each flexible body's ``frequencies_hz``, of which ``boundary``, and the ``mesh_notes`` on its file."""
    divided = run.division.divided
    return {
        name: {
            "frequencies_hz": (divided[name].frequencies_hz if name in divided else part.modes.frequencies_hz).tolist(),
            "boundary": _name_boundary(part, name in divided),
            "mesh_notes": list(part.mesh_notes),
        }
        for name, part in run.wholes.items()
    }


def _name_boundary(part: FlexiblePart, divided: bool) -> str:
    """Name what holds a part while it vibrates in its modes."""
    if part.is_reduced:
        return "as in its file"
    if not divided and part.shape.modes.boundary == "joint" and not part.joint.floating:
        return "held at its joint"
    if part.shape.support:
        return "on its supports"
    return "free of its joint" if part.joint.marker else "free"


def mode_warnings(run: Pipeline) -> list[dict[str, str]]:
    """Warn of unusual values, poor meshes, and bases with more modes than requested, to complete a group of equal ones.

    Each warning has ``code``, ``body`` and ``text``.
    """
    found = [{"code": UNUSUAL, "text": text} for text in find_unusual(run.scene)]
    for name, part in run.wholes.items():
        if part.shape.file_keys[:1] == ("mesh",) and (quality := float(part.mesh.quality.min())) < POOR_QUALITY:
            text = f"{name}: an element has a scaled Jacobian of {quality:.2g}; results around it are poor"
            found.append({"code": "poor-mesh", "body": name, "text": text})
        if lost := [note for note in part.mesh_notes if "aren't solid" in note]:
            text = (
                f"{name}: {lost[0].removeprefix('mended: ')}; what links and masses do takes link and mass of the body"
            )
            found.append({"code": "left-out", "body": name, "text": text})
        found += _midsurface_warnings(name, part)
        if len(run.pieces_of(name)) > 1:  # whose modes are those of its pieces
            continue
        tied = part.fe if part.shape.file_keys[:1] == ("mesh",) and part.mesh.connections is not None else None
        for label, share in getattr(tied, "part_ties", {}).items():
            text = f"{name}: {label} holds {100 * share:.2g} % of its edge; beside the rest is nothing near enough"
            found.append({"code": "tie-in-part", "body": name, "text": text})
        if (cost := _cost_of_lumping(part)) > LUMPING_COUNTS:
            text = (
                f"{name}: its masses are lumped on nodes, which changes a frequency of its modes by about "
                f"{100 * cost:.2g} %; finer elements, or a lumped mass matrix of the other program, leave less"
            )
            found.append({"code": "masses-lumped", "body": name, "text": text})
        if text := _thick_layers(part):
            found.append({"code": "thick-layers", "body": name, "text": f"{name}: {text}"})
        found += [{"code": "unusual-size", "body": name, "text": text} for text in unusual_sizes(part)]
        count, more = part.shape.modes.count, part.modes.n_completing
        if more:
            text = (
                f"{name}: mode {count} is one of {'a pair' if more == 1 else 'several'} of equal frequency; alone it "
                f"would bend the body in an arbitrary direction, so {count + more} modes are taken instead of {count}"
            )
            found.append({"code": "mode-pair-completed", "body": name, "text": text})
    exports = [own for own in run.scene.output if isinstance(own, Export) and own.format]
    for own in exports:
        from fmd.output.formats import left_out  # with all that writes them

        if what := left_out(run, own.format or "", own.body):
            found.append({"code": "second-order-left-out", "body": own.body or "", "text": what})
    return found


def _midsurface_warnings(name: str, part: FlexiblePart) -> list[dict[str, str]]:
    """Warn of a midsurface whose volume isn't the solid's, hinges, struts, and sections not read or in doubt."""
    if not part.mesh_notes:
        return []
    from fmd.fem.formats.beam_sections import DIAMETER_MEND
    from fmd.fem.formats.import_shell import THICKNESS_ALONE
    from fmd.fem.joined import HINGE_MEND, STRUT_MEND
    from fmd.stages.meshing.cad_files import UNLIKE_SOLID

    codes = {
        UNLIKE_SOLID: "midsurface-volume",
        HINGE_MEND: "hinge",
        STRUT_MEND: "point-moment",
        THICKNESS_ALONE: "left-out",
        DIAMETER_MEND: "radius",
    }
    return [
        {"code": code, "body": name, "text": f"{name}: {note}"}
        for end, code in codes.items()
        for note in part.mesh_notes
        if note.endswith(end)
    ]


def _thick_layers(part: FlexiblePart) -> str:
    """Return what modes bend layers in half waves too short for one mean shear; empty if none does."""
    if not (part.has_mesh and getattr(part.shape, "has_own_layers", False)):
        return ""
    own = shells_of(part.space)
    waves = half_waves(own.space, own.of_shapes(part.modes.shapes))
    short = np.flatnonzero(waves < THICK_LAYERS)
    if not len(short):
        return ""
    first = f"{part.modes.numbers[short[0]]} with {waves[short[0]]:.2g}"
    return (
        f"{len(short)} of {len(waves)} modes, from {first} on, bend its layers in half waves below {THICK_LAYERS:g} "
        "thicknesses: a plate of carbon bends 1 % too much at 7 and 8 % at 3, with 15 and 50 % too little stress along "
        "its fibres; take solids, or fewer modes if these don't count"
    )


def interface_warnings(run: Pipeline) -> list[dict[str, str]]:
    """Warn of frequencies of fixed-interface modes, whose errors only an error budget states."""
    text = (
        "frequencies of few fixed-interface modes and static deflections are upper bounds, and the higher ones may be "
        "half too high: the error budget of fmd run has their errors, modes.boundary = 'free' the mesh's own"
    )
    names = [name for name, part in run.wholes.items() if part.shape.modes.boundary == "interface"]
    return [{"code": "interface-modes", "body": name, "text": f"{name}: {text}"} for name in names]


def _cost_of_lumping(part: FlexiblePart) -> float:
    """Return the largest relative change of a frequency by lumped masses of matrices with rotations."""
    if not isinstance(part.shape, MatrixPart) or part.shape.matrices.unknowns == 3:
        return 0.0
    from fmd.fem.formats.matrix_model import MatrixModel

    assert isinstance(part.fe, MatrixModel)
    return float(np.abs(part.fe.frequency_changes(part.modes.shapes)).max(initial=0.0))


def rotating_table(run: Pipeline, rate: float) -> dict[str, Any]:
    """Gather frequencies of the first flexible body on its joint at a constant rate [rad/s], and what grows there."""
    part = run.part
    body = part.body if run.scene.moves and run.scene.simulation.stiffening == "off" else part.stiffened
    found = rotating_modes(body, np.array(part.joint.axis), rate, len(part.joint.free) == 1)
    frequencies = found.frequencies_hz[found.frequencies_hz > 0.0]
    return {
        "speed_rad_s": rate,
        "rotating_frequencies_hz": frequencies.tolist(),
        "rotating_growth_1_s": float(found.growth.max(initial=0.0)),
    }
