"""Bodies in pieces in scenes: what is refused, and the number of pieces that is found."""

from pathlib import Path

import pytest

from pipeline import Pipeline, load_scene
from pipeline.accuracy.deflection import TOO_LARGE, find_deflection_error
from pipeline.accuracy.piece_counts import choose_piece_counts
from pipeline.core.errors import InputError
from tests.verification.test_large_deflection import FORCE, strip

SMALL = FORCE | {"LOAD": "1 N", "ALONG": 8}


def refused(folder: Path, pieces: str, *overrides: str) -> str:
    """Return the message by which a strip in pieces is refused."""
    strip(folder, PIECES=1, **SMALL)
    with pytest.raises(InputError) as fault:
        Pipeline(load_scene(folder / "strip.toml", [f"body.strip.pieces={pieces}", *overrides])).parts  # noqa: B018
    return str(fault.value)


@pytest.mark.parametrize(
    ("pieces", "override", "message"),
    [
        ("9", "title='x'", "body.strip.pieces = 9: the mesh has 8 elements"),
        (
            "2",
            "body.strip.marker.tip.face='y-'",
            "body.strip.marker.tip: its face extends over 2 of the body's 2 pieces",
        ),
        ("2", "body.strip.modes.boundary='joint'", "pieces are held at their cuts"),
        ("2", "body.strip.modes.family='torsion'", "pieces deform in every way"),
        ("0", "title='x'", "body.strip.pieces = 0: must be a whole number from 1 to 1000, or 'auto'"),
        ("2", "body.strip.modes.damping=0.01", "pieces take a factor of the stiffness"),
        ("1", "body.strip.sections='rigid'", "belongs to a body in pieces"),
        ('"auto"', "title='x'", "`fmd run` finds the number"),
        ("2", "body.strip.support=[{face='z-'}]", "a support holds nodes of several pieces"),
    ],
)
def test_what_pieces_cannot_be_is_refused(tmp_path: Path, pieces: str, override: str, message: str) -> None:
    assert message in refused(tmp_path, pieces, override)


def test_the_number_of_pieces_is_doubled_until_the_error_is_small(tmp_path: Path) -> None:
    run = choose_piece_counts(strip(tmp_path, PIECES='"auto"', **SMALL | {"LOAD": "2 N"}))
    count = len(run.pieces_of("strip"))
    assert count == 4
    assert find_deflection_error(run, "strip") < TOO_LARGE
