"""Numbers of pieces that a scene leaves open: doubled until deflections within the pieces are small enough."""

from __future__ import annotations

from fmd.accuracy.deflection import find_deflection_error
from fmd.core.errors import AccuracyError, InputError
from fmd.core.limits.errors import SAFETY, TOO_LARGE
from fmd.core.limits.pieces import FEWEST_PIECES, MOST_PIECES_TRIED
from fmd.scene.variants import set_pieces
from fmd.stages.pipeline import Pipeline


def choose_piece_counts(run: Pipeline) -> Pipeline:
    """Return the run with a number of pieces for each body that leaves it open, or the run itself if none does.

    A body starts with two pieces. While the error of its deflection is above what the scene wants, half of its
    accuracy or 1 % without one, it gets twice as many; so it does where there is no motion with so few.

    Raises
    ------
    InputError
        The mesh is too coarse for the pieces that it takes.
    AccuracyError
        There is no motion, however many pieces.
    """
    counts = {name: FEWEST_PIECES for name, count in run.scene.pieces.items() if count == "auto"}
    if not counts:
        return run
    accuracy = run.scene.accuracy
    required = TOO_LARGE if accuracy is None else accuracy / SAFETY
    while True:
        chosen = run.variant(set_pieces(run.scene, counts), run.store.monitor)
        try:
            errors = {name: find_deflection_error(chosen, name) for name in counts}
        except AccuracyError:
            if max(counts.values()) >= MOST_PIECES_TRIED:
                raise
            errors = dict.fromkeys(counts, 1.0)
        more = {
            name: 2 * counts[name]
            for name, error in errors.items()
            if error > required and counts[name] < MOST_PIECES_TRIED
        }
        if not more:
            return chosen
        try:
            counts |= more
            run.variant(set_pieces(run.scene, counts)).parts  # noqa: B018 - can the meshes be cut so often?
        except InputError as error:
            worst = max(errors, key=lambda name: errors[name])
            problem = f"{counts[worst] // 2} pieces leave an error of {100 * errors[worst]:.2g} % by large deflection"
            raise InputError(run.scene.file, f"body.{worst}.pieces", "auto", f"{problem}; for more, {error}") from error
