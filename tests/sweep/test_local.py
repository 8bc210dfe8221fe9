"""Processes on this machine: what becomes of a point that kills them."""

from __future__ import annotations

import os

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
