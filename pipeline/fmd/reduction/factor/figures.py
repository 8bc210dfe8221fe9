"""Figures of a factorisation, read without loading a solver, and the memory that this process may still take."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class FactorFigures:
    """Solver, order, size and memory of a factorisation.

    Attributes
    ----------
    solver : str
        ``CHOLMOD`` or ``SuperLU``; ``MUMPS`` and others of PETSc's with the number of ranks.
    order : str
        Method that reordered the unknowns: ``METIS`` (nested dissection), ``MMD`` (minimum degree) or ``own``.
    unknowns : int
        Number of unknowns of the matrix.
    nonzeros : int
        Number of nonzeros of its Cholesky factor in this order.
    memory : int
        Memory that the solver keeps, by prediction [bytes].
    """

    solver: str
    order: str
    unknowns: int
    nonzeros: int
    memory: int


_CGROUP = Path("/sys/fs/cgroup")
# Limit, use, and pages of files, which make room when needed: in version 2 of Linux's control groups and in version 1.
_GROUPS = (
    ("memory.max", "memory.current", "memory.stat", ("active_file", "inactive_file")),
    (
        *("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes", "memory/memory.stat"),
        ("total_active_file", "total_inactive_file"),
    ),
)


def available_memory(cgroup: Path = _CGROUP) -> float:
    """Return the memory that is free or can be freed, within the limit of a container [bytes].

    Parameters
    ----------
    cgroup : Path
        Folder of this process's control group, version 2 or 1; psutil knows the machine's memory only.
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
