"""Records of points: written, read again, and damaged."""

from __future__ import annotations

from fmd.sweep.record import Record, read_record, write_record


def test_a_damaged_record_counts_as_none(tmp_path):
    path = tmp_path / "point.json"
    write_record(Record("ok", summary={"a": 1.0}), path)
    assert read_record(path) == Record("ok", summary={"a": 1.0})
    whole = path.read_text()
    for damaged in (whole[:-20], "[]", '{"status": "fine"}', ""):
        path.write_text(damaged)
        assert read_record(path) is None
