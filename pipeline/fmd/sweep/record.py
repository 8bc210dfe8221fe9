"""The result of one point of a sweep, kept as a file that exists whole or not at all."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from fmd.core.files import write_json
from fmd.output.variable_errors import NO_BUDGET

STATUSES = ("ok", "refused", "failed")


@dataclass(frozen=True)
class Record:
    """The result of one point of a sweep.

    Parameters
    ----------
    status : str
        ``"ok"``; ``"refused"``: its input is wrong; ``"failed"``: a number failed its check, or its process died.
    message : str
        The reason, unless it is ok.
    summary : dict
        The figures that ``fmd run`` writes as summary.json.
    lasting : bool
        False if computing once more may succeed, e.g. after a process has died; then it isn't kept.
    """

    status: str
    message: str = ""
    summary: dict[str, Any] = field(default_factory=dict)
    lasting: bool = True

    @property
    def lacks_budget(self) -> bool:
        """True for the summary of a motion whose errors nobody has estimated."""
        errors = self.summary.get("stated_errors", {})
        return any(isinstance(error, str) and NO_BUDGET in error for error in errors.values())


def interrupted_record(message: str) -> Record:
    """Make the record of a point whose computation was interrupted; a later sweep tries it once more."""
    return Record("failed", message, lasting=False)


def write_record(record: Record, path: Path) -> None:
    """Write a record to a file that appears whole; raises ``OSError``."""
    write_json(path, asdict(record))


def read_record(path: Path) -> Record | None:
    """Read a record from a file; return ``None`` if the file is missing, damaged or something else."""
    try:
        record = Record(**json.loads(path.read_text()))
    except (OSError, ValueError, TypeError):
        return None
    return record if record.status in STATUSES and isinstance(record.summary, dict) else None
