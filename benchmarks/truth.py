"""Stated against true errors of random scenes, each run as a user would, written to truth.csv.

Run from the project's root: ``python benchmarks/truth.py``. Scenes are those of `truth_scenes`, by their seeds; each is
loaded from its file, integrated by ``auto`` with all defaults and an error budget within its time limit, and compared
with a reference: `truth_references`, `truth_beams`, `truth_space` or `truth_finer`. Rows that the table holds already
aren't made again, so that a run can be interrupted; ``--again`` makes them anew. ``--scenes 40`` takes the first forty
seeds, ``--seed 7`` one, and ``--mixed 40`` the first forty scenes with features of `truth_features`, whose pairs are
counted.

A quantity is *covered* if its true error is below the stated one, *wrong* if it is more than three times as large, and
*overstated* if it is less than a twentieth; both are shares of the same value, the run's or the better one, which of
the two is larger. What is known of the reference's own error is taken off first; where that
decides, a quantity isn't judged. Where the reference is a finer run, it has the same model: the model's part of what is
stated is left out then, and joints and markers are compared, too. A scene's row has the quantity that is worst.
"""

import argparse
import csv
import math
import multiprocessing
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, fields
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from table_format import write_rows
from true_errors import compared_quantities
from truth_beams import beams_reference
from truth_features import pairwise_coverage
from truth_finer import finer_run
from truth_references import elastica_reference
from truth_scenes import MIXED, Case, random_case
from truth_space import space_reference

from fmd import Pipeline, load_scene, solve
from fmd.accuracy.details import detail_quantities
from fmd.accuracy.error_budget import state_errors
from fmd.accuracy.error_estimates import Quantity
from fmd.accuracy.quantities import motion_quantities, stress_quantities
from fmd.core.cache import Cache
from fmd.core.errors import AccuracyError, InputError
from fmd.output.write import write_results

TABLE = Path(__file__).parent / "truth.csv"
SCENES = 300
# Kinds whose reference has no model of ours.
APART = {
    "planar": elastica_reference,
    "arm": beams_reference,
    "arm in space": space_reference,
    "tree": space_reference,
}
WRONG = 3.0  # times the stated error
OVERSTATED = 20.0  # times the true error
PATIENCE = 400.0  # processor seconds of a run, and of its reference
WAIT = 10 * PATIENCE  # seconds by the clock, after which a process that only waits is ended
ROUND_OFF = 1e-9


@dataclass
class Row:
    """Outcome of a scene: compared, refused, traceback, long (beyond `PATIENCE`) or no reference, with what was said.

    ``quantity`` is the worst one, with its stated, its true error and that of its reference; ``wrong`` counts those
    beyond `WRONG` times what is stated, ``bounded`` those whose error isn't stated, since an estimate is missing.
    ``ratios`` are the stated over the true errors of all others. Seconds are of the processor for the whole run,
    compiling included; those of the march are in ``march``.
    """

    seed: int
    kind: str
    outcome: str
    quantity: str = ""
    stated: float = 0.0
    true: float = 0.0
    reference: float = 0.0
    quantities: int = 0
    covered: int = 0
    wrong: int = 0
    bounded: int = 0
    seconds: float = 0.0
    march: float = 0.0
    overstated: int = 0
    features: str = ""
    ratios: str = ""
    warnings: str = ""
    said: str = ""


def run_case(case: Case, folder: Path) -> tuple[Row, Pipeline | None]:
    """Run a scene as ``fmd run`` does, without pictures, and return its row as far as it is known."""
    file = folder / f"truth-{case.seed}.toml"
    file.write_text(case.text)
    row, run, begun = Row(case.seed, case.kind, "compared"), None, time.process_time()
    row.features = ", ".join(case.features)
    try:
        solved = solve(load_scene(file), Cache(None))
        run = solved.run
        summary = write_results(solved, folder / "out", pictures=False)
        row.warnings = " ".join(sorted({each["code"] for each in summary["warnings"]}))
    except (InputError, AccuracyError) as error:
        row.outcome, row.said = "refused", str(error).replace(f"{folder}/", "")
    except Exception:
        row.outcome, row.said = "traceback", traceback.format_exc(limit=-3)
    row.seconds = time.process_time() - begun
    row.march = run.log.seconds.get("motion", 0.0) if run else 0.0
    return row, run


def reference_errors(case: Case, run: Pipeline, file: Path) -> dict[str, tuple[float, float, float]]:
    """Return the true error of each quantity and the reference's own, as shares of its scale, and this scale."""
    if case.kind not in APART:
        pairs = compared_quantities(run, finer_run(file, case, run), details=True)
        return {name: (own.error(exact), 0.0, exact.scale) for name, (own, exact) in pairs.items()}
    exact, off = APART[case.kind](case)
    ours = motion_quantities(run.motion, run.fine_motion) | detail_quantities(run.scene, run.motion)
    ours |= stress_quantities(run, run.motion, np.arange(len(run.motion.times)))
    return {
        name: (ours[name].error(each), off[name], each.scale) for name, each in exact.items() if is_compared(each, ours)
    }


def is_compared(quantity: Quantity, ours: dict[str, Quantity]) -> bool:
    """Return true unless a quantity vanishes."""
    return quantity.name in ours and quantity.scale > 0


