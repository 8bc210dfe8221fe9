"""What is known of a point once it has been computed, as a file that is there whole or not at all."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pipeline.core.files import whole_file

STATUSES = ("ok", "refused", "failed")


@dataclass(frozen=True)
class Record:
    """What became of a point.

    Parameters
    ----------
    status : str
        ``"ok"``; ``"refused"``: its input is wrong; ``"failed"``: a number failed its check, or the work broke off.
    message : str
        Why, unless it is ok.
    summary : dict
        What ``fmd run`` writes as summary.json.
    lasting : bool
        Whether the same would come out again: a process that died may be luckier next time.
    """

    status: str
    message: str = ""
    summary: dict[str, Any] = field(default_factory=dict)
    lasting: bool = True


def broken_off(message: str) -> Record:
    """Return the record of a point whose work broke off; a later sweep tries it again."""
    return Record("failed", message, lasting=False)


def write_record(record: Record, path: Path) -> None:
    """Keep a record; raises ``OSError``."""
    with whole_file(path) as part:
        part.write_text(json.dumps(asdict(record), indent=1, allow_nan=False) + "\n")


def read_record(path: Path) -> Record | None:
    """Read what was kept; ``None`` if there is nothing, or something else."""
    try:
        record = Record(**json.loads(path.read_text()))
    except (OSError, ValueError, TypeError):
        return None
    return record if record.status in STATUSES and isinstance(record.summary, dict) else None
