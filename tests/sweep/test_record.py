"""Records of points: written, read again, and damaged."""

from fmd.output.error_columns import NO_BUDGET
from fmd.sweep.record import Record, read_record, write_record


def test_a_damaged_record_counts_as_none(tmp_path):
    path = tmp_path / "point.json"
    write_record(Record("ok", summary={"a": 1.0}), path)
    assert read_record(path) == Record("ok", summary={"a": 1.0})
    whole = path.read_text()
    for damaged in (whole[:-20], "[]", '{"status": "fine"}', ""):
        path.write_text(damaged)
        assert read_record(path) is None


def test_what_a_point_had_stays_when_it_is_computed_for_more() -> None:
    unstated = f"not stated: {NO_BUDGET}"
    before = Record(
        "ok", summary={"mass_kg": 1.0, "stated_errors": {"tip": 0.1}, "error_budget": {}, "results": {"a": {}}}
    )
    after = Record("ok", summary={"mass_kg": 1.0, "stated_errors": {"tip": unstated, "b": 0.2}, "results": {"b": {}}})
    found = after.with_known(before).summary
    assert found["stated_errors"] == {"tip": 0.1, "b": 0.2}
    assert found["results"] == {"a": {}, "b": {}}
    assert "error_budget" in found
    assert after.with_known(Record("refused", "no mesh")) is after
