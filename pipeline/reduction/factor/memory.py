"""How much memory this process may still take."""

from __future__ import annotations

import os
from pathlib import Path

_MEMINFO = Path("/proc/meminfo")
_CGROUP = Path("/sys/fs/cgroup")
# Limit, use, and what of that are files' pages, which make room: by version 2 of control groups, and by version 1.
_GROUPS = (
    ("memory.max", "memory.current", "memory.stat", ("active_file", "inactive_file")),
    (
        *("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes", "memory/memory.stat"),
        ("total_active_file", "total_inactive_file"),
    ),
)


def available_memory(meminfo: Path = _MEMINFO, cgroup: Path = _CGROUP) -> float:
    """Memory that is free or can be freed, within what a container allows [bytes]; infinite if it can't be told.

    Parameters
    ----------
    meminfo, cgroup : Path
        Linux's file on memory, and the folder of this process's control group, version 2 or 1.
    """
    return min(_of_machine(meminfo), _of_group(cgroup))


def _of_machine(meminfo: Path) -> float:
    try:
        lines = dict(line.split(":", 1) for line in meminfo.read_text().splitlines() if ":" in line)
        return 1024.0 * float(lines["MemAvailable"].split()[0])
    except (OSError, KeyError, ValueError):
        pass
    try:  # what the machine has at all
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, ValueError, OSError):
        return float("inf")


def _of_group(cgroup: Path) -> float:
    for limit, used, stat, cached in _GROUPS:
        try:
            lines = dict(line.split() for line in (cgroup / stat).read_text().splitlines())
            free = float((cgroup / limit).read_text()) - float((cgroup / used).read_text())
            return free + sum(float(lines[name]) for name in cached)
        except (OSError, KeyError, ValueError):  # no such file, or "max": no limit
            continue
    return float("inf")
