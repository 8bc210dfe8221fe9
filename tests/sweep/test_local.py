"""Processes on this machine: what becomes of a point that kills them."""

import os
import sys

import pytest

from fmd.core.errors import InputError
from fmd.sweep import local
from fmd.sweep.local import compute_locally
from fmd.sweep.record import SUMMARY


class Deadly:
    """Ends the process that reads it."""

    def __reduce__(self):
        return os._exit, (3,)


def test_a_point_that_kills_every_process_is_a_row_that_is_not_kept():
    records = dict(compute_locally({"point-1": Deadly(), "point-2": Deadly()}, 1, SUMMARY))
    assert sorted(records) == ["point-1", "point-2"]
    assert {(record.status, record.lasting) for record in records.values()} == {("failed", False)}
    assert all("its process died, 2 times" in record.message for record in records.values())


def test_processes_that_all_die_before_they_are_ready_end_the_sweep(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of 1,000 points was tried twice, for ten minutes."""
    monkeypatch.setattr(local, "_serve", sys.exit)  # with what it is given for a status
    with pytest.raises(InputError, match="2 processes in a row ended with status 1 before they could compute a point"):
        dict(compute_locally({f"point-{number}": Deadly() for number in range(1000)}, 2, SUMMARY))
