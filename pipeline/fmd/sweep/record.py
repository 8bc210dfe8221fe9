"""The result of one point of a sweep, kept as a file that exists whole or not at all."""

from __future__ import annotations

import json
from dataclasses import field, replace
from pathlib import Path
from typing import Any

from fmd.core.data_classes import dataclass
from fmd.core.files import renamed_file
from fmd.output.error_columns import NO_BUDGET

STATUSES = ("ok", "refused", "failed")


@dataclass(frozen=True)
class Wanted:
    """Results that are wanted of each point: those of some names alone, or else the summary of its run."""

    budget: bool = False  # errors, which stand in the summary
    results: tuple[str, ...] = ()  # names of results, as `fmd.output.channels.find_channels` takes them
    histories: bool = False  # values over time of the results that are histories

    @property
    def summary(self) -> bool:
        """True if the summary is wanted, too."""
        return self.budget or not self.results


SUMMARY = Wanted()


@dataclass(frozen=True)
class Record:
    """The result of one point of a sweep."""

    # ``"ok"``; ``"refused"``: its input is wrong; ``"failed"``: a number failed its check, or its process died.
    status: str
    message: str = ""  # the reason, unless it is ok
    # The figures that ``fmd run`` writes as summary.json; of results by their names alone these and warnings.
    summary: dict[str, Any] = field(default_factory=dict)
    lasting: bool = True  # false if computing once more may succeed, e.g. after a process has died; then it isn't kept

    def lacks(self, wanted: Wanted) -> bool:
        """Return true if a scene that was computed has to be computed anew for what is wanted."""
        if not self.summary:
            return False
        errors, results = self.summary.get("stated_errors", {}), self.summary.get("results", {})
        no_budget = any(_is_open(error) for error in errors.values())
        figures = [own for name in wanted.results for own in results.get(name, {}).values()]
        no_history = any("rms" in own and "history" not in own for own in figures)
        no_result = any(name not in results for name in wanted.results)
        no_summary = wanted.summary and not self._is_summarised
        return no_summary or (wanted.budget and no_budget) or no_result or (wanted.histories and no_history)

    @property
    def _is_summarised(self) -> bool:
        """True if the summary is that of the run, which says what it took."""
        return "seconds" in self.summary

    def with_known(self, before: Record) -> Record:
        """Return this record of a scene with what an earlier one of the same scene has beside it: results, errors."""
        if not (self.summary and before.summary):
            return self
        known = [before.summary, self.summary]
        first, last = known if self._is_summarised or not before._is_summarised else known[::-1]
        summary = {**first, **last}
        errors, stated = last.get("stated_errors", {}), first.get("stated_errors", {})
        summary["stated_errors"] = {
            name: stated.get(name, own) if _is_open(own) else own for name, own in errors.items()
        }
        summary["results"] = before.summary.get("results", {}) | self.summary.get("results", {})
        return replace(self, summary=summary)


def _is_open(error: Any) -> bool:
    """Tell whether an error isn't stated because no budget was made."""
    return isinstance(error, str) and NO_BUDGET in error


def interrupted_record(message: str) -> Record:
    """Make the record of a point whose computation was interrupted; a later sweep tries it once more."""
    return Record("failed", message, lasting=False)


def write_record(record: Record, path: Path) -> None:
    """Write a record to a file that appears whole; raises ``OSError``."""
    with renamed_file(path) as part:
        part.write_text(json.dumps(vars(record), allow_nan=False))


def read_record(path: Path) -> Record | None:
    """Read a record from a file; return ``None`` if the file is missing, damaged or something else."""
    try:
        record = Record(**json.loads(path.read_text()))
    except (OSError, ValueError, TypeError):
        return None
    return record if record.status in STATUSES and isinstance(record.summary, dict) else None
