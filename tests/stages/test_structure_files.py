"""Files of a body of solids, shells, beams and a lumped mass, read back by the readers here."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fmd
from fmd.core.arrays import Array
from fmd.output.formats import left_out, write_format
from fmd.reduction.formats.nastran_file import read_external
from fmd.reduction.inertia import InertiaIntegrals
from fmd.stages.spatial_body import superelement
from tests.stages.test_reduced_files import SUFFIXES
from tests.stages.test_structures import TIE, body, framed

MARKERS, KINDS, SECOND = ("base", "tip", "disc"), ("translation", "rotation"), ("displacement2", "rotation2")


def scene(part: dict[str, Any], stiffening: str) -> fmd.Pipeline:
    """The body on a hinge."""
    hinge = {"type": "revolute", "parent": "ground", "child": "b.base", "axis": [0, 0, 1], "rate": "20 rad/s"}
    return fmd.load(
        {
            "title": "Frame",
            "body": {"b": part},
            "joint": {"hub": hinge},
            "simulation": {
                "duration": "1 ms",
                "output_step": "1 ms",
                "tip": "b.tip",
                "stiffening": stiffening,
                "gravity": ["0 m/s^2", "-9.81 m/s^2", "1 m/s^2"],
                "run": [{"integrator": "runge-kutta", "tolerance": 1e-6}],
            },
        }
    ).run


def whole(integrals: InertiaIntegrals) -> Array:
    """G without what stiffening took off."""
    G = integrals.G.copy()
    if integrals.stiffening.size:
        G[:, :, 1:, 1:] += integrals.stiffening
    return G


def test_files_of_a_structure_hold_its_modes_mass_stress_and_motion_of_second_order(tmp_path: Path) -> None:
    deck = framed(np.random.default_rng(1))
    end = len(deck.nodes)
    deck.elements |= {"MASS, ELSET=DISC": [[end]], "ROTARYI, ELSET=DISCS": [[end]]}
    deck.sets["END"] = [end]
    deck.more += ["*MASS, ELSET=DISC\n0.05", "*ROTARY INERTIA, ELSET=DISCS\n1e-5, 1e-5, 2e-5, 0, 0, 0"]
    deck.write(tmp_path / "frame.inp")
    table = body(tmp_path / "frame.inp", shell="deck", beam="deck", tie=TIE, mass_unit="kg", force_unit="N")
    markers = {"base": {"face": "BASE"}, "tip": {"face": "TIP"}, "disc": {"link": "END"}}
    run = scene(table | {"modes": {"count": 3, "damping": 0.02}, "marker": markers}, "off")
    part = run.parts["b"]
    ours = part.for_any_motion(run.bodies["b"])
    assert ours.integrals.displacement2.any()  # by the arms of mass and sections, without the stress of any element
    for to in ("sid", "mbdyn", "exudyn"):
        file = tmp_path / f"b{SUFFIXES[to]}"
        write_format(run, to, "b", file)
        labels = ("1", "2", "3") if to == "sid" else MARKERS
        nodes = {name: {"node": label} for name, label in zip(MARKERS, labels, strict=True)}
        back = scene({"body": {"file": str(file)}, "marker": nodes}, "auto")
        theirs = back.parts["b"].for_any_motion(back.bodies["b"])
        turn = np.sign(np.sum(theirs.markers["tip"].translation * ours.markers["tip"].translation, axis=0))
        p = np.r_[1.0, turn]
        assert theirs.omega == pytest.approx(ours.omega, rel=1e-9)
        G, given = whole(theirs.integrals) * np.outer(p, p), whole(ours.integrals)
        assert np.abs(G - given).max() < 1e-9 * np.abs(given).max()
        shapes = [(theirs.markers[name], ours.markers[name]) for name in MARKERS[1:]]
        pairs = [(getattr(one, kind) * turn, getattr(own, kind)) for one, own in shapes for kind in KINDS]
        if warning := left_out(run, to, "b"):
            assert warning.startswith("b: as links, lumped masses and sections of beams turn")
        else:
            own, one = ours.integrals, theirs.integrals
            pairs += [(getattr(one, kind) * np.outer(turn, turn), getattr(own, kind)) for kind in SECOND]
            pairs += [(one.displacement2 * np.outer(turn, turn), own.displacement2) for one, own in shapes]
        assert bool(warning) == (to in ("mbdyn", "exudyn"))
        assert all(np.abs(one - own).max() < 1e-8 * np.abs(own).max() for one, own in pairs)
        if back.parts["b"].has_stress:
            found, wanted = back.parts["b"].surface_stress * turn, part.surface_stress
            assert np.abs(found - wanted).max() < 1e-9 * np.abs(wanted).max()
    write_format(run, "nastran", "b", tmp_path / "b.pch")
    found, element = read_external(tmp_path / "b.pch"), superelement(part)
    for A, B in ((found.K, element.K), (found.M, element.M), (found.D, element.D)):
        assert np.abs(A - B).max() < 1e-9 * np.abs(B).max()
    assert np.array([*found.nodes.values()]) == pytest.approx(np.array([*element.origins.values()]), abs=1e-10)