def is_open(part: float | str) -> bool:
    """Return true if an estimate of a budget is missing, so that the stated error is a lower bound."""
    return isinstance(part, str) and part.startswith("not estimated")


def judge(case: Case, folder: Path, told: Callable[[Row], None] = lambda row: None) -> Row:
    """Run a scene and compare it with its reference; the row of the run alone is ``told`` before."""
    row, run = run_case(case, folder)
    told(row)
    if run is None or row.outcome != "compared":
        return row
    budget = state_errors(run)
    row.said = "; ".join(budget.left_out)
    rows = (*budget.rows, *budget.details)
    stated = {each.name: each.total if case.kind in APART else each.numerical for each in rows}
    whole = {each.name: max(each.value, each.value + each.correction) for each in rows}  # what they are shares of
    open_ = {each.name for each in rows if any(is_open(part) for part in each.parts.values())}
    try:
        true = reference_errors(case, run, folder / f"truth-{case.seed}.toml")
    except Exception as error:
        row.outcome, row.said = "no reference", f"{type(error).__name__}: {error}"
        return row
    worst, ratios = -1.0, []
    for name, (*shares, scale) in true.items():
        if name not in stated or shares[0] * scale <= ROUND_OFF * whole[name]:
            continue
        error, off = (each * scale / (whole[name] or scale) for each in shares)
        if name in open_:
            row.bounded += 1
            continue
        sure = max(error - off, 0.0)
        if sure <= stated[name] < error:  # only the reference's own error decides
            row.bounded += 1
            continue
        row.quantities += 1
        row.covered += sure <= stated[name]
        row.wrong += sure > WRONG * stated[name]
        row.overstated += stated[name] > OVERSTATED * error
        ratio = sure / max(stated[name], ROUND_OFF)
        ratios.append(f"{stated[name] / error:.3g}")
        if ratio > worst:
            worst = ratio
            row.quantity, row.stated, row.true, row.reference = name, stated[name], error, off
    row.ratios = " ".join(ratios)
    return row


def _work(case: Case, folder: Path, answer: Connection) -> None:
    _allow_more()

    def told(row: Row) -> None:
        answer.send(row)
        _allow_more()

    answer.send(judge(case, folder, told))


def _allow_more() -> None:
    """Let the system end this process after `PATIENCE` more seconds of the processor."""
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(time.process_time() + PATIENCE), resource.RLIM_INFINITY))


def judge_apart(case: Case) -> Row:
    """Judge a scene in a process of its own, which is ended if the run or its reference takes too long."""
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        ours, theirs = multiprocessing.Pipe()
        process = multiprocessing.get_context("fork").Process(target=_work, args=(case, Path(folder), theirs))
        process.start()
        theirs.close()
        waits = False
        try:
            while not (waits := not ours.poll(WAIT)):  # for the run alone, and with its reference
                rows.append(ours.recv())
            process.kill()
        except EOFError:
            pass
        process.join()
    if process.exitcode == 0:
        return rows[-1]
    row = rows[-1] if rows else Row(case.seed, case.kind, "compared", seconds=PATIENCE)
    spent = waits or process.exitcode == -signal.SIGXCPU
    row.said = f"the process ended by {process.exitcode}"
    if spent:
        row.said = f"it took more than {WAIT:g} s by the clock" if waits else f"it took more than {PATIENCE:g} s"
    row.outcome = "no reference" if rows else "long" if spent else "traceback"
    return row


def read_table() -> dict[int, Row]:
    """Return the rows that the table holds, by their seeds."""
    if not TABLE.exists():
        return {}
    kinds: dict[str, Any] = {field.name: field.type for field in fields(Row)}
    with TABLE.open(newline="") as file:
        rows = [Row(**{name: kinds[name](text) for name, text in row.items()}) for row in csv.DictReader(file)]
    return {row.seed: row for row in rows}


def main(arguments: list[str]) -> None:
    """Judge scenes and keep each row; `tables.py` counts them."""
    parser = argparse.ArgumentParser(description="Stated against true errors of random scenes.")
    parser.add_argument("--scenes", type=int, default=SCENES)
    parser.add_argument("--seed", type=int, action="append")
    parser.add_argument("--mixed", type=int, default=0)
    parser.add_argument("--again", action="store_true")
    options = parser.parse_args(arguments)
    rows, seeds = read_table(), options.seed or range(options.scenes)
    if options.mixed:
        seeds = range(MIXED, MIXED + options.mixed)
        seen, pairs, lacking = pairwise_coverage(map(random_case, seeds))
        print(f"{seen} of {pairs} pairs of features are drawn; not drawn: {lacking}", flush=True)
    for seed in seeds:
        if seed in rows and not options.again:
            continue
        row = rows[seed] = judge_apart(random_case(seed))
        write_rows(TABLE, [row for _, row in sorted(rows.items())])
        told = f"{row.quantity}: stated {row.stated:.1e}, true {row.true:.1e} ± {row.reference:.0e}"
        print(f"{seed} {row.kind} {row.outcome} {row.seconds:.1f} s, {told} {row.warnings} {row.said}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
