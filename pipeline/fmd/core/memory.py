"""Memory that this process may still take, on the machine and within its container."""

from pathlib import Path

# Limit, use, and pages of files, which make room when needed: in version 2 of Linux's control groups and in version 1.
_GROUPS = (
    ("memory.max", "memory.current", "memory.stat", ("active_file", "inactive_file")),
    (
        *("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes", "memory/memory.stat"),
        ("total_active_file", "total_inactive_file"),
    ),
)


def available_memory(cgroup: Path = Path("/sys/fs/cgroup")) -> float:
    """Return the memory that is free or can be freed, within the limit of a container [bytes].

    Of that psutil knows nothing: it is in the folder of this process's control group, version 2 or 1.
    """
    import psutil

    return min(float(psutil.virtual_memory().available), _left_in_group(cgroup))


def _left_in_group(cgroup: Path) -> float:
    """Memory that a control group's limit leaves [bytes]; infinite without a limit."""
    for limit, used, stat, pages in _GROUPS:
        try:
            lines = dict(line.split() for line in (cgroup / stat).read_text().splitlines())
            free = float((cgroup / limit).read_text()) - float((cgroup / used).read_text())
            return free + sum(float(lines[name]) for name in pages)
        except (OSError, KeyError, ValueError):  # no such file, or "max": no limit
            continue
    return float("inf")
